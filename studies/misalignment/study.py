"""The published misalignment study, run again: aligned and tilted, rigid, on bearings, on shafts, and on both.

    rise = RMS(tilted)/RMS(aligned) − 1,   RMS = sqrt(Σ_n RMS_n²) over the bands of mesh harmonics 1 … 5

Compared are the second derivative of the force between the driver and its shaft, to which the acceleration of an
elastic support is proportional, which the authors measured on the gearbox; and the force itself, which they took from
their model. Both were vertical: read as across the line of centres, and also along it (`dabrowski_2012`).

Source   D. Dąbrowski et al., Diagnostyka 2(62) (2012), chapters 2 and 3
Holds    steady runs: what is kept begins after a turn
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from studies.misalignment.bands import band_rms, derivative, sideband_ratio, whole_turn
from studies.misalignment.dabrowski_2012 import (
    ESTIMATES,
    EXPERIMENT_RISE,
    MOST_AT,
    READINGS,
    SPEEDS_RPM,
    TILT_ANGLE,
    TORQUES,
    drawn,
    system,
)
from studies.misalignment.motion import SLICES, STEPS, Case, Motion, integrate
from studies.misalignment.system import System, Tilt
from twin.errors import NotConverged

VARIANTS: dict[str, Mapping[str, bool]] = {  # what is compliant
    "rigid": {},
    "bearings": {"bearings": True},
    "shafts": {"shafts": True},
    "both": {"bearings": True, "shafts": True},
    "teeth": {"teeth": True},
    "all": {"bearings": True, "shafts": True, "teeth": True},
}
TILTS: dict[str, Tilt] = {
    "aligned": Tilt(),
    "normal": Tilt(angle=TILT_ANGLE, direction="normal"),
    "in_plane": Tilt(angle=TILT_ANGLE, direction="in_plane"),
    "turning": Tilt(angle=TILT_ANGLE, turning=True),
    "turning_end": Tilt(angle=TILT_ANGLE, turning=True, pivot=-0.5),
}
RESIDUALS: dict[str, Tilt] = {  # of the reference state
    "tilt 0.1°": Tilt(angle=0.1 * TILT_ANGLE),
    "tilt 0.2°": Tilt(angle=0.2 * TILT_ANGLE),
}
POINTS = tuple((n, T) for n in SPEEDS_RPM for T in TORQUES)
DRAWN = ("rigid", "bearings", "shafts", "both", "all")  # variants that are run with drawn estimates
CROOKED = ("rigid", "both", "all")  # variants in which the gear that turns crookedly is tried
SHOWN = (800.0, 200.0)  # the operating point whose signals the authors show: a whole turn is kept there
SIGNALS = ("acceleration", "force")  # what was measured before what was computed
SETTLE = 28  # mesh periods before what is kept
COARSE = (256, 15)  # steps and slices of the sensitivities: within some 5 % of the fine ones


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Run:
    """One steady run."""

    variant: str
    tilt: str
    speed_rpm: float
    torque: float  # [N·m]
    force: np.ndarray  # vertical, of the driver on its shaft, over a turn (n,) [N]
    force_bands: np.ndarray  # RMS (5,) [N]
    acceleration_bands: np.ndarray  # RMS of the second derivative of the force (5,) [N/s²]
    along_bands: np.ndarray  # as both, along the line of centres instead: force, acceleration (2, 5) [N, N/s²]
    sidebands: np.ndarray  # ratio at ± 1 and ± 2 orders of rotation of each mesh harmonic (2, 5)
    back_contact: bool  # whether back flanks touch

    @property
    def force_rms(self) -> float:
        """[N]."""
        return float(np.linalg.norm(self.force_bands))

    @property
    def acceleration_rms(self) -> float:
        """[N/s²]."""
        return float(np.linalg.norm(self.acceleration_bands))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Rise:
    """What a tilt does, against the aligned run of the same variant, speed and torque."""

    variant: str
    tilt: str
    speed_rpm: float
    torque: float
    force: float  # of the RMS in all bands [%]
    bands: np.ndarray  # of each band of the force, and of the acceleration where there are no sidebands (5,) [%]
    acceleration: float  # [%]
    gains: np.ndarray  # what each band adds to the acceleration's RMS, of the aligned RMS in all bands (5,) [%]
    force_along: float  # of the force along the line of centres [%]
    acceleration_along: float  # [%]
    experiment: float  # about [%]

    @property
    def most_at(self) -> tuple[bool, bool]:
        """Whether each of the harmonics that rose most in the experiment rises more than harmonic 1, and than 5."""
        named = min(self.bands[n - 1] for n in MOST_AT)
        return bool(named > self.bands[0]), bool(named > self.bands[-1])


def run(
    given: System,
    variant: str,
    tilt: str,
    speed_rpm: float,
    torque: float,
    steps: int = STEPS,
    slices: int = SLICES,
) -> Run:
    """One run of `VARIANTS` and `TILTS` or `RESIDUALS`; raises NotConverged where the integration fails."""
    made = given.giving(**VARIANTS[variant])
    case = Case(system=made, speed_rpm=speed_rpm, torque=torque, tilt=(TILTS | RESIDUALS)[tilt])
    teeth = made.pair.teeth[0]
    shown = variant in CROOKED and (speed_rpm, torque) == SHOWN
    keep = teeth if case.tilt.turning or shown else 1
    motion = _integrated(case, keep, steps, slices)
    along, force = (whole_turn(motion.shaft[:, 0, axis], teeth, keep) for axis in (0, 1))
    sizes = [[band_rms(f, teeth), band_rms(derivative(f, case.omega, 2), teeth)] for f in (force, along)]
    return Run(
        variant=variant,
        tilt=tilt,
        speed_rpm=speed_rpm,
        torque=torque,
        force=force,
        force_bands=sizes[0][0],
        acceleration_bands=sizes[0][1],
        along_bands=np.array(sizes[1]),
        sidebands=np.array([sideband_ratio(force, teeth, order) for order in (1, 2)]),
        back_contact=bool(motion.back_force.any()),
    )


def _integrated(case: Case, keep: int, steps: int, slices: int) -> Motion:
    """With up to a quarter of the step where Newton's method leaves a step unsolved."""
    for finer in (1, 2):
        try:
            return integrate(case, settle=SETTLE, keep=keep, steps=finer * steps, slices=slices)
        except NotConverged:
            continue
    return integrate(case, settle=SETTLE, keep=keep, steps=4 * steps, slices=slices)


