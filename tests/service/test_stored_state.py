"""What a service finds at its start: states of an earlier version, and rig files that have changed since."""

from __future__ import annotations

import copy
import gzip
import json
import sqlite3
import tomllib
from pathlib import Path

import pytest
from service_streams import RIG, Sink

from service.results.board import Board
from service.results.migrate import user_version
from service.results.schema import REVISION
from service.results.sql_store import SqlStore
from service.runtime.lane import Entry
from service.runtime.pipeline import Pipeline
from service.runtime.rigs import GivenRigs, Rigs, rig_change
from service.runtime.twin_port import gear_twin
from service.runtime.worker import restore
from service.stream.sources.mcap import Recording
from twin.options import Options
from twin.rig import Rig
from twin.windows import Window

ROOT = Path(__file__).parents[2]
STORED = ROOT / "tests" / "data" / "store_v1.sqlite.gz"
SHORT = ROOT / "recordings" / "short-campaign.mcap"
ASSETS = ("bench", "two-encoders", "unsw-rig", "unsw-short")


@pytest.fixture
def path(tmp_path):
    out = tmp_path / "gear-twin.sqlite"
    out.write_bytes(gzip.decompress(STORED.read_bytes()))
    return out


@pytest.fixture
def old(path):
    with SqlStore(path) as store:
        yield store


def test_store_of_version_1_opens_with_all_its_windows_counted(old):
    assert old.assets() == ASSETS
    assert [old.asset(a).windows for a in ASSETS] == [1, 1, 8, 6]
    with sqlite3.connect(old.path) as peek:
        assert peek.execute("PRAGMA user_version").fetchone() == (user_version(REVISION),)
    peek.close()
    for asset in ASSETS:
        windows = old.windows(asset)
        assert [w.record["index"] for w in windows] == list(range(len(windows)))
        assert old.asset(asset).updates == sum(bool(w.record["updated"]) for w in windows)
        counted = sum(f["count"] for w in windows for f in w.record["faults"])
        assert sum(count for count, _ in old.asset(asset).fault_totals.values()) == counted
    board = Board.from_store(old)
    whole = board.get("unsw-rig").whole
    assert whole["windows_total"] == 8 and whole["status"]["level"] == "no_verdict"
    assert "earlier version" in whole["status"]["reasons"][0]
    assert set(whole["wear"]["methods"]) == {"fused", "rms"} and whole["wear"]["method"]
    assert "indistinguishable_from" in whole["effects"][0]["evidence"]
    assert not {"not_told_from", "ways", "depth_from", "strange"} & set(_keys(whole))


def _keys(value):
    if isinstance(value, dict):
        for key, item in value.items():
            yield key
            yield from _keys(item)
    elif isinstance(value, list):
        for item in value:
            yield from _keys(item)


@pytest.mark.slow
def test_states_of_version_1_are_restored_and_the_next_windows_follow(old):
    """The store has six of the eight windows of the short campaign; replayed whole, two more are processed."""
    outcomes = []
    twin = gear_twin(Options(trace=False))

    def rig_of(asset):
        return Rig.from_mapping(old.asset(asset).rig or {})

    pipeline = Pipeline(rig_of, twin, Sink(outcomes))
    restore(pipeline.lanes, old)
    assert pipeline.assets == list(ASSETS)
    with Recording(SHORT) as recording:
        for frame in recording.frames(lambda channel, error: None):
            object.__setattr__(frame, "channel", frame.channel._replace(asset="unsw-short"))
            pipeline.feed(frame)
    pipeline.flush("unsw-short")
    assert [o.index for o in outcomes] == [6, 7]
    depths = [w.record["wear_depth_um"] for w in old.windows("unsw-short")]
    assert outcomes[0].record["wear_depth_um"] > depths[-1] > 0
    json.dumps(outcomes[-1].state.to_dict(), allow_nan=False)


@pytest.mark.parametrize(
    ("harm", "cure"),
    [
        ({"schema_version": 99}, "by another version of gear-twin; use that version, or another --data directory"),
        ("not a state", "it is damaged, or this is an internal error; restore a backup, or report it"),
        ({"memory": []}, "it is damaged, or this is an internal error; restore a backup, or report it"),
    ],
)
def test_state_that_cannot_be_read_is_one_sentence_and_its_windows_go_on_waiting(path, harm, cure, caplog):
    with sqlite3.connect(path) as edit:
        edit.execute("UPDATE assets SET state = ? WHERE asset = 'bench'", (json.dumps(harm),))
    edit.close()
    outcomes = []
    with SqlStore(path) as store:
        pipeline = Pipeline(lambda asset: Rig.from_mapping({}), gear_twin(Options(trace=False)), Sink(outcomes))
        restore(pipeline.lanes, store)
        for asset in ("bench", "unsw-rig"):
            entry = Entry(start_ns=0, window=Window(start_time_ns=0))
            pipeline.lanes.put(asset, entry, store.asset(asset).assembly)
    (said,) = [r.message for r in caplog.records]
    assert "stored state of bench cannot be read" in said and said.endswith(cure)
    assert [o.asset for o in outcomes] == ["unsw-rig"] and pipeline.lanes.backlog("bench") == 1


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
        "unsw", 1, record={"index": 0}, state={"n": 1}, report={}, assembly={}, quality={}, received_ns=1
    )  # fmt: skip
    return store


class Nobody:
    def find(self, asset):
        return None


def test_rig_file_of_other_gears_is_not_used_until_people_have_answered(learned, board):
    rigs = Rigs(learned, board, GivenRigs(all=(changed(gears__face_width=0.025), "mine.toml")))
    assert rigs.named_differences("unsw", rigs.given.of("unsw")) == ["gears.face_width = 0.025 (was 0.02)"]
    assert rigs.of("unsw", Nobody()).get("gears.face_width") == 0.02
    assert learned.asset("unsw").rig == GIVEN and learned.last_event_id("unsw") == 0


def test_question_about_other_gears_names_their_teeth_first(learned, board):
    """A rig file of tooth counts alone was said to lack an addendum, a backlash, "and 15 more"."""
    given = {"gears": {"pinion": {"teeth": 23}, "gear": {"teeth": 57}}}
    named = Rigs(learned, board, GivenRigs(all=(given, "mine.toml"))).named_differences("unsw", given)
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
