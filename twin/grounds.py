"""What speaks against using a wear depth or a remaining life as it is: every rule with its sentence and its remedy.

What a quantity that scatters from window to window says is judged with hysteresis (twin/noisy.py).

Every rule reads what the twin knows after a window and gives its grounds, a sentence each with figures. What held-out
windows confirm is not doubted: there the twin has predicted windows that no fit had used.

Depth and life are doubted apart: a depth measured by the encoders holds from its first worn window on, a life needs a
rate as well.

A ground that has arisen since (the model no longer meets what is measured today) says nothing against earlier windows.
One that was as true of them does: a rig file of another machine or of estimates, a calibration that fits badly, a level
alone, a wear rate that is only a prior. So does one by which today's figure may be no wear at all: an effect in the
model that nothing has tested yet, a sudden change of the rate.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from math import exp, hypot, sqrt

from twin.assessment import HeldOutErrors
from twin.established import HYSTERESIS, LIMITS, EstablishedLimits
from twin.gear_age import NEWNESS
from twin.quantiles import Z99
from twin.rig import Rig
from twin.tracing.unexplained import VERDICT_LIMITS, VerdictLimits, does_not_fit, excess, figure_of
from twin.updating.calibration import outliers
from twin.updating.conditions import MATCH
from twin.updating.encoders import ENCODERS
from twin.updating.inspections import MEASURED_DEPTH
from twin.updating.measurement import SCATTER
from twin.updating.tracker import RATE as WEAR_RATE
from twin.updating.update import UpdateOutcome, reference_rate

# remedies: imperatives, since the first of them is the action of the status
NEW_GEARS = f"record three windows of the gears when they are new (their first {NEWNESS.revolutions:.0f} turns)"
LOW_SPEED = "run the unworn gears at a fifth of the operating speed, under two loads that differ by a third or more"
TWO_ENCODERS = "mount encoders on both shafts: their transmission error measures the depth"
OWN_RIG_FILE = "write a rig file of this machine: teeth, module, shafts, bearings, place and unit of the sensor"
MORE_WINDOWS = "record more windows at this speed and load"
OF_NEW_GEARS = (NEW_GEARS, LOW_SPEED)  # what cannot be done any more once the gears have run

# quantities that scatter from window to window, and are judged with hysteresis (twin/noisy.py)
HELD_OUT = {"transmission_error": "held-out transmission error", "waveform": "held-out acceleration"}
MESH_LINES, OTHER_GEARS, UNREACHABLE = "mesh lines", "other gears", "unreachable level"
LEVEL_RISE, RATE = "level rise", "wear rate"


@dataclass(frozen=True, slots=True, kw_only=True)
class Ground:
    """Why a figure is not established."""

    reason: str
    remedies: tuple[str, ...]
    depth: bool = True  # whether the depth is doubted
    life: bool = True
    in_band: bool = False  # whether the band of a depth by encoders holds it already
    of_zero: bool = False  # whether it doubts from where depths count, and not how far they have grown
    arisen: bool = False  # whether it says nothing against earlier windows in which it was not there


@dataclass(frozen=True, slots=True, kw_only=True)
class Basis:
    """What the twin knows after a window."""

    rig: Rig
    outcome: UpdateOutcome
    errors: HeldOutErrors | None  # of the twin in use, on held-out windows
    alone: tuple[float, float] | None = None  # depth by wear alone that is as likely as that with effects [m]
    raised: tuple[str, ...] = ()  # quantities in doubt
    verdict: VerdictLimits = VERDICT_LIMITS
    limits: EstablishedLimits = LIMITS

    @property
    def by_level(self) -> bool:
        """Whether the depth rests on the vibration level: no encoder has measured one."""
        return by_level(self.outcome)

    def doable(self, remedies: Iterable[str]) -> tuple[str, ...]:
        """The remedies that can still be done, each once."""
        can = tuple(dict.fromkeys(r for r in remedies if self.outcome.unworn or r not in OF_NEW_GEARS))
        return can or (MEASURED_DEPTH,)

    @property
    def over_expected(self) -> float | None:
        """Wear until now over what the rig file's coefficient makes of the revolutions since new; None if not known."""
        outcome, points = self.outcome, self.outcome.memory.points
        if not outcome.age_known or outcome.memory.prior is not None or not points or not points[-1].revolutions > 0:
            return None
        (K,) = self.rig.require("the wear coefficient", "wear.K")
        fresh = self.rig.get("wear.running_in.initial_ratio", 1.0)
        return points[-1].work / (K * fresh * reference_rate(self.rig) * points[-1].revolutions)

    @property
    def confirmed(self) -> bool:
        """Whether held-out windows confirm the twin."""
        errors = self.errors
        if errors is None or not errors.windows or any(name in self.raised for name in HELD_OUT.values()):
            return False
        return all(getattr(errors, channel) is not None for channel in HELD_OUT)

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
        return self.level_rise is not None and LEVEL_RISE not in self.raised

    @property
    def level_missed(self) -> float | None:
        """By how much the level that the model reaches differs from the measured one; None where it reaches it."""
        outcome, found = self.outcome, self.outcome.rms_result
        if not self.by_level or found is None or not found.updated or found.converged or not outcome.rms_measured:
            return None
        return abs(found.rms_after / outcome.rms_measured - 1)


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
    estimate = basis.outcome.estimate
    if estimate is not None and OTHER_GEARS in basis.raised:
        yield Ground(
            reason=f"the encoders' mesh lines differ from the model by {sqrt(estimate.misfit):.1f} times what the rig "
            "file's tolerances allow at any depth: the rig file does not describe these gears",
            remedies=("write a rig file of these gears: teeth, module, face width", NEW_GEARS, MEASURED_DEPTH),
        )