def rise(tilted: Run, aligned: Run) -> Rise:
    """Of one run over the aligned one."""
    along = 100 * (np.linalg.norm(tilted.along_bands, axis=1) / np.linalg.norm(aligned.along_bands, axis=1) - 1)
    return Rise(
        variant=tilted.variant,
        tilt=tilted.tilt,
        speed_rpm=tilted.speed_rpm,
        torque=tilted.torque,
        force=100 * (tilted.force_rms / aligned.force_rms - 1),
        bands=100 * (tilted.force_bands / aligned.force_bands - 1),
        acceleration=100 * (tilted.acceleration_rms / aligned.acceleration_rms - 1),
        gains=100 * (tilted.acceleration_bands - aligned.acceleration_bands) / aligned.acceleration_rms,
        force_along=float(along[0]),
        acceleration_along=float(along[1]),
        experiment=EXPERIMENT_RISE[tilted.speed_rpm],
    )


def mean_miss(rises: Iterable[Rise], of: str) -> float:
    """Mean distance of a rise from the experiment's [%-points]; `of` is one of `SIGNALS`, also with `_along`."""
    return float(np.mean([abs(getattr(r, of) - r.experiment) for r in rises]))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Sensitivity:
    """The rises at the four operating points where one parameter is something else, axis tilted normal to the plane."""

    name: str
    value: float | None  # in the estimate's unit; None for another reading of the paper
    rigid: tuple[Rise, ...] | None
    both: tuple[Rise, ...]  # on bearings and shafts


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Study:
    """All runs with what follows from them."""

    runs: tuple[Run, ...]
    rises: tuple[Rise, ...]
    coarse: Mapping[str, tuple[Rise, ...]]  # by variant, on the grid of what follows
    sensitivities: tuple[Sensitivity, ...]
    residuals: Mapping[tuple[str, str], tuple[Rise, ...]]  # by variant and state that is called correct
    frictionless: Mapping[str, tuple[Rise, ...]]  # by variant, without friction between the teeth
    draws: tuple[Mapping[str, tuple[Rise, ...]], ...]  # by variant, of systems with all estimates drawn

    def of(self, variant: str, tilt: str) -> list[Rise]:
        """At the four operating points."""
        return [r for r in self.rises if (r.variant, r.tilt) == (variant, tilt)]

    def misses(self, variant: str, of: str) -> np.ndarray:
        """Mean distance from the experiment in every draw (draws,) [%-points]; `of` as in `mean_miss`."""
        return np.array([mean_miss(draw[variant], of) for draw in self.draws])

    def run(self, variant: str, tilt: str, speed_rpm: float, torque: float) -> Run:
        key = (variant, tilt, speed_rpm, torque)
        return next(r for r in self.runs if (r.variant, r.tilt, r.speed_rpm, r.torque) == key)


