"""What a gearbox may have beside wear: one effect, one file, one line here. The key is the name that results report."""

from typing import Any

from twin.effects.backlash_rattle import BacklashRattle
from twin.effects.bearing_defect import BearingDefect, BearingGeometry
from twin.effects.gear_eccentricity import GearEccentricity
from twin.effects.mass_unbalance import MassUnbalance
from twin.effects.mesh_damping import MeshDamping
from twin.effects.mesh_stiffness_loss import MeshStiffnessLoss
from twin.effects.misalignment import Misalignment
from twin.effects.none import NoEffect
from twin.effects.parameter import Parameter, neutral
from twin.effects.pinion_eccentricity import PinionEccentricity
from twin.effects.pitch_error import PitchError
from twin.effects.profile_error import ProfileError
from twin.effects.response import Effect, Response, solve_with
from twin.effects.sensor_gain import SensorGain
from twin.effects.sensor_resonance import SensorResonance
from twin.effects.setup import Setup
from twin.effects.tooth_crack import ToothCrack
from twin.effects.tooth_friction import ToothFriction
from twin.effects.torque_ripple import TorqueRipple
from twin.effects.unknown_effect import UnknownEffect

EFFECTS: dict[str, Any] = {
    "none": NoEffect,
    "pinion_eccentricity": PinionEccentricity,
    "gear_eccentricity": GearEccentricity,
    "misalignment": Misalignment,
    "tooth_friction": ToothFriction,
    "pitch_error": PitchError,
    "profile_error": ProfileError,
    "tooth_crack": ToothCrack,
    "mass_unbalance": MassUnbalance,
    "torque_ripple": TorqueRipple,
    "bearing_defect": BearingDefect,
    "backlash_rattle": BacklashRattle,
    "mesh_stiffness_loss": MeshStiffnessLoss,
    "mesh_damping": MeshDamping,
    "sensor_gain": SensorGain,
    "sensor_resonance": SensorResonance,
    "unknown_effect": UnknownEffect,
}

__all__ = ["EFFECTS", "BearingGeometry", "Effect", "Parameter", "Response", "Setup", "neutral", "solve_with"]
