"""The master curve as data: profile, work and steady response against the largest depth.

    x = K·τ·ω1·N        profile(d), x(d) and the steady lines of the condition it was made for

Beyond the depth at which no steady state was found the last wear rate is held and the curve is marked: what stands
there is an extrapolation, and the response there is not known.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline

from twin.dynamics.harmonic_balance import SteadyState
from twin.errors import NotConverged, ParameterError
from twin.model import Condition, Model
from twin.wear.archard import wear_per_revolution
from twin.wear.evolution import WearPoint, evolve
from twin.wear.profile import WornProfile

LINES = 12  # mesh harmonics kept of every response


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
            transmission_error=model.transmission_error_lines(steady)[:LINES],
            mean=model.mean_transmission_error(steady, condition),
            pinion_motion=model.pinion_motion_lines(steady)[:LINES],
            acceleration=model.acceleration_lines(steady)[:LINES],
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class MasterCurve:
    """Wear under one operating condition from a start profile, by depth."""

    condition: Condition
    start: WornProfile
    depth: np.ndarray  # largest combined depth (m,) [m], strictly rising
    work: np.ndarray  # x (m,) [rad/N], strictly rising
    profiles: np.ndarray  # combined depth along the path (m, p), or of every slice (m, slices, p) [m]
    transmission_error: np.ndarray  # complex lines of mesh harmonics 1 … LINES (m, LINES) [m]
    mean_transmission_error: np.ndarray  # (m,) [m]
    pinion_motion: np.ndarray  # complex lines of r_b1·θ7, the pinion's encoder alone (m, LINES) [m]
    acceleration: np.ndarray  # complex lines (m, LINES) [m/s²]
    final_rate: np.ndarray  # dh/dx at the deepest point (p,), or of every slice (slices, p) [m·N/rad]
    loss_from: float | None  # depth from which the teeth part for some of the mesh [m]
    complete: bool  # whether the requested depth was reached with a steady state

    @classmethod
    def build(cls, model: Model, condition: Condition, start: WornProfile, until_depth: float) -> MasterCurve:
        """Wears the profile on until `until_depth` [m] or until no steady state is found."""
        half_width = model.calibration.contact_half_width
        start = start.across(model.slices)
        points: list[WearPoint] = []
        complete = True
        try:
            for point in evolve(model.mesh, lambda p, s: model.steady(p, condition, s), start, half_width, until_depth):
                if not points or point.profile.max_depth > points[-1].profile.max_depth:
                    points.append(point)
        except NotConverged:
            complete = False
        if not points:
            raise NotConverged(
                f"no steady state at the start of wear ({condition.speed_hz:g} Hz, {condition.torque:g} N·m)"
            )
        lines = [MeshLines.of(model, p.steady, condition) for p in points]
        lost = [p.profile.max_depth for p in points if p.steady.contact_loss > 0]
        return cls(
            condition=condition,
            start=start,
            depth=np.array([p.profile.max_depth for p in points]),
            work=np.array([p.work for p in points]),
            profiles=np.array([p.profile.depth for p in points]),
            transmission_error=np.array([line.transmission_error for line in lines]),
            mean_transmission_error=np.array([line.mean for line in lines]),
            pinion_motion=np.array([line.pinion_motion for line in lines]),
            acceleration=np.array([line.acceleration for line in lines]),
            final_rate=wear_per_revolution(model.mesh, points[-1].steady.contact_forces, half_width, model.slices),
            loss_from=min(lost, default=None),
            complete=complete,
        )

    @property
    def valid_to(self) -> float:
        """Deepest wear with a steady state [m]."""
        return float(self.depth[-1])

    @cached_property
    def _depth_rate(self) -> float:
        """d(depth)/dx held beyond the last point [m·N/rad]."""
        rate = self.final_rate if self.final_rate.ndim == 1 else self.final_rate.mean(axis=0)
        return float(rate[self.start.on_active].max())

    @cached_property
    def _profile_spline(self) -> CubicSpline:
        return CubicSpline(self.depth, self.profiles, axis=0)

    def profile(self, depth: float) -> WornProfile:
        """The worn profile of a largest depth [m], at or beyond the start's; NotConverged where wear has ended."""
        if depth < self.depth[0] - 1e-12:
            raise ParameterError(
                f"depth = {depth * 1e6:.2f} µm lies before the curve's start at {self.depth[0] * 1e6:.2f} µm"
            )
        if depth > self.valid_to or self.depth.size == 1:
            if depth > self.valid_to and not self._depth_rate > 0:
                raise NotConverged(f"no wear goes on beyond {self.valid_to * 1e6:.1f} µm: the teeth do not touch there")
            worn = self.profiles[-1] + self.final_rate * (max(depth, self.valid_to) - self.valid_to) / self._depth_rate
        elif self.profiles.ndim == 3:  # a spline of every slice would take four times the curve's memory
            i = min(int(np.searchsorted(self.depth, depth, side="right")), self.depth.size - 1)
            t = (max(depth, self.depth[0]) - self.depth[i - 1]) / (self.depth[i] - self.depth[i - 1])
            worn = (1 - t) * self.profiles[i - 1] + t * self.profiles[i]
        else:
            worn = self._profile_spline(max(depth, self.depth[0]))
        return WornProfile(positions=self.start.positions, depth=worn, active=self.start.active)

    def work_at(self, depth: float) -> float:
        """x [rad/N] at which the largest depth is reached."""
        if depth > self.valid_to:
            return float(self.work[-1] + (depth - self.valid_to) / self._depth_rate)
        return float(np.interp(depth, self.depth, self.work))

    def work_per_depth(self, depth: float) -> float:
        """dx/d(depth) [rad/(N·m)]."""
        step = 1e-6
        return (self.work_at(depth + step) - self.work_at(depth)) / step

    def depth_at(self, work: float) -> float:
        """Largest depth [m] after x [rad/N]."""
        if work > self.work[-1]:
            return float(self.valid_to + (work - self.work[-1]) * self._depth_rate)
        return float(np.interp(work, self.work, self.depth))

    def lines_at(self, depth: float) -> MeshLines:
        """The condition's lines at a depth [m]; held beyond the end."""
        if self.depth.size == 1:
            i, j, t = 0, 0, 0.0
        else:
            i = min(max(int(np.searchsorted(self.depth, depth)) - 1, 0), self.depth.size - 2)
            j = i + 1
            t = min(max(float((depth - self.depth[i]) / (self.depth[j] - self.depth[i])), 0.0), 1.0)

        def at(values: np.ndarray) -> np.ndarray:
            return (1 - t) * values[i] + t * values[j]

        return MeshLines(
            transmission_error=at(self.transmission_error),
            mean=float(at(self.mean_transmission_error)),
            pinion_motion=at(self.pinion_motion),
            acceleration=at(self.acceleration),
        )
