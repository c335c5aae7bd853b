"""`gear-twin doctor`: what a recording and a rig file support, and what speaks against them."""

from __future__ import annotations

import copy
import json
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from service.cli.commands import app
from service.errors import InputError
from service.setup.examination import _of_windows, examined
from service.stream.sources.mcap import read_windows
from tests.mesh_pairs import UNSW_RIG
from twin.rig import Rig
from twin.suitability import NOTE, OK, PROBLEM

SHORT = Path(__file__).parents[2] / "recordings" / "short-campaign.mcap"


@lru_cache(maxsize=1)
def recorded():
    mapping, _, windows = read_windows(SHORT)
    return mapping, windows


def rig_with(**values) -> Rig:
    mapping = copy.deepcopy(UNSW_RIG)
    for path, value in values.items():
        table, key = path.split("__")
        mapping[table][key] = value
    return Rig.from_mapping(mapping)


def said(rig=None, change=lambda w: w, count=4):
    windows = [change(w) for w in recorded()[1][:count]]
    return _of_windows(SHORT, rig or Rig.from_mapping(recorded()[0]), "rig", windows)


def level_of(found, words):
    matching = [f for f in found.findings if words in f.text]
    assert matching, (words, [f.text for f in found.findings])
    return matching[0].level


def test_a_sound_recording_has_no_problem():
    found = said(count=8)
    assert [f.text for f in found.findings if f.level != OK] == []
    assert {row.label for row in found.channels} == {"accel/y6", "torque/pinion", "encoder/pinion", "encoder/gear"}
    assert found.abilities[0].level == "yes"
    assert level_of(found, "the encoders turn in the ratio 2.7368") == OK
    assert level_of(found, "mesh frequency") == OK


@pytest.mark.slow
def test_the_command_prints_channels_findings_and_abilities():
    run = CliRunner().invoke(app, ["doctor", str(SHORT)])
    assert run.exit_code == 0, run.output
    for words in ("accel/y6", "Findings", "What this machine can tell", "2048 edges a turn"):
        assert words in run.output
    answer = json.loads(CliRunner().invoke(app, ["doctor", str(SHORT), "--json", "-"]).output)
    assert answer["windows"] == 8 and answer["abilities"][0]["what"] == "wear depth"


def test_a_rig_file_alone_is_examined():
    found = examined(None, SHORT.parent / "rigs" / "unsw.toml")
    assert found.recording is None and found.windows == 0
    assert found.abilities[0].level == "yes"


def test_nothing_to_examine_is_refused():
    with pytest.raises(InputError, match="nothing to examine"):
        examined(None, None)


def test_exchanged_encoders_are_named_once_and_nothing_is_said_of_a_mesh_at_the_wrong_speed():
    def exchanged(window):
        shafts = window.encoders
        return replace(window, encoders={"pinion": shafts["gear"], "gear": shafts["pinion"]})

    problems = [f for f in said(change=exchanged).findings if f.level == PROBLEM]
    assert [f.remedy for f in problems] == ["the encoders of pinion and gear are exchanged?"]


def test_other_tooth_counts_than_the_encoders_show_are_a_problem():
    mapping = {"gears": {"pinion": {"teeth": 23}, "gear": {"teeth": 57}}, "operating": {"pinion_speed_hz": 10.0}}
    found = said(rig=Rig.from_mapping(mapping))
    assert level_of(found, "the tooth counts 23/57 give 2.4783") == PROBLEM


def test_a_reversed_torque_and_another_unit_of_torque_are_problems():
    def times(factor):
        return lambda w: replace(w, torques={k: replace(s, values=factor * s.values) for k, s in w.torques.items()})

    reversed_ = [f for f in said(change=times(-1.0)).findings if f.mistake == "polarity"]
    assert [f.level for f in reversed_] == [PROBLEM]
    assert (
        level_of(said(change=times(8.85)), "times the largest that the rig file states") == PROBLEM
    )  # pound-force inches


def test_a_coarse_encoder_shows_what_would_resolve_the_mesh():
    def once(window):
        return replace(
            window,
            encoders={
                k: replace(e, per_rev=1, first_index=0, times=e.times[:: e.per_rev]) for k, e in window.encoders.items()
            },
        )

    found = said(change=once)
    coarse = next(f for f in found.findings if f.text.startswith("encoder/pinion: one pulse a turn"))
    assert coarse.level == NOTE and coarse.remedy == "an encoder with at least 127 edges a turn"
    row = next(row for row in found.channels if row.label == "encoder/pinion")
    turns, speed = (float(part.split()[0]) for part in row.level.split(", "))
    assert row.rate == "1 edge a turn" and speed == pytest.approx(turns / row.duration, rel=1e-3)
    assert turns == pytest.approx(sum(int(w.encoders["pinion"].times.size - 1) // 1024 for w in recorded()[1][:4]))
    assert found.abilities[0].level == "partly"
    assert any("encoders on both shafts (127 and 347 edges" in line for line in found.one_more_sensor)


def test_a_low_sampling_rate_is_named():
    def slow(window):
        accelerations = {k: replace(s, rate=1280.0, values=s.values[::10]) for k, s in window.accelerations.items()}
        return replace(window, accelerations=accelerations)

    found = said(change=slow)
    assert level_of(found, "usable to 576 Hz; the rig file's band ends at 2000 Hz") == NOTE
    note = next(f for f in found.findings if "5 are evaluated" in f.text)
    assert "sample at" in note.remedy


def test_noise_without_mesh_lines_is_a_problem():
    def noise(window):
        random = np.random.default_rng(window.start_time_ns % 2**32)
        accelerations = {
            k: replace(s, values=random.standard_normal(s.values.size)) for k, s in window.accelerations.items()
        }
        return replace(window, accelerations=accelerations)

    found = said(change=noise)
    assert level_of(found, "no line of the accelerometer stands out at the mesh frequency") == PROBLEM


def test_missing_channels_speed_and_count_are_said():
    bare = said(change=lambda w: replace(w, encoders={}, torques={}), rig=rig_with())
    assert level_of(bare, "torque/pinion, which the rig file names, is not in the recording") == PROBLEM
    assert level_of(bare, "no absolute count of revolutions") == NOTE
    assert level_of(bare, "no torque is measured: the rig file's nominal 10 N·m is taken") == NOTE


def test_a_recording_without_a_rig_file_says_what_knowledge_would_give():
    found = said(rig=Rig.from_mapping({}))
    assert found.abilities[0].level == "no"
    assert "the rig file does not give" in found.abilities[0].how


def test_another_speed_than_the_nominal_one_is_noted():
    mapping = {"gears": {"pinion": {"teeth": 19}, "gear": {"teeth": 52}}, "operating": {"pinion_speed_hz": 24.6}}
    assert level_of(said(rig=Rig.from_mapping(mapping)), "the rig file's nominal speed is 24.6 Hz") == NOTE
