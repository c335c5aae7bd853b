"""The spec of a campaign is checked key by key, and what is wrong is said in one line."""

import copy

import pytest

from recordings.generator import SpecError
from recordings.generator.effects import EFFECTS
from recordings.generator.spec import read
from tests.generator_instances import SPEC


def changed(path, value):
    spec = copy.deepcopy(SPEC)
    node = spec
    *parents, last = path
    for key in parents:
        node = node[key] if isinstance(node, list) else node.setdefault(key, {})
    node[last] = value
    return spec


def test_what_is_left_out_is_filled_in():
    spec = read(SPEC)
    assert spec["sensors"]["acceleration_rate_hz"] == 12800
    assert spec["wear"]["step_um"] == 1.0
    assert spec["conditions"][0]["until_revolutions"] == float("inf")


@pytest.mark.parametrize(
    ("path", "value", "says"),
    [
        (
            ("wear", "k_m2_per_newton"),
            1e-12,
            "wear.k_m2_per_newton is not a key.*did you mean wear.k_m2_per_n",
        ),
        (("wear", "k_m2_per_n"), 1.0, r"wear.k_m2_per_n = 1 m²/N is outside \[0, 1e-09\] m²/N"),
        (("seed",), 1.5, "seed = 1.5 must be a whole number"),
        (("asset",), 7, "asset = 7 must be text"),
        (("schema",), "gear-campaign/9", "schema = 'gear-campaign/9' must be 'gear-campaign/1'"),
        (("windows", "at_revolutions"), [100, 0], "windows.at_revolutions must rise"),
        (("windows", "at_revolutions"), 100, "windows.at_revolutions = 100 must be a list"),
        (("calibration",), {"speed_hz": 2.0}, "calibration must be a list of tables"),
        (("conditions", 0, "until_revolutions"), 5.0, "conditions must be in rising order"),
        (("conditions", 0, "torque_nm"), -3.0, r"conditions\[0\].torque_nm = -3 N·m is outside"),
        (("sensors", "acceleration_rate_hz"), 13000.0, "sensors.acceleration_rate_hz = 13000 Hz must divide"),
        (("effects",), [{"name": "gremlin"}], "effects.0..name = 'gremlin' must be one of"),
        (("effects",), [{"name": "misalignment"}], "effects.0..lead_um is missing"),
        (("faults",), [{"kind": "lost", "window": 9}], "faults.0..window = 9 but there are 3 windows"),
        (("started",), "2026-01-05T08:00:00", "started = .* must be ISO 8601 with a time zone"),
        (("started",), "Monday", "started = 'Monday' must be ISO 8601"),
        (("sensors", "missing"), ["encoder/hub"], "sensors.missing = .* must be a list out of torque/pinion"),
        (("truth", "to_end_of_life"), 1, "truth.to_end_of_life = 1 must be true or false"),
    ],
)
def test_a_wrong_spec_is_one_clear_error(path, value, says):
    with pytest.raises(SpecError, match=says) as error:
        read(changed(path, value))
    assert "\n" not in str(error.value)


def test_a_missing_key_is_named():
    spec = copy.deepcopy(SPEC)
    del spec["seed"]
    with pytest.raises(SpecError, match="seed is missing"):
        read(spec)


def test_an_effect_does_not_take_another_ones_parameters():
    effects = [{"name": "tooth_friction", "mu": 0.1, "lead_um": 3.0}]
    with pytest.raises(SpecError, match="lead_um is not a key"):
        read(changed(("effects",), effects))


CONTRACT = {
    *(
        "pinion_eccentricity",
        "gear_eccentricity",
        "misalignment",
        "tooth_friction",
        "pitch_error",
        "profile_error",
    ),
    *("tooth_crack", "mass_unbalance", "torque_ripple", "bearing_defect", "backlash_rattle", "sensor_gain"),
    *("mesh_stiffness_loss", "mesh_damping", "sensor_resonance"),
}


def test_every_effect_name_of_the_contract_can_be_put_in():
    assert set(EFFECTS) >= CONTRACT
