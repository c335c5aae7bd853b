"""The pair of Dąbrowski, Adamczyk and Plascencia Mora: what their paper gives, and what had to be estimated.

Source   D. Dąbrowski, J. Adamczyk, H. Plascencia Mora, A multi-body model of gears for simulation of vibration signals
         for gears misalignment, Diagnostyka 2(62) (2012) 15–22, Tables 1 and 2, chapters 2 and 3
Reads    K = 2.9852·10⁵ is printed with the unit N/mm^3/2, that of the Hertzian exponent of eq. (3), next to the
         exponent 1.3. A solver takes the number as it is: N/mm^1.3. What the other readings give is in `READINGS`.
         "Vertical" is read as across the line of centres, as where the axes lie side by side; the paper does not say
         how they lie. The study also gives the rise along the line of centres. The direction in which the axis is
         tilted by "about 1 degree" is not stated either: normal to the plane of the axes, and also in that plane.
Bearing  deep groove 6206, 9 balls of 9.525 mm, δ = 4.36·10⁻⁴·(Q²/D)^⅓ mm with Q = 5·F_r/9 (A. Palmgren, Ball and
         roller bearing engineering, 3rd ed. 1959): 1.5·F_r/δ = 1.4·10⁸ N/m under half of the mesh force at 200 N·m
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import radians, tan

import numpy as np

from studies.misalignment.impact_law import ImpactLaw
from studies.misalignment.system import Shafts, System
from twin.geometry import GearPair

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
    """A parameter that the paper does not give, the reason for its value, and its range."""

    name: str
    unit: str
    scale: float  # SI over the unit
    value: float  # in the unit, as low and high
    low: float
    high: float
    reason: str
    change: Callable[[System, float], System]  # of a value in SI
    rigid_too: bool = True  # whether it matters where bearings and shafts are rigid

    def at(self, system: System, value: float) -> System:
        """The system with another value, in the estimate's unit."""
        return self.change(system, value * self.scale)


def _pair(name: str) -> Callable[[System, float], System]:
    return lambda s, value: replace(s, pair=replace(s.pair, **{name: value}))  # type: ignore[arg-type]


def _law(name: str) -> Callable[[System, float], System]:
    return lambda s, value: replace(s, law=replace(s.law, **{name: value}))


def _shafts(name: str) -> Callable[[System, float], System]:
    return lambda s, value: replace(s, shafts=replace(s.shafts, **{name: value}))


def _face(s: System, width: float) -> System:
    """With the backlash that the tilted teeth then need."""
    return replace(s, pair=replace(s.pair, face_width=width, backlash=max(s.pair.backlash, _needed_backlash(width))))


def _needed_backlash(width: float) -> float:
    """With which teeth of a face width turn free, tilted and under load [m]."""
    return 1.2 * width * tan(TILT_ANGLE)


ESTIMATES: tuple[Estimate, ...] = (
    Estimate(
        name="face width", unit="mm", scale=1e-3, value=20, low=15, high=25, change=_face,
        reason="6.5 modules, usual for such a pair",
    ),
    Estimate(
        name="density of the discs", unit="kg/m³", scale=1, value=7850, low=4700, high=10000,
        change=lambda s, value: replace(s, density=value),
        reason="steel, solid; less with webs, more with hubs",
    ),
    Estimate(
        name="backlash", unit="mm", scale=1e-3, value=0.4, low=0.2, high=0.6, change=_pair("backlash"),
        reason="teeth tilted by 1° over the face need 0.33 mm to turn free",
    ),
    Estimate(
        name="penetration of full damping", unit="mm", scale=1e-3, value=0.1, low=0.05, high=0.5,
        change=_law("full_damping_depth"), reason="the solver's customary value",
    ),
    Estimate(
        name="shaft diameter", unit="mm", scale=1e-3, value=30, low=25, high=40, change=_shafts("diameter"),
        reason="200 N·m at 40 MPa of shear", rigid_too=False,
    ),
    Estimate(
        name="span of the bearings", unit="mm", scale=1e-3, value=120, low=80, high=200, change=_shafts("span"),
        reason="face, two bearings and room to change gears", rigid_too=False,
    ),
    Estimate(
        name="place of the gears in the span", unit="", scale=1, value=0.5, low=0.35, high=0.65,
        change=_shafts("place"), reason="no other is stated", rigid_too=False,
    ),
    Estimate(
        name="bearing stiffness", unit="N/µm", scale=1e6, value=140, low=70, high=300,
        change=_shafts("bearing_stiffness"), reason="6206 under half of the mesh force (Palmgren)", rigid_too=False,
    ),
    Estimate(
        name="damping ratio of shafts and bearings", unit="%", scale=0.01, value=3, low=1, high=10,
        change=_shafts("damping_ratio"), reason="usual for shafts in rolling bearings", rigid_too=False,
    ),
)  # fmt: skip


def _same_force(s: System) -> System:
    x = s.law.penetration(s.static_force(TORQUES[1]))
    return replace(s, law=replace(s.law, exponent=1.5, stiffness=s.law.stiffness * x ** (s.law.exponent - 1.5)))


READINGS: Mapping[str, Callable[[System], System]] = {
    "K in N/mm^1.5, exponent 1.5": lambda s: replace(s, law=replace(s.law, exponent=1.5, stiffness=_K * _MM**1.5)),
    "exponent 1.5, the force of 200 N·m at the same penetration": _same_force,
}


def drawn(seed: int, number: int) -> list[System]:
    """So many systems with every estimate drawn evenly on the logarithm of its range.

    Of backlash no less is drawn than the face width that was drawn needs to turn free: the authors' gears turned.
    """
    random, out = np.random.default_rng(seed), []
    for _ in range(number):
        made = system()
        for estimate in ESTIMATES:
            low = estimate.low
            if estimate.name == "backlash":
                low = max(low, _needed_backlash(made.pair.face_width) / estimate.scale)
            made = estimate.at(made, float(np.exp(random.uniform(np.log(low), np.log(estimate.high)))))
        out.append(made)
    return out
