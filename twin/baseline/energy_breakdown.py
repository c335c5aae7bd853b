"""The energy of a window by origin: mesh, either shaft, both together, lines of no shaft, and the rest.

    share  = ½·Σ_lines E/rms²,  E = ⟨|X|²⟩ − floor     steady = Σ (S·|⟨X⟩|² − ⟨|X|²⟩)/(S − 1) / Σ E
    fixed  = Σ E·(S·|⟨c⟩|²/⟨|c|²⟩ − 1)/(S − 1) / Σ E    c = mean over a stretch of e^{i·o·(2π·v·t(θ) − θ)}

X        complex line in each of S stretches of the window, against the pinion's angle; ⟨ ⟩ the mean over them
share    of the channel's energy; its standard deviation is that from stretch to stretch
steady   how much of a family's energy keeps its phase against the angle, without bias: 1 for what turns with the
         shafts, 0 for what comes and goes
fixed    the same share for tones of fixed frequency at these orders o of the mean speed v, on this track: where it is
         as close to 1, the speed was too even to distinguish rotation from fixed frequency; for lines of no shaft about
         the mesh harmonics, only the modulation is taken as fixed

A line of no shaft is evaluated at its own order: a component that turns at a fixed ratio is as steady as a shaft, one
that slips is not.

Source   power of a coherent mean without bias: S. Braun, Acustica 32 (1975) 69–77
Holds    stretches of at least `least_turns` and four common periods of the shafts; up to the highest order that is read
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from twin.baseline.reading import HIGHEST, TURNS_PER_PERIOD, USABLE, common_period, lines_of, part_of
from twin.baseline.spacing import Spacing
from twin.baseline.spacing_search import SpacingSearchThresholds
from twin.closed_forms import chirp_transform
from twin.errors import WindowError
from twin.features.angle import AngleTrack
from twin.features.resample import AngleSignal, on_angle, spline_response
from twin.features.transforms import hann
from twin.thresholds import deciding
from twin.windows import Samples

STRETCHES = 4
POINTS = 8  # a turn, at which the slow course of the speed is taken
MULTIPLES = 6  # of an unattributed spacing to either side of a mesh harmonic
FAMILIES = ("mesh", "pinion", "gear", "both shafts", "no shaft")


@dataclass(frozen=True, slots=True, kw_only=True)
class EnergyThresholds:
    """When the energy of a window can be broken down."""

    least_turns: float = deciding(
        20.0, unit="turns of the pinion", meaning="length of one of the stretches whose phases are compared",
        source="not derived: 20 turns resolve a twentieth of an order",
    )  # fmt: skip


DEFAULT = EnergyThresholds()


@dataclass(frozen=True, slots=True, kw_only=True)
class Family:
    """The lines of one origin in one channel."""

    channel: str
    name: str  # of `FAMILIES`
    share: float  # of the channel's energy
    share_std: float
    steady: float | None  # None where there is no energy above the floor
    steady_if_fixed: float | None  # what tones of fixed frequency in place of these lines would have


def energy_breakdown(
    accelerations: Mapping[str, Samples],
    track: AngleTrack,
    teeth: tuple[int, int],
    shafts: Sequence[Fraction],
    spacings: Sequence[Spacing] = (),
    limits: EnergyThresholds = DEFAULT,
) -> list[Family]:
    """Shares of every channel's energy by family.

    shafts   orders of the pinion, of the gear and of what else is geared to them
    spacings  of lines that no shaft makes
    Raises WindowError where the window is too short.
    """
    Q = common_period(shafts)
    least = STRETCHES * max(limits.least_turns, TURNS_PER_PERIOD * Q)
    out = []
    for name, samples in accelerations.items():
        signal, per_turn = on_angle(samples, track, samples.values.size)
        if signal.turns < least:
            raise WindowError(
                f"{signal.turns:.0f} pinion turns are too few to attribute lines to shafts: at least {least:.0f}"
            )
        stretches = [part_of(signal, (i / STRETCHES, (i + 1) / STRETCHES)) for i in range(STRETCHES)]
        read = [lines_of(stretch, per_turn, Q) for stretch in stretches]
        rms2 = np.array([r.rms**2 for r in read])
        lines = np.array([r.lines for r in read])
        floor = np.array([r.floor for r in read])
        kind = _kinds(lines.shape[1], Q, teeth, shafts)
        orders = np.arange(1, lines.shape[1] + 1) / Q
        for i, family in enumerate(FAMILIES[:-1]):
            own = kind == i
            tones = _fixed(track, stretches, orders[own])
            out.append(_family(name, family, lines[:, own], floor[:, own], rms2, tones))
        if spacings:
            own, at, tones = _of_no_shaft(spacings, track, stretches, teeth[0], Q, per_turn)
            near = np.clip(np.rint(at * Q).astype(int) - 1, 0, floor.shape[1] - 1)
            out.append(_family(name, FAMILIES[-1], own, floor[:, near], rms2, tones))
    return out


def _of_no_shaft(
    spacings: Sequence[Spacing], track: AngleTrack, stretches: Sequence[AngleSignal], z1: int, Q: int, per_turn: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lines of all spacings, each once: of every stretch, their orders (n,), and tones (stretches, n)."""
    lines, orders, tones = [], [np.zeros(0)], []
    for spacing in spacings:
        turns = stretches[0].turns
        grid, apart = _orders(spacing, z1, Q, per_turn, turns)
        reach = SpacingSearchThresholds().known_lines / turns
        apart &= (np.abs(grid[..., None] - np.concatenate(orders)) > reach).all(axis=-1)
        modulation = np.broadcast_to(spacing.order * np.arange(-MULTIPLES, MULTIPLES + 1), grid.shape)
        lines.append(_at(stretches, grid, spacing.order, per_turn)[:, apart])
        orders.append(grid[apart])
        tones.append(_fixed(track, stretches, modulation[apart]))
    return np.concatenate(lines, axis=1), np.concatenate(orders), np.concatenate(tones, axis=1)


