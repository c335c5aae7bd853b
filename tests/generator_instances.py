"""Machines, specs and effects that the tests of the generator share."""

import tomllib
from functools import cache
from pathlib import Path

import numpy as np

from recordings.generator.effects import EFFECTS, Knobs, knobs_at
from recordings.generator.flanks import pair_of
from recordings.generator.machine import Condition, Machine
from recordings.generator.schema import Number, Text, checked
from recordings.generator.structure import build

RECORDINGS = Path(__file__).parents[1] / "recordings"
RATED = Condition(2 * np.pi * 10, 10.0)

SPEC = {
    "schema": "gear-campaign/1",
    "asset": "test-rig",
    "seed": 5,
    "wear": {"k_m2_per_n": 6e-12},
    "machine": {"slices": 3},
    "calibration": [{"speed_hz": 2.0, "torque_nm": 10.0, "seconds": 0.5}],
    "conditions": [{"speed_hz": 10.0, "torque_nm": 10.0}],
    "windows": {"seconds": 0.5, "at_revolutions": [0, 100]},
}

EFFECT_INSTANCES = {
    "pinion_eccentricity": {"e_um": 20.0},
    "gear_eccentricity": {"e_um": 60.0, "phase": 0.4},
    "misalignment": {"lead_um": 30.0},
    "tooth_friction": {"mu": 0.1},
    "pitch_error": {"pinion_um": 4.0, "gear_um": 3.0},
    "profile_error": {"tip_relief_um": 8.0},
    "tooth_crack": {"tooth": 12, "remaining_stiffness": 0.5},
    "mass_unbalance": {"pinion_g_mm": 300.0},
    "torque_ripple": {"amplitude_nm": 1.0, "order": 2.0},
    "bearing_defect": {"force_n": 5.0, "order": 3.2},
    "sensor_gain": {"gain": 0.9},
    "sensor_resonance": {"frequency_hz": 1500.0},
    "mesh_damping": {"factor": 2.0},
    "mesh_stiffness_loss": {"loss": 0.2},
    "backlash_rattle": {"load_ripple_nm": 12.0, "order": 2.0},
    "mains_interference": {"frequencies_hz": [50.0, 150.0], "amplitudes": [1.0, 0.5]},
    "order_tone": {"amplitude": 2.0, "order": 7.43},
    "level_modulation": {"depth": 0.3, "frequency_hz": 39.6},
    "random_impacts": {"amplitude": 20.0, "rate_hz": 8.0, "frequency_hz": 1200.0},
    "rub": {"amplitude": 3.0},
    "drifting_tone": {"amplitude": 2.0, "frequency_hz": 310.0},
    "second_mesh": {"amplitude": 2.0, "teeth": 31, "shaft_hz": 24.0},
    "loose_bearing": {"play_um": 40.0},
    "coupling_misalignment": {"offset_mm": 0.15, "angle_deg": 1.0},
    "shaft_rub": {"force_n": 30.0},
    "loose_foot": {"load_n": 20.0, "unbalance_g_mm": 4000.0},
    "loose_accelerometer": {"hold": 30.0},
    "time_shift": {"shift_ms": 1.0},
    "wrong_polarity": {},
    "lost_encoder_line": {"line": 100},
    "doubled_encoder_line": {"line": 100},
}


@cache
def rig() -> dict:
    return tomllib.loads((RECORDINGS / "rigs" / "unsw.toml").read_text(encoding="utf-8"))


@cache
def pair():
    return pair_of(rig())


def machine(*, step_rate=102400.0, slices=1, phase=1e-3, damping=1.0) -> Machine:
    """The reference rig as the file says, without any perturbation, unworn."""
    structure = build(rig(), np.random.default_rng(0))
    n = len(pair().points)
    return Machine(
        structure=structure,
        pair=pair(),
        slices=slices,
        stiffness_scale=1.0,
        damping_time=damping * rig()["mesh"]["relative_damping_time"],
        rated_torque=10.0,
        phase=phase,
        accelerometer="y6",
        dt=1 / step_rate,
        pinion_worn=np.zeros((19, n, slices)),
        gear_worn=np.zeros((52, n, slices)),
    )


def knobs(name: str | None = None, **parameters) -> Knobs:
    """The knobs with one effect turned on from the start."""
    if name is None:
        return Knobs()
    age = Number("rev", 0, 1e9, 0.0)
    schema = {"name": Text(), "onset_revolutions": age, "full_revolutions": age, **EFFECTS[name].parameters}
    row = checked({"name": name, **parameters}, schema)
    return knobs_at((row,), 0.0, pair(), seed=3)[0]


def steady(m: Machine, effect: Knobs, seconds: float, condition: Condition = RATED, settle: float = 0.6):
    """The record of a machine that has settled, (steps, 8)."""
    rng = np.random.default_rng(1)
    motion = m.at_rest(condition, effect, 0.3)
    m.settle(motion, condition, effect, settle, rng)
    return m.run(motion, condition, effect, seconds, rng)


def transmission_error(record) -> np.ndarray:
    """Rb1·th7 − Rb2·th8 [m]."""
    rb = pair().base_radius
    return rb[0] * record[:, 2] - rb[1] * record[:, 3]


def order_amplitude(record, values, order: float) -> float:
    """Amplitude of `values` at an order of the pinion, over whole pinion turns."""
    turns = record[:, 2] / (2 * np.pi)
    whole = int(turns[-1] - turns[0])
    at = turns[0] + np.arange(whole * 4096) / 4096
    y = np.interp(at, turns, values)
    return float(2 * abs(np.mean((y - y.mean()) * np.exp(-2j * np.pi * order * at))))
