"""Whether wear depth and remaining life may be used as they are, and what would make them so.

    established       a calibrated model that fits this machine, and a depth that follows from it
    preliminary       a depth or life with a wider band, its reasons, and the measurements that would settle it
    not available     the evidence says that the model is not one of this machine

Every rule reads what the twin knows after a window and gives its grounds, a sentence each with figures. What held-out
windows confirm is not doubted: there the twin has predicted windows that no fit had used.

Depth and life are doubted apart: a depth measured by the encoders holds from its first worn window on, a life needs a
rate as well.

Bands  by level: the half-widths of its band in ln, times √max(misfit of the calibration, 1) (Birge's ratio, as in
       updating/depth.py), and times √2 where no unworn window has calibrated the level, which is then as uncertain as
       the depth that follows from a calibrated one; down to zero where no wear can be seen in the level.
       By encoders: at least the spread of true over estimated depth where the calibration was in doubt.
       A life inherits the relative width of its depth. With few windows, the rate may still halve (running-in).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from math import log, sqrt

from twin.assessment import HeldOutErrors, Preliminary
from twin.quantiles import Z95
from twin.rig import Rig
from twin.thresholds import deciding
from twin.tracing.unexplained import VERDICT_LIMITS, VerdictLimits, held_out_faults
from twin.updating.calibration import outliers
from twin.updating.conditions import MATCH
from twin.updating.encoders import ENCODERS
from twin.updating.life import NO_DOUBT, LifeDoubt
from twin.updating.measurement import SCATTER
from twin.updating.remaining_life import LIFE
from twin.updating.update import UpdateOutcome


@dataclass(frozen=True, slots=True, kw_only=True)
class EstablishedLimits:
    """What an established depth or life demands, beyond what the verdict on the residual does (VerdictLimits)."""

    other_machine: float = deciding(
        9.0,
        meaning="misfit of a calibration by the acceleration alone from which the model is not one of this machine",
        source="convention: the lines of the unworn gears differ by three times their scatter; with the channels of a "
        "tachometer the calibrations of D00–D13 leave at most 4.6, and 44 in D03, whose depth is then wrong as well",
    )
    other_gears: float = deciding(
        25.0,
        meaning="misfit of the encoders' mesh lines from which, without an unworn window to subtract, the model is not "
        "one of these gears",
        source="convention: the lines differ by five times their standard deviation",
    )
    unreachable: float = deciding(
        0.5,
        of="measured level",
        meaning="difference of the predicted level that no wear coefficient removes, from which the model is not one "
        "of this machine",
        source="reference campaigns with the channels of a tachometer: at most 0.22 in worn windows",
    )
    level_rise: float = deciding(
        0.5,
        of="level of the unworn gears at the same speed and torque",
        meaning="rise of the vibration level from which it shows wear",
        source="not derived: a changed sensor, mount or drive makes some tens of per cent; the levels of D00-D13 have "
        "risen by half at 6 to 24 µm",
    )
    least_worn_windows: int = deciding(
        3,
        unit="windows",
        meaning="worn windows at one wear rate from which it is established",
        source="derivation: two windows give a rate, the third tests it",
    )
    young_rate: float = deciding(
        log(2) / Z95,
        of="remaining life",
        meaning="standard deviation of its logarithm with fewer worn windows than that",
        source="derivation: the rate may still halve while the gears run in (RateDrift.running_in)",
    )
    doubtful_low: float = deciding(
        0.5,
        of="the depth by the encoders where the calibration is in doubt",
        meaning="5 % quantile of the true depth",
        source="D00–D13 without attribution, 36 doubtful windows of 5 campaigns: 0.74, the least 0.53; rounded down",
    )
    doubtful_high: float = deciding(
        1.25,
        of="the depth by the encoders where the calibration is in doubt",
        meaning="95 % quantile of the true depth",
        source="as doubtful_low: 1.01, the largest 1.10; rounded up",
    )
    uncalibrated_level: float = deciding(
        2.0,
        of="variance of the logarithm of a depth by the level",
        meaning="its variance where no unworn window has calibrated the level",
        source="derivation: the level of a structure within its tolerance scatters by 0.35 (CalibrationFit."
        "level_scatter), as much as the depth from a calibrated level (LifeSpread.rms_spread)",
    )


LIMITS = EstablishedLimits()

NEW_GEARS = f"three windows of the gears when they are new (their first {MATCH.unworn_revolutions:.0f} turns)"
LOW_SPEED = "runs of the unworn gears at a fifth of the operating speed, under two loads that differ by a third or more"
MEASURED_DEPTH = "a measured wear depth"
TWO_ENCODERS = "encoders on both shafts: their transmission error measures the depth"
OWN_RIG_FILE = "a rig file of this machine: teeth, module, shafts, bearings, place and unit of the sensor"
MORE_WINDOWS = "more windows at this speed and load"


@dataclass(frozen=True, slots=True, kw_only=True)
class Ground:
    """Why a figure is not established."""

    reason: str
    remedies: tuple[str, ...]
    depth: bool = True  # whether the depth is doubted
    life: bool = True
    in_band: bool = False  # whether the band of a depth by encoders holds it already


@dataclass(frozen=True, slots=True, kw_only=True)
class Basis:
    """What the twin knows after a window."""

    rig: Rig
    outcome: UpdateOutcome
    errors: HeldOutErrors | None  # of the twin in use, on held-out windows
    verdict: VerdictLimits = VERDICT_LIMITS
    limits: EstablishedLimits = LIMITS

    @property
    def by_level(self) -> bool:
        """Whether the depth rests on the vibration level: no encoder has measured one."""
        return by_level(self.outcome)

    @property
    def confirmed(self) -> bool:
        """Whether held-out windows confirm the twin."""
        errors = self.errors
        return errors is not None and bool(errors.windows) and not held_out_faults(errors, self.verdict.held_out_error)

    @property
    def level_rise(self) -> float | None:
        """Rise of the level since the gears were new, at the same speed and torque; None where that is not known."""
        outcome, now = self.outcome, self.outcome.condition
        if outcome.rms_measured is None:
            return None
        before = [
            w.rms
            for w in outcome.memory.unworn
            if w.rms
            and _near(w.speed_hz, now.speed_hz, ENCODERS.same_speed)
            and (w.torque_nm is None or _near(w.torque_nm, now.torque, ENCODERS.same_torque))
        ]
        return outcome.rms_measured / (sum(before) / len(before)) - 1 if before else None

    @property
    def shows_wear(self) -> bool:
        """Whether the level has risen since the gears were new."""
        rise = self.level_rise
        return rise is not None and rise > self.limits.level_rise


Rule = Callable[[Basis], Iterable[Ground]]


def by_level(outcome: UpdateOutcome) -> bool:
    """Whether a depth rests on the vibration level: no encoder has measured one."""
    return outcome.method == "rms" or (outcome.estimate is None and not outcome.memory.track.windows)


def _near(value: float | None, other: float, tolerance: float) -> bool:
    return value is not None and abs(value / other - 1) < tolerance


# -- the model is not one of this machine ---------------------------------------------------------------------


def _other_machine(basis: Basis) -> Iterator[Ground]:
    """A calibration by the acceleration alone that the unworn windows contradict."""
    fit = basis.outcome.memory.fit
    if basis.by_level and fit is not None and fit.misfit > basis.limits.other_machine:
        yield Ground(
            reason=f"the mesh lines of the unworn gears differ from the calibrated model by {sqrt(fit.misfit):.1f} "
            f"times their scatter (limit {sqrt(basis.limits.other_machine):.1f}): the rig file does not describe this "
            "machine",
            remedies=(OWN_RIG_FILE, TWO_ENCODERS),
        )


def _other_gears(basis: Basis) -> Iterator[Ground]:
    """Encoder lines that no depth explains, with nothing known of the unworn gears."""
    estimate, fit = basis.outcome.estimate, basis.outcome.memory.fit
    if estimate is not None and fit is None and estimate.misfit > basis.limits.other_gears:
        yield Ground(
            reason=f"the encoders' mesh lines differ from the model by {sqrt(estimate.misfit):.1f} times what the rig "
            "file's tolerances allow at any depth: the rig file does not describe these gears",
            remedies=("a rig file of these gears: teeth, module, face width", NEW_GEARS, MEASURED_DEPTH),
        )


def _unreachable_level(basis: Basis) -> Iterator[Ground]:
    """A level that the model does not reach at any depth."""
    outcome, found = basis.outcome, basis.outcome.rms_result
    if not basis.by_level or found is None or not found.updated or found.converged or not outcome.rms_measured:
        return
    off = found.rms_after / outcome.rms_measured - 1
    if abs(off) > basis.limits.unreachable:
        yield Ground(
            reason=f"the model gives {found.rms_after:.3g} m/s² where {outcome.rms_measured:.3g} m/s² were measured, "
            "and no wear depth removes the difference: the rig file does not describe this machine, or the level is "
            "in another unit",
            remedies=(OWN_RIG_FILE, TWO_ENCODERS),
        )


# -- depth and life are preliminary -----------------------------------------------------------------------------


def _level_alone(basis: Basis) -> Iterator[Ground]:
    """A depth that no encoder has measured."""
    if not basis.by_level:
        return
    fit, low, high = basis.outcome.memory.fit, 1 - SCATTER.rms_low, SCATTER.rms_high - 1
    reason = (
        f"the depth follows from the vibration level alone, which was off by −{100 * low:.0f} to +{100 * high:.0f} % "
        "in trials, and no transfer path from the mesh to the accelerometer has been learned"
    )
    yield Ground(reason=reason, remedies=(TWO_ENCODERS, MEASURED_DEPTH))
    if basis.outcome.rms_measured is not None and not basis.shows_wear:
        yield Ground(reason=_no_rise(basis), remedies=(NEW_GEARS, MEASURED_DEPTH))
    if fit is not None and not _low_speed(basis):
        yield Ground(
            reason="the level was calibrated at one operating condition", remedies=(LOW_SPEED,), life=False
        )  # fmt: skip


def _no_rise(basis: Basis) -> str:
    """Why the level shows no wear."""
    rise = basis.level_rise
    if rise is None:
        now = basis.outcome.condition
        return (
            f"the vibration level of the new gears at {now.speed_hz:.4g} Hz and {now.torque:.4g} N·m is not known, so "
            "none of the present level can be ascribed to wear"
        )
    return (
        f"the vibration level is {100 * rise:+.0f} % from that of the new gears: it shows wear from "
        f"+{100 * basis.limits.level_rise:.0f} % on"
    )


def _low_speed(basis: Basis) -> bool:
    """Whether unworn windows of more than one operating condition have calibrated the model."""
    now = basis.outcome.condition
    return any(
        not _near(w.speed_hz, now.speed_hz, MATCH.calibration_point)
        or (w.torque_nm is not None and not _near(w.torque_nm, now.torque, MATCH.calibration_point))
        for w in basis.outcome.memory.unworn
    )


def _nothing_measured(basis: Basis) -> Iterator[Ground]:
    """A depth of zero that is assumed, not measured."""
    if basis.outcome.method == "unworn":
        yield Ground(
            reason="no worn window has been measured: the depth of zero is an assumption",
            remedies=("a window at the operating speed",),
        )


def _not_calibrated(basis: Basis) -> Iterator[Ground]:
    """A model of which no unworn window has been seen."""
    if basis.outcome.memory.fit is None:
        yield Ground(
            reason="no window of the new gears has calibrated the model: stiffness and damping are those of the rig "
            "file, and deviations of the unworn teeth count as wear",
            remedies=(NEW_GEARS, MEASURED_DEPTH),
        )


def _calibration(basis: Basis) -> Iterator[Ground]:
    """A calibration that fits badly, or only far from the rig file, and that no held-out window confirms."""
    fit = basis.outcome.memory.fit
    if fit is None or (basis.confirmed and not basis.by_level):
        return
    if fit.misfit > basis.verdict.doubtful_misfit:
        yield Ground(
            reason=f"the mesh lines of the new gears differ from the calibrated model by {sqrt(fit.misfit):.1f} times "
            f"their scatter (limit {sqrt(basis.verdict.doubtful_misfit):.1f})",
            remedies=(LOW_SPEED, MORE_WINDOWS, MEASURED_DEPTH),
        )
    for sentence in outliers(basis.rig, fit):
        yield Ground(reason=sentence, remedies=(LOW_SPEED, MORE_WINDOWS, MEASURED_DEPTH))


def _mesh_lines(basis: Basis) -> Iterator[Ground]:
    """Encoder lines that the model does not meet at the depth found."""
    estimate = basis.outcome.estimate
    if estimate is not None and estimate.misfit > basis.verdict.doubtful_misfit and not basis.confirmed:
        yield Ground(
            reason=f"the encoders' mesh lines differ from the model by {sqrt(estimate.misfit):.1f} times what the rig "
            f"file's tolerances allow (limit {sqrt(basis.verdict.doubtful_misfit):.1f})",
            remedies=(MORE_WINDOWS, MEASURED_DEPTH),
        )


def _held_out(basis: Basis) -> Iterator[Ground]:
    """Held-out windows that the twin does not predict."""
    if basis.errors is None or not basis.errors.windows:
        return
    for sentence in held_out_faults(basis.errors, basis.verdict.held_out_error, missing=False):
        yield Ground(
            reason=f"{sentence}: vibration that the model does not explain may change the depth",
            remedies=(MORE_WINDOWS, MEASURED_DEPTH),
        )


def _estimated_rig(basis: Basis) -> Iterator[Ground]:
    """A rig file whose structure, inertias or mesh are estimates."""
    estimated = basis.rig.estimated
    if estimated.parts:
        by = f" by {estimated.by}" if estimated.by else ""
        yield Ground(
            reason=f"the rig file's {', '.join(estimated.parts)} are estimates{by}",
            remedies=("drawings or measured natural frequencies of the machine", MEASURED_DEPTH),
            in_band=True,  # twin/updating/joint_gauge.py
        )


def _beyond_the_curve(basis: Basis) -> Iterator[Ground]:
    """A depth at the end of what the model can compute, below the end of life."""
    outcome, limit = basis.outcome, basis.rig.get("end_of_life.max_depth")
    if limit is not None and outcome.depth >= limit:
        return
    end = outcome.curve.valid_within(outcome.depth)
    if outcome.depth > end:
        yield Ground(
            reason=f"the depth lies beyond the last steady state that the model finds ({1e6 * end:.0f} µm)",
            remedies=(MEASURED_DEPTH,),
        )


def _untested_effects(basis: Basis) -> Iterator[Ground]:
    """Effects in the model that no held-out window has tested."""
    found = basis.outcome.memory.effects
    if found and (basis.errors is None or not basis.errors.windows):
        yield Ground(
            reason=f"{_listed(dict.fromkeys(a.effect.facts.label for a in found))} in the model has not been tested on "
            "held-out windows yet",
            remedies=(MORE_WINDOWS,),
        )


def _listed(names: Iterable[str]) -> str:
    return " and ".join(names)


def _windows(count: int, more: str = "") -> str:
    return f"{count} {more}window{'' if count == 1 else 's'}"


def _changed_rate(basis: Basis) -> Iterator[Ground]:
    """A wear rate that has changed suddenly: the wear, or an effect that has begun and looks like wear."""
    track, least = basis.outcome.memory.track, basis.limits.least_worn_windows
    if not basis.by_level and track.steady < least <= track.windows:
        yield Ground(
            reason=f"the wear rate changed suddenly, {_windows(track.steady)} ago: either the wear itself, or an "
            "effect that has begun and moves the transmission error as wear does",
            remedies=(f"{_windows(least - track.steady, 'more ')} at this speed and load", MEASURED_DEPTH),
        )


def _young(basis: Basis) -> Iterator[Ground]:
    """A wear rate from few worn windows, or none that differs from zero."""
    track, least = basis.outcome.memory.track, basis.limits.least_worn_windows
    if basis.by_level:
        return
    if track.windows < least:
        yield Ground(
            reason=f"the wear rate rests on {track.windows} of at least {least} worn windows",
            remedies=(f"{_windows(least - track.windows, 'more ')} at this speed and load",),
            depth=False,
        )
    elif track.rate <= LIFE.measurable * track.rate_std:
        yield Ground(
            reason="the wear rate cannot be distinguished from zero yet", remedies=(MORE_WINDOWS,), depth=False
        )  # fmt: skip


EXCLUDING: tuple[Rule, ...] = (_other_machine, _other_gears, _unreachable_level)
RULES: tuple[Rule, ...] = (
    _nothing_measured,
    _not_calibrated,
    _calibration,
    _mesh_lines,
    _held_out,
    _level_alone,
    _estimated_rig,
    _beyond_the_curve,
    _untested_effects,
    _changed_rate,
    _young,
)


# -- what follows -------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class Confidence:
    """How far the depth and the life after a window may be relied on."""

    band: tuple[float, float]  # of the depth [m]
    not_this_machine: str | None = None  # why neither is available; None where they are
    depth: Preliminary | None = None  # None where the depth is established
    life: Preliminary | None = None
    no_life: str | None = None  # why the life alone is not available
    life_doubt: LifeDoubt = NO_DOUBT


def confidence_of(rig: Rig, outcome: UpdateOutcome, errors: HeldOutErrors | None) -> Confidence:
    """What a window's depth and life are worth.

    errors  of the twin in use on held-out windows; None where there were none
    """
    basis = Basis(rig=rig, outcome=outcome, errors=errors)
    excluding = [ground for rule in EXCLUDING for ground in rule(basis)]
    if excluding:
        return Confidence(not_this_machine=_missing(excluding), band=outcome.depth_band)
    grounds = [ground for rule in RULES for ground in rule(basis)]
    doubted = any(ground.depth and not ground.in_band for ground in grounds)
    return Confidence(
        band=_band(basis, doubted),
        depth=_preliminary(ground for ground in grounds if ground.depth),
        life=_preliminary(ground for ground in grounds if ground.life),
        no_life=_no_rise(basis) if basis.by_level and not basis.shows_wear else None,
        life_doubt=_life_doubt(basis, doubted),
    )


def _missing(excluding: list[Ground]) -> str:
    """Why depth and life are not available, and what would help."""
    remedies = dict.fromkeys(remedy for ground in excluding for remedy in ground.remedies)
    return f"{'; '.join(ground.reason for ground in excluding)}. What would help: {'; '.join(remedies)}"


def _preliminary(grounds: Iterable[Ground]) -> Preliminary | None:
    known = list(grounds)
    if not known:
        return None
    return Preliminary(
        reasons=tuple(dict.fromkeys(ground.reason for ground in known)),
        remedies=tuple(dict.fromkeys(remedy for ground in known for remedy in ground.remedies)),
    )


def _level_factor(basis: Basis) -> float:
    """By how much the half-widths of a depth by level grow, in ln."""
    fit = basis.outcome.memory.fit
    return sqrt(basis.limits.uncalibrated_level if fit is None else max(fit.misfit, 1.0))


def _band(basis: Basis, doubted: bool) -> tuple[float, float]:
    """5 and 95 % of the depth [m]."""
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
        of_depth=(high - low) / (2 * Z95 * depth) if doubted and depth > 0 else 0.0,
        of_rate=basis.limits.young_rate if young else 0.0,
    )
