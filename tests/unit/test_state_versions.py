"""States of version 1 are migrated, later ones round-trip, unknown ones are refused."""

import json

import pytest

from tests.stored_states import state_v1
from twin.assessment import Life, Wear
from twin.errors import ParameterError
from twin.state import SCHEMA_VERSION, State

ASSETS = ("unsw-short", "unsw-rig", "bench", "two-encoders")


@pytest.mark.parametrize("asset", ASSETS)
def test_migrated_state_is_a_state_of_this_version_that_survives_json_to_the_bit(asset):
    state = State.from_dict(state_v1(asset))
    text = json.dumps(state.to_dict(), allow_nan=False)
    assert json.loads(text)["schema_version"] == SCHEMA_VERSION
    assert State.from_dict(json.loads(text)) == state


def test_migration_keeps_wear_life_and_the_memory_of_the_twin():
    old = state_v1("unsw-rig")
    state = State.from_dict(old)
    wear, life = state.latest.wear, state.latest.life
    assert isinstance(wear, Wear) and isinstance(life, Life)
    depth = old["standing"]["wear"]["max_depth_um"]["combined"]["median"]
    assert wear.depth["combined"].median == pytest.approx(depth * 1e-6)
    assert life.time.median == pytest.approx(old["standing"]["rul"]["hours"]["median"] * 3600)
    assert state.memory.depth == old["memory"]["depth"] and state.windows_seen == 8
    assert state.memory.track.rate == old["memory"]["track"]["rate"]


def test_migration_keeps_effects_with_their_errors_as_fractions_and_the_log():
    old = state_v1("unsw-rig")["tracing"]
    tracing = State.from_dict(state_v1("unsw-rig")).tracing
    assert [f.name for f in tracing.found] == ["misalignment"] and len(tracing.stages) == 2
    (errors,) = tracing.errors
    assert errors.before.waveform == pytest.approx(old["errors"][0]["waveform_percent"] / 100)
    assert errors.after.windows == tuple(old["errors"][1]["windows"])
    assert tracing.latest.misfit_after == old["standing"]["misfit_after"]
    assert [(e.action, e.name) for e in tracing.log] == [(e["action"], e["name"]) for e in old["log"]]


def test_migration_of_a_machine_with_a_baseline_keeps_what_was_seen_so_that_it_is_not_announced_again():
    state = State.from_dict(state_v1("bench"))
    assert [e.name for e in state.latest.baseline.effects] == ["tooth_crack"]
    assert state.latest.wear is None, "no window has said anything of its wear"


def test_memory_of_the_twin_in_use_is_kept_once():
    old = state_v1("unsw-rig")
    state = State.from_dict(old)
    text = json.dumps(state.to_dict())
    assert text.count('"compliance_scale"') == len(state.tracing.stages) + 1  # the calibration's figure is the other
    assert len(text) < len(json.dumps(old)) - 0.8 * len(json.dumps(old["memory"]))


@pytest.mark.parametrize(
    ("data", "said"),
    [
        ({"schema_version": 3}, "schema version 3, this program knows up to 2: it was written by a newer gear-twin"),
        ({"schema_version": "two"}, "schema version 'two'"),
        ("a text", "a state of the twin is a mapping"),
    ],
)
def test_state_of_an_unknown_version_is_refused_with_a_sentence(data, said):
    with pytest.raises(ParameterError, match=said):
        State.from_dict(data)
