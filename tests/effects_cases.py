"""One instance of every effect, and the lines that it may move: multiples of so many 1/52 of a pinion turn."""

from functools import lru_cache

from tests.dynamics_cases import RIG, TEN, model, worn
from twin.dynamics.structure import direction
from twin.effects import EFFECTS, Response, solve_with

MESH, PINION, GEAR = 988, 52, 19  # lines of the hunting-tooth record between two orders of each
TEETH = RIG.teeth

INSTANCES = {
    "none": (EFFECTS["none"](), MESH),
    "pinion_eccentricity": (EFFECTS["pinion_eccentricity"](eccentricity=20e-6, high_point=0.7), PINION),
    "gear_eccentricity": (EFFECTS["gear_eccentricity"](eccentricity=20e-6, high_point=0.7), GEAR),
    "misalignment": (EFFECTS["misalignment"](lead_gap=20e-6), MESH),
    "tooth_friction": (EFFECTS["tooth_friction"](coefficient=0.1, static_ratio=1.25), MESH),
    "pitch_error": (EFFECTS["pitch_error"].drawn(TEETH, 5e-6, 0.0, seed=1), PINION),
    "profile_error": (EFFECTS["profile_error"](pinion_relief=10e-6, gear_relief=5e-6, slope=3e-6), MESH),
    "tooth_crack": (EFFECTS["tooth_crack"](stiffness_loss=0.2, tooth=3), PINION),
    "mass_unbalance": (EFFECTS["mass_unbalance"](pinion=1e-3, gear=0.0), PINION),
    "torque_ripple": (EFFECTS["torque_ripple"](amplitude=0.5, order=10.0), PINION),
    "bearing_defect": (EFFECTS["bearing_defect"](blow=20.0, order=3.5, place="y6"), 26),  # gcd(182, 988)
    "backlash_rattle": (EFFECTS["backlash_rattle"](extra_backlash=1e-4, load_ripple=2.0, order=2.0), PINION),
    "mesh_stiffness_loss": (EFFECTS["mesh_stiffness_loss"](loss=0.1), MESH),
    "mesh_damping": (EFFECTS["mesh_damping"](factor=2.0), MESH),
    "sensor_gain": (EFFECTS["sensor_gain"](gain=0.88), MESH),
    "sensor_resonance": (EFFECTS["sensor_resonance"](frequency=3000.0, damping_ratio=0.03), MESH),
}
INSTANCES["unknown_effect"] = (
    EFFECTS["unknown_effect"](
        amplitude=(2e-6,), frequency=(0.0,), order=(3.5,), entry=("mesh",), drift=(0.0,), torque_exponent=(0.0,),
        speed_exponent=(0.0,), growth=(0.0,), since=(0.0,), torque=TEN.torque, speed=TEN.speed_hz,
    ),
    26,  # gcd(182, 988)
)  # fmt: skip
GEAR_INSTANCES = {
    "gear pitch": (EFFECTS["pitch_error"].drawn(TEETH, 0.0, 5e-6, seed=1), GEAR),
    "gear crack": (EFFECTS["tooth_crack"](stiffness_loss=0.2, tooth=3, on="gear"), GEAR),
    "gear unbalance": (EFFECTS["mass_unbalance"](gear=1e-3), GEAR),
}


def solved(*effects, depth: float = 0.0, condition=TEN, period=None, samples=None) -> Response:
    """The reference rig with effects at a wear depth [m]."""
    found = solve_with(model(), effects, worn(TEN, depth), condition, period, samples=samples)
    found.steady.require_converged()
    return found


@lru_cache(maxsize=32)
def with_instance(name: str, period: str) -> Response:
    return solved({**INSTANCES, **GEAR_INSTANCES}[name][0], period=period)


def action_power(found):
    """Power that the actions of the contacts take from the mean rotation (n,) [W].

    Those of an error that only varies in time give back what they take, over a period.
    """
    ω1, ω2 = found.setup.omega
    turning = direction({f"th{n}": ω1 for n in (1, 2, 3, 5, 7)} | {f"th{n}": ω2 for n in (8, 10, 12, 13)})
    sides = found.contacts.side[:, None] * found.steady.contact_forces
    return sum(float(a.direction @ turning) * (a.weight * sides).sum(axis=0) for a in found.contacts.actions)
