"""`gear-twin init`: answers become a rig file and a mapping; mistakes are refused with a likely cause."""

from __future__ import annotations

import importlib.util
import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from service.cli.commands import app
from service.errors import InputError
from service.files.import_mapping import load_import_mapping
from service.files.rig import load_rig
from service.setup.abilities import NO, PARTLY, YES, abilities, equipment_of, one_more
from service.setup.answers import checked_answers
from service.setup.questions import quantity
from service.setup.rig_file import draft_of, rig_text
from tests.mesh_pairs import UNSW_RIG
from twin.rig import Rig
from twin.rig_notes import rig_notes
from twin.updating.update import NEEDED

EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "answers.toml"
FULL = {key: value for key, value in tomllib.loads(EXAMPLE.read_text()).items() if key != "schema"}
POOR = {
    "pinion_teeth": 23, "gear_teeth": 57, "speed": "1476 rpm", "encoder_pinion": 1,
    "accelerometers": [{"column": "Acc1 (g)", "unit": "g"}],
}  # fmt: skip


def draft(**change):
    return draft_of(checked_answers({**FULL, **change}, "answers"))


def rig_of(**change) -> Rig:
    return draft(**change).rig


def can(answers):
    given = checked_answers(answers, "answers")
    equipment = equipment_of(given, draft_of(given))
    return {a.what: a for a in abilities(equipment)}, one_more(equipment)


def test_the_example_makes_a_rig_file_with_a_model(tmp_path):
    run = CliRunner().invoke(app, ["init", "--answers", str(EXAMPLE), "--out", str(tmp_path / "new")])
    assert run.exit_code == 0, run.output
    rig = load_rig(tmp_path / "new" / "rig.toml")
    assert rig.has(*NEEDED)
    assert rig_notes(rig) == ()
    assert rig.gear_pair().contact_ratio == pytest.approx(1.65258, abs=1e-4)  # the reference rig file's
    assert rig.estimated.by == "gear-twin init"
    assert "bearings.ky_input" in rig.estimated.assumed and "gears.addendum" in rig.estimated.derived
    assert "wear depth" in run.output and "What this machine can tell" in run.output


def test_the_geometry_of_the_reference_rig_follows_from_its_data_sheet():
    got, known = rig_of().gear_pair(), Rig.from_mapping(UNSW_RIG).gear_pair()
    for name in (
        "teeth",
        "module",
        "pressure_angle",
        "face_width",
        "addendum",
        "dedendum",
        "base_radius",
        "path_start",
    ):
        assert getattr(got, name) == pytest.approx(getattr(known, name), rel=1e-6), name


def test_every_value_states_its_origin_and_the_file_is_the_draft():
    found = draft()
    text = rig_text(found)
    values = [line for line in text.splitlines() if " = " in line and not line.startswith(("schema", "name"))]
    listed = text.index("[estimated]")
    assert all("# given" in v or "# derived" in v or "# assumed" in v for v in values if text.index(v) < listed)
    assert Rig.from_mapping(tomllib.loads(text)).estimated.assumed == found.rig.estimated.assumed


@pytest.mark.parametrize("signal", ["edge times", "quadrature", "pulses"])
def test_the_mapping_is_one_that_import_reads(tmp_path, signal):
    answers = tmp_path / "answers.toml"
    answers.write_text(EXAMPLE.read_text().replace("edge times", signal))
    run = CliRunner().invoke(app, ["init", "--answers", str(answers), "--out", str(tmp_path)])
    assert run.exit_code == 0, run.output
    mapping = tomllib.loads((tmp_path / "mapping.toml").read_text())
    assert mapping["rig"] == "rig.toml"
    edges = 4096 if signal == "quadrature" else 1024
    read = {c.label: c for c in load_import_mapping(tmp_path / "mapping.toml").channels}
    assert set(read) == {"accel/y6", "torque/pinion", "encoder/pinion", "encoder/gear"}
    if signal != "pulses":
        assert read["encoder/pinion"].edges_per_rev == edges
    assert load_rig(tmp_path / "rig.toml").get("encoders.pinion_edges_per_rev") == edges


