"""The pair of Dąbrowski, Adamczyk and Plascencia Mora: what their paper gives, and what had to be estimated.

Source   D. Dąbrowski, J. Adamczyk, H. Plascencia Mora, A multi-body model of gears for simulation of vibration signals
         for gears misalignment, Diagnostyka 2(62) (2012) 15–22, Tables 1 and 2, chapters 2 and 3
Reads    K = 2.9852·10⁵ is printed with the unit N/mm^3/2, that of the Hertzian exponent of eq. (3), and stands beside
         the exponent 1.3. A solver takes the number as it is: N/mm^1.3. What the other readings give is in `ESTIMATES`.
Bearing  deep groove 6206, 9 balls of 9.525 mm, δ = 4.36·10⁻⁴·(Q²/D)^⅓ mm with Q = 5·F_r/9 (A. Palmgren, Ball and
         roller bearing engineering, 3rd ed. 1959): 1.5·F_r/δ = 1.4·10⁸ N/m under half of the mesh force at 200 N·m
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import radians
from typing import Any

from twin.geometry import GearPair
from twin.multibody.impact_law import ImpactLaw
from twin.multibody.system import Shafts, System

TEETH = 29
SPEEDS_RPM = (400.0, 800.0)
TORQUES = (100.0, 200.0)  # [N·m]
TILT_ANGLE = radians(1)
EXPERIMENT_RISE = {400.0: 20.0, 800.0: 30.0}  # of the RMS in the bands, "about" [%]
MOST_AT = (2, 3, 4)  # mesh harmonics that rose most at 800 rpm in the experiment
MODULE, PITCH_RADIUS, OUTER_RADIUS, ROOT_RADIUS = 3.065e-3, 44.435e-3, 47.5e-3, 40.605e-3  # [m]
_K = 2.9852e5  # [N/mm^e]
_MM = 1e3  # [1/m]


def system() -> System:
    """The pair as the paper gives it, on rigid shafts; what it does not give is in `ESTIMATES`."""
    law = ImpactLaw(
        stiffness=_K * _MM**1.3,
        exponent=1.3,
        damping=3000e3,
        full_damping_depth=0.1e-3,
        static_friction=0.1,
        dynamic_friction=0.08,
        static_speed=1e-3,
        dynamic_speed=10e-3,
    )
    pair = GearPair(
        teeth=(TEETH, TEETH),
        module=MODULE,
        pressure_angle=radians(20),
        face_width=20e-3,
        addendum=OUTER_RADIUS - PITCH_RADIUS,
        dedendum=PITCH_RADIUS - ROOT_RADIUS,
        bore_radius=(15e-3, 15e-3),
        youngs_modulus=2.1e11,
        poisson_ratio=0.3,
        backlash=0.4e-3,
    )
    shafts = Shafts(diameter=30e-3, span=120e-3, place=0.5, bearing_stiffness=1.4e8, damping_ratio=0.03)
    return System(pair=pair, law=law, shafts=shafts, density=7850.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """A parameter that the paper does not give, why it was taken so, and what else it could be."""

    name: str
    value: str
    reason: str
    others: tuple[tuple[str, Callable[[System], System]], ...]
    rigid_too: bool = True  # whether it matters where bearings and shafts are rigid


def _pair(**change: Any) -> Callable[[System], System]:
    return lambda s: replace(s, pair=replace(s.pair, **change))


def _law(**change: float) -> Callable[[System], System]:
    return lambda s: replace(s, law=replace(s.law, **change))


def _shafts(**change: float) -> Callable[[System], System]:
    return lambda s: replace(s, shafts=replace(s.shafts, **change))


def _converted(s: System) -> System:
    """Exponent 1.5 with the stiffness that bears the force of 200 N·m at the same penetration."""
    x = s.law.penetration(s.static_force(200.0))
    return replace(s, law=replace(s.law, exponent=1.5, stiffness=s.law.stiffness * x ** (s.law.exponent - 1.5)))


ESTIMATES: tuple[Estimate, ...] = (
    Estimate(
        name="face width",
        value="20 mm",
        reason="6.5 modules, usual for such a pair",
        others=(("15 mm", _pair(face_width=15e-3)), ("25 mm", _pair(face_width=25e-3, backlash=0.5e-3))),
    ),
    Estimate(
        name="mass of the gears",
        value="solid discs of steel",
        reason="webs and hubs are not said",
        others=(
            ("0.6 of it", lambda s: replace(s, density=0.6 * s.density)),
            ("1.5 of it", lambda s: replace(s, density=1.5 * s.density)),
        ),
    ),
    Estimate(
        name="backlash",
        value="0.4 mm",
        reason="teeth tilted by 1° over the face need 0.33 mm to turn free",
        others=(("0.2 mm", _pair(backlash=0.2e-3)), ("0.6 mm", _pair(backlash=0.6e-3))),
    ),
    Estimate(
        name="penetration of full damping",
        value="0.1 mm",
        reason="the solver's customary value",
        others=(("0.02 mm", _law(full_damping_depth=0.02e-3)), ("0.5 mm", _law(full_damping_depth=0.5e-3))),
    ),
    Estimate(
        name="reading of K",
        value="N/mm^1.3",
        reason="the number with the exponent beside it, as a solver takes it",
        others=(
            ("exponent 1.5, K in N/mm^1.5", _law(exponent=1.5, stiffness=_K * _MM**1.5)),
            ("exponent 1.5, same force at 200 N·m", _converted),
        ),
    ),
    Estimate(
        name="shaft diameter",
        value="30 mm",
        reason="200 N·m at 40 MPa of shear",
        others=(("25 mm", _shafts(diameter=25e-3)), ("40 mm", _shafts(diameter=40e-3))),
        rigid_too=False,
    ),
    Estimate(
        name="span of the bearings",
        value="120 mm",
        reason="face, two bearings and room for the clamping",
        others=(("80 mm", _shafts(span=80e-3)), ("200 mm", _shafts(span=200e-3))),
        rigid_too=False,
    ),
    Estimate(
        name="place of the gears",
        value="middle of the span",
        reason="no other is said",
        others=(("35 %", _shafts(place=0.35)), ("65 %", _shafts(place=0.65))),
        rigid_too=False,
    ),
    Estimate(
        name="bearing stiffness",
        value="1.4e8 N/m",
        reason="6206 under half of the mesh force (Palmgren)",
        others=(("0.7e8 N/m", _shafts(bearing_stiffness=0.7e8)), ("3e8 N/m", _shafts(bearing_stiffness=3e8))),
        rigid_too=False,
    ),
    Estimate(
        name="damping ratio of shafts and bearings",
        value="3 %",
        reason="usual for shafts in rolling bearings",
        others=(("1 %", _shafts(damping_ratio=0.01)), ("10 %", _shafts(damping_ratio=0.1))),
        rigid_too=False,
    ),
)