def _unreachable_level(basis: Basis) -> Iterator[Ground]:
    """A level that the model does not reach at any depth."""
    outcome, found = basis.outcome, basis.outcome.rms_result
    if found is not None and UNREACHABLE in basis.raised:
        yield Ground(
            reason=f"the model gives {found.rms_after:.3g} m/s² where {outcome.rms_measured:.3g} m/s² were measured, "
            "and no wear depth removes the difference: the rig file does not describe this machine, or the level is "
            "in another unit",
            remedies=(OWN_RIG_FILE, TWO_ENCODERS),
        )


def _level_without_rise(basis: Basis) -> Iterator[Ground]:
    """A level that shows no wear: one level alone, or one that has not risen since the gears were new."""
    if basis.by_level and not basis.shows_wear:
        yield Ground(reason=no_rise(basis), remedies=(NEW_GEARS, TWO_ENCODERS, MEASURED_DEPTH))


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
    if fit is not None and not _low_speed(basis):
        yield Ground(
            reason="the level was calibrated at one operating condition", remedies=(LOW_SPEED,), life=False
        )  # fmt: skip


def no_rise(basis: Basis) -> str:
    """Why the level shows no wear."""
    rise, limit = basis.level_rise, basis.limits.level_rise
    if rise is None:
        now = basis.outcome.condition
        return (
            f"the vibration level of the new gears at {now.speed_hz:.4g} Hz and {now.torque:.4g} N·m is not known, so "
            "none of the present level can be ascribed to wear"
        )
    return (
        f"the vibration level is {100 * rise:+.0f} % from that of the new gears: it shows wear from "
        f"+{100 * (limit if rise <= limit else limit * HYSTERESIS.level_release):.0f} % on"
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
            remedies=("record a window at the operating speed",),
        )


def _not_calibrated(basis: Basis) -> Iterator[Ground]:
    """A model of which no unworn window has been seen."""
    if basis.outcome.memory.fit is None:
        yield Ground(
            reason="no window of the new gears has calibrated the model: stiffness and damping are those of the rig "
            "file, and deviations of the unworn teeth count as wear",
            remedies=(NEW_GEARS, MEASURED_DEPTH),
            of_zero=True,
        )


def _unknown_age(basis: Basis) -> Iterator[Ground]:
    """Gears that had run before the first window, nobody knows how long."""
    if not basis.outcome.age_known:
        yield Ground(
            reason="the age of the gears is not known: what had worn before the first window is not known either, only "
            "what has worn since",
            remedies=(MEASURED_DEPTH,),
            of_zero=True,
        )


