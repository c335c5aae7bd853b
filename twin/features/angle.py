"""Shaft angle from encoder edges, smoothed.

    φ_k = 2π·(first_index + k)/per_rev        at the time t_k of edge k
    t(θ) = Σ c_i B_i(θ)                       cubic spline through (φ_k, t_k), one knot per 1.5 turns
    θ(t_k) = φ_k + (t_k − t(φ_k))/t'(φ_k)

φ   the encoder's own angle, absolute since the gears were new                              [rad]
θ   the smoothed angle of the pinion: the angle that all orders refer to                    [rad]
t   time after the window's start                                                           [s]

The encoder's angle carries the torsional vibration, the transmission error and the disc's graduation
error; the smoothed angle carries the shaft's slow speed changes only. Edge counts are absolute, so is θ.

Edges that were timed by samples (edge_timing.py) are in error by up to half a sampling interval T, in a saw-tooth at
frac(1/(T·f)) of the pulse rate f and its multiples. A track with a knot every 1.5 turns follows much of it, and so
modulates every line of the machine. Such a track has the fewest pieces, doubled once, whose mean time of every turn
lies no farther from the edges than the timing of a shaft that moves like the track would put it. What is left of the
error is carried along: `errors` are those of the track in `DRAWS` positions of the sampling clock.

Source   P. Borghesani et al., Mech. Syst. Signal Process. 23 (2009) 1–24 (angle from phase);
         C. de Boor, A Practical Guide to Splines (2001), ch. XIV (least squares)
Holds    speed changes slower than one in three turns; no reversal within the window
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import pi

import numpy as np
from scipy.interpolate import BSpline, PPoly, make_lsq_spline
from scipy.linalg import solveh_banded

from twin import compiled
from twin.errors import WindowError
from twin.features.edge_timing import EdgeTiming, edge_timing
from twin.windows import Edges

TURNS_PER_KNOT = 1.5
GROUPS_PER_TURN = 64  # edges are averaged in groups of at most 1/64 turn before the fit
FEWEST_TURNS = 3.0
DRAWS = 4  # positions of the sampling clock, evenly within its interval, in which a track's error is computed
UNIFORM = 1.5 * (0.8**0.5)  # three deviations of the root mean square of n evenly spread errors, times √n
MANY = 12  # values of every piece between knots from which the normal equations are well conditioned


@dataclass(frozen=True, eq=False, kw_only=True)
class AngleTrack:
    """Smoothed absolute pinion angle θ against time t, over one window."""

    start: float  # θ at the first edge [rad]
    stop: float  # θ at the last edge [rad]
    knots: np.ndarray  # θ − start at which a piece of t(θ − start) ends and the next begins (m + 1,) [rad]
    cubics: np.ndarray  # coefficients of (θ − start − knot)³ … ⁰ of every piece (4, m) [s]
    source: str  # which channel the angle comes from
    speed_std: float = 0.0  # standard deviation of the mean speed [Hz]
    errors: tuple[np.ndarray, ...] = ()  # of `cubics`, by the timing of the edges; none where they are exact
    rivals: tuple[float, ...] = ()  # other speeds that the mesh lines suggest nearly as well [Hz]

    @property
    def in_error(self) -> tuple[AngleTrack, ...]:
        """The tracks that the timing of its edges would have made of this one."""
        return tuple(replace(self, cubics=self.cubics + e, errors=()) for e in self.errors)

    @property
    def pieces(self) -> int:
        """Pieces of t(θ): half as many lines beside a line of the window can follow the angle's error."""
        return self.knots.size - 1

    @property
    def doubt(self) -> str:
        """That the speed is one of several candidates; empty where it is not."""
        if not self.rivals:
            return ""
        others = " or ".join(f"{rival:.4g} Hz" for rival in self.rivals)
        return f"the mesh lines fit {self.speed:.4g} Hz and {others}, within a per cent: either may be the speed"

    def time_and_slowness(self, angle) -> tuple[np.ndarray, np.ndarray]:
        """Time [s] and dt/dθ [s/rad] at each smoothed angle [rad]; any shape → two of the same."""
        x = np.asarray(angle - self.start, dtype=float)
        time, slowness = compiled.cubics_at(self.knots, self.cubics, x.ravel())
        return time.reshape(x.shape), slowness.reshape(x.shape)

    def time(self, angle) -> np.ndarray:
        """Time [s] at which the pinion is at each smoothed angle [rad]; (n,) → (n,)."""
        x = np.asarray(angle - self.start, dtype=float)
        return compiled.cubics_at(self.knots, self.cubics, x.ravel(), slopes=False)[0].reshape(x.shape)

    def slowness(self, angle) -> np.ndarray:
        """dt/dθ [s/rad] at each smoothed angle [rad]; (n,) → (n,)."""
        return self.time_and_slowness(angle)[1]

    def angle(self, time, guess) -> np.ndarray:
        """Smoothed angle [rad] at each time [s], from a guess within hundredths of a radian; (n,) → (n,)."""
        at_guess, slowness = self.time_and_slowness(guess)
        return guess + (time - at_guess) / slowness

    @cached_property
    def ends(self) -> tuple[float, float]:
        """Time [s] of the first edge and of the last."""
        first, last = self.time(np.array([self.start, self.stop]))
        return float(first), float(last)

    def angle_at(self, time: float) -> float:
        """Smoothed angle [rad] at one time [s] between the first edge and the last."""
        first, last = self.ends
        angle = self.start + (time - first) / (last - first) * (self.stop - self.start)
        for _ in range(20):
            better = float(np.clip(self.angle(time, angle), self.start, self.stop))
            if abs(better - angle) < 1e-10:
                break
            angle = better
        return better

    @property
    def turns(self) -> float:
        """Pinion turns covered."""
        return (self.stop - self.start) / (2 * pi)

    @property
    def speed(self) -> float:
        """Mean pinion speed [Hz]."""
        first, last = self.ends
        return self.turns / (last - first)

    @property
    def revolutions(self) -> float:
        """Absolute pinion revolutions half-way between the window's first edge and its last."""
        return 0.5 * (self.start + self.stop) / (2 * pi)

    @property
    def speed_variation(self) -> float:
        """Standard deviation of the smoothed speed over its mean."""
        grid = np.linspace(self.start, self.stop, 4 * max(8, int(self.turns)))
        speed = 1 / (2 * pi * self.slowness(grid))
        return float(speed.std() / speed.mean())


