"""What effects may turn in a machine and its instruments."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from recordings.generator.foreign import Felt
from recordings.generator.housing import LooseFoot
from recordings.generator.sensor_faults import Clock, DiscLine, LooseAccelerometer
from recordings.generator.turning import Coupling, ShaftRub


@dataclass(slots=True)
class Knobs:
    """Everything that effects may turn; SI. As made, a healthy machine with perfect instruments."""

    pinion_eccentricity: tuple[float, float] = (0.0, 0.0)  # [m], high point [rad]
    gear_eccentricity: tuple[float, float] = (0.0, 0.0)
    lead: float = 0.0  # across the whole face [m]
    friction: float = 0.0
    stiffness: float = 1.0  # of the mesh
    damping: float = 1.0  # of the mesh
    backlash: float = 0.0  # added [m]
    tooth_stiffness: dict[int, float] = field(default_factory=dict)  # of pinion teeth
    gear_tooth_stiffness: dict[int, float] = field(default_factory=dict)
    pinion_form: np.ndarray | float = 0.0  # missing material, broadcast to (teeth, points) [m]
    gear_form: np.ndarray | float = 0.0
    pinion_unbalance: tuple[float, float] = (0.0, 0.0)  # [kg·m], phase
    gear_unbalance: tuple[float, float] = (0.0, 0.0)
    ripple: tuple[float, float, float] = (0.0, 1.0, 0.0)  # motor torque [N·m], order, phase
    load_ripple: tuple[float, float] = (0.0, 1.0)  # brake torque at the pinion [N·m], order of the pinion
    bearing: tuple[float, float, float] = (0.0, 0.0, 0.0)  # blow [N], order of the pinion, slip
    gain: float = 1.0  # of the accelerometer
    resonance: tuple[float, float] = (0.0, 0.0)  # of the accelerometer's mounting [Hz], damping ratio
    tones: list[tuple[float, float]] = field(default_factory=list)  # (Hz, m/s²) added to the acceleration
    foreign: list[Felt] = field(default_factory=list)  # what else shakes the housing
    play: tuple[int, float, float, float] | None = None  # bearing of the pinion's shaft, play [m], exponent, stiffness
    turning: list[Coupling | ShaftRub] = field(default_factory=list)  # forces that are a function of the angle
    foot: LooseFoot | None = None
    loose_accelerometer: LooseAccelerometer | None = None
    clock: Clock = field(default_factory=Clock)  # of the accelerometer, against the encoders'
    disc_lines: dict[str, list[DiscLine]] = field(default_factory=dict)  # faults of a shaft's encoder
