"""Whether wear depth and remaining life may be used as they are, and what would make them so.

    established       a calibrated model that fits this machine, and a depth that follows from it
    preliminary       a depth or life with a wider band, its reasons, and the measurements that would settle it
    not available     the evidence says that the model is not one of this machine, or the level alone shows no wear

The reasons are those of twin/grounds.py.

Bands  by level: the half-widths of its band in ln, times √max(misfit of the calibration, 1) (Birge's ratio, as in
       updating/depth.py), and times √2 where no unworn window has calibrated the level, which is then as uncertain as
       the depth that follows from a calibrated one.
       By encoders: at least the spread of true over estimated depth where the calibration was in doubt, its
       half-widths in ln times Birge's ratio where the lines fit worse than there. Where it is in
       doubt from where the depths count (no window of new gears, an unknown age, a first depth that no wear makes), the
       5th percentile is what the growth since the first worn window proves (updating/growth.py).
       With effects in the model of an estimated structure: also the band of wear alone (twin/tracing/wear_alone.py).
       A life inherits the relative width of its depth. With few windows, the rate may still halve (running-in).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import sqrt

from twin.assessment import EstablishedBefore, HeldOutErrors, Preliminary
from twin.established import Doubts, History
from twin.grounds import EXCLUDING, RULES, Basis, Ground
from twin.noisy import doubts_after
from twin.quantiles import Z95
from twin.rig import Rig
from twin.tracing.unexplained import does_not_fit
from twin.updating.growth import growth_of
from twin.updating.life import NO_DOUBT, LifeDoubt
from twin.updating.measurement import SCATTER
from twin.updating.update import UpdateOutcome

NO_HISTORY, NO_DOUBTS = History(), Doubts()


@dataclass(frozen=True, slots=True, kw_only=True)
class Confidence:
    """How far the depth and the life after a window may be relied on."""

    band: tuple[float, float]  # of the depth [m]
    missing: str | None = None  # why neither is available; None where they are
    depth: Preliminary | None = None  # None where the depth is established
    life: Preliminary | None = None
    no_life: str | None = None  # why the life alone is not available
    life_doubt: LifeDoubt = NO_DOUBT
    doubts: Doubts = NO_DOUBTS


def confidence_of(
    rig: Rig,
    outcome: UpdateOutcome,
    errors: HeldOutErrors | None,
    history: History = NO_HISTORY,
    *,
    alone: tuple[float, float] | None = None,
    again: bool = False,
) -> Confidence:
    """What a window's depth and life are worth.

    errors   of the twin in use on held-out windows; None where there were none
    alone    5 and 95 % of the depth by wear alone [m], where the effects in the model may be the estimated structure
    history  of the windows before; with this one where it is judged `again`
    """
    basis = Basis(rig=rig, outcome=outcome, errors=errors, alone=alone)
    doubts = doubts_after(basis, history.of_rig(rig).doubts, again=again)
    basis = replace(basis, raised=doubts.raised)
    excluding = [ground for rule in EXCLUDING for ground in rule(basis)]
    if excluding:
        return Confidence(missing=_missing(basis, excluding), band=outcome.depth_band, doubts=doubts)
    grounds = [ground for rule in RULES for ground in rule(basis)]
    before = history.of_rig(rig).supports(outcome.depth, outcome.memory.track.revolutions)
    doubt = _life_doubt(basis, grounds)
    return Confidence(
        band=_band(basis, grounds),
        depth=_preliminary(basis, [ground for ground in grounds if ground.depth], before),
        life=_preliminary(basis, [ground for ground in grounds if ground.life], before),
        no_life=does_not_fit(errors) or _unknown_depth(basis, doubt),
        life_doubt=doubt,
        doubts=doubts,
    )


def _missing(basis: Basis, excluding: list[Ground]) -> str:
    """Why depth and life are not available, and what would help."""
    remedies = basis.doable(remedy for ground in excluding for remedy in ground.remedies)
    return f"{'; '.join(ground.reason for ground in excluding)}. What would help: {'; '.join(remedies)}"


def _preliminary(basis: Basis, known: list[Ground], before: EstablishedBefore | None) -> Preliminary | None:
    """Why a figure is preliminary; earlier windows support it where every ground has arisen since."""
    if not known:
        return None
    return Preliminary(
        reasons=tuple(dict.fromkeys(ground.reason for ground in known)),
        remedies=basis.doable(remedy for ground in known for remedy in ground.remedies),
        before=before if all(ground.arisen for ground in known) else None,
    )


def _level_factor(basis: Basis) -> float:
    """By how much the half-widths of a depth by level grow, in ln."""
    fit = basis.outcome.memory.fit
    return sqrt(basis.limits.uncalibrated_level if fit is None else max(fit.misfit, 1.0))


def _band(basis: Basis, grounds: list[Ground]) -> tuple[float, float]:
    """5 and 95 % of the depth [m], with those of wear alone where these are as likely."""
    low, high = _band_with_effects(basis, grounds)
    return (low, high) if basis.alone is None else (min(low, basis.alone[0]), max(high, basis.alone[1]))


def _doubting(grounds: list[Ground]) -> list[Ground]:
    """The grounds that widen the band of a depth by encoders."""
    return [ground for ground in grounds if ground.depth and not ground.in_band]


def _band_with_effects(basis: Basis, grounds: list[Ground]) -> tuple[float, float]:
    outcome, depth = basis.outcome, basis.outcome.depth
    low, high = outcome.depth_band
    if basis.by_level:
        if outcome.method == "unworn":
            return low, high
        factor = _level_factor(basis)
        return depth * SCATTER.rms_low**factor, depth * SCATTER.rms_high**factor
    doubting = _doubting(grounds)
    if not doubting:
        return low, high
    wider = _misfit_ratio(basis)
    certain = basis.limits.doubtful_low**wider if any(not ground.of_zero for ground in doubting) else 1.0
    least = certain * (_proven(outcome) if any(ground.of_zero for ground in doubting) else depth)
    return min(low, least), max(high, basis.limits.doubtful_high**wider * depth)


def _misfit_ratio(basis: Basis) -> float:
    """By how much the half-widths of a doubtful depth by encoders grow, in ln: their lines fit worse than they may."""
    estimate = basis.outcome.estimate
    return sqrt(max(1.0, (0.0 if estimate is None else estimate.misfit) / basis.limits.doubtful_misfit))


def _proven(outcome: UpdateOutcome) -> float:
    """What the growth since the first worn window alone proves of a depth, 5 % quantile [m]."""
    growth = growth_of(outcome.memory)
    return 0.0 if growth is None else growth.depth.p05


def _life_doubt(basis: Basis, grounds: list[Ground]) -> LifeDoubt:
    """What a life is uncertain by for the grounds."""
    if basis.by_level:
        return LifeDoubt(level_factor=_level_factor(basis))
    doubted = bool(_doubting(grounds))
    low, high = _band(basis, grounds)
    depth, young = basis.outcome.depth, basis.outcome.memory.track.steady < basis.limits.least_worn_windows
    return LifeDoubt(
        of_depth=(high - low) / (2 * Z95 * depth) if (doubted or basis.alone) and depth > 0 else 0.0,
        of_rate=basis.limits.young_rate if young else 0.0,
    )


def _unknown_depth(basis: Basis, doubt: LifeDoubt) -> str | None:
    """Why no life follows from a depth by encoders that is uncertain by more than itself; None where it is less."""
    estimate = basis.outcome.estimate
    if estimate is None or _misfit_ratio(basis) == 1 or doubt.of_depth < 1:
        return None
    return (
        f"the encoders' mesh lines differ from the model by {sqrt(estimate.misfit):.1f} times what the rig file's "
        "tolerances allow, so that the depth is uncertain by more than itself"
    )


def history_after(
    rig: Rig, history: History, outcome: UpdateOutcome, confidence: Confidence, index: int | None
) -> History:
    """The history after a window: it counts where it measured a worn depth that is established.

    index  of the window; None where it gave no depth
    """
    if outcome.kind != "measurement":
        return history
    history = replace(history.of_rig(rig), doubts=confidence.doubts)
    revolutions, established = outcome.memory.track.revolutions, confidence.depth is None
    if index is None or not established or not outcome.memory.track.windows:
        return history
    return history.with_window(index, revolutions, outcome.depth, confidence.band[1])
