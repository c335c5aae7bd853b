"""What a recording that was imported says of the gears' age: what a person states, and nothing else."""

from __future__ import annotations

import json
import runpy
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from service.cli.commands import app
from service.errors import InputError
from service.files.rig import age_of, load_rig, rig_of
from service.stream.sources.mcap import Recording

ROOT = Path(__file__).parents[2]
RATE, SPEED, SECONDS = 2000, 10.0, 6.0
MAPPING = """schema = "gear-import/1"
asset = "box"
{head}
[file]
path = "{path}"
sample_rate_hz = 2000

[channels.y6]
column = "acc"
unit = "m/s2"

[channels.tachometer.pinion]
column = "tacho"
{channel}
{rig}
"""
RIG = "[rig.gears.pinion]\nteeth = 23\n\n[rig.gears.gear]\nteeth = 57\n\n[rig.operating]\npinion_speed_hz = 10.0\n"


@pytest.fixture
def imported(tmp_path):
    """Imports one file by a mapping, and answers the age in the attached rig file and what was said."""
    t = np.arange(round(RATE * SECONDS)) / RATE
    acc, tacho = np.random.default_rng(1).standard_normal(t.size), np.where((t * SPEED) % 1 < 0.3, 5.0, 0.0)
    for name in ("first.csv", "later.csv"):
        np.savetxt(tmp_path / name, np.c_[acc, tacho], delimiter=",", header="acc,tacho", comments="", fmt="%.5g")

    def by(*options, head="", channel="", rig=RIG):
        mapping, out = tmp_path / "mapping.toml", tmp_path / "out.mcap"
        mapping.write_text(MAPPING.format(head=head, path="first.csv", channel=channel, rig=rig))
        options = [str(tmp_path / o) if o.endswith(".csv") else o for o in options]
        done = CliRunner().invoke(app, ["import", str(mapping), "--out", str(out), *options])
        assert done.exit_code == 0, (done.output, done.exception)
        with Recording(out) as recording:
            return rig_of(recording, None).get("gears.age"), done.output

    return by


def test_a_file_of_which_nobody_states_the_age_is_of_gears_of_unknown_age_and_says_how_to_state_it(imported):
    age, said = imported()
    assert age == "unknown" and "--age" in said and 'age = "new"' in said


@pytest.mark.parametrize(
    ("options", "given", "age"),
    [
        (["--age", "new"], {}, "new"),
        (["--age", "5000 rev"], {}, 5000.0),
        (["--age", "2 h"], {}, 2 * 3600 * SPEED),
        ([], {"head": 'age = "unknown"'}, "unknown"),
        ([], {"head": 'age = "1,5 hours"'}, 1.5 * 3600 * SPEED),
        (["--age", "unknown"], {"head": 'age = "new"'}, "unknown"),
        ([], {"channel": "first_edge_index = 7000"}, "new"),  # edges counted since the gears were new
        ([], {"rig": RIG.replace("[rig.gears.pinion]", "[rig.gears]\nage = 300\n\n[rig.gears.pinion]")}, 300),
    ],
)
def test_a_stated_age_is_that_of_the_recording(imported, options, given, age):
    found, said = imported(*options, **given)
    assert found == age and "is not stated" not in said


def test_the_age_that_a_mapping_states_of_its_own_file_is_not_that_of_another_one(imported):
    assert imported("--source", "first.csv", head='age = "new"')[0] == "new"
    assert imported("--source", "later.csv", head='age = "new"')[0] == "unknown"
    assert imported("--source", "later.csv", "--age", "40 rev", head='age = "new"')[0] == 40


def test_a_rig_file_of_the_machine_s_counter_says_nothing_of_a_file_without_one(imported, tmp_path):
    (tmp_path / "rig.toml").write_text('schema = "gear-rig/1"\nname = "box"\n[gears]\nage = "new"\n')
    assert imported(head='rig = "rig.toml"', rig="")[0] == "unknown"