def test_a_mapping_may_name_its_rig_file(tmp_path):
    (tmp_path / "rig.toml").write_text(rig_text(draft()))
    (tmp_path / "mapping.toml").write_text(
        'schema = "gear-import/1"\nasset = "a"\nrig = "rig.toml"\n[file]\npath = "x.csv"\nsample_rate_hz = 5120\n'
        '[channels.y6]\nunit = "g"\n'
    )
    assert load_import_mapping(tmp_path / "mapping.toml").rig["gears"]["pinion"]["teeth"] == 19


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"module": 2}, "module = 2 needs a number with its unit, such as '2 mm'"),
        ({"speed": "600"}, "speed = '600' needs a number with its unit, such as '600 rpm'"),
        ({"speed": "600 Hz"}, "speed = 36000 rpm = 600 Hz is outside (0, 500] Hz: rpm or Hz?"),
        ({"module": "2 in"}, "is 0.394 modules of 50.8 mm"),
        ({"module": "2 m"}, "module = 2000 mm is outside [0.2, 60] mm: another unit, or a diametral pitch"),
        ({"pinion_teeth": 52, "gear_teeth": 19}, "pinion_teeth = 52 is more than gear_teeth = 19: swapped?"),
        ({"power": "4 kW"}, "torque = 10 N·m contradicts power = 4000 W at 10 Hz, which makes 63.66 N·m"),
        ({"centre_distance": "72.5 mm"}, "makes a module of 2.042 mm and contradicts module = 2 mm"),
        ({"face_width": "20 cm"}, "face_width = 200 mm is 100 modules of 2 mm"),
        ({"pressure_angle": "20 rad"}, "pressure_angle"),
        ({"wear_limit": "0.5 cm"}, "wear_limit = 5 mm is more than a tooth of module 2 mm is thick"),
        ({"shaft_diameter_pinion": "40 mm"}, "shaft_diameter_pinion = 40 mm must be below the root diameter"),
        ({"teeth": 19}, "teeth is not a question of init"),
        ({"pinion_teeth": float("inf")}, "pinion_teeth = inf must be a number, such as"),
        ({"torque_meter": ["yes"]}, "torque_meter = ['yes'] must be yes or no"),
        ({"torque": "10 kg"}, "'kg' is no unit of torque; known: Nm"),
        ({"known": {"inertia.J1": 1.0}}, "inertia is not a key of a rig file; did you mean inertias?"),
        ({"known": {"inertias.J1": 1e9}}, "inertias.J1 = 1e+09 kg·m² is outside"),
        ({"accelerometers": [{"place": "gearbox"}]}, "accelerometers[0].place = 'gearbox' must be one of pinion drive"),
        ({"accelerometers": [{"unit": "V"}]}, "unit 'V' and sensitivity (V per m/s²) go together"),
    ],
)
def test_a_wrong_answer_is_refused_with_a_likely_cause(change, message):
    with pytest.raises(InputError) as caught:
        draft(**change)
    assert message in str(caught.value)


def test_what_can_be_derived_of_other_dimensions_is():
    for key, value in (("centre_distance", "71 mm"), ("outside_diameter", "108 mm")):
        change = {key: value, "module": ""}
        assert rig_of(**change).get("gears.module") == pytest.approx(0.002)
        assert "gears.module" in rig_of(**change).estimated.derived
    assert rig_of(torque="", power="628.3 W").get("operating.input_torque") == pytest.approx(10, rel=1e-3)


