"""The geometry of one external spur pair on its theoretical centre distance.

The path of contact is measured by s, the signed distance from the pitch point along the line of
action, negative in approach and positive in recess; the contact moves at s' = ω₁·r_b1.

Source   ISO 21771-1:2024, clauses 4 and 7 (basic relations of involute spur gears)
Holds    standard gears without profile shift, meshing at the sum of their pitch radii
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi, sin, sqrt, tan

from twin.errors import ParameterError
from twin.geometry.tooth_form import ToothForm


@dataclass(frozen=True, slots=True, kw_only=True)
class GearPair:
    """An external spur pair: index 1 is the pinion (driver), index 2 the gear."""

    teeth: tuple[int, int]  # z1, z2
    module: float  # m [m]
    pressure_angle: float  # α [rad]
    face_width: float  # W [m]
    addendum: float  # h_a [m]
    dedendum: float  # h_f [m]
    bore_radius: tuple[float, float]  # [m]
    youngs_modulus: float  # E [Pa]
    poisson_ratio: float  # ν
    backlash: float  # along the line of action, total of both sides [m]

    def __post_init__(self) -> None:
        if not self.contact_ratio > 1:
            raise ParameterError(
                f"contact ratio = {self.contact_ratio:.3f} must be above 1 for continuous motion; "
                f"addendum = {self.addendum * 1e3:.3f} mm with module {self.module * 1e3:.3f} mm "
                "(an addendum coefficient given in mm?)"
            )

    @property
    def pitch_radius(self) -> tuple[float, float]:
        """r = m·z/2 of pinion and gear [m]."""
        return self.module * self.teeth[0] / 2, self.module * self.teeth[1] / 2

    @property
    def base_radius(self) -> tuple[float, float]:
        """r_b = r·cos α of pinion and gear [m]."""
        r1, r2 = self.pitch_radius
        return r1 * cos(self.pressure_angle), r2 * cos(self.pressure_angle)

    @property
    def tip_radius(self) -> tuple[float, float]:
        """r_a = r + h_a of pinion and gear [m]."""
        r1, r2 = self.pitch_radius
        return r1 + self.addendum, r2 + self.addendum

    @property
    def root_radius(self) -> tuple[float, float]:
        """r_f = r − h_f of pinion and gear [m]."""
        r1, r2 = self.pitch_radius
        return r1 - self.dedendum, r2 - self.dedendum

    @property
    def centre_distance(self) -> float:
        """a = r1 + r2 [m]."""
        return sum(self.pitch_radius)

    @property
    def base_pitch(self) -> float:
        """p_b = π·m·cos α [m]."""
        return pi * self.module * cos(self.pressure_angle)

    @property
    def tooth_thickness(self) -> float:
        """t = π·m/2 − j/(2·cos α) on the pitch circles: each gear gives half of the backlash j [m]."""
        return pi * self.module / 2 - self.backlash / (2 * cos(self.pressure_angle))

    def tooth(self, wheel: int) -> ToothForm:
        """The tooth of the pinion (0) or the gear (1)."""
        return ToothForm(
            teeth=self.teeth[wheel],
            module=self.module,
            pressure_angle=self.pressure_angle,
            addendum=self.addendum,
            dedendum=self.dedendum,
            thickness=self.tooth_thickness,
        )

    @property
    def path_start(self) -> float:
        """s at which the gear's tip meets the pinion's flank (negative) [m]."""
        a, r, rb = self.tip_radius[1], self.pitch_radius[1], self.base_radius[1]
        start = -(sqrt(a**2 - rb**2) - r * sin(self.pressure_angle))
        return max(start, self._flank_foot(0))

    @property
    def path_end(self) -> float:
        """s at which the pinion's tip leaves the gear's flank (positive) [m]."""
        a, r, rb = self.tip_radius[0], self.pitch_radius[0], self.base_radius[0]
        end = sqrt(a**2 - rb**2) - r * sin(self.pressure_angle)
        return min(end, -self._flank_foot(1))

    def _flank_foot(self, wheel: int) -> float:
        """Path position of the lowest involute point of a gear's flank, negative [m].

        Where the mating tip would reach below it, the contact starts there.
        """
        ρ = self.tooth(wheel).form_roll_angle * self.base_radius[wheel]
        return ρ - self.pitch_radius[wheel] * sin(self.pressure_angle)

    @property
    def contact_ratio(self) -> float:
        """ε_α = (path_end − path_start)/p_b."""
        return (self.path_end - self.path_start) / self.base_pitch

    def curvature_radius(self, s):
        """Radii of curvature ρ1, ρ2 of the two flanks [m] at path positions s [m]; (n,) → two of (n,).

        ρ1 = r_b1·tan α + s,   ρ2 = r_b2·tan α − s
        """
        t = tan(self.pressure_angle)
        return self.base_radius[0] * t + s, self.base_radius[1] * t - s

    def sliding_velocity(self, s, pinion_speed):
        """Magnitude of the sliding velocity [m/s] at path positions s [m]; (n,) → (n,).

        v = |s|·(ω1 + ω2), with pinion_speed = ω1 [rad/s]
        """
        return abs(s) * pinion_speed * (1 + self.teeth[0] / self.teeth[1])
