"""One wear history by depth, computed only as far as somebody asks.

The points of a history depend on the model, the operating condition and the profile that it starts from, and on
nothing else: computing ten more gives the same ten whoever asks for them and when. So a path is a growing cache of a
pure function. It ends where no steady state is found, or at `furthest`. The points of a path can be kept and given to
another (`kept`): that computes them again only where somebody asks for points behind them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from twin.dynamics.harmonic_balance import SteadyState
from twin.errors import NotConverged
from twin.model import Condition, Model
from twin.wear.evolution import FINE, StepSizes, WearPoint, evolve
from twin.wear.kept_points import KeptPoints
from twin.wear.law_of_rig import law_of
from twin.wear.profile import WornProfile

LINES = 12  # mesh harmonics kept of every response
FIRST = slice(1, LINES + 1)
SAME = 1e-4  # relative difference of largest depths that the cubic of the largest depth may leave
STATES, PROFILES = 2, 4  # steady states and profiles that a path holds to go on from: its last ones, and those between


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MeshLines:
    """Complex lines of mesh harmonics 1 … LINES of one steady state, (LINES,) each, and the mean."""

    transmission_error: np.ndarray  # [m]
    mean: float  # of the transmission error [m]
    pinion_motion: np.ndarray  # r_b1·θ7 [m]
    acceleration: np.ndarray  # [m/s²]

    @classmethod
    def of(cls, model: Model, steady: SteadyState, condition: Condition) -> MeshLines:
        return cls(
            transmission_error=model.transmission_error_lines(steady, FIRST),
            mean=model.mean_transmission_error(steady, condition),
            pinion_motion=model.pinion_motion_lines(steady, FIRST),
            acceleration=model.acceleration_lines(steady, FIRST),
        )


class WearPath:
    """Depth, work, profile and lines of one wear history, in order of depth."""

    def __init__(
        self,
        model: Model,
        condition: Condition,
        start: WornProfile,
        furthest: float,
        steps: StepSizes = FINE,
        kept: KeptPoints | None = None,
    ) -> None:
        """Solves the first steady state, or has the points that are given.

        furthest  largest combined depth [m] to which the history is computed at all
        steps     between its points
        kept      points that an equal path has computed
        Raises NotConverged where the start profile has no steady state.
        """
        self.condition = condition
        self.start = start.across(model.slices)
        self.furthest = furthest
        self.ended: bool = False  # whether nothing follows the last point
        self.converged: bool = True  # False where the path ended because no steady state was found
        self.lines: list[MeshLines] = []
        self.profiles: list[np.ndarray] = []
        self.rates: list[np.ndarray] = []  # dh/dx of each profile [m·N/rad]
        self.lost: list[float] = []  # depths at which the teeth part for some of the mesh [m]
        self._model = model
        self._law = law_of(model.rig)
        self._depth: list[float] = []
        self._work: list[float] = []
        self._arrays = np.empty(0), np.empty(0)
        self._last: WearPoint | None = None
        self._tables: dict[str, np.ndarray] = {}
        self._source: Iterator[WearPoint] = evolve(
            model.mesh,
            lambda p, s: model.steady(p, condition, s),
            self.start,
            model.calibration.contact_half_width,
            furthest,
            largest_step=steps.largest,
            step=steps.size,
            by_slice=steps.by_slice,
            law=self._law,
        )
        if kept is None:
            self._advance()
        else:
            self._restore(kept)
        if not self._depth:
            raise NotConverged(
                f"no steady state at the start of wear ({condition.speed_hz:g} Hz, {condition.torque:g} N·m)"
            )

    def _advance(self) -> None:
        """Computes one more point, or ends the path."""
        try:
            point = next(self._source, None)
        except NotConverged:
            self.ended, self.converged = True, False
            return
        if point is None:
            self.ended = True
            return
        depth = point.profile.max_depth
        if self._depth and depth <= self._depth[-1]:
            return
        self._depth.append(depth)
        self._work.append(point.work)
        self.profiles.append(point.profile.depth)
        self.rates.append(point.rate)
        self.lines.append(MeshLines.of(self._model, point.steady, self.condition))
        if point.steady.contact_loss > 0:
            self.lost.append(depth)
        self._last = point

    def _restore(self, kept: KeptPoints) -> None:
        """Takes points over; the first that is asked for behind them has all of them computed again."""
        self.ended, self.converged, self.lost = kept.ended, kept.converged, kept.lost.tolist()
        self.profiles, self.rates = list(kept.profiles), list(kept.rates)
        self.lines = [
            MeshLines(transmission_error=error, mean=mean, pinion_motion=motion, acceleration=acceleration)
            for (error, motion, acceleration), mean in zip(kept.lines, kept.means.tolist(), strict=True)
        ]
        self._depth, self._work = kept.depth.tolist(), kept.work.tolist()

    @property
    def kept(self) -> KeptPoints:
        """The points computed so far."""
        depth, work = self.points
        lines = [(line.transmission_error, line.pinion_motion, line.acceleration) for line in self.lines]
        return KeptPoints(
            depth=depth,
            work=work,
            profiles=np.array(self.profiles),
            rates=np.array(self.rates),
            lines=np.array(lines),
            means=np.array([line.mean for line in self.lines]),
            lost=np.array(self.lost),
            ended=self.ended,
            converged=self.converged,
        )

    def reach(self, depth: float) -> None:
        """Computes on until a depth [m] is passed or the path ends."""
        while not self.ended and self._depth[-1] < depth:
            self._advance()

    def reach_work(self, work: float) -> None:
        """Computes on until a work [rad/N] is passed or the path ends."""
        while not self.ended and self._work[-1] < work:
            self._advance()

    @property
    def points(self) -> tuple[np.ndarray, np.ndarray]:
        """Depth [m] and work [rad/N] of the points computed so far, (m,) each."""
        if self._arrays[0].size != len(self._depth):
            self._arrays = np.array(self._depth), np.array(self._work)
        return self._arrays

    def table(self, quantity: str) -> np.ndarray:
        """One quantity of `MeshLines` at all points computed so far, (m, LINES) or, of the mean, (m,)."""
        kept = self._tables.get(quantity)
        if kept is None or len(kept) != len(self.lines):
            kept = self._tables[quantity] = np.array([getattr(lines, quantity) for lines in self.lines])
        return kept

    @property
    def nbytes(self) -> int:
        """Memory of the points computed so far, and of the states to go on from [bytes]."""
        lines = 3 * LINES * 16
        points = len(self._depth) * (2 * self.profiles[0].nbytes + lines + 64)
        tables = sum(table.nbytes for table in self._tables.values())
        states = (
            0 if self._last is None else STATES * self._last.steady.nbytes + PROFILES * self._last.profile.depth.nbytes
        )
        return points + tables + states

    def profile_at(self, depth: float) -> np.ndarray:
        """The profile of a depth [m] between two points, (p,) or (slices, p): by cubics over work, with both rates.

        The cubic of the largest depth says where between the points the depth is reached; where another place becomes
        the deepest between them, the profile's own depth does.
        """
        self.reach(depth)
        known, work = self.points
        i = min(max(int(np.searchsorted(known, depth, side="right")) - 1, 0), known.size - 2)
        dx = float(work[i + 1] - work[i])
        ends = float(known[i]), float(known[i + 1]), dx * self._deepening(i), dx * self._deepening(i + 1)
        sides = self.profiles[i], self.profiles[i + 1], dx * self.rates[i], dx * self.rates[i + 1]
        active = self.start.on_active

        def deepest(t: float) -> float:
            at = _between(*sides, t)
            return float((at if at.ndim == 1 else at.mean(axis=0))[active].max())

        t = brentq(lambda t: float(_between(*ends, t)) - depth, 0.0, 1.0, xtol=1e-14)
        if abs(deepest(t) - depth) > SAME * depth:
            t = brentq(lambda t: deepest(t) - depth, 0.0, 1.0, xtol=1e-9)
        return _between(*sides, t)

    def _deepening(self, i: int) -> float:
        """How fast the largest depth of a point grows [m·N/rad]."""
        depth, rate = (a if a.ndim == 1 else a.mean(axis=0) for a in (self.profiles[i], self.rates[i]))
        active = self.start.on_active
        return float(rate[active][np.argmax(depth[active])]) if depth.any() else float(rate[active].max())


def _between(left, right, left_rate, right_rate, t: float):
    """The cubic with two values and, over the way between them, two rates, at a share t of the way; any shape."""
    u = 1 - t
    return (1 + 2 * t) * u * u * left + t * t * (3 - 2 * t) * right + t * u * (u * left_rate - t * right_rate)
