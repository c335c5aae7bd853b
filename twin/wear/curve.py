"""The master curve as data: profile, work and steady response against the largest depth.

    x = K·τ·ω1·N        profile(d), x(d) and the steady lines of the condition it was made for

Points are computed as far as a reading needs them (twin.wear.path). Beyond the depth at which no steady state was
found, or at which the path ends, the last wear rate is held: values there are an extrapolation, and the response there
is not known. `valid_to` says where that begins.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from twin.errors import NotConverged, ParameterError
from twin.model import Condition, Model
from twin.wear.evolution import FINE, StepSizes
from twin.wear.path import LINES, MeshLines, WearPath
from twin.wear.profile import WornProfile

__all__ = ["LINES", "MasterCurve", "MeshLines"]


@dataclass(frozen=True, eq=False, kw_only=True)
class MasterCurve:
    """Wear under one operating condition from a start profile, by depth."""

    path: WearPath
    limit: float  # depth to which steady states are sought for a search or a statement of validity [m]

    @classmethod
    def begin(
        cls, model: Model, condition: Condition, start: WornProfile, limit: float, steps: StepSizes = FINE
    ) -> MasterCurve:
        """A curve with its first point; the others follow as readings need them, to `limit` [m] at most."""
        return cls(path=WearPath(model, condition, start, limit, steps), limit=limit)

    @classmethod
    def build(cls, model: Model, condition: Condition, start: WornProfile, until_depth: float) -> MasterCurve:
        """Wears the profile on until `until_depth` [m] or until no steady state is found, at once."""
        curve = cls.begin(model, condition, start, until_depth)
        curve.path.reach(until_depth)
        return curve

    @property
    def condition(self) -> Condition:
        return self.path.condition

    @property
    def start(self) -> WornProfile:
        return self.path.start

    @property
    def start_depth(self) -> float:
        """Largest depth of the start profile [m]."""
        return float(self.path.points[0][0])

    @property
    def depth(self) -> np.ndarray:
        """Largest combined depths of the points computed so far (m,) [m], strictly rising."""
        return self.path.points[0]

    @property
    def work(self) -> np.ndarray:
        """x of the points computed so far (m,) [rad/N], strictly rising."""
        return self.path.points[1]

    @property
    def profiles(self) -> np.ndarray:
        """Combined depth along the path of contact (m, p), or of every slice (m, slices, p) [m]; so far."""
        return np.array(self.path.profiles)

    @property
    def transmission_error(self) -> np.ndarray:
        """Complex lines of mesh harmonics 1 … LINES (m, LINES) [m]; so far."""
        return np.array([line.transmission_error for line in self.path.lines])

    @property
    def mean_transmission_error(self) -> np.ndarray:
        """(m,) [m]; so far."""
        return np.array([line.mean for line in self.path.lines])

    @property
    def acceleration(self) -> np.ndarray:
        """Complex lines (m, LINES) [m/s²]; so far."""
        return np.array([line.acceleration for line in self.path.lines])

    def valid_within(self, depth: float) -> float:
        """The first point [m] at or beyond a depth [m], or the deepest with a steady state where that is less."""
        self.path.reach(depth)
        known = self.depth
        return float(known[min(int(np.searchsorted(known, depth)), known.size - 1)])

    @property
    def valid_to(self) -> float:
        """Deepest wear with a steady state [m], to the limit of the curve; computes as far."""
        return self.valid_within(self.limit)

    @property
    def complete(self) -> bool:
        """Whether the limit is reached with a steady state."""
        return self.valid_to >= self.limit

    @property
    def loss_from(self) -> float | None:
        """Depth from which the teeth part for some of the mesh [m], None if not within the limit."""
        end = self.valid_to
        return min((d for d in self.path.lost if d <= end), default=None)

    @cached_property
    def _end_rate(self) -> tuple[np.ndarray, float]:
        """dh/dx held beyond the last point of the path, and d(depth)/dx there [m·N/rad]."""
        rate = self.path.rates[-1]
        face = rate if rate.ndim == 1 else rate.mean(axis=0)
        return rate, float(face[self.start.on_active].max())

    def profile(self, depth: float) -> WornProfile:
        """The worn profile of a largest depth [m], at or beyond the start's; NotConverged where wear has ended."""
        if depth < self.start_depth - 1e-12:
            raise ParameterError(
                f"depth = {depth * 1e6:.2f} µm lies before the curve's start at {self.start_depth * 1e6:.2f} µm"
            )
        path, depth = self.path, max(depth, self.start_depth)
        path.reach(depth)
        known = self.depth
        if depth > known[-1]:
            rate, by_depth = self._end_rate
            if not by_depth > 0:
                raise NotConverged(f"no wear goes on beyond {known[-1] * 1e6:.1f} µm: the teeth do not touch there")
            worn = path.profiles[-1] + rate * (depth - float(known[-1])) / by_depth
        elif depth == self.start_depth:
            worn = path.profiles[0]
        else:
            worn = path.profile_at(depth)
        return WornProfile(positions=self.start.positions, depth=worn, active=self.start.active)

    def work_at(self, depth: float) -> float:
        """x [rad/N] at which the largest depth is reached."""
        self.path.reach(depth)
        known, work = self.path.points
        if depth > known[-1]:
            return float(work[-1] + (depth - known[-1]) / self._end_rate[1])
        return float(np.interp(depth, known, work))

    def work_per_depth(self, depth: float) -> float:
        """dx/d(depth) [rad/(N·m)]."""
        step = 1e-6
        return (self.work_at(depth + step) - self.work_at(depth)) / step

    def depth_at(self, work: float) -> float:
        """Largest depth [m] after x [rad/N]."""
        self.path.reach_work(work)
        known, x = self.path.points
        if work > x[-1]:
            return float(known[-1] + (work - x[-1]) * self._end_rate[1])
        return float(np.interp(work, x, known))

    def lines_at(self, depth: float) -> MeshLines:
        """The condition's lines at a depth [m]; held beyond the end."""
        self.path.reach(depth)
        known, lines = self.depth, self.path.lines
        if known.size == 1:
            return lines[0]
        i = min(max(int(np.searchsorted(known, depth)) - 1, 0), known.size - 2)
        t = min(max(float((depth - known[i]) / (known[i + 1] - known[i])), 0.0), 1.0)
        a, b = lines[i], lines[i + 1]
        return MeshLines(
            transmission_error=(1 - t) * a.transmission_error + t * b.transmission_error,
            mean=(1 - t) * a.mean + t * b.mean,
            pinion_motion=(1 - t) * a.pinion_motion + t * b.pinion_motion,
            acceleration=(1 - t) * a.acceleration + t * b.acceleration,
        )

    def over(self, depths: np.ndarray, *quantities: str, most: int = LINES) -> list[np.ndarray]:
        """Quantities of `lines_at` at several depths (m,) [m]: the first lines (m, most) each, or (m,) of the mean."""
        self.path.reach(float(depths.max()))
        known = self.depth
        tables = [self.path.table(quantity) for quantity in quantities]
        tables = [table if table.ndim == 1 else table[:, :most] for table in tables]
        if known.size == 1:
            return [np.repeat(table, depths.size, axis=0) for table in tables]
        i = np.minimum(np.maximum(known.searchsorted(depths) - 1, 0), known.size - 2)
        before = known[i]
        t = np.minimum(np.maximum((depths - before) / (known[i + 1] - before), 0.0), 1.0)
        out = []
        for table in tables:
            share = t if table.ndim == 1 else t[:, None]
            out.append((1 - share) * table[i] + share * table[i + 1])
        return out