def rises_of(
    given: System,
    variant: str,
    tilt: str = "normal",
    steps: int = STEPS,
    slices: int = SLICES,
    against: str = "aligned",
) -> tuple[Rise, ...]:
    """At the four operating points, over the aligned state or over one of `RESIDUALS`."""
    return tuple(
        rise(run(given, variant, tilt, n, T, steps, slices), run(given, variant, against, n, T, steps, slices))
        for n, T in POINTS
    )


def study(
    progress: Callable[[float, str], None] = lambda share, note: None,
    *,
    fine: tuple[int, int] = (STEPS, SLICES),
    coarse: tuple[int, int] = COARSE,
    sensitivities: bool = True,
    draws: int = 0,
) -> Study:
    """Every variant, tilt and operating point; each estimate otherwise; all estimates drawn at random.

    progress      gets the share done and a note
    fine, coarse  steps a mesh period and slices of the runs and of sensitivities and draws
    draws         how many systems with all estimates drawn
    """
    given = system()
    cases = [(v, t, n, T) for v in VARIANTS for n, T in POINTS for t in TILTS if v in CROOKED or not TILTS[t].turning]
    others = _others(given) if sensitivities else []
    total = len(cases) + 10 * len(others) + 40 * draws
    runs, found, sets = [], [], []
    for i, (variant, tilt, speed, torque) in enumerate(cases):
        progress(i / total, f"{variant}, {speed:g} rpm, {torque:g} N·m")
        runs.append(run(given, variant, tilt, speed, torque, *fine))
    aligned = {(r.variant, r.speed_rpm, r.torque): r for r in runs if r.tilt == "aligned"}
    rises = [rise(r, aligned[r.variant, r.speed_rpm, r.torque]) for r in runs if r.tilt != "aligned"]
    for i, (name, value, other, rigid_too) in enumerate(others):
        progress((len(cases) + 10 * i) / total, name)
        rigid = rises_of(other, "rigid", "normal", *coarse) if rigid_too else None
        both = rises_of(other, "both", "normal", *coarse)
        found.append(Sensitivity(name=name, value=value, rigid=rigid, both=both))
    for i, other in enumerate(drawn(seed=1, number=draws)):
        progress((len(cases) + 10 * len(others) + 40 * i) / total, f"estimates drawn, {i + 1} of {draws}")
        sets.append({v: rises_of(other, v, "normal", *coarse) for v in DRAWN})
    residuals = {
        (variant, state): rises_of(given, variant, "normal", *coarse, against=state)
        for variant in CROOKED
        for state in RESIDUALS
    }
    smooth = replace(given, law=given.law.without_friction())
    return Study(
        runs=tuple(runs),
        rises=tuple(rises),
        coarse={variant: rises_of(given, variant, "normal", *coarse) for variant in ("rigid", "both")},
        sensitivities=tuple(found),
        residuals=residuals,
        frictionless={variant: rises_of(smooth, variant, "normal", *coarse) for variant in VARIANTS},
        draws=tuple(sets),
    )


def _others(given: System) -> list[tuple[str, float | None, System, bool]]:
    """Every estimate at both ends of its range, then the other readings of K."""
    ends = [(e.name, v, e.at(given, v), e.rigid_too) for e in ESTIMATES for v in (e.low, e.high)]
    return [*ends, *((name, None, change(given), True) for name, change in READINGS.items())]