def grouped(position, values, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Means of positions and values over groups of `size` neighbours, NaN left out; two of (n,) → of (m,)."""
    if size <= 1:
        keep = np.isfinite(values)
        return position[keep], values[keep]
    n = values.size // size * size
    rows = values[:n].reshape(-1, size)
    good = np.isfinite(rows)
    if good.all():
        return position[:n].reshape(-1, size).sum(axis=1) / size, rows.sum(axis=1) / size
    count = good.sum(axis=1)
    keep = count > 0
    count = count[keep]
    mean_position = np.where(good, position[:n].reshape(-1, size), 0.0).sum(axis=1)[keep] / count
    return mean_position, np.where(good, rows, 0.0).sum(axis=1)[keep] / count


def least_squares_spline(x, y, knots) -> np.ndarray:
    """Coefficients of the cubic spline nearest to y at rising x (n,), by the normal equations; (m + 4,) → (m,).

    Where every piece holds many values these are as good as an orthogonal factorisation, in a fifth of its time.
    """
    design = BSpline.design_matrix(x, knots, 3)
    weights, first, m = design.data.reshape(-1, 4), design.indices[::4], knots.size - 4

    def total(place: int, values: np.ndarray) -> np.ndarray:
        return np.bincount(first + place, weights=weights[:, place] * values, minlength=m)

    band = np.stack([sum(total(i, weights[:, i + lag]) for i in range(4 - lag)) for lag in range(4)])
    return solveh_banded(band, sum(total(i, y) for i in range(4)), lower=True)


def _careful_spline(x, y, knots) -> np.ndarray:
    """The same where some pieces hold few values."""
    return make_lsq_spline(x, y, knots, k=3).c


def _knots(x, span: float, pieces: int) -> tuple[np.ndarray, int]:
    """Even knots over a span (m + 1,), fewer where a piece would stand on nothing; the least values of a piece."""
    while True:
        knots = np.linspace(0.0, span, pieces + 1)
        counts = np.diff(np.append(np.searchsorted(x, knots[:-1]), np.searchsorted(x, span, side="right")))
        if pieces == 1 or ((counts >= 2).all() and x.size >= pieces + 8):
            return knots, int(counts.min())
        pieces = max(1, pieces // 2)


def _spline(x, y, knots: np.ndarray, least: int) -> PPoly:
    """Least-squares cubic spline of y at rising x, (n,) each, on knots (m + 1,) of which none has fewer values."""
    span = knots[-1]
    full = np.concatenate(([0.0] * 3, knots, [span] * 3))
    slope = (y[-1] - y[0]) / (x[-1] - x[0])
    many = least >= MANY and x[0] >= 0 and x[-1] <= span
    fitted = least_squares_spline if many else _careful_spline
    line = slope * np.convolve(full[1:-1], np.ones(3) / 3, "valid")
    whole = PPoly.from_spline((full, fitted(x, y - slope * x, full) + line, 3))
    return PPoly(whole.c[:, 3:-3], whole.x[3:-3])  # without the empty pieces at the ends


def fit_track(
    angle, time, start: float, stop: float, source: str, turns_per_knot: float = TURNS_PER_KNOT
) -> AngleTrack:
    """Least-squares spline of time [s] against absolute angle [rad], (n,) each."""
    span, x = stop - start, angle - start
    pieces = max(1, round(span / (2 * pi * turns_per_knot)))
    if x.size < 5:
        raise WindowError(f"{source}: {x.size} valid edges are too few for a speed")
    knots, least = _knots(x, span, pieces)
    whole = _spline(x, time, knots, least)
    if np.any(compiled.cubics_at(whole.x, whole.c, np.linspace(0, span, 8 * pieces + 1))[1] <= 0):
        raise WindowError(f"{source}: the angle does not rise steadily; encoder reversed, or edges out of order?")
    return AngleTrack(start=start, stop=stop, knots=whole.x, cubics=whole.c, source=source)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _SampledEdges:
    """Edges that were timed by samples, in the groups that the spline is fitted to."""

    angles: np.ndarray  # of every edge (n,) [rad]
    times: np.ndarray  # (n,) [s], NaN where lost
    size: int  # edges of a group
    per_turn: int  # edges of a pinion turn, at least 1
    timing: EdgeTiming

    def errors(self, track: AngleTrack, clock: float) -> np.ndarray:
        """Errors of the edges' times on a shaft that moves like a track (n,) [s]; clock [sampling intervals]."""
        true = track.time(self.angles) + clock * self.timing.interval
        return np.where(np.isfinite(self.times), self.timing.as_timed(true) - true, np.nan)

    def _of_turns(self, values: np.ndarray) -> float:
        """Root mean square of the means of every turn."""
        return float(np.sqrt(np.mean(grouped(self.angles, values, self.per_turn)[1] ** 2)))

    def explains(self, track: AngleTrack) -> bool:
        """Whether the edges lie no farther from a track than their timing would put them."""
        turns = self.times.size / self.per_turn
        expected = np.mean([self._of_turns(self.errors(track, (i + 0.5) / DRAWS)) for i in range(DRAWS)])
        return self._of_turns(self.times - track.time(self.angles)) <= expected * (1 + UNIFORM / np.sqrt(turns))

    def smoothest(self, track: AngleTrack, fitted: Callable[[int], AngleTrack]) -> AngleTrack:
        """The track of the fewest pieces, doubled once, that the timing explains; one that it does not stays."""
        if not self.explains(track):
            return track
        most, pieces = track.pieces, 1
        while pieces < most and not self._serves(fitted, pieces):
            pieces *= 2
        return fitted(min(2 * pieces, most))

    def _serves(self, fitted: Callable[[int], AngleTrack], pieces: int) -> bool:
        """Whether the timing explains the edges beside a track of so few pieces; not where its angle falls."""
        try:
            return self.explains(fitted(pieces))
        except WindowError:
            return False

    def with_errors(self, track: AngleTrack) -> AngleTrack:
        """A track with its errors, without their mean: an angle that is late throughout is the same angle."""
        span, pieces = track.knots[-1], track.pieces
        out = []
        for i in range(DRAWS):
            at, error = grouped(self.angles - track.start, self.errors(track, (i + 0.5) / DRAWS), self.size)
            out.append(_spline(at, error - error.mean(), *_knots(at, span, pieces)).c)
        return replace(track, errors=tuple(out))


def edge_angles(edges: Edges, ratio: float = 1.0) -> np.ndarray:
    """The encoder's absolute angle at each edge [rad], times a speed ratio to the pinion; (n,)."""
    return (edges.first_index + np.arange(edges.times.size)) * (2 * pi * ratio / edges.per_rev)


def angle_track(
    edges: Edges, ratio: float = 1.0, source: str = "encoder/pinion", rates: Sequence[float] = ()
) -> AngleTrack:
    """The smoothed absolute pinion angle from one shaft's edges.

    ratio   pinion turns per turn of the encoder's shaft (z2/z1 for the gear's encoder); the zero of
            the angle is then that encoder's edge 0
    rates   sampling rates by which the edges may have been timed [Hz]
    """
    good = np.flatnonzero(np.isfinite(edges.times))
    turns = (good[-1] - good[0]) / edges.per_rev * ratio if good.size else 0.0
    if turns < FEWEST_TURNS:
        raise WindowError(f"{source}: valid edges cover {turns:.2f} pinion turns; at least {FEWEST_TURNS:g} are needed")
    if np.any(np.diff(edges.times[good]) <= 0):
        raise WindowError(f"{source}: edge times do not rise; encoder reversed, or frames out of order?")
    angles = edge_angles(edges, ratio)
    size = int(edges.per_rev / ratio / GROUPS_PER_TURN)
    mean_angle, mean_time = grouped(angles, edges.times, size)
    start, stop = float(angles[good[0]]), float(angles[good[-1]])
    track = fit_track(mean_angle, mean_time, start, stop, source)

    def rest(values: np.ndarray) -> tuple[np.ndarray, int]:
        x, knots = angles[good] - start, track.knots
        return values - _spline(x, values, *_knots(x, knots[-1], track.pieces))(x), track.pieces + 3

    timing = edge_timing(edges.times[good], rates, rest if size <= 1 else None)
    if timing is None:
        return track

    def fitted(pieces: int) -> AngleTrack:
        return fit_track(mean_angle, mean_time, start, stop, source, (stop - start) / (2 * pi * pieces))

    used, per_turn = slice(good[0], good[-1] + 1), max(1, round(edges.per_rev / ratio))
    sampled = _SampledEdges(angles=angles[used], times=edges.times[used], size=size, per_turn=per_turn, timing=timing)
    return sampled.with_errors(sampled.smoothest(track, fitted))
