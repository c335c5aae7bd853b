"""The half-profile of one tooth: involute flank, and the fillet that a rounded rack tool leaves below it.

Axes on the tooth: y along its centre line from the gear's centre, x the half-thickness.

    flank    x = r_b·((τ + θ_b)·cos τ − sin τ)            y = r_b·((τ + θ_b)·sin τ + cos τ)
    fillet   x = r·sin φ − (a/sin γ + ρ)·cos(γ − φ)       y = r·cos φ − (a/sin γ + ρ)·sin(γ − φ)
             φ = (a/tan γ + b)/r,   γ from π/2 (root circle) down to α (form point)

τ    angle of the flank's normal from the tooth's cross direction; τ + θ_b is the roll angle     [rad]
θ_b  half the angle of the tooth on its base circle: t/(2r) + inv α                              [rad]
t    tooth thickness on the pitch circle                                                         [m]
ρ    tip rounding of the tool: (h_f − h_a)/(1 − sin α), or what fits between the tool's flanks   [m]
a    depth of the rounding's centre below the pitch line: h_f − ρ                                [m]
b    distance of that centre from the tooth's centre line: t/2 + a·tan α + ρ/cos α               [m]

The two curves hold whether the root circle lies below or above the base circle. Where the tool cuts
into the flank (undercut, few teeth), fillet and flank end where they cross.

Source   H. Ma et al., Engineering Failure Analysis 44 (2014) 179-194 (curves as above);
         F. L. Litvin, Gear Geometry and Applied Theory, chapter 6
Holds    standard gears without profile shift, cut by a rack
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import cos, pi, sin, tan

import numpy as np

from twin.errors import ParameterError
from twin.geometry.involute import involute, roll_angle


@dataclass(frozen=True, slots=True, kw_only=True)
class ToothForm:
    """One tooth of a standard gear."""

    teeth: int  # z
    module: float  # m [m]
    pressure_angle: float  # α [rad]
    addendum: float  # h_a [m]
    dedendum: float  # h_f [m]
    thickness: float  # t on the pitch circle [m]

    def __post_init__(self) -> None:
        if not 0 < self.thickness < pi * self.module:
            raise ParameterError(
                f"tooth thickness = {self.thickness:g} m is outside (0, {pi * self.module:g}) m; "
                "a backlash larger than the space between the teeth?"
            )
        if not self.dedendum >= self.addendum:
            raise ParameterError(
                f"dedendum = {self.dedendum:g} m must be at least the addendum = {self.addendum:g} m of the "
                "mating gear; the two exchanged?"
            )

    @property
    def pitch_radius(self) -> float:
        return self.module * self.teeth / 2

    @property
    def base_radius(self) -> float:
        return self.pitch_radius * cos(self.pressure_angle)

    @property
    def root_radius(self) -> float:
        return self.pitch_radius - self.dedendum

    @property
    def base_half_angle(self) -> float:
        """θ_b [rad]."""
        return self.thickness / (2 * self.pitch_radius) + float(involute(self.pressure_angle))

    @property
    def tool_rounding(self) -> float:
        """ρ [m]."""
        α = self.pressure_angle
        wanted = (self.dedendum - self.addendum) / (1 - sin(α))
        half_space = (pi * self.module - self.thickness) / 2  # of the gear; the tool's tooth, halved
        room = (half_space - self.dedendum * tan(α)) * cos(α) / (1 - sin(α))
        if room < 0:
            raise ParameterError(
                f"dedendum = {self.dedendum:g} m: the rack that cuts it is pointed before it gets so deep; "
                f"allowed up to {half_space / tan(α):g} m"
            )
        return min(wanted, room)

    @property
    def tool_depth(self) -> float:
        """a = h_f − ρ [m]."""
        return self.dedendum - self.tool_rounding

    @property
    def tool_offset(self) -> float:
        """b = t/2 + a·tan α + ρ/cos α [m]."""
        α, ρ = self.pressure_angle, self.tool_rounding
        return self.thickness / 2 + self.tool_depth * tan(α) + ρ / cos(α)

    @property
    def root_half_angle(self) -> float:
        """Half the angle of the tooth where its fillet meets the root circle: b/r [rad]."""
        return self.tool_offset / self.pitch_radius

    def flank_point(self, τ):
        """x, y [m] of the flank at angles τ [rad]; (n,) → two of (n,)."""
        r_b, ξ = self.base_radius, τ + self.base_half_angle
        return r_b * (ξ * np.cos(τ) - np.sin(τ)), r_b * (ξ * np.sin(τ) + np.cos(τ))

    def flank_slope(self, τ):
        """dy/dτ [m/rad] of the flank; (n,) → (n,)."""
        return self.base_radius * (τ + self.base_half_angle) * np.cos(τ)

    def fillet_point(self, γ):
        """x, y [m] of the fillet at angles γ [rad]; (n,) → two of (n,)."""
        a, b, ρ, r = self.tool_depth, self.tool_offset, self.tool_rounding, self.pitch_radius
        φ = (a / np.tan(γ) + b) / r
        arm = a / np.sin(γ) + ρ
        return r * np.sin(φ) - arm * np.cos(γ - φ), r * np.cos(φ) - arm * np.sin(γ - φ)

    def fillet_slope(self, γ):
        """dy/dγ [m/rad] of the fillet; (n,) → (n,)."""
        a, b, ρ, r = self.tool_depth, self.tool_offset, self.tool_rounding, self.pitch_radius
        φ = (a / np.tan(γ) + b) / r
        dφ = -a / (r * np.sin(γ) ** 2)
        arm, d_arm = a / np.sin(γ) + ρ, -a * np.cos(γ) / np.sin(γ) ** 2
        return -r * np.sin(φ) * dφ - d_arm * np.sin(γ - φ) - arm * np.cos(γ - φ) * (1 - dφ)

    @property
    def form_point(self) -> tuple[float, float]:
        """τ on the flank and γ on the fillet [rad] of the point where one passes into the other."""
        return _form_point(self)

    @property
    def form_roll_angle(self) -> float:
        """ξ [rad] of the lowest point of the involute flank."""
        return self.form_point[0] + self.base_half_angle


@lru_cache(maxsize=256)
def _form_point(tooth: ToothForm) -> tuple[float, float]:
    α, r = tooth.pressure_angle, tooth.pitch_radius
    ρ = tooth.tool_rounding
    straight = tooth.dedendum - ρ * (1 - sin(α))  # depth to which the tool's flank is straight
    ξ = (r * sin(α) - straight / sin(α)) / tooth.base_radius
    if ξ >= 0:
        return ξ - tooth.base_half_angle, α
    return _undercut_point(tooth)


def _undercut_point(tooth: ToothForm) -> tuple[float, float]:
    """The crossing of fillet and flank where the tool cuts into the flank; (τ, γ) [rad]."""
    r_b, θ_b = tooth.base_radius, tooth.base_half_angle

    def outside(γ):  # angle of the fillet beyond the flank's at the same radius
        x, y = tooth.fillet_point(γ)
        ξ = roll_angle(np.hypot(x, y), r_b)
        return np.arctan2(x, y) - (θ_b - (ξ - np.arctan(ξ)))

    α = tooth.pressure_angle
    γ = α + (pi / 2 - α) * np.linspace(1, 0, 4001) ** 3  # dense near α: a slight undercut ends close to it
    x, y = tooth.fillet_point(γ)
    above = np.hypot(x, y) > r_b
    crossings = np.flatnonzero(above[:-1] & (outside(γ)[:-1] < 0) & (outside(γ)[1:] >= 0))
    if not crossings.size:
        raise ParameterError(
            f"teeth = {tooth.teeth}: the tool of dedendum {tooth.dedendum:g} m leaves no involute flank; "
            f"at least {2 * tooth.addendum / tooth.module / sin(tooth.pressure_angle) ** 2:.0f} teeth are "
            "free of undercut"
        )
    from scipy.optimize import brentq  # loads scipy, which a start of the service does without

    i = crossings[0]
    γ_form = float(brentq(outside, γ[i], γ[i + 1], xtol=1e-14))
    x, y = tooth.fillet_point(γ_form)
    return float(roll_angle(np.hypot(x, y), r_b)) - θ_b, γ_form