def test_a_rig_file_given_in_place_of_the_attached_one_leaves_what_the_recording_says_of_the_age(imported, tmp_path):
    imported("--age", "5000 rev")
    silent, stating = tmp_path / "silent.toml", tmp_path / "stating.toml"
    silent.write_text('schema = "gear-rig/1"\nname = "box"\n')
    stating.write_text('schema = "gear-rig/1"\nname = "box"\n[gears]\nage = "unknown"\n')
    with Recording(tmp_path / "out.mcap") as recording:
        assert rig_of(recording, silent).gear_age.revolutions == 5000
        assert not rig_of(recording, stating).gear_age.known


def test_init_asks_the_age_and_takes_none_for_granted(tmp_path):
    answers = 'schema = "gear-answers/1"\npinion_teeth = 23\ngear_teeth = 57\nspeed = "10 Hz"\nencoder_pinion = 1\n'
    for age, expected in (("", "unknown"), ('age = "new"\n', "new"), ('age = "3 h"\n', 3 * 3600 * SPEED)):
        (tmp_path / "answers.toml").write_text(answers + age)
        done = CliRunner().invoke(
            app, ["init", "--answers", str(tmp_path / "answers.toml"), "--out", str(tmp_path), "--force", "--json", "-"]
        )
        assert done.exit_code == 0 and json.loads(done.output)["rig"]
        assert load_rig(tmp_path / "rig.toml").get("gears.age") == expected


@pytest.mark.parametrize(("given", "why"), [("old", "must be new"), ("5000", "must be new"), ("7 h", "pinion's speed")])
def test_an_age_that_cannot_be_used_is_refused(given, why):
    with pytest.raises(InputError, match=why):
        age_of("--age", given, None)


def used_machine(tmp_path, age):
    """The answer about six seconds of the tutorial's pump, whose rig and mapping files `init` has made."""
    machine = runpy.run_path(str(ROOT / "docs" / "examples" / "machine.py"))
    values = machine["recording"](0.5, seed=3, modulation=0.15, duration=6.0)
    np.savetxt(
        tmp_path / "run.csv", values, delimiter=",", header=",".join(machine["COLUMNS"]), comments="", fmt="%.9g"
    )
    (tmp_path / "answers.toml").write_text(
        'schema = "gear-answers/1"\nasset = "pump-drive"\npinion_teeth = 23\ngear_teeth = 57\nspeed = "1476 rpm"\n'
        'module = "2.5 mm"\nface_width = "25 mm"\npower = "4 kW"\nencoder_pinion = 1\n'
        f'encoder_pinion_column = "Tacho (V)"\ndata_file = "run.csv"\nsample_rate = "5.12 kHz"\n{age}'
        '[[accelerometers]]\ncolumn = "Acc1 (g)"\nunit = "g"\n'
    )
    for step in (
        ["init", "--answers", str(tmp_path / "answers.toml"), "--out", str(tmp_path)],
        ["import", str(tmp_path / "mapping.toml"), "--out", str(tmp_path / "run.mcap")],
        ["assess", str(tmp_path / "run.mcap"), "--no-trace", "--json", str(tmp_path / "answer.json")],
    ):
        done = CliRunner().invoke(app, step)
        assert done.exit_code == 0, (step, done.output, done.exception)
    return json.loads((tmp_path / "answer.json").read_text())


@pytest.mark.slow
@pytest.mark.parametrize("age", ["", 'age = "5000 rev"\n', 'age = "unknown"\n'])
def test_a_used_gearbox_is_not_taken_for_new(tmp_path, age):
    answer = used_machine(tmp_path, age)
    assert answer["wear"]["status"] == answer["rul"]["status"] == "not available"
    assert all(window["wear_depth_um"] is None for window in answer["windows"])
    assert "unworn" not in answer["wear"]["reason"] and "when they are new" not in answer["wear"]["reason"]
    assert "measure the wear depth at a stop" in answer["wear"]["reason"]
