"""What effects act on: the contacts of one period, the forces and the sensor, before they are solved.

Each effect takes a `Setup` and gives another one; nothing in it knows an effect by name, and the order in which
effects are applied does not matter beyond rounding. Arrays over the contacts broadcast to (slices, p, n):

    slices  across the face width, 1 unless an effect or the wear differs along it
    p       contacts as in twin.dynamics: drive flanks first, then back flanks
    n       samples of the period

    k_p = stiffness·k(s_p + (σ1 + σ2)/2)      e_p = −h1(s_p + σ1) − h2(s_p + σ2) − gap(s_p + σ) + separation

σ1, σ2  shift of the contact on the pinion's and on the gear's flank, in s [m]; the gap before the path takes σ2
        (the gear's tip begins the contact) and the gap behind it σ1 (the pinion's tip ends it)
h1, h2  shares of the wear: 1/(1 + z1/z2) and the rest

Ignores  slices and shifts on the back flanks: they stay whole, with the mean separation of the slices
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache
from math import lcm, pi

import numpy as np

from twin.compiled import spline
from twin.dynamics.harmonic_balance import Action, Contacts, Load
from twin.dynamics.hunting import SAMPLES, HuntingPeriod, Passages
from twin.dynamics.mesh import ROWS, PairMesh
from twin.dynamics.structure import Structure, direction
from twin.errors import ParameterError
from twin.geometry import GearPair
from twin.model import Condition, Model
from twin.wear.profile import WornProfile

DRIVEN_SHAFT = direction({f"th{n}": 1.0 for n in (1, 2, 3, 5, 7)})  # rotation of the pinion's shaft as a whole

SensorGain = Callable[[np.ndarray], np.ndarray]  # frequencies (m,) [Hz] → complex gain (m,)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Shift:
    """How far contacts sit from their nominal place on the flanks, and the slopes along θ1."""

    pinion: np.ndarray  # σ1 (n,) [m]
    gear: np.ndarray  # σ2 (n,) [m]
    pinion_slope: np.ndarray  # dσ1/dθ1 (n,) [m/rad]
    gear_slope: np.ndarray  # dσ2/dθ1 (n,) [m/rad]

    def __add__(self, other: Shift) -> Shift:
        return Shift(
            pinion=self.pinion + other.pinion,
            gear=self.gear + other.gear,
            pinion_slope=self.pinion_slope + other.pinion_slope,
            gear_slope=self.gear_slope + other.gear_slope,
        )

    @property
    def present(self) -> bool:
        return bool(self.pinion.any() or self.gear.any())


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Setup:
    """One period of the mesh with everything that effects may change."""

    structure: Structure
    pair: GearPair
    condition: Condition
    mesh: PairMesh  # of one mesh period, with the samples of this setup
    passages: Passages  # of the whole period
    turns: Fraction  # pinion turns in the period
    any_order: bool  # whether an order between the lines may go to the nearest: on the hunting-tooth period alone
    slices: int
    stiffness: np.ndarray | float  # factor on every pair's stiffness
    separation: np.ndarray | float = 0.0  # added, positive where there is more material [m]
    slope: np.ndarray | float = 0.0  # of the added separation along θ1 [m/rad]
    shift: Shift | None = None
    damping_time: float  # τ [s]
    actions: tuple[tuple[np.ndarray, np.ndarray], ...] = ()  # direction (21,), weight
    loads: tuple[Load, ...] = ()
    accelerometer: tuple[SensorGain, ...] = ()

    @property
    def samples(self) -> int:
        """Of the whole period."""
        return self.passages.pinion_angle.size

    @property
    def omega(self) -> tuple[float, float]:
        """ω1, ω2 [rad/s]."""
        z1, z2 = self.pair.teeth
        ω1 = 2 * pi * self.condition.speed_hz
        return ω1, ω1 * z1 / z2

    @property
    def face_position(self) -> np.ndarray:
        """Middle of every slice across the face, −½ … ½ of its width; (slices, 1, 1)."""
        return ((np.arange(self.slices) + 0.5) / self.slices - 0.5)[:, None, None]

    @property
    def drive(self) -> np.ndarray:
        """1 for drive flanks, 0 for back flanks (p, 1)."""
        return (self.passages.side > 0).astype(float)

    def sliced(self, slices: int) -> Setup:
        """With so many slices across the face, unless it is sliced already."""
        return self if self.slices > 1 else replace(self, slices=slices)

    def with_error(self, added: np.ndarray | float, slope: np.ndarray | float) -> Setup:
        """More material at the contacts [m], and its slope along θ1 [m/rad]."""
        return replace(self, separation=self.separation + added, slope=self.slope + slope)

    def with_stiffness(self, factor: np.ndarray | float) -> Setup:
        return replace(self, stiffness=self.stiffness * factor)

    def with_shift(self, shift: Shift) -> Setup:
        return replace(self, shift=shift if self.shift is None else self.shift + shift)

    def with_action(self, along: np.ndarray, weight: np.ndarray) -> Setup:
        """A force −along·Σ weight·F of the contacts; along (21,)."""
        return replace(self, actions=(*self.actions, (along, weight)))

    def with_sensor(self, gain: SensorGain) -> Setup:
        return replace(self, accelerometer=(*self.accelerometer, gain))

    def with_load(self, along: np.ndarray, amplitudes: Mapping[float, complex]) -> Setup:
        """A force along (21,) of Re A·e^{i·order·θ1} at each order of the pinion's rotation."""
        lines = np.zeros(self.samples // 2 + 1, dtype=complex)
        for order, amplitude in amplitudes.items():
            lines[self.line(order)] += amplitude / 2
        return self.with_load_lines(along, lines)

    def with_load_lines(self, along: np.ndarray, lines: np.ndarray) -> Setup:
        """A force along (21,) with two-sided coefficients (n//2 + 1,) of the period's harmonics, no mean."""
        return replace(self, loads=(*self.loads, Load(direction=along, lines=lines)))

    def line(self, order: float) -> int:
        """Number of the period's harmonic nearest an order of the pinion's rotation.

        On the hunting-tooth period any order is within half of 1/turns of a line.
        """
        place = order * float(self.turns)
        k = round(place)
        off_grid = not self.any_order and abs(place - k) > 1e-9
        if off_grid or not 1 <= k < self.samples // 2:
            highest = (self.samples // 2 - 1) / float(self.turns)
            raise ParameterError(
                f"order {order:g} of the pinion's rotation is no line of this period: multiples of "
                f"{float(1 / self.turns):g} up to {highest:g}; other orders need the hunting-tooth period"
            )
        return k


PERIODS = ("mesh", "pinion", "gear", "hunting")  # of a pair, a pinion tooth, a gear tooth, the same two teeth


def common_period(periods: Iterable[str]) -> str:
    """The shortest over which all repeat."""
    wanted = set(periods)
    if not wanted <= set(PERIODS):
        raise ParameterError(f"{wanted - set(PERIODS)} is no period: {', '.join(PERIODS)}")
    if "hunting" in wanted or {"pinion", "gear"} <= wanted:
        return "hunting"
    return next((name for name in ("pinion", "gear") if name in wanted), "mesh")


@lru_cache(maxsize=8)
def _passages(mesh: PairMesh, mesh_periods: int) -> Passages:
    return HuntingPeriod(mesh=mesh).first_passages(mesh_periods)


def sampled(mesh: PairMesh, samples: int) -> PairMesh:
    """The mesh with so many samples a mesh period."""
    return mesh if samples == mesh.samples else _sampled(mesh, samples)


@lru_cache(maxsize=16)
def _sampled(mesh: PairMesh, samples: int) -> PairMesh:
    return HuntingPeriod.of(mesh, samples).mesh


def setup_of(model: Model, condition: Condition, period: str, slices: int = 1, samples: int | None = None) -> Setup:
    """The gearbox without effects over one of `PERIODS`.

    samples  a mesh period; the model's own over one, 64 over the longer periods, where None
    """
    z1, z2 = model.mesh.pair.teeth
    mesh_periods = {"mesh": 1, "pinion": z1, "gear": z2, "hunting": lcm(z1, z2)}[common_period([period])]
    if samples is None:
        samples = model.mesh.samples if period == "mesh" else SAMPLES
    mesh = sampled(model.mesh, samples)
    passages, turns = _passages(mesh, mesh_periods), Fraction(mesh_periods, z1)
    return Setup(
        structure=model.structure,
        pair=mesh.pair,
        condition=condition,
        mesh=mesh,
        passages=passages,
        turns=turns,
        any_order=period == "hunting",
        slices=slices,
        stiffness=model.calibration.stiffness_scale,
        damping_time=model.calibration.damping_time,
    )


def contacts_of(setup: Setup, profiles: Sequence[WornProfile]) -> Contacts:
    """The contacts that the solvers see: (3·slices + 3, n), drive flanks slice by slice, then back flanks.

    profiles  one for every slice, or a single one for all
    """
    tables = _Tables.of(setup, profiles)
    m, (p, n), drive = setup.slices, setup.passages.position.shape, len(ROWS)
    speed = setup.omega[0] * setup.pair.base_radius[0]
    k = setup.stiffness * tables.stiffness / m
    e = setup.separation - tables.separation
    rate = -speed * tables.along_s
    for slope, sign in ((setup.slope, 1.0), (tables.along_angle, -1.0)):
        if not (isinstance(slope, float) and slope == 0.0):
            rate = rate + sign * setup.omega[0] * slope

    def rows(values: np.ndarray, whole: float = 1.0) -> np.ndarray:
        """Drive flanks slice by slice, and so many times the back flanks' mean over the slices."""
        alike = values.shape in ((p, n), (1, p, n))
        if m == 1:
            return values.reshape(p, n) if alike else np.ascontiguousarray(np.broadcast_to(values, (1, p, n))[0])
        full, out = np.broadcast_to(values, (m, p, n)), np.empty((m * drive + p - drive, n))
        out[: m * drive].reshape(m, drive, n)[:] = full[:, :drive]
        backs = out[m * drive :]
        if alike:
            backs[:] = full[0, drive:]
        else:
            np.add.reduce(full[:, drive:], axis=0, out=backs)
            backs /= m
        backs *= whole
        return out

    side = setup.passages.side[:, 0]
    return Contacts(
        stiffness=rows(k, m),
        separation=rows(e),
        separation_rate=rows(rate),
        side=np.concatenate((np.ones(drive * m), side[drive:])),
        damping_time=setup.damping_time,
        period=setup.pair.base_pitch / speed * (setup.samples // setup.mesh.samples),
        actions=tuple(_action(setup, along, rows(weight)) for along, weight in setup.actions),
    )


def _action(setup: Setup, along: np.ndarray, weight: np.ndarray) -> Action:
    mean = float(along @ DRIVEN_SHAFT) / float(setup.structure.mesh @ DRIVEN_SHAFT)
    return Action(direction=along, weight=weight, mean=mean)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Tables:
    """Stiffness and separation of the flanks as they are, each to broadcast to (slices, p, n)."""

    stiffness: np.ndarray  # k [N/m]
    separation: np.ndarray  # h + gap [m], positive where material is missing
    along_s: np.ndarray  # its slope as the contact moves along the path [1]
    along_angle: np.ndarray | float  # its slope along θ1 by the shift alone [m/rad]

    @classmethod
    def of(cls, setup: Setup, profiles: Sequence[WornProfile]) -> _Tables:
        if len(profiles) not in (1, setup.slices):
            raise ParameterError(f"{len(profiles)} worn profiles for {setup.slices} slices: one each, or one for all")
        if setup.shift is not None and setup.shift.present:
            return cls._shifted(setup, setup.shift, profiles)
        if setup.samples == setup.mesh.samples:
            return _over_one_period(setup.mesh, tuple(profiles))
        return cls._unshifted(setup.mesh, profiles, setup.samples // setup.mesh.samples)

    @classmethod
    def _unshifted(cls, mesh: PairMesh, profiles: Sequence[WornProfile], periods: int) -> _Tables:
        k, gap, slope = mesh.drive_tables
        k_b, gap_b, slope_b = mesh.back_tables
        worn, worn_slope = _depths(profiles, mesh.positions)
        drive, shape = len(k), (len(profiles), len(k) + len(k_b), k.shape[1])
        separation, along_s = np.empty((2, *shape))
        np.add(gap, worn, out=separation[:, :drive])
        np.add(slope, worn_slope, out=along_s[:, :drive])
        separation[:, drive:] = gap_b + mesh.pair.backlash
        along_s[:, drive:] = -slope_b
        stiffness = np.concatenate((k, k_b))
        if periods > 1:
            stiffness, separation, along_s = (np.tile(x, periods) for x in (stiffness, separation, along_s))
        return cls(stiffness=stiffness, separation=separation, along_s=along_s, along_angle=0.0)

    @classmethod
    def _shifted(cls, setup: Setup, shift: Shift, profiles: Sequence[WornProfile]) -> _Tables:
        mesh, drive = setup.mesh, len(ROWS)
        s, s_b = setup.passages.position[:drive], setup.passages.position[drive:]
        k = mesh.stiffness(s + (shift.pinion + shift.gear) / 2)
        leaving = s > 0
        gap, slope = mesh.corner(s + np.where(leaving, shift.pinion, shift.gear))
        half = 3 / 2 * mesh.pair.base_pitch  # the profiles' grid ends here; nothing touches beyond
        z1, z2 = mesh.pair.teeth
        share = 1 / (1 + z2 / z1)  # of the gear
        h1, slope1 = _depths(profiles, np.clip(s + shift.pinion, -half, half))
        h2, slope2 = _depths(profiles, np.clip(s + shift.gear, -half, half))
        worn, worn_slope = h1 + share * (h2 - h1), slope1 + share * (slope2 - slope1)
        by_angle = (1 - share) * slope1 * shift.pinion_slope + share * slope2 * shift.gear_slope
        by_angle = by_angle + slope * np.where(leaving, shift.pinion_slope, shift.gear_slope)
        periods = setup.samples // mesh.samples
        k_b, gap_b, slope_b = (np.tile(table, periods) for table in mesh.back_tables)
        backs = (len(profiles), *s_b.shape)
        return cls(
            stiffness=np.concatenate((k, k_b)),
            separation=np.concatenate((gap + worn, np.broadcast_to(gap_b + mesh.pair.backlash, backs)), axis=1),
            along_s=np.concatenate((slope + worn_slope, np.broadcast_to(-slope_b, backs)), axis=1),
            along_angle=np.concatenate((by_angle, np.zeros(backs)), axis=1),
        )


@lru_cache(maxsize=16)  # of a sliced face some 0.3 MB each
def _over_one_period(mesh: PairMesh, profiles: tuple[WornProfile, ...]) -> _Tables:
    """Kept, because a fit asks for many states of the same flanks."""
    return _Tables._unshifted(mesh, profiles, 1)


def _depths(profiles: Sequence[WornProfile], s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Depths and slopes of all profiles at s (3, n): (profiles, 3, n) each, by one spline for all of them."""
    first = profiles[0]
    if len(profiles) == 1:
        depth, slope = first.at(s)
        return depth[None], slope[None]
    shape = len(profiles), *s.shape
    values = np.array([profile.depth if profile.depth.ndim == 1 else profile.mean for profile in profiles])
    if not values.any():
        return np.zeros(shape), np.zeros(shape)
    depth, slope = spline(first.positions[0], first.spacing, values, s.ravel())
    return depth.reshape(shape), slope.reshape(shape)
