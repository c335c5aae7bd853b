"""Transmission error from the two encoders, by phase demodulation.

    TE = r_b1·(θ1 − θ2·z2/z1)                      along the line of action, positive: teeth pressed together
       = r_b1·(Δ1(θ) − Δ2(θ)),    Δ = φ − θ

φ1      pinion encoder's angle                                                        [rad]
φ2      gear encoder's angle times z2/z1                                              [rad]
θ       smoothed pinion angle (angle.py)                                              [rad]
Δ       what an encoder's angle departs from θ, known at its edges, φ(t_k) − θ(t_k)   [rad]

Each encoder's Δ is interpolated on its own even grid of edges by quintic splines to an even grid of θ (the
function's argument is θ, but the edges are even in φ: two fixed-point steps φ = θ + Δ(φ), on straight lines,
find φ to Δ'·1e-3·Δ). What the spline takes from a line of order o, with P edges per pinion turn, H(o/P), is
given back to the lines that are read out.

Edge counts are absolute, so the mean of TE is kept: it is a constant (how the discs are mounted) plus the
mean deflection of the teeth and what wear has taken off them. r_b2 = r_b1·z2/z1 exactly.

Source   P. Sweeney, R. Randall, Proc. IMechE C 210 (1996) 201–213;
         D. Remond, Meas. Sci. Technol. 9 (1998) 347–353
Holds    Δ well below one edge spacing's worth of folding: |dΔ/dθ| much less than 1
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from math import pi

import numpy as np

from twin import compiled
from twin.errors import NotAvailable, WindowError
from twin.features.angle import AngleTrack, angle_track
from twin.features.gaps import filled, runs
from twin.features.resample import AngleSignal, at, coefficients, spline_response
from twin.windows import Edges

LONGEST_GAP = 4  # edges that a straight line may bridge


@dataclass(frozen=True, slots=True, kw_only=True)
class TransmissionError:
    """TE on an even grid of smoothed pinion angle, as its pinion part minus its gear part."""

    pinion: AngleSignal  # r_b1·Δ1 [m, or rad where r_b1 is not known]
    gear: AngleSignal  # r_b1·Δ2, without `offset`, on the same grid
    offset: float  # constant part of TE [m or rad]
    edges_per_turn: tuple[float, float]  # edges of the two encoders per pinion turn
    unit: str  # m, or rad (at the pinion)

    @property
    def signal(self) -> AngleSignal:
        """TE itself, with its mean."""
        return AngleSignal(
            start=self.pinion.start,
            step=self.pinion.step,
            values=self.pinion.values - self.gear.values + self.offset,
            usable=self.pinion.usable & self.gear.usable,
        )

    def responses(self, orders) -> tuple[np.ndarray, np.ndarray]:
        """What interpolation left of each order in the pinion's and the gear's part; two of (n,)."""
        p1, p2 = self.edges_per_turn
        return spline_response(np.asarray(orders) / p1), spline_response(np.asarray(orders) / p2)


def departure(edges: Edges, ratio: float, track: AngleTrack, shift: float, grid) -> tuple[np.ndarray, np.ndarray]:
    """Δ of one encoder at each angle of an even grid, and where it may be used.

    ratio   pinion turns per turn of the encoder's shaft
    shift   added to the encoder's angle to bring it near θ [rad]
    grid    smoothed pinion angles [rad], (n,)
    returns Δ [rad] (n,) and a mask (n,)
    """
    spacing = 2 * pi * ratio / edges.per_rev
    φ0 = edges.first_index * spacing + shift
    times, usable = filled(edges.times, LONGEST_GAP)
    φ = φ0 + spacing * np.arange(times.size)
    Δ = φ - track.angle(times, φ)
    whole = bool(usable.all())
    for start, stop in () if whole else runs(~usable):  # a straight line in Δ, not in time, where edges are lost
        before, after = Δ[max(start - 1, 0)], Δ[min(stop, Δ.size - 1)]
        ends = (after, after) if start == 0 else (before, before if stop == Δ.size else after)
        Δ[start:stop] = np.linspace(*ends, stop - start + 2)[1:-1]
    position = (grid - φ0) / spacing
    for _ in range(2):
        position = (grid + compiled.linear_at(Δ, position) - φ0) / spacing
    inside = (position > -0.5) & (position < times.size - 0.5)
    if not whole:
        inside &= usable[np.clip(np.rint(position).astype(int), 0, times.size - 1)]
    return at(coefficients(Δ), position), inside


def pinion_motion(pinion: Edges, base_radius: float | None, track: AngleTrack) -> tuple[AngleSignal, str]:
    """r_b1·Δ1, the pinion's own motion about its smoothed rotation, and its unit; from the pinion's encoder alone.

    At mesh orders the mesh force turns the light pinion by most of what transmission error shows, so that one
    encoder tells nearly as much as two; the mean and the slow rest are taken up by the smoothed rotation.
    """
    step = 2 * pi / pinion.per_rev
    grid = np.arange(track.start + step, track.stop - step, step)
    Δ, usable = departure(pinion, 1.0, track, 0.0, grid)
    scale, unit = (1.0, "rad") if base_radius is None else (base_radius, "m")
    return AngleSignal(start=float(grid[0]), step=step, values=scale * Δ, usable=usable), unit


def transmission_error(
    pinion: Edges,
    gear: Edges,
    teeth: tuple[int, int],
    base_radius: float | None,
    track: AngleTrack | None = None,
) -> TransmissionError:
    """TE over one window from the edges of both encoders.

    base_radius  r_b1 [m]; None gives TE as an angle at the pinion [rad]
    track        smoothed pinion angle, from the pinion's encoder where not given
    """
    z1, z2 = teeth
    per_turn = (float(pinion.per_rev), gear.per_rev * z1 / z2)
    if min(per_turn) < 2 * z1:
        raise NotAvailable(
            f"transmission error is not available: {min(per_turn):.4g} encoder edges per pinion turn do not "
            f"resolve the mesh order {z1}; at least {2 * z1} are needed"
        )
    track = track or angle_track(pinion)
    counted = 2 * pi * float(Fraction(gear.first_index * z2, gear.per_rev * z1))
    first = np.flatnonzero(np.isfinite(gear.times))
    if first.size < 8:
        raise WindowError(f"encoder/gear: {first.size} valid edges are too few for a transmission error")
    if np.any(np.diff(gear.times[first]) <= 0):
        raise WindowError("encoder/gear: edge times do not rise; encoder reversed, or frames out of order?")
    # bring the gear's angle near θ: whole difference at its middle edge, then kept exactly in `offset`
    k = int(first[first.size // 2])
    φ = counted + k * 2 * pi * z2 / (gear.per_rev * z1)
    middle = track.angle_at(float(gear.times[k]))
    shift = middle - φ
    spacing = 2 * pi * z2 / (gear.per_rev * z1)
    low = max(track.start, counted + shift) + spacing
    high = min(track.stop, counted + shift + (gear.times.size - 1) * spacing) - spacing
    if not high - low > 3 * 2 * pi:
        raise WindowError(f"transmission error: both encoders cover only {max(0, high - low) / (2 * pi):.2f} turns")
    step = 2 * pi / max(per_turn)
    grid = low + step * np.arange(int((high - low) / step))
    Δ1, good1 = departure(pinion, 1.0, track, 0.0, grid)
    Δ2, good2 = departure(gear, z2 / z1, track, shift, grid)
    scale = 1.0 if base_radius is None else base_radius

    def part(values, usable):
        return AngleSignal(start=low, step=step, values=scale * values, usable=usable)

    return TransmissionError(
        pinion=part(Δ1, good1),
        gear=part(Δ2, good2),
        offset=scale * shift,
        edges_per_turn=per_turn,
        unit="rad" if base_radius is None else "m",
    )