def test_known_values_replace_generic_ones():
    rig = rig_of(known={"bearings": {"ky_input": 1.4e7}, "inertias.J1": 0.0135})
    assert rig.get("bearings.ky_input") == 1.4e7
    assert not {"bearings.ky_input", "inertias.J1"} & set(rig.estimated.assumed)
    assert "bearings.kx_input" in rig.estimated.assumed


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"module": ""}, "the module is not known"),
        ({"face_width": ""}, "the face width is not known"),
        ({"torque": ""}, "neither torque nor power is known"),
        ({"helix_angle": "12 deg"}, "the gears are helical (12°), and the model is of spur gears"),
        ({"profile_shift": "0.3"}, "the profile shift is 0.3, and the model is of gears without one"),
    ],
)
def test_what_allows_no_model_is_said_and_the_rest_still_serves(change, reason):
    found = draft(**change)
    assert found.without_model[0].startswith(reason)
    assert not found.rig.has(*NEEDED) and found.rig.teeth == (19, 52)
    table, _ = can({**FULL, **change})
    assert table["wear depth"].level == NO and reason in table["wear depth"].how
    assert table["change against a healthy baseline"].level == YES


def test_where_the_gear_drives_the_files_call_it_the_pinion():
    rig = rig_of(driver="gear", torque="27 Nm", accelerometers=[{"place": "gear free side"}])
    assert rig.teeth == (52, 19)
    assert rig.get("encoders.pinion_edges_per_rev") == 2048
    assert rig.accelerometer == "y6"


def test_accelerometers_are_named_by_their_place_in_the_model():
    places = [
        {"place": "gear drive side", "direction": "along"}, {"place": "pinion drive side"},
        {"place": "pinion drive side"},
    ]  # fmt: skip
    assert draft(accelerometers=places).accelerometers == ("x11", "y4", "y4-2")


def test_a_limit_that_nobody_states_is_a_tenth_of_the_tooth_and_is_said_to_be_assumed():
    rig = rig_of(wear_limit="")
    assert rig.get("end_of_life.max_depth") == pytest.approx(0.1 * 3.14159e-3, rel=1e-4)
    assert "end_of_life.max_depth" in rig.estimated.assumed


def test_what_a_machine_with_everything_can_tell():
    table, more = can(FULL)
    assert table["wear depth"].level == YES and table["remaining life"].level == YES
    assert "estimated" in table["wear depth"].how
    assert more == ()


def test_an_accelerometer_and_a_tachometer_show_no_depth_and_what_would():
    table, more = can(POOR)
    assert table["wear depth"].level == NO
    assert table["condition indicators"].level == YES
    assert table["ratio and run-out of the gears"].level == NO
    known = {"module": "2.5 mm", "face_width": "25 mm", "torque": "50 Nm"}
    table, more = can({**POOR, **known})
    assert table["wear depth"].level == PARTLY
    assert any("encoders on both shafts (154 and 380 edges" in line and "wear depth" in line for line in more)


def test_a_coarse_encoder_is_named():
    table, more = can({**FULL, "encoder_gear": 100, "accelerometers": []})
    assert table["wear depth"].level == NO
    assert any("accelerometer" in line for line in more)
    _, more = can({**FULL, "encoder_gear": 100})
    assert any("at least 347 edges a turn on the driven shaft" in line for line in more)


def test_questions_are_asked_and_a_wrong_answer_is_asked_again(tmp_path):
    said = [
        "box-1", "19", "52", "", "600", "600 rpm", "", "628 W", "", "71 mm", "", "20 mm", "", "", "",
        "old", "1200 h", "", "dry", "", "", "1024", "2048", "edge times", "e1", "", "yes", "", "", "", "", "", "",
        "y", "acc", "g", "", "", "n",
    ]  # fmt: skip
    run = CliRunner().invoke(app, ["init", "--out", str(tmp_path), "--json", "-"], input="\n".join(said) + "\n")
    assert run.exit_code == 0, run.output
    assert "speed = '600' needs a number with its unit" in run.output
    assert "age = 'old' must be new, unknown, revolutions of the pinion" in run.output
    rig = load_rig(tmp_path / "rig.toml")
    mapping = tomllib.loads((tmp_path / "mapping.toml").read_text())
    assert mapping["channels"]["encoder"]["pinion"]["column"] == "e1"
    assert rig.get("gears.age") == pytest.approx(1200 * 3600 * 10.0) and mapping["age"] == "43200000 rev"
    assert rig.name == "box-1" and rig.get("gears.module") == pytest.approx(0.002)
    answer = json.loads(run.output[run.output.index("{") :])
    assert answer["abilities"][0]["what"] == "wear depth"
    assert answer["without_model"] == []


