"""Whether wear depth and remaining life may be used as they are, and what would make them so.

    established       a calibrated model that fits this machine, and a depth that follows from it
    preliminary       a depth or life with a wider band, its reasons, and the measurements that would settle it
    not available     the evidence says that the model is not one of this machine

The reasons are those of twin/grounds.py.

Bands  by level: the half-widths of its band in ln, times √max(misfit of the calibration, 1) (Birge's ratio, as in
       updating/depth.py), and times √2 where no unworn window has calibrated the level, which is then as uncertain as
       the depth that follows from a calibrated one; down to zero where no wear can be seen in the level.
       By encoders: at least the spread of true over estimated depth where the calibration was in doubt.
       With effects in the model of an estimated structure: also the band of wear alone (twin/tracing/wear_alone.py).
       A life inherits the relative width of its depth. With few windows, the rate may still halve (running-in).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from math import sqrt

from twin.assessment import EstablishedBefore, HeldOutErrors, Preliminary
from twin.established import Doubts, History
from twin.grounds import EXCLUDING, RULES, Basis, Ground, no_rise
from twin.noisy import doubts_after
from twin.quantiles import Z95
from twin.rig import Rig
from twin.tracing.unexplained import does_not_fit
from twin.updating.life import NO_DOUBT, LifeDoubt
from twin.updating.measurement import SCATTER
from twin.updating.update import UpdateOutcome

NO_HISTORY, NO_DOUBTS = History(), Doubts()


@dataclass(frozen=True, slots=True, kw_only=True)
class Confidence:
    """How far the depth and the life after a window may be relied on."""

    band: tuple[float, float]  # of the depth [m]
    not_this_machine: str | None = None  # why neither is available; None where they are
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
        return Confidence(not_this_machine=_missing(excluding), band=outcome.depth_band, doubts=doubts)
    grounds = [ground for rule in RULES for ground in rule(basis)]
    doubted = any(ground.depth and not ground.in_band for ground in grounds)
    before = history.of_rig(rig).supports(outcome.depth, outcome.memory.track.revolutions)
    return Confidence(
        band=_band(basis, doubted),
        depth=_preliminary((ground for ground in grounds if ground.depth), before),
        life=_preliminary((ground for ground in grounds if ground.life), before),
        no_life=does_not_fit(errors) or (no_rise(basis) if basis.by_level and not basis.shows_wear else None),
        life_doubt=_life_doubt(basis, doubted),
        doubts=doubts,
    )


def _missing(excluding: list[Ground]) -> str:
    """Why depth and life are not available, and what would help."""
    remedies = dict.fromkeys(remedy for ground in excluding for remedy in ground.remedies)
    return f"{'; '.join(ground.reason for ground in excluding)}. What would help: {'; '.join(remedies)}"


def _preliminary(grounds: Iterable[Ground], before: EstablishedBefore | None) -> Preliminary | None:
    """Why a figure is preliminary; earlier windows support it where every ground has arisen since."""
    known = list(grounds)
    if not known:
        return None
    return Preliminary(
        reasons=tuple(dict.fromkeys(ground.reason for ground in known)),
        remedies=tuple(dict.fromkeys(remedy for ground in known for remedy in ground.remedies)),
        before=before if all(ground.arisen for ground in known) else None,
    )


def _level_factor(basis: Basis) -> float:
    """By how much the half-widths of a depth by level grow, in ln."""
    fit = basis.outcome.memory.fit
    return sqrt(basis.limits.uncalibrated_level if fit is None else max(fit.misfit, 1.0))


def _band(basis: Basis, doubted: bool) -> tuple[float, float]:
    """5 and 95 % of the depth [m], with those of wear alone where these are as likely."""
    low, high = _band_with_effects(basis, doubted)
    return (low, high) if basis.alone is None else (min(low, basis.alone[0]), max(high, basis.alone[1]))


def _band_with_effects(basis: Basis, doubted: bool) -> tuple[float, float]:
    outcome, depth = basis.outcome, basis.outcome.depth
    low, high = outcome.depth_band
    if basis.by_level:
        if outcome.method == "unworn":
            return low, high
        factor = _level_factor(basis)
        least = depth * SCATTER.rms_low**factor if basis.shows_wear else 0.0
        return least, depth * SCATTER.rms_high**factor
    if not doubted:
        return low, high
    compared = outcome.memory.track.windows and outcome.memory.fit is not None  # with unworn teeth
    least = basis.limits.doubtful_low * depth if compared else 0.0
    return min(low, least), max(high, basis.limits.doubtful_high * depth)


def _life_doubt(basis: Basis, doubted: bool) -> LifeDoubt:
    """What a life is uncertain by for the grounds."""
    if basis.by_level:
        return LifeDoubt(level_factor=_level_factor(basis))
    low, high = _band(basis, doubted)
    depth, young = basis.outcome.depth, basis.outcome.memory.track.steady < basis.limits.least_worn_windows
    return LifeDoubt(
        of_depth=(high - low) / (2 * Z95 * depth) if (doubted or basis.alone) and depth > 0 else 0.0,
        of_rate=basis.limits.young_rate if young else 0.0,
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
