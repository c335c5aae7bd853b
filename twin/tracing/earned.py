"""Whether an effect has earned its name: one rule for every effect, after all detectors.

    d_w = e_w(without) − e_w(with),      e_w² = Σ|y − m|²/v / Σ|y|²/v over one channel's lines of a window w
    earned      mean(d) > s in a channel that the effect claims, and mean(d) ≥ −s in every channel that is left with
                more than a healthy machine leaves, unless a claimed one falls by a larger factor than it rises by
                and the channel may show the effect all the same (shown_share in moved_lines.py)
    suspected   the same where fewer windows than `least_windows` could say so
    refused     else, or where its size is impossible on this rig or as likely as not by chance

v  variance of a healthy machine's line (healthy_lines.py), so that a line counts as far as the model can predict it
s  standard error of the mean over the windows; paired, so that what both predictions miss cancels
y  measured
m  predicted by the twin in use without the effect alone, and with it; without it at the depth that predicts better:
   that of the twin in use, or that of the twin before the effect joined

The windows are those recorded since the effect is certainly there that took no part in the fit of its numbers. A refit
takes part in windows that its numbers of before had not seen: these are predicted by those numbers, where too few are
left without. What no steady state predicts line by line claims content of its own (held_out_content.py).

What has been there from the start, turns with a shaft and lowers the error of an encoder alone, may be the encoder's
own disc: then the disc is a rival of the effect that the channels cannot tell from it.

    P(size by chance) = P(χ²_n > (x/σ)²)      n = 1, or 2 of an amplitude with a free phase; of what stands for many
                                             numbers, as pitch errors do, the detector says it by the lines' own noise

Source   Student, Biometrika 6 (1908) 1–25 (paired differences); chance of an amplitude: Rayleigh's distribution
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtrc

from twin.assessment import HeldOutResidual
from twin.effects import EFFECTS
from twin.effects.addition import Addition
from twin.errors import NotAvailable, TwinError
from twin.rig import Rig
from twin.scales import Scales
from twin.thresholds import deciding
from twin.tracing.attribution import AttributedEffect
from twin.tracing.context import held_out
from twin.tracing.healthy_lines import LearnedFactors, largest_healthy
from twin.tracing.held_out_content import content_change
from twin.tracing.held_out_error import (
    ENCODERS,
    ChannelComparison,
    HeldOutComparison,
    compare,
    errors_of,
    residual_by_band_and_order,
)
from twin.tracing.moved_lines import MOVED_LINE_LIMITS, MovedLineLimits, counted_lines, moved_lines, shown_share
from twin.tracing.state import ChannelChange, EffectErrors, Refusal, Tracing, relevant
from twin.tracing.unknown_held_out import path_without_fault, with_unknown
from twin.updating.conditions import LEVEL, condition_of, kind_of
from twin.updating.history import WindowInput

MOST_COMPARED = 5  # held-out windows that errors are computed on, the newest
Pair = tuple[HeldOutComparison, HeldOutComparison]  # without the effect, and with it


@dataclass(frozen=True, slots=True, kw_only=True)
class EarnedLimits:
    """When an effect has earned its name."""

    least_windows: int = deciding(
        3,
        unit="windows",
        meaning="held-out windows since the onset below which an effect is only suspected",
        source="derivation: with three, a standard error has two degrees of freedom; with two, one",
    )
    chance: float = deciding(
        0.01,
        meaning="probability of so large a size by chance up to which a size is one",
        source="derivation: the stated rate of false alarms of a search (twin/required_evidence.py)",
    )
    bound_std: float = deciding(
        2.0,
        of="standard deviation of the size",
        meaning="how far a size must lie beyond the rig's bound to be impossible",
        source="derivation: a size at the bound is refused in 2 % of the cases",
    )
    worse: float = deciding(
        0.01,
        of="error without the effect",
        meaning="rise of an error that counts at least",
        source="not derived: chosen so that an effect that changes nothing is not refused for rounding",
    )
    least_shown: float = deciding(
        0.5,
        of="what the effect would make of a channel's lines",
        meaning="share that a channel must be able to show, by two standard deviations, for its error to be excused; "
        "what shows more than its inverse shows something else",
        source="derivation: the path to a sensor that lies within its tolerances is off by less than half",
    )
    chance_shown: float = deciding(
        0.05,
        meaning="probability that lines of no such cause agree with an effect as well, up to which a channel shows it",
        source="convention; where it is larger the effect keeps its name, and its rival",
    )


LIMITS = EarnedLimits()
DISC = "encoder_disc"  # of channel_faults.py


@dataclass(frozen=True, slots=True, kw_only=True)
class Judgement:
    """What held-out windows say of one effect."""

    kind: str  # "earned", "suspected" or "refused"
    reason: str = ""  # a clause; "" where it is earned
    merit: float = 0.0  # the clearest fall of a channel that it claims, in standard errors
    rivals: tuple[str, ...] = ()  # what the channels that show it cannot tell it from


def implausible(rig: Rig, item: AttributedEffect, limits: EarnedLimits = LIMITS) -> str | None:
    """Why an effect of this size cannot be, or may be chance; None where neither holds."""
    sizes = _sizes(item)
    if sizes and all(chance > limits.chance for _, chance in sizes):
        name, chance = min(sizes, key=lambda size: size[1])
        return f"its {name.replace('_', ' ')} is as large by chance in {100 * chance:.2g} % of healthy machines"
    try:
        most = Scales.of(rig).sized(EFFECTS[item.name].facts.detection, "largest_size")
    except NotAvailable:
        return None
    for parameter in EFFECTS[item.name].parameters:
        value, _, std = item.parameters.get(parameter.name, (0.0, "", 0.0))
        if not parameter.shape and abs(value) - limits.bound_std * std > most:
            return f"its {parameter.name.replace('_', ' ')} is {abs(value) / most:.2g} times the most that is possible"
    return None


def _sizes(item: AttributedEffect) -> list[tuple[str, float]]:
    """Every number that gives the effect its size, with the chance of so large a one where the effect is not there."""
    if item.chance is not None:
        return [(item.name, item.chance)]
    out = []
    for parameter in EFFECTS[item.name].parameters:
        value, _, std = item.parameters.get(parameter.name, (0.0, "", 0.0))
        if parameter.shape or parameter.many or not std > 0 or not np.isfinite(parameter.neutral):
            continue
        square = ((value - parameter.neutral) / std) ** 2
        out.append((parameter.name, float(chdtrc(2 if parameter.phase else 1, square))))
    return out


def asked_again(rig: Rig, tracing: Tracing, item: AttributedEffect, limits: EarnedLimits = LIMITS) -> bool:
    """Whether an effect that was refused before is judged again: by windows that have come since.

    One that sets in later is another one than one from the start. Where all windows took part in the fit of its
    numbers, as many must have come since as it takes to judge it.
    """
    before = tracing.refuted.get(item.name)
    if before is None or (before.onset > 0) != (item.addition.onset_revolutions > 0):
        return True
    now, _ = _windows(rig, tracing, item)
    if now:
        return not {w.index for w in now} <= set(before.windows)
    return tracing.measured >= before.measured + limits.least_windows


def refusal_of(tracing: Tracing, item: AttributedEffect, reason: str) -> Refusal:
    """What is remembered of an effect that was refused."""
    windows = next((e.windows for f, e in zip(tracing.found, tracing.errors, strict=False) if f is item), ())
    onset = item.addition.onset_revolutions
    return Refusal(reason=reason, windows=windows, onset=onset, measured=tracing.measured)


def with_errors(rig: Rig, tracing: Tracing) -> Tracing:
    """The memory with the errors of the twin in use, and of the twin without and with each effect.

    Of a machine without a model, only what needs none is compared.
    """
    errors = tuple(_errors(rig, tracing, item) for item in tracing.found)
    if not tracing.stages:
        return replace(tracing, errors=errors, error=None, residual=None)
    whole = _compared(rig, tracing, *_windows(rig, tracing, None), tracing.found)
    final = errors_of(list(whole.values())) if whole else None
    return replace(tracing, errors=errors, error=final, residual=_residual(rig, tracing, whole))


def _errors(rig: Rig, tracing: Tracing, item: AttributedEffect) -> EffectErrors:
    """Of the twin in use without one effect and with it, on the windows held out for it.

    Its numbers before a refit may speak for it, not against it: the refit may have mended them.
    """
    errors = _errors_on(rig, tracing, item, *_windows(rig, tracing, item))
    if item.earlier and judged(item, errors).kind == "refused":
        errors = _errors_on(rig, tracing, item, *_windows(rig, tracing, replace(item, earlier=())))
    return errors


def _errors_on(
    rig: Rig, tracing: Tracing, item: AttributedEffect, windows: Sequence[WindowInput], held: Collection[int]
) -> EffectErrors:
    """The same on these windows; `held` are the indices from which the twin in use takes no factors."""
    by_numbers = _by_numbers(item, windows)
    facts = item.addition.effect.facts
    if facts.claims != "lines":
        errors = errors_of(list(_compared(rig, tracing, windows, held, tracing.found).values()))
        before, after = np.empty(0), np.empty(0)
        for version, group in by_numbers:
            without, present = content_change(version.addition.effect, group, _fitted(tracing, version))
            before, after = np.append(before, without), np.append(after, present)
        changes = (_change(facts.claims, before, after, 0.0, True, (1.0, 0.0)),)
        return EffectErrors(before=errors, after=errors, changes=changes, windows=tuple(w.index for w in windows))
    pairs: list[Pair] = []
    for version, group in by_numbers:
        found = tuple(version if f is item else f for f in tracing.found)
        pairs += _pairs(rig, replace(tracing, found=found), version, group, held)
    pairs.sort(key=lambda pair: pair[0].index)
    shown = tuple(a.index for a, _ in pairs)
    note = "; ".join(f"window {w.index} is left out: no steady state" for w in windows if w.index not in shown)
    return EffectErrors(
        before=errors_of([a for a, _ in pairs], note),
        after=errors_of([b for _, b in pairs], note),
        moved=moved_lines(pairs, facts.is_torque),
        windows=shown,
        changes=_changes(pairs, facts.is_torque),
    )


def _by_numbers(
    item: AttributedEffect, windows: Sequence[WindowInput]
) -> list[tuple[AttributedEffect, list[WindowInput]]]:
    """The effect with the newest numbers that each window took no part in, with its windows."""
    out = []
    rest = list(windows)
    for numbers in item.by_fit:
        group = [w for w in rest if w.index not in numbers.fitted]
        rest = [w for w in rest if w.index in numbers.fitted]
        if group:
            same = numbers.addition is item.addition
            out.append((item if same else replace(item, addition=numbers.addition, fitted=numbers.fitted), group))
    return out


def _pairs(
    rig: Rig, tracing: Tracing, item: AttributedEffect, windows: Sequence[WindowInput], held: Collection[int]
) -> list[Pair]:
    """Windows as the twin predicts them without one of its effects and with it."""
    rest = tuple(f for f in tracing.found if f is not item)
    present = _compared(rig, tracing, windows, held, tracing.found)
    absent = _compared(rig, tracing, windows, held, rest)
    before = len(relevant(tracing.found[: tracing.found.index(item)]))
    if item.addition.effect.facts.changes_mesh_lines:
        other = _compared(rig, tracing, windows, held, rest, stage=before)
        if _whole(other, present) < _whole(absent, present):
            absent = other
    return [(absent[i], present[i]) for i in present if i in absent]


def _whole(twin: Mapping[int, HeldOutComparison], others: Collection[int]) -> float:
    """Sum of the squared errors of all channels over the windows that both can predict; inf where there are none."""
    errors = [c.error**2 for i, w in twin.items() if i in others for c in w.channels.values()]
    return float(np.sum(errors)) if errors else np.inf


def _changes(
    pairs: Sequence[Pair], is_torque: bool, moves: MovedLineLimits = MOVED_LINE_LIMITS
) -> tuple[ChannelChange, ...]:
    """The fall of the error of every channel over the windows."""
    out = []
    for name in dict.fromkeys(name for a, _ in pairs for name in a.channels):
        both = [_counted(name, a, b, is_torque) for a, b in pairs if name in a.channels]
        used = [(one, other) for one, other in both if other.energy > 0]
        if not used:
            continue
        energies = [float(np.sum(np.abs(other.measured) ** 2 / other.variance)) for _, other in used]
        shift = np.mean([np.sum(np.abs(a.predicted - b.predicted) ** 2 / b.variance) for a, b in used])
        before, after = (
            [float(np.sqrt(_left(one, other.variance) / e)) for (one, other), e in zip(chosen, energies, strict=True)]
            for chosen in (used, [(other, other) for _, other in used])
        )
        count = sum(other.orders.size for _, other in used)
        healthy = float(np.sqrt(largest_healthy([np.ones(count)]) / sum(energies)))
        claimed = bool(shift > moves.least_move**2)
        out.append(_change(name, before, after, healthy, claimed, shown_share(used)))
    return tuple(out)


def _left(lines: ChannelComparison, variance: np.ndarray) -> float:
    """Energy of what a prediction leaves, every line over what a healthy machine scatters by."""
    return float(np.sum(np.abs(lines.measured - lines.predicted) ** 2 / variance))


def _counted(
    name: str, without: HeldOutComparison, present: HeldOutComparison, is_torque: bool
) -> tuple[ChannelComparison, ChannelComparison]:
    """One channel of a window without and with an effect, of the lines that it can be judged by."""
    one, other = without.channels[name], present.channels[name]
    use = counted_lines(name, other, present.speed_hz, is_torque)
    return one.chosen(use), other.chosen(use)


def _change(
    channel: str, before: ArrayLike, after: ArrayLike, healthy: float, claimed: bool, shown: tuple[float, float]
) -> ChannelChange:
    fall = np.subtract(before, after)
    return ChannelChange(
        channel=channel,
        before=float(np.sqrt(np.mean(np.square(before)))) if fall.size else 0.0,
        after=float(np.sqrt(np.mean(np.square(after)))) if fall.size else 0.0,
        fall=float(fall.mean()) if fall.size else 0.0,
        std=float(np.std(fall, ddof=1) / np.sqrt(fall.size)) if fall.size > 1 else 0.0,
        healthy=healthy,
        claimed=claimed,
        shown=shown,
        windows=int(fall.size),
    )


def judged(item: AttributedEffect, errors: EffectErrors, limits: EarnedLimits = LIMITS) -> Judgement:
    """What held-out windows say of an effect."""
    count = max((c.windows for c in errors.changes), default=0)
    if count == 0:
        return Judgement(kind="suspected", reason="no held-out window since its onset could test it yet")
    claimed = [c for c in errors.changes if c.claimed]
    falling = [c for c in claimed if c.fall > (c.std if count >= limits.least_windows else 0.0)]
    most = max((_ratio(c) for c in falling), default=0.0)
    rising = [
        c
        for c in errors.changes
        if -c.fall > max(c.std, limits.worse * c.before)
        and c.after > c.healthy
        and (_ratio(c) < -most or (c.claimed and c.shown[0] + 2 * c.shown[1] < limits.least_shown))
    ]
    merit = max((c.fall / max(c.std, 1e-12) for c in claimed), default=-np.inf)
    if not falling:
        return Judgement(kind="refused", reason=_unimproved(claimed), merit=merit)
    if rising:
        return Judgement(kind="refused", reason=f"{_said(rising[0])} rises with it", merit=merit)
    rivals = _rivals(item, errors.changes, limits)
    if count < limits.least_windows:
        number = "one held-out window" if count == 1 else f"{count} held-out windows"
        reason = f"only {number} since its onset could test it"
        return Judgement(kind="suspected", reason=reason, merit=merit, rivals=rivals)
    return Judgement(kind="earned", merit=merit, rivals=rivals)


def _rivals(item: AttributedEffect, changes: Sequence[ChannelChange], limits: EarnedLimits) -> tuple[str, ...]:
    """The encoder's disc, where what turns with a shaft from the start is shown by no channel but the encoders'."""
    if item.addition.effect.period == "mesh" or item.addition.onset_revolutions > 0:
        return ()
    others = [c for c in changes if c.channel not in ENCODERS]
    by_encoder = any(c.claimed and c.fall > c.std for c in changes if c.channel in ENCODERS)
    confirmed = any(_as_large(c, limits) or (c.claimed and c.fall > c.std) for c in others)
    return (DISC,) if by_encoder and not confirmed else ()


def _as_large(change: ChannelChange, limits: EarnedLimits) -> bool:
    """Whether a channel clearly shows what the effect makes there, and no more of it than a path may add."""
    share, std = change.shown
    clear = np.sqrt(-2 * np.log(limits.chance_shown))
    return bool(share > clear * std and share - 2 * std < 1 / limits.least_shown)


def _ratio(change: ChannelChange) -> float:
    """ln of the error without an effect over that with it."""
    tiny = np.finfo(float).tiny
    return float(np.log(max(change.before, tiny) / max(change.after, tiny)))


def _unimproved(claimed: Sequence[ChannelChange]) -> str:
    if not claimed:
        return "it moves the lines of no channel on held-out windows by more than healthy machines scatter by"
    return f"{_said(max(claimed, key=lambda c: c.fall))} does not fall with it"


def _said(change: ChannelChange) -> str:
    what = change.channel.replace("_", " ")
    return f"the error of the {what} on held-out windows ({100 * change.before:.3g} → {100 * change.after:.3g} %)"


def refused(tracing: Tracing) -> list[tuple[AttributedEffect, str]]:
    """The effect that held-out windows speak against most clearly, with why; empty where there is none.

    One at a time: the others may be needed once it has gone. What an engineer has accepted or pinned stays.
    """
    out = []
    for item, errors in zip(tracing.found, tracing.errors, strict=True):
        verdict = judged(item, errors)
        if verdict.kind == "refused" and item.name not in tracing.fixed:
            out.append((verdict.merit, item, verdict.reason))
    return [(item, reason) for _, item, reason in sorted(out, key=lambda o: o[0])[:1]]


def certain_since(tracing: Tracing, item: AttributedEffect) -> float:
    """Revolutions from which an effect is certainly there: of the first fitted window after its onset."""
    onset = item.addition.onset_revolutions
    if not onset > 0:
        return 0.0
    later = [w.features.revolutions or 0.0 for w in _fitted(tracing, item)]
    return min((n for n in later if n >= onset), default=onset)


def _fitted(tracing: Tracing, item: AttributedEffect) -> list[WindowInput]:
    return [w for w in tracing.history if w.index in item.fitted]


def _windows(rig: Rig, tracing: Tracing, item: AttributedEffect | None) -> tuple[list[WindowInput], set[int]]:
    """The newest windows that can judge an effect, or the twin in use, and the indices of all that took part in no fit.

    Windows whose speed changes through resonances are compared only where there are no others; those that only numbers
    before a refit had not seen, where there are too few without.
    """
    measured = [w for w in tracing.history if kind_of(w.features, rig) == "measurement"]
    if item is not None:
        since = certain_since(tracing, item)
        later = [w for w in measured if (w.features.revolutions or 0.0) >= since]
        windows = _steady([w for w in later if w.index not in item.fitted])[-MOST_COMPARED:]
        if len(windows) < LIMITS.least_windows:
            unseen = (w for w in later if any(w.index not in n.fitted for n in item.earlier))
            more = _steady([w for w in unseen if w.index in item.fitted])[len(windows) - LIMITS.least_windows :]
            windows = sorted((*windows, *more), key=lambda w: w.index)
        return windows, {w.index for w in measured if w.index not in item.fitted} | {w.index for w in windows}
    fitted = {i for one in tracing.found for i in one.fitted} or set(tracing.latest.fitted)
    every = [w.index for w in measured]
    out = {i for i in every if i >= min(fitted)} - fitted if fitted else held_out(every)
    since = max((certain_since(tracing, one) for one in tracing.found), default=0.0)
    windows = [w for w in measured if w.index in out]
    later = [w for w in windows if (w.features.revolutions or 0.0) >= since]
    return _steady(later or windows)[-MOST_COMPARED:], out


def _steady(windows: list[WindowInput]) -> list[WindowInput]:
    """Those whose speed does not change through resonances, or all where there are none."""
    return [w for w in windows if (w.features.level_uncertainty or 0.0) <= LEVEL.most_uncertain] or windows


def learned_factors(tracing: Tracing, held_out_windows: Collection[int]) -> LearnedFactors:
    """Factors of path and mesh that the twin in use took from the windows that were fitted."""
    twin = tracing.stages[-1]
    learned = LearnedFactors.of(twin.memory, held_out_windows, twin.depths)
    found = [f.addition for f in tracing.found]
    return replace(learned, path=path_without_fault(learned.path, found, tracing.history))


def _compared(
    rig: Rig,
    tracing: Tracing,
    windows: Sequence[WindowInput],
    held: Collection[int],
    present: Sequence[AttributedEffect],
    stage: int = -1,
) -> dict[int, HeldOutComparison]:
    """The windows by index as the twin with some of the effects predicts them, those that it can predict."""
    if not tracing.stages:
        return {}
    learned, twin = learned_factors(tracing, held), tracing.stages[stage]
    every, additions = [f.addition for f in tracing.found], [f.addition for f in present]
    out = {}
    for window in windows:
        depth = twin.depths.get(window.index, twin.depth)
        try:
            out[window.index] = _one(rig, tracing, stage, every, additions, learned, window, depth)
        except TwinError:
            continue
    return out


def _one(
    rig: Rig,
    tracing: Tracing,
    stage: int,
    every: Sequence[Addition],
    additions: Sequence[Addition],
    learned: LearnedFactors,
    window: WindowInput,
    depth: float,
) -> HeldOutComparison:
    memory = tracing.stages[stage].memory
    compared = compare(rig, memory, additions, learned, window, depth)
    torque = condition_of(window.features, rig).torque
    return with_unknown(rig, memory, compared, every, additions, window, torque)


def in_use(rig: Rig, tracing: Tracing) -> list[HeldOutComparison]:
    """The held-out windows that the twin in use can predict, compared with it."""
    return list(_compared(rig, tracing, *_windows(rig, tracing, None), tracing.found).values())


def _residual(rig: Rig, tracing: Tracing, whole: Mapping[int, HeldOutComparison]) -> HeldOutResidual | None:
    """The residual of the newest window that the twin without effects and the twin in use can both predict."""
    if not tracing.found:
        return None
    windows, held = _windows(rig, tracing, None)
    for window in reversed(windows):
        before = _compared(rig, tracing, [window], held, (), stage=0).get(window.index)
        if before is not None and window.index in whole:
            return residual_by_band_and_order(before, whole[window.index], rig.teeth[0])
    return None
