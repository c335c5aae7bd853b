"""Two gears on shafts in bearings: masses, compliances, and how one gear is tilted.

At a gear that sits at a from one bearing and b from the other, L = a + b, under a force and a couple in one plane
through the axis, displacement w and slope φ are

    [w]   (            [a²b²      ab(b − a)    ]      [(a² + b²)/L²  (a − b)/L²]  1  ) [F]
    [φ] = ( 1/(3EIL) · [ab(b − a) a² − ab + b² ]  +   [(a − b)/L²    2/L²      ]·─── )·[M]
          (                  shaft                            bearings           k_b )

    torsion between joint and gear:  k_t = G·I_p/a

E, G    moduli of steel                              [Pa]
I, I_p  second moments of the shaft's section        [m⁴]
k_b     radial stiffness of one bearing              [N/m]

What is left out of the sum is rigid. Each gear moves by x along the line of centres and y across it, both at the
middle of its face, tilts by φ_x and φ_y about them and turns by θ, each against the nominal rotation; signs as in
NOMENCLATURE. A tilt moves the tooth at the place z·W across the face by (W·z·φ_y, −W·z·φ_x).

Source   S. P. Timoshenko, Strength of Materials I, 3rd ed. (1955), ch. V (beam on two supports), ch. X (torsion);
         tilt in and normal to the plane of the axes: ISO/TR 10064-3:1996, clause 4 (f_Σδ and f_Σβ)
Holds    slender shafts, small motions against the rotation
Ignores  gyroscopic moments (ω is 1 % of the lowest natural frequency), axial motion, tilt stiffness and clearance of
         the bearings, the mass of the shaft but for a share at the gear, the housing
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi

import numpy as np

from studies.misalignment.impact_law import ImpactLaw
from twin.errors import ParameterError
from twin.geometry import GearPair

FREEDOMS = ("x1", "y1", "phix1", "phiy1", "theta1", "x2", "y2", "phix2", "phiy2", "theta2")
SHAFT_SHARE = 17 / 35  # of a shaft's mass that moves with its middle (Rayleigh)


@dataclass(frozen=True, slots=True, kw_only=True)
class Shafts:
    """Both shafts alike, with what carries them."""

    diameter: float  # [m]
    span: float  # L, between the bearings [m]
    place: float  # a/L of the gear, from the joint's side
    bearing_stiffness: float  # k_b, radial, each of two [N/m]
    damping_ratio: float  # ζ of the modes on shafts and bearings without the mesh

    def __post_init__(self) -> None:
        if not 0 < self.place < 1:
            raise ParameterError(f"place = {self.place:g} must be between 0 and 1, a share of the span")
        for name in ("diameter", "span", "bearing_stiffness"):
            if not getattr(self, name) > 0:
                raise ParameterError(f"{name} = {getattr(self, name):g} must be above 0")
        if not 0 <= self.damping_ratio < 1:
            raise ParameterError(f"damping_ratio = {self.damping_ratio:g} is outside [0, 1)")


@dataclass(frozen=True, slots=True, kw_only=True)
class System:
    """The pair with its contact law and its shafts."""

    pair: GearPair
    law: ImpactLaw
    shafts: Shafts
    density: float  # of gears and shafts [kg/m³]
    bearings_give: bool = False
    shafts_give: bool = False
    teeth_give: bool = False

    def __post_init__(self) -> None:
        if self.pair.teeth[0] != self.pair.teeth[1]:
            raise ParameterError(f"teeth = {self.pair.teeth} must be equal: the period is one turn of both gears")

    def giving(self, *, bearings: bool = False, shafts: bool = False, teeth: bool = False) -> System:
        """The same with some parts compliant."""
        return replace(self, bearings_give=bearings, shafts_give=shafts, teeth_give=teeth)

    @property
    def free(self) -> np.ndarray:
        """Indices of `FREEDOMS` that move (n,)."""
        if not (self.bearings_give or self.shafts_give):
            return np.array([9])
        return np.array([i for i in range(10) if i != 4 or self.shafts_give])

    @property
    def mass(self) -> np.ndarray:
        """Masses [kg] and moments of inertia [kg·m²] along `FREEDOMS` (10,)."""
        W, r1, r_s, L = self.pair.face_width, self.pair.pitch_radius[0], self.shafts.diameter / 2, self.shafts.span
        disc, shaft = self.density * pi * r1**2 * W, self.density * pi * r_s**2 * L
        m = disc + SHAFT_SHARE * (shaft - self.density * pi * r_s**2 * W)
        tilt = disc * (3 * r1**2 + W**2) / 12
        turn = disc * r1**2 / 2 + shaft * r_s**2 / 2
        return np.array([m, m, tilt, tilt, turn] * 2)

    @property
    def support_compliance(self) -> np.ndarray:
        """(w, φ) at the gear under (F, M) in one plane (2, 2); zero where all is rigid."""
        s, E = self.shafts, self.pair.youngs_modulus
        L, a = s.span, s.place * s.span
        b, I = L - a, pi * s.diameter**4 / 64  # noqa: E741
        bent = np.array([[a**2 * b**2, a * b * (b - a)], [a * b * (b - a), a**2 - a * b + b**2]]) / (3 * E * I * L)
        carried = np.array([[a**2 + b**2, a - b], [a - b, 2.0]]) / (s.bearing_stiffness * L**2)
        return self.shafts_give * bent + self.bearings_give * carried

    @property
    def torsional_stiffness(self) -> float:
        """k_t between the joint and the gear [N·m/rad]."""
        s = self.shafts
        G = self.pair.youngs_modulus / (2 * (1 + self.pair.poisson_ratio))
        return G * pi * s.diameter**4 / 32 / (s.place * s.span)

    @property
    def stiffness(self) -> np.ndarray:
        """Of bearings and shafts (10, 10), zero along what is held fast."""
        K = np.zeros((10, 10))
        if not (self.bearings_give or self.shafts_give):
            return K
        plane = np.linalg.inv(self.support_compliance)
        for base in (0, 5):
            x, y, φx, φy = range(base, base + 4)
            K[np.ix_((x, φy), (x, φy))] = plane  # φ_y is the slope dx/dz
            K[np.ix_((y, φx), (y, φx))] = plane * np.array([[1, -1], [-1, 1]])  # and −φ_x that of y
        if self.shafts_give:
            K[4, 4] = self.torsional_stiffness  # the driven shaft beyond its gear is wound by a constant torque
        return K

    @property
    def damping(self) -> np.ndarray:
        """C = M·Φ·diag(2ζω)·Φᵀ·M of the modes on shafts and bearings (10, 10)."""
        root = np.sqrt(self.mass)
        λ, V = np.linalg.eigh(self.stiffness / np.outer(root, root))
        ω = np.sqrt(np.maximum(λ, 0.0))
        return np.outer(root, root) * ((V * (2 * self.shafts.damping_ratio * ω)) @ V.T)

    @property
    def natural_frequencies(self) -> np.ndarray:
        """Of the gears on shafts and bearings, teeth apart, without rigid rotation [Hz]; ascending."""
        root = np.sqrt(self.mass)
        λ = np.linalg.eigvalsh(self.stiffness / np.outer(root, root))
        return np.sqrt(λ[λ > 1.0]) / (2 * pi)

    def static_force(self, torque: float) -> float:
        """T/r_b2 [N]: the normal force without friction."""
        return torque / self.pair.base_radius[1]


@dataclass(frozen=True, slots=True, kw_only=True)
class Tilt:
    """Phase of the driven gear's teeth against the driver's."""

    angle: float = 0.0  # [rad]
    direction: str = "normal"  # to the plane of the axes (f_Σβ), or "in_plane" (f_Σδ): at angle zero where it turns
    turning: bool = False  # False: the axis is tilted in space; True: the gear sits crooked on its shaft and turns
    pivot: float = 0.0  # place across the face about which the gear is tilted, −½ … ½ of its width

    def __post_init__(self) -> None:
        if self.direction not in ("normal", "in_plane"):
            raise ParameterError(f"direction = {self.direction!r} must be 'normal' or 'in_plane'")
        if not abs(self.angle) < 0.2:
            raise ParameterError(f"angle = {self.angle:g} rad is outside (−0.2, 0.2); degrees?")
        if not abs(self.pivot) <= 0.5:
            raise ParameterError(f"pivot = {self.pivot:g} is outside [−0.5, 0.5], shares of the face width")

    def lead_gap(self, pair: GearPair, turn: float = 0.0) -> float:
        """λ = W·tan γ·cos(ψ − α) [m] at an angle of rotation [rad]; ψ grows with it where the tilt turns.

        Positive where the teeth come together at z = +½. ψ = 0 gives W·tan γ·cos α, ψ = π/2 W·tan γ·sin α.
        """
        ψ = self.phase + (turn if self.turning else 0.0)
        return float(pair.face_width * np.tan(self.angle) * np.cos(ψ - pair.pressure_angle))

    @property
    def phase(self) -> float:
        """ψ at the rotation's zero [rad]: the tilt vector of the driven gear is −tan γ·(cos ψ, sin ψ)."""
        return pi / 2 if self.direction == "in_plane" else 0.0
