"""No key of a rig file is read and then ignored: each changes what is computed or said, or its change is refused."""

import copy
from functools import cache

import numpy as np
import pytest

from service.files.rig import expected_channels
from service.stream.window import by_sound_instruments
from tests.mesh_pairs import UNSW_RIG
from twin.dynamics.structure import Structure
from twin.errors import ParameterError
from twin.features.window_features import WindowFeatures
from twin.model import Calibration, mesh_of
from twin.rig import Rig
from twin.rig_notes import rig_notes
from twin.updating.conditions import kind_of
from twin.updating.model_cache import deepest
from twin.wear.profile import WornProfile
from twin.windows import Edges, Window

FULL = copy.deepcopy(UNSW_RIG) | {"tolerances": {"stiffness": 0.03, "mass": 0.01, "damping": 0.2}}
FULL["tolerances"] |= {
    f"{wheel}_{what}": 1e-6 for wheel in ("pinion", "gear") for what in ("once_per_turn", "graduation")
}
FULL["tolerances"] |= {"accelerometer_gain": 0.2, "acceleration_floor": 0.002, "torque_floor": 0.005}
FULL["sensors"] |= {"temperature": ["oil"], "ranges": {"accel": {"y6": 500.0}, "torque": 50.0}}
FULL["mesh"] |= {"stiffness_source": "energy"}
FULL["couplings"]["lateral_stiffness"] = 1e6
FULL["estimated"] = {
    "by": "gear-twin init", "parts": ["structure"], "spread": {"structure": 0.5}, "derived": ["gears.addendum"],
    "assumed": ["bearings.kx_input"],
}  # fmt: skip

DESCRIPTIVE = ("reference.",)  # the table that is declared as not used by the model
OTHER_TEXT = {
    "schema": "gear-rig/2",
    "name": "another",
    "mesh.stiffness_source": "given",
    "sensors.accelerometer": "y4",
    "sensors.encoder_input": "th5",
    "sensors.encoder_output": "th10",
    "sensors.torque": "k_12_13*(th12-th13)",
    "end_of_life.criterion": "rms",
    "estimated.by": "another",
}


def leaves(table, path=""):
    for key, value in table.items():
        if isinstance(value, dict):
            yield from leaves(value, f"{path}{key}.")
        else:
            yield f"{path}{key}"


KEYS = [key for key in leaves(FULL) if not key.startswith(DESCRIPTIVE)]


def another(path, value):
    """A plausible other value of a key."""
    if isinstance(value, str):
        return OTHER_TEXT[path]
    if isinstance(value, list):
        if isinstance(value[0], str):
            return [*value[:-1], "another"]
        return [[x * 1.2 for x in item] if isinstance(item, list) else item * 1.2 for item in value]
    return value + 3 if isinstance(value, int) and value < 100 else type(value)(value * 1.3)


def changed(path):
    values = copy.deepcopy(FULL)
    *tables, key = path.split(".")
    node = values
    for table in tables:
        node = node[table]
    node[key] = another(path, node[key])
    return values


def windows_at(rig):
    """Kinds of windows at a row of low speeds, as the rig's calibration points decide."""
    speeds, torques = np.linspace(1.5, 3.5, 9), (8.0, 10.0, 13.0, 20.0, 26.0)
    return [
        kind_of(WindowFeatures(start_time_ns=0, duration=1.0, quality="good", speed_hz=float(f), torque_nm=t), rig)
        for f in speeds
        for t in torques
    ]


@cache
def encoder_window():
    times = np.arange(64) / 1e4
    return Window(
        start_time_ns=0,
        encoders={
            "pinion": Edges(per_rev=1024, first_index=0, times=times),
            "gear": Edges(per_rev=2048, first_index=0, times=times),
        },
    )


def outputs(rig):
    """What the twin makes of a rig file, without running it."""
    structure, mesh = Structure.from_rig(rig), mesh_of(rig, 256)
    nominal = rig.require("the nominal state", "operating.pinion_speed_hz", "operating.input_torque")
    wear = rig.require("the wear rate", "wear.K", "wear.dwell_time")
    arrays = (
        structure.mass,
        structure.stiffness,
        structure.damping,
        structure.mesh,
        structure.transmission_error,
        structure.torque_meter,
        *mesh.drive_tables,
        *mesh.back_tables,
        mesh.contacts(WornProfile.unworn(mesh.pair), 10.0).separation,
    )
    said = (
        rig.name,
        rig.accelerometer,
        rig.band,
        rig.tolerances,
        rig.estimated,
        rig.sensor_range("accel", "y6"),
        rig.sensor_range("torque", "pinion"),
        Calibration.prior(rig),
        nominal,
        wear,
        deepest(rig, 0.0),
        windows_at(rig),
        expected_channels(rig),
        by_sound_instruments(rig, encoder_window()).faults,
        rig.mesh_stiffness_source,
        rig_notes(rig),
    )
    return repr((said, [(a.tobytes()) for a in arrays]))


@cache
def reference():
    return outputs(Rig.from_mapping(FULL))


def test_reference_rig_file_agrees_with_itself():
    assert rig_notes(Rig.from_mapping(UNSW_RIG)) == ()


@pytest.mark.parametrize("path", KEYS)
def test_every_key_changes_an_output_or_is_refused(path):
    try:
        rig = Rig.from_mapping(changed(path))
    except ParameterError:
        return
    assert outputs(rig) != reference(), f"{path} is accepted and ignored"