def _too_fast(basis: Basis) -> Iterator[Ground]:
    """A depth that no wear coefficient near the rig file's makes within the revolutions since new."""
    over, outcome = basis.over_expected, basis.outcome
    most = exp(Z99 * hypot(WEAR_RATE.prior, basis.rig.estimated.spread.get("wear", 0.0)))
    if over is not None and over > most:
        yield Ground(
            reason=f"{1e6 * outcome.depth:.3g} µm after {outcome.memory.track.revolutions:,.0f} revolutions is "
            f"{over:.0f} times the wear that the rig file's coefficient makes (limit {most:.0f}): the gears were not "
            "new when the count began, or an effect that is not in the model looks like wear",
            remedies=(MEASURED_DEPTH, MORE_WINDOWS),
            of_zero=True,
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
    estimate, limit = basis.outcome.estimate, basis.verdict.doubtful_misfit
    if estimate is None or MESH_LINES not in basis.raised or basis.confirmed:
        return
    once = "" if estimate.misfit > limit else f"; {sqrt(limit * HYSTERESIS.release):.1f} once it was exceeded"
    yield Ground(
        reason=f"the encoders' mesh lines differ from the model by {sqrt(estimate.misfit):.1f} times what the rig "
        f"file's tolerances allow (limit {sqrt(limit):.1f}{once})",
        remedies=(MORE_WINDOWS, MEASURED_DEPTH),
        arisen=True,
    )


def _held_out(basis: Basis) -> Iterator[Ground]:
    """Held-out windows that the twin does not predict."""
    for channel, name in HELD_OUT.items():
        if name not in basis.raised or basis.errors is None:
            continue
        ratio = excess(basis.errors, channel) or 0.0
        once = "" if ratio > 1 else f", and {100 * HYSTERESIS.release:.0f} % of it once it was exceeded"
        yield Ground(
            reason=f"{figure_of(basis.errors, channel)}{once}: what the model does not explain may change the depth",
            remedies=(MORE_WINDOWS, MEASURED_DEPTH),
            arisen=True,
        )


def _estimated_rig(basis: Basis) -> Iterator[Ground]:
    """A rig file whose structure, inertias or mesh are estimates."""
    estimated = basis.rig.estimated
    if estimated.parts:
        by = f" by {estimated.by}" if estimated.by else ""
        yield Ground(
            reason=f"the rig file's {', '.join(estimated.parts)} are estimates{by}",
            remedies=(
                "replace the estimates in the rig file by drawings or measured natural frequencies",
                MEASURED_DEPTH,
            ),
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
            arisen=True,
        )


def _doubtful_torque(basis: Basis) -> Iterator[Ground]:
    """A torque that the depth was found at, and that its meter could not measure."""
    if basis.outcome.torque_fault is not None:
        yield Ground(
            reason=f"the depth was found at a torque of {basis.outcome.condition.torque:.4g} N·m, which is doubtful "
            f"({basis.outcome.torque_fault})",
            remedies=("record a window with a torque meter that works within its measuring range", MEASURED_DEPTH),
            arisen=True,
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


def counted(number: int, what: str) -> str:
    """For example "2 windows"."""
    return f"{number} {what}{'' if number == 1 else 's'}"


def _changed_rate(basis: Basis) -> Iterator[Ground]:
    """A wear rate that has changed suddenly: the wear, or an effect that has begun and looks like wear."""
    track, least = basis.outcome.memory.track, basis.limits.least_worn_windows
    if not basis.by_level and track.steady < least <= track.windows:
        yield Ground(
            reason=f"the wear rate changed suddenly, {counted(track.steady, 'window')} ago: either the wear itself, or "
            "an effect that has begun and moves the transmission error as wear does",
            remedies=(f"record {counted(least - track.steady, 'more window')} at this speed and load", MEASURED_DEPTH),
        )


def _young(basis: Basis) -> Iterator[Ground]:
    """A wear rate from few worn windows, or none that differs from zero."""
    track, least = basis.outcome.memory.track, basis.limits.least_worn_windows
    if basis.by_level:
        return
    if track.windows < least:
        yield Ground(
            reason=f"the wear rate rests on {track.windows} of at least {least} worn windows",
            remedies=(f"record {counted(least - track.windows, 'more window')} at this speed and load",),
            depth=False,
        )
    elif RATE in basis.raised:
        yield Ground(
            reason="the wear rate cannot be distinguished from zero yet", remedies=(MORE_WINDOWS,), depth=False
        )  # fmt: skip


def _does_not_fit(basis: Basis) -> Iterator[Ground]:
    """A level that the model predicts worse than nothing would."""
    reason = does_not_fit(basis.errors) if basis.by_level else None
    if reason is not None:
        yield Ground(reason=reason, remedies=(OWN_RIG_FILE, TWO_ENCODERS))


EXCLUDING: tuple[Rule, ...] = (_other_machine, _other_gears, _unreachable_level, _level_without_rise, _does_not_fit)
RULES: tuple[Rule, ...] = (
    _nothing_measured,
    _unknown_age,
    _not_calibrated,
    _too_fast,
    _calibration,
    _mesh_lines,
    _held_out,
    _level_alone,
    _estimated_rig,
    _beyond_the_curve,
    _doubtful_torque,
    _untested_effects,
    _changed_rate,
    _young,
)
