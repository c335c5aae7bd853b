"""Machines whose structure nobody knows, drawn from what a rig file of `gear-twin init` states, and their windows."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache

import numpy as np

from service.setup.answers import checked_answers
from service.setup.rig_file import draft_of
from tests.updating_cases import seen
from twin.features.window_features import WindowFeatures
from twin.model import Calibration, Condition, Model
from twin.options import Options
from twin.rig import Rig
from twin.structure_spread import drawn
from twin.updating.memory import Memory
from twin.updating.outcome import UpdateOutcome
from twin.updating.update import update_twin
from twin.wear.curve import MasterCurve

LAB = {
    "age": "new",
    "pinion_teeth": 19, "gear_teeth": 52, "speed": "10 Hz", "torque": "10 Nm", "module": "2 mm", "face_width": "20 mm",
    "lubrication": "dry", "encoder_pinion": 1024, "encoder_gear": 2048, "torque_meter": True,
    "accelerometers": [{"place": "pinion free side"}],
}  # fmt: skip
PUMP = LAB | {
    "pinion_teeth": 23, "gear_teeth": 57, "module": "2.5 mm", "face_width": "30 mm", "speed": "1476 rpm",
    "torque": "80 Nm",
}  # fmt: skip
DEPTHS = np.array([0.0, 5.0, 12.0, 25.0, 45.0, 70.0]) * 1e-6
TURNS_PER_METRE = 5e7  # of the pinion: 20 µm in 1000 turns


@lru_cache(maxsize=4)
def rig_of(name: str) -> Rig:
    return draft_of(checked_answers({"lab": LAB, "pump": PUMP}[name], "answers")).rig


def machine(name: str, seed: int) -> Model:
    """A machine that the rig file of these answers may describe."""
    rig = drawn(rig_of(name), np.random.default_rng(seed))
    return Model.of(rig, Calibration.prior(rig))


def windows(twin: Model, condition: Condition, drift: float = 1e-6, seed: int = 1) -> Iterator[WindowFeatures]:
    """Windows of a machine that wears, with noise and a zero between its discs that drifts [m a window]."""
    curve = MasterCurve.build(twin, condition, twin.unworn, DEPTHS[-1])
    random = np.random.default_rng(seed)
    zero = 3e-3
    for i, depth in enumerate(DEPTHS):
        zero += drift * random.standard_normal()
        yield seen(
            curve.profile(float(depth)), condition, twin=twin, revolutions=5.0 + depth * TURNS_PER_METRE,
            phase=1.0, offset=zero, noise=2e-8, seed=100 * seed + i,
        )  # fmt: skip


def followed(rig: Rig, features: Iterator[WindowFeatures]) -> list[UpdateOutcome]:
    """What the twin with a rig file makes of windows."""
    memory, out = Memory(), []
    for i, window in enumerate(features):
        outcome = update_twin(rig, memory, window, i, Options().updating(rig))
        memory = outcome.memory
        out.append(outcome)
    return out


@lru_cache(maxsize=4)
def followed_of(name: str, seed: int) -> list[UpdateOutcome]:
    """A machine of these answers, followed with their rig file."""
    rig, twin = rig_of(name), machine(name, seed)
    speed, torque = rig.require("the condition", "operating.pinion_speed_hz", "operating.input_torque")
    return followed(rig, windows(twin, Condition(speed_hz=speed, torque=torque), seed=seed))


def lost_count(features: WindowFeatures, jump: float) -> WindowFeatures:
    """The window with a mean transmission error that is off by a jump [m]."""
    te = features.transmission_error
    assert te is not None
    mean = te.amplitudes[0] + jump
    return replace(features, transmission_error=replace(te, amplitudes=(mean, *te.amplitudes[1:])))