def _kinds(count: int, Q: int, teeth: tuple[int, int], shafts: Sequence[Fraction]) -> np.ndarray:
    """Index of the family of every line k/Q, k = 1 … count."""
    k = np.arange(1, count + 1)
    pinion, gear = k % Q == 0, (k * shafts[1].denominator) % (Q * shafts[1].numerator) == 0
    kind = np.full(count, FAMILIES.index("both shafts"))
    kind[gear] = FAMILIES.index("gear")
    kind[pinion] = FAMILIES.index("pinion")
    kind[pinion & (k % (Q * teeth[0]) == 0)] = FAMILIES.index("mesh")
    return kind


def _orders(spacing: Spacing, z1: int, Q: int, per_turn: float, turns: float) -> tuple[np.ndarray, np.ndarray]:
    """Orders of the lines of no shaft (mesh harmonics from 0, multiples), and which are read: none that a shaft has."""
    multiples = np.arange(-MULTIPLES, MULTIPLES + 1)
    top = min(HIGHEST, USABLE * per_turn)
    grid = np.arange(int(top // z1) + 1)[:, None] * z1 + multiples * spacing.order
    apart = np.abs(grid * Q - np.rint(grid * Q)) / Q > SpacingSearchThresholds().known_lines / turns
    return grid, apart & (multiples != 0) & (grid > 0) & (grid < top)


def _at(stretches: Sequence[AngleSignal], grid: np.ndarray, spacing: float, per_turn: float) -> np.ndarray:
    """Complex lines of every stretch at orders that go by the spacing along every row; (stretches, *grid)."""
    step, out = stretches[0].step, []
    plans: dict[int, Callable[[np.ndarray], np.ndarray]] = {}
    for stretch in stretches:
        n = stretch.values.size
        plan = plans.get(n) or plans.setdefault(n, chirp_transform(n, grid.shape[1], step * spacing))
        weight = hann(n)
        values = 2 * (stretch.values - stretch.values.mean()) * weight / weight.sum()
        turning = np.exp(-1j * step * grid[:, :1] * np.arange(n))
        out.append(plan(values * turning) * np.exp(-1j * grid * stretch.start))
    return np.array(out) / spline_response(grid / per_turn)


def _fixed(track: AngleTrack, stretches: Sequence[AngleSignal], orders: np.ndarray) -> np.ndarray:
    """c of tones of unit size and fixed frequency at orders (n,) of the mean speed; (stretches, n)."""
    out = []
    for stretch in stretches:
        angle = stretch.start + stretch.step * np.arange(0, stretch.values.size)
        angle = angle[:: max(1, int(2 * np.pi / POINTS / stretch.step))]
        weight = hann(angle.size)
        ahead = 2 * np.pi * track.speed * track.time(angle) - angle
        out.append(np.exp(1j * np.outer(orders, ahead)) @ (weight / weight.sum()))
    return np.array(out)


def _kept(lines: np.ndarray) -> np.ndarray:
    """|⟨X⟩|² of lines (stretches, n) without bias; (n,)."""
    S = lines.shape[0]
    return (S * np.abs(lines.mean(axis=0)) ** 2 - np.mean(np.abs(lines) ** 2, axis=0)) / (S - 1)


def _family(
    channel: str, name: str, lines: np.ndarray, floor: np.ndarray, rms2: np.ndarray, tones: np.ndarray
) -> Family:
    """Lines, floors and c of fixed tones in their place (stretches, lines), energies of the stretches."""
    power = np.maximum(np.sum(np.abs(lines) ** 2 - floor, axis=1), 0.0)
    share = 0.5 * power / rms2
    own = np.mean(np.abs(lines) ** 2 - floor, axis=0)
    energy, above = float(own.sum()), np.maximum(own, 0.0)
    fixed = _kept(tones) / np.mean(np.abs(tones) ** 2, axis=0)
    return Family(
        channel=channel,
        name=name,
        share=float(share.mean()),
        share_std=float(share.std(ddof=1) / np.sqrt(share.size)),
        steady=float(np.clip(_kept(lines).sum() / energy, 0.0, 1.0)) if energy > 0 else None,
        steady_if_fixed=float(np.clip(above @ fixed / above.sum(), 0.0, 1.0)) if energy > 0 else None,
    )
