"""How far a machine may differ from its rig file, and its instruments from perfect ones, without anything being wrong.

The rig file states them in its table `[tolerances]`; the defaults below hold for what it does not state. Attribution
accepts a departure only where it exceeds these. What is estimated (`[estimated]`) is as wide as its spread says. The
floor of the torque meter is a share of the rated torque where the file gives one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import sqrt
from typing import Any

from twin.rig_estimated import Estimated

UNIFORM = sqrt(3)  # half-width of a uniform distribution over its standard deviation
WIDEST = 0.9  # a tolerance never makes a stiffness vanish
TORQUE_FLOOR_SHARE = 5e-4  # of the rated torque: 5 mN·m on the reference rig, tuned on the campaigns T01–T58


@dataclass(frozen=True, slots=True, kw_only=True)
class Tolerances:
    """Tolerances of structure and instruments; one field for each key of `[tolerances]`."""

    stiffness: float = 0.03  # relative half-width, of every shaft, coupling and bearing stiffness
    mass: float = 0.01  # relative half-width, of every mass and inertia
    damping: float = 0.2  # relative half-width, of every modal damping ratio
    pinion_once_per_turn: float = 1.5e-6  # std of an encoder disc's error at one cycle a turn, at the base radius [m]
    gear_once_per_turn: float = 1.5e-6  # the same of the gear's disc [m]
    pinion_graduation: float = 0.6e-6  # std of the disc's error at the next few cycles a turn, at the base radius [m]
    gear_graduation: float = 1.6e-6  # the same of the gear's disc [m]
    accelerometer_gain: float = 0.2  # std of the logarithm of an accelerometer's gain
    acceleration_floor: float = 0.002  # amplitude of an acceleration line below which nothing is read from it [m/s²]
    torque_floor: float = 0.005  # the same of a line of the torque meter [N·m]

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Tolerances:
        """The tolerances of a rig file's mapping: those stated, else the defaults."""
        rated = values.get("operating", {}).get("input_torque")
        spread = Estimated.of(values).spread
        parts = {"stiffness": "structure", "mass": "inertias", "damping": "damping"}
        wide = {name: min(UNIFORM * spread[part], WIDEST) for name, part in parts.items() if part in spread}
        scaled = {} if rated is None or rated == 0 else {"torque_floor": TORQUE_FLOOR_SHARE * abs(rated)}
        return cls(**(scaled | wide | dict(values.get("tolerances", {}))))
