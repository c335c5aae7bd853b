"""Whether held-out windows confirm the effects in the twin.

Every effect is judged by the twin without it and with it, on the same windows: those that both can predict.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from twin.errors import TwinError
from twin.rig import Rig
from twin.scales import Scales
from twin.thresholds import deciding
from twin.tracing.attribution import AttributedEffect
from twin.tracing.held_out_error import (
    HeldOutComparison,
    LearnedFactors,
    compare,
    errors_of,
    residual_by_band_and_order,
)
from twin.tracing.held_out_gain import log_likelihood_ratio
from twin.tracing.moved_lines import moved_lines
from twin.tracing.state import EffectErrors, Tracing, relevant
from twin.tracing.trace import held_out
from twin.tracing.unknown_held_out import improves, path_without_fault, with_unknown
from twin.updating.conditions import LEVEL, condition_of, kind_of
from twin.updating.history import WindowInput

MOST_COMPARED = 3  # held-out windows that errors are computed on, the newest
Row = Mapping[int, HeldOutComparison | str]  # by window: the comparison, or why it cannot be made


@dataclass(frozen=True, slots=True, kw_only=True)
class ConfirmationLimits:
    """When held-out windows speak against an effect."""

    growth: float = deciding(
        1.02,
        of="error without the effect",
        meaning="error of held-out windows from which an effect is not confirmed",
        source="not derived: chosen so that an effect that changes nothing (1.00) is not refused for rounding",
    )
    least_gain: float = deciding(
        float(np.log(100)),
        unit="nat",
        meaning="log likelihood ratio of held-out windows that an effect must reach, over the twin without it",
        source="derivation: where the effect is not there, chance reaches a likelihood ratio of 100 in at most 1 of "
        "100 cases (Markov's inequality)",
    )
    same_relative: float = deciding(
        0.3,
        meaning="relative difference of fitted numbers up to which a refuted effect is the same again",
        source="not derived: chosen",
    )
    same_absolute: float = deciding(
        0.1,
        of="prior spread of the fitted number",
        meaning="difference of fitted numbers up to which a refuted effect is the same again",
        source="not derived: chosen below the least size that an effect is reported from (0.3)",
    )


CONFIRMATION_LIMITS = ConfirmationLimits()


def with_errors(rig: Rig, tracing: Tracing) -> Tracing:
    """The memory with the errors of the twin in use, and of the twin without and with each effect."""
    windows, indices = windows_to_compare(rig, tracing)
    if not windows or not tracing.stages:
        return replace(tracing, errors=(), error=None, residual=None)
    learned = learned_factors(tracing, indices)
    rows = [_row(rig, tracing, count, learned, windows) for count in range(len(tracing.found) + 1)]
    errors = tuple(_pair(before, after) for before, after in pairwise(rows))
    errors = tuple(
        _with_own_lines(rig, e, f, _alone(rig, tracing, f, learned, windows))
        for e, f in zip(errors, tracing.found, strict=True)
    )
    final = _pair(rows[-1], rows[-1]).after
    return replace(tracing, errors=errors, error=final, residual=_residual(rig, rows) if tracing.found else None)


def learned_factors(tracing: Tracing, held_out_windows: set[int]) -> LearnedFactors:
    """Factors of path and mesh that the twin in use took from the windows that were fitted."""
    learned = LearnedFactors.of(tracing.stages[-1].memory, held_out_windows)
    found = [f.addition for f in tracing.found]
    return replace(learned, path=path_without_fault(learned.path, found, tracing.history))


def windows_to_compare(rig: Rig, tracing: Tracing) -> tuple[list[WindowInput], set[int]]:
    """The newest held-out windows recorded since all effects are certainly there, and the indices of all held out.

    Those whose speed changes through resonances are compared only where there are no others.
    """
    out = held_out([t.index for t in tracing.history if kind_of(t.features, rig) == "measurement"])
    out -= set(tracing.latest.fitted)  # a trace since a remount begins with another window
    windows = [t for t in tracing.history if t.index in out]
    latest = max((certain_since(tracing, f) for f in tracing.found), default=0.0)
    windows = [t for t in windows if (t.features.revolutions or 0.0) >= latest] or windows
    steady = [t for t in windows if (t.features.level_uncertainty or 0.0) <= LEVEL.most_uncertain]
    return (steady or windows)[-MOST_COMPARED:], out


def _row(rig: Rig, tracing: Tracing, count: int, learned: LearnedFactors, windows: Sequence[WindowInput]) -> Row:
    """The windows compared with the twin with `count` of the effects."""
    additions = [f.addition for f in tracing.found[:count]]
    stage = tracing.stages[len(relevant(tracing.found[:count]))]
    row: dict[int, HeldOutComparison | str] = {}
    for window in windows:
        depth = stage.depths.get(window.index, stage.depth)
        try:
            compared = compare(rig, stage.memory, additions, learned, window, depth)
            torque = condition_of(window.features, rig).torque
            every = [f.addition for f in tracing.found]
            row[window.index] = with_unknown(rig, stage.memory, compared, every, additions, window, torque)
        except TwinError as reason:
            row[window.index] = str(reason)
    return row


def _pair(before: Row, after: Row) -> EffectErrors:
    """Errors of both twins on the windows that both can predict; the note names the others."""
    first, second, left_out = [], [], []
    for index, one in before.items():
        other = after[index]
        if isinstance(one, HeldOutComparison) and isinstance(other, HeldOutComparison):
            first.append(one)
            second.append(other)
        else:
            why = one if isinstance(one, str) else other
            left_out.append(f"window {index} is left out: {why}")
    note = "; ".join(left_out)
    return EffectErrors(before=errors_of(first, note), after=errors_of(second, note))


def _alone(
    rig: Rig, tracing: Tracing, item: AttributedEffect, learned: LearnedFactors, windows: Sequence[WindowInput]
) -> list[tuple[HeldOutComparison, HeldOutComparison]]:
    """The windows since an effect is there, compared with the twin in use without this effect alone, and with it.

    Both at the depth of the twin in use, so that they differ by the effect alone; windows that one of both cannot
    predict are left out.
    """
    stage, found = tracing.stages[-1], [f.addition for f in tracing.found]
    rest = [addition for addition in found if addition is not item.addition]
    out = []
    for window in windows:
        if (window.features.revolutions or 0.0) < certain_since(tracing, item):
            continue
        depth = stage.depths.get(window.index, stage.depth)
        try:
            without, present = (compare(rig, stage.memory, a, learned, window, depth) for a in (rest, found))
        except TwinError:
            continue
        out.append((without, present))
    return out


def _with_own_lines(
    rig: Rig,
    errors: EffectErrors,
    item: AttributedEffect,
    windows: Sequence[tuple[HeldOutComparison, HeldOutComparison]],
) -> EffectErrors:
    """The errors with the likelihood ratio of the lines that the effect moves, and with the errors of these lines."""
    if not any(without.channels for without, _ in windows):
        return errors
    own, scales = (1.0, rig.teeth[0] / rig.teeth[1]), Scales.of(rig)
    gain = sum(log_likelihood_ratio(without, present, own, scales) for without, present in windows)
    line = item.addition.effect.facts.shaft_line
    is_torque = line is not None and line.channel == "torque"
    return replace(errors, gain=gain, moved=moved_lines(windows, own, scales, is_torque))


def _residual(rig: Rig, rows: Sequence[Row]):
    """The residual of the newest window that the twin without effects and the twin in use can both predict."""
    for index in reversed(list(rows[0])):
        before, after = rows[0][index], rows[-1][index]
        if isinstance(before, HeldOutComparison) and isinstance(after, HeldOutComparison):
            return residual_by_band_and_order(before, after, rig.teeth[0])
    return None


def certain_since(tracing: Tracing, item: AttributedEffect) -> float:
    """Revolutions from which an effect is certainly there: of the first fitted window after its onset."""
    onset = item.addition.onset_revolutions
    if not onset > 0:
        return 0.0
    later = [t.features.revolutions or 0.0 for t in tracing.history if t.index in tracing.latest.fitted]
    return min((n for n in later if n >= onset), default=onset)


def not_confirmed(
    tracing: Tracing, known: Collection[str], limits: ConfirmationLimits = CONFIRMATION_LIMITS
) -> list[AttributedEffect]:
    """Effects by which held-out windows are predicted worse, vibration and transmission error together.

    An effect may move one of both the wrong way for what the model of the path lacks, if the other gains as much. The
    lines that it moves, of all channels, must be likelier with it than without it: an effect that is small beside the
    others hides in the errors of the whole. Of several effects that are not likelier, the least likely one goes, since
    the others may be needed once it has gone. By the whole error, pitch errors and cracks are judged only when they are
    new: later the teeth have worn to fit them.
    An unknown effect is always judged, by lines of its own: it must predict something better.

    known  names of the effects that were in the twin before
    """
    out: list[AttributedEffect] = []
    unlikely: list[tuple[float, AttributedEffect]] = []
    turns = {t.index: t.features.revolutions or 0.0 for t in tracing.history}
    for item, errors in zip(tracing.found, tracing.errors, strict=False):
        facts = item.addition.effect.facts
        since = any(turns[j] >= certain_since(tracing, item) for j in errors.after.windows)
        judged = facts.acts_on == "unknown" and since and item.name not in tracing.fixed
        if judged and not improves(errors.before, errors.after):
            out.append(item)
        if not facts.synchronous or facts.separates_teeth or item.name in tracing.fixed:
            continue  # without lines that a twin could predict, or kept by an engineer
        if not since:
            continue  # no window was recorded since it is there
        before, after = errors.before, errors.after
        pairs = ((before.waveform, after.waveform), (before.transmission_error, after.transmission_error))
        growth = [b / a for a, b in pairs if a is not None and b is not None and a > 0]
        worn_in = item.name in known and facts.acts_on == "teeth"
        if growth and not worn_in and np.prod(growth) > limits.growth ** len(growth):
            out.append(item)
        elif errors.gain is not None and errors.gain < limits.least_gain:
            unlikely.append((errors.gain, item))
    return out or [item for _, item in sorted(unlikely, key=lambda pair: pair[0])[:1]]


def refuted_numbers(item: AttributedEffect) -> tuple[float, ...]:
    """What is remembered of an effect that held-out windows speak against: its fitted numbers and its onset."""
    return (*item.numbers, item.addition.onset_revolutions)


def refuted_before(
    item: AttributedEffect, refuted: Mapping[str, Sequence[float]], limits: ConfirmationLimits = CONFIRMATION_LIMITS
) -> bool:
    """Whether held-out windows have spoken against much the same numbers before.

    An effect that sets in later is another one than an effect from the start: held-out windows before its onset may
    have been what spoke against that.
    """
    before = refuted.get(item.name)
    if before is None or len(before) != len(item.numbers) + 1 or item.addition.effect.facts.acts_on == "unknown":
        return False
    if (before[-1] > 0) != (item.addition.onset_revolutions > 0):
        return False
    return bool(np.allclose(before[:-1], item.numbers, rtol=limits.same_relative, atol=limits.same_absolute))