@pytest.mark.slow
def test_a_csv_file_with_a_tachometer_gets_in_with_the_files_that_init_writes(tmp_path):
    """The tutorial's machine: from answers to an assessment that claims neither depth nor life without saying so."""
    spec = importlib.util.spec_from_file_location("machine", EXAMPLE.parent / "machine.py")
    assert spec is not None and spec.loader is not None
    machine = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(machine)
    values = machine.recording(0.5, seed=3, modulation=0.15, duration=6.0)
    header = ",".join(machine.COLUMNS)
    np.savetxt(tmp_path / "run.csv", values, delimiter=",", header=header, comments="", fmt="%.9g")
    (tmp_path / "answers.toml").write_text(
        'schema = "gear-answers/1"\nasset = "pump-drive"\npinion_teeth = 23\ngear_teeth = 57\nspeed = "1476 rpm"\n'
        'module = "2.5 mm"\nface_width = "25 mm"\npower = "4 kW"\nencoder_pinion = 1\n'
        'encoder_pinion_column = "Tacho (V)"\ndata_file = "run.csv"\n'
        '[[accelerometers]]\ncolumn = "Acc1 (g)"\nunit = "g"\n'
    )
    steps = (
        ["init", "--answers", str(tmp_path / "answers.toml"), "--out", str(tmp_path)],
        ["import", str(tmp_path / "mapping.toml"), "--out", str(tmp_path / "run.mcap")],
        ["doctor", str(tmp_path / "run.mcap"), "--json", str(tmp_path / "doctor.json")],
        ["assess", str(tmp_path / "run.mcap"), "--no-trace", "--json", str(tmp_path / "answer.json")],
    )
    for step in steps:
        run = CliRunner().invoke(app, step)
        assert run.exit_code == 0, (step, run.output, run.exception)
    said = json.loads((tmp_path / "doctor.json").read_text())
    assert {row["label"] for row in said["channels"]} == {"accel/y6", "encoder/pinion"}
    assert said["abilities"][0]["level"] == PARTLY
    answer = json.loads((tmp_path / "answer.json").read_text())
    assert answer["status"]["level"] not in ("alarm", "end_of_life")
    for part in ("wear", "rul"):
        assert answer[part].get("preliminary") or answer[part].get("reason")


def test_files_that_are_there_are_not_replaced_unasked(tmp_path):
    (tmp_path / "rig.toml").write_text("mine")
    with pytest.raises(InputError, match="--force replaces it"):
        CliRunner().invoke(app, ["init", "--answers", str(EXAMPLE), "--out", str(tmp_path)], catch_exceptions=False)
    assert (tmp_path / "rig.toml").read_text() == "mine"


@pytest.mark.parametrize(
    ("text", "kind", "si"),
    [
        ("2,5 mm", "length", 2.5e-3), ("1500 rpm", "speed", 25.0), ("25 Hz", "speed", 25.0), ("1.5 kW", "power", 1500),
        ("0.1 in", "length", 2.54e-3), ("20 deg", "angle", 0.34906585), ("10 lbf·ft", "torque", 13.558179),
    ],
)  # fmt: skip
def test_quantities_are_read_with_their_units(text, kind, si):
    assert quantity("x", text, kind, "") == pytest.approx(si, rel=1e-6)
