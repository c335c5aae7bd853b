"""What a service finds at its start: states that cannot be read, and rig files that have changed since."""

from __future__ import annotations

import copy
import tomllib

import pytest
from loops import loop_of
from segments import segment_of
from service_streams import RIG

from service.runtime.rigs import GivenRigs, Rigs, named_differences, rig_change
from service.runtime.twin_port import gear_twin
from tests.stored_states import stored_state
from twin.options import Options
from twin.windows import Window


@pytest.mark.parametrize(
    ("harm", "cure"),
    [
        ({"schema_version": 99}, "by another version of gear-twin; use that version, or another --data directory"),
        ("not a state", "it is damaged, or this is an internal error; restore a backup, or report it"),
        ({"schema_version": 2}, "it is damaged, or this is an internal error; restore a backup, or report it"),
    ],
)
def test_state_that_cannot_be_read_is_one_sentence_and_its_windows_go_on_waiting(store, tmp_path, harm, cure, caplog):
    loop = loop_of(store, tmp_path, gear_twin(Options(trace=False)))
    for asset, state in (("bench", harm), ("unsw-rig", stored_state("unsw-rig").to_dict())):
        store.commit(asset, 1, record={"index": 0}, state=state, report={}, received_ns=1)
        loop.add(asset, segment_of(Window(start_time_ns=7)))
    loop.carry_out()
    (said,) = [r.message for r in caplog.records]
    assert "stored state of bench cannot be read" in said and said.endswith(cure)
    assert loop.table.get("bench").damaged.reason == said
    assert len(store.windows("unsw-rig")) == 2 and len(loop.windows.waiting("bench")) == 1


# -- rig files -----------------------------------------------------------------------------------------

GIVEN = tomllib.loads(RIG.read_text())


def changed(**changes):
    rig = copy.deepcopy(GIVEN)
    for key, value in changes.items():
        *tables, last = key.split("__")
        place = rig
        for table in tables:
            place = place[table]
        place[last] = value
    return rig


@pytest.fixture
def learned(store):
    """An asset whose state was learned with the reference rig."""
    store.keep_rig("unsw", GIVEN)
    store.commit(
        "unsw", 1, record={"index": 0}, state={"n": 1}, report={}, received_ns=1
    )  # fmt: skip
    return store


class Nobody:
    def find(self, asset):
        return None


def test_rig_file_of_other_gears_is_not_used_until_people_have_answered(learned, board):
    rigs = Rigs(learned, board, GivenRigs(all=(changed(gears__face_width=0.025), "mine.toml")))
    assert named_differences(learned.asset("unsw"), rigs.given.of("unsw")) == ["gears.face_width = 0.025 (was 0.02)"]
    assert rigs.of("unsw", Nobody()).get("gears.face_width") == 0.02
    assert learned.asset("unsw").rig == GIVEN and learned.last_event_id("unsw") == 0


def test_question_about_other_gears_names_their_teeth_first(learned):
    """A rig file of tooth counts alone was said to lack an addendum, a backlash, "and 15 more"."""
    given = {"gears": {"pinion": {"teeth": 23}, "gear": {"teeth": 57}}}
    named = named_differences(learned.asset("unsw"), given)
    assert named[:2] == ["gears.gear.teeth = 57 (was 52)", "gears.pinion.teeth = 23 (was 19)"]
    assert all("= absent" in line for line in named[2:-1]) and named[-1].endswith("more")


def test_rig_file_that_differs_elsewhere_is_adopted_with_an_event(learned, board):
    rig = changed(name="after the overhaul", end_of_life__max_depth=4e-4)
    rigs = Rigs(learned, board, GivenRigs(all=(rig, "mine.toml")))
    rigs.of("unsw", Nobody())
    assert learned.asset("unsw").rig == rig
    (event,) = learned.events("unsw", 0)
    assert (event.kind, event.data["kind"]) == ("data_fault", "rig_changed")
    assert "end_of_life.max_depth = 0.0004 (was 0.0005)" in event.data["detail"]
    assert "name = after the overhaul" in event.data["detail"]
    rigs.of("unsw", Nobody())
    assert learned.last_event_id("unsw") == event.id  # told once
    assert board.get("unsw").last_event_id == event.id


def test_the_same_rig_file_says_nothing(learned, board):
    rigs = Rigs(learned, board, GivenRigs(all=(copy.deepcopy(GIVEN), "mine.toml")))
    rigs.of("unsw", Nobody())
    assert learned.last_event_id("unsw") == 0


def test_asset_without_a_state_accepts_any_rig_file(store, board):
    store.keep_rig("unsw", GIVEN)
    Rigs(store, board, GivenRigs(all=(changed(gears__face_width=0.025), "mine.toml"))).of("unsw", Nobody())
    assert store.asset("unsw").rig["gears"]["face_width"] == 0.025


def test_gears_that_are_only_known_better_are_the_same_gears():
    known = {"gears": {"pinion": {"teeth": 19}, "gear": {"teeth": 52}}}
    assert rig_change(known, GIVEN).identity == ()
    assert rig_change(GIVEN, known).identity != ()
    assert rig_change(known, {"gears": {"pinion": {"teeth": 23}, "gear": {"teeth": 52}}}).identity == (
        "gears.pinion.teeth = 23 (was 19)",
    )
