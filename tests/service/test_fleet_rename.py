"""A renamed asset stays in its partition, whatever its new name hashes to: one name, one asset, one place."""

from __future__ import annotations

import threading
import time
from dataclasses import replace

import httpx
import pytest
import service_fakes as fakes
import sqlalchemy as sa
from fleets import PARTITIONS, at_front, front, routed, row, taken, worker
from service_streams import wait_until, write_recording

from service.alarms.keeper import AlarmKeeper
from service.cli import run
from service.errors import DeliveryError, InputError
from service.fleet.layout import Layout, partition_of, share_of
from service.fleet.naming import PartitionStreams
from service.results.alarm_store import AlarmStore
from service.results.asset_table import AssetTable
from service.results.commit_watch import CHANNEL
from service.results.names import Names
from service.results.schema import NAMES
from service.results.unknown_assets import UnknownAssets
from service.runtime.begun import declare
from service.runtime.feed import Feed
from service.runtime.replay import replay
from service.settings import Settings
from service.stream.frames import LENGTH_LIMITS

OWN = partition_of("unsw", PARTITIONS)
AWAY = [name for n in range(99) if partition_of(name := f"press-{n}", PARTITIONS) != OWN]
NEW, NEXT = AWAY[:2]
HASHED = partition_of(NEW, PARTITIONS)
LAYOUT = Layout(PARTITIONS)


def place(store, name):
    return share_of(store.database, name, LAYOUT)


def names(fleet):
    """Every name that was given, with the partition that has it."""
    with at_front(fleet) as store:
        return {name: place(store, name) for (name,) in store.database.rows(sa.select(NAMES.c.name))}


def rename(store, asset, name):
    Names(store.database).rename(asset, name)


def key_of(fleet, asset, capsys):
    capsys.readouterr()
    assert run(["fleet", "key", asset, "--database", fleet]) == 0
    return capsys.readouterr().out.strip()


def renamed(ask, asset, name):
    answer = ask.post(f"/v1/assets/{asset}/changes", json={"kind": "renamed", "name": name})
    assert answer.status_code == 201 and answer.json()["done"], answer.text


def halting(frames):
    """Frames with a pause in the midst of the last window: the earlier name has been silent for long by then."""
    frames = list(frames)
    yield from frames[:-16]
    time.sleep(0.4)
    yield from frames[-16:]


# -- workers and front ends ------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_renamed_asset_is_served_under_all_its_names_and_nowhere_else(tmp_path, fleet, capsys):
    first, second, third = (write_recording(tmp_path / f"{n}.mcap", n) for n in (2, 3, 4))  # each goes on from the last
    shared = {"DATA": str(tmp_path / "data")}
    with (
        routed() as endpoint,
        worker(tmp_path / "own", fleet, endpoint, **shared) as own,
        worker(tmp_path / "hashed", fleet, endpoint, NEW, **shared) as hashed,
        front(fleet, own.given["DATA"]) as address,
        httpx.Client(base_url=address, timeout=60) as ask,
    ):

        def publish(recording, prefix, **given):
            replay(recording, [endpoint], 0, prefix=prefix, recorded="gearbox", **given)

        def windows_of(asset, count):
            wait_until(lambda: len(ask.get(f"/v1/assets/{asset}/windows").json()) == count)

        publish(first, own.prefix)
        windows_of("unsw", 2)
        renamed(ask, "unsw", NEW)
        assert ask.get(f"/v1/assets/{NEW}").status_code == 200 and ask.get("/v1/assets/unsw").status_code == 404
        assert [a["asset"] for a in ask.get("/v1/assets").json()] == [NEW]
        decided = ask.post(f"/v1/assets/{NEW}/effects/misalignment", json={"decision": "accept"})
        assert decided.json()["done"]
        wait_until(lambda: ask.get("/v1/assets/unsw/position").json()["accepting"])  # the worker has said so
        position = ask.get("/v1/assets/unsw/position").json()  # of the stream that is routed to it
        assert position["instance"].startswith(f"partition {OWN}, ")
        assert position["settled_until_ns"] > 1_700_000_000 * 10**9
        held = position["settled_until_ns"] - position["unsettled_from_ns"]
        assert held == LENGTH_LIMITS[1] * 10**9  # a frame may reach beyond the window
        assert {each["sequence"] for each in position["channels"].values()} == {2 * 8 - 1}
        assert {key_of(fleet, name, capsys) for name in ("unsw", NEW)} == {own.prefix}
        publish(second, own.prefix)  # under the old name
        windows_of(NEW, 3)
        with pytest.raises(DeliveryError, match=f"{NEW} is in partition {OWN}: publish it under {own.prefix}, which"):
            publish(third, hashed.prefix, asset=NEW, wait=10.0)
        publish(third, own.prefix, asset=NEW, disturb=halting)
        windows_of(NEW, 4)
        renamed(ask, NEW, NEXT)
        assert {key_of(fleet, name, capsys) for name in ("unsw", NEW, NEXT)} == {own.prefix}
        assert names(fleet) == dict.fromkeys(("unsw", NEW, NEXT), OWN)
        assert len(ask.get(f"/v1/assets/{NEXT}/windows").json()) == 4
        assert ask.post("/v1/assets", json={"asset": NEW}).status_code == 409  # it was called so
        assert row(fleet)["share"] == OWN and row(fleet, NEW) is None
        assert "frames are left out" in hashed.err.read_text()


def test_a_kill_right_after_a_rename_leaves_one_asset_with_one_name(fleet):
    with taken(fleet, OWN) as store, at_front(fleet) as front_end:
        fakes.take(store, None, "unsw", 0, 100.0)
        before = row(fleet)
        assert before["share"] == OWN and front_end.assets() == ("unsw",)  # from its first transaction on
        rename(store, "unsw", NEW)  # and nothing else
        assert row(fleet)["label"] == NEW and front_end.assets() == ("unsw",)
        board = AssetTable(front_end, AlarmKeeper(AlarmStore(front_end.database)))
        assert board.find("unsw") is None and board.find(NEW).asset == "unsw" and board.names() == (NEW,)
        assert place(front_end, NEW) == place(front_end, "unsw") == OWN
        number = fakes.decide(front_end, "unsw", "crack", "confirm")
        assert [d.id for d in fakes.jobs_of(store).pending()] == [number]


@pytest.mark.parametrize("said_before", [(), ("", "asset", "nothing unsw"), ("asset no\\such",)])
def test_an_alarm_that_was_signed_under_a_former_name_is_shown_under_the_present_one(tmp_path, fleet, said_before):
    """Whatever anybody has said on the channel before: one word alone ended the thread that listens."""
    with taken(fleet, OWN) as store:
        fakes.take(store, None, "unsw", 0, 100.0)
        board, alarms, looked = fakes.WrittenTable(store), AlarmKeeper(AlarmStore(store.database)), threading.Event()
        feed = Feed(store, board, lambda heard: looked.set())
        feed.start()
        assert looked.wait(20)  # its connection listens
        for payload in said_before:
            looked.clear()
            with store.database.transaction() as db:
                db.exec_driver_sql(f"NOTIFY {CHANNEL}, '{payload}'")
            assert looked.wait(20) and feed.is_alive()
        rename(store, "unsw", NEW)
        assert alarms.data("unsw", {"level": "stale", "reason": "no frame for 2 h"})
        (alarm,) = alarms.open("unsw")
        board.update("unsw", label=NEW, alarms=(alarm,))
        with board.follow() as changes, at_front(fleet) as front_end:
            wait_until(lambda: not changes.take(0.5))  # all assets
            keeper = AlarmKeeper(AlarmStore(front_end.database))
            table = AssetTable(front_end, keeper)
            with front_end.database.transaction():
                signed = keeper.sign("unsw", alarm["id"], "acknowledged", "A", "")
                front_end.note("unsw", signed[1])
                table.write(replace(table.get("unsw"), alarms=(signed[0],)).with_whole())
            assert changes.take(20) == ("unsw",)
        feed.end()
        assert board.names() == (NEW,) and board.get("unsw").alarms[0]["acknowledged"]


# -- names that are taken --------------------------------------------------------------------------------


def test_a_name_that_an_asset_of_another_partition_has_or_had_is_refused(fleet):
    with taken(fleet, OWN) as store, taken(fleet, HASHED) as other:
        fakes.take(store, None, "unsw", 0, 100.0)
        fakes.take(other, None, NEW, 0, 100.0)
        refused = pytest.raises(InputError, match=f"there is an asset '{NEW}' already, or one that was called so")
        with refused:
            rename(store, "unsw", NEW)
        rename(other, NEW, NEXT)
        with refused:
            rename(store, "unsw", NEW)
        with pytest.raises(InputError, match=NEXT):
            rename(store, "unsw", NEXT)
        assert row(fleet)["label"] == "unsw" and row(fleet, NEW)["label"] == NEXT
        assert names(fleet) == {"unsw": OWN, NEW: HASHED, NEXT: HASHED}
        assert [place(store, name) for name in ("unsw", NEW, NEXT)] == [OWN, HASHED, HASHED]


def test_a_name_that_was_given_elsewhere_begins_no_asset_where_it_hashes_to(fleet):
    with taken(fleet, OWN) as store, taken(fleet, HASHED) as other, at_front(fleet) as front_end:
        fakes.take(store, None, "unsw", 0, 100.0)
        rename(store, "unsw", NEW)
        with pytest.raises(InputError, match=f"there is an asset '{NEW}' already"):
            fakes.take(other, None, NEW, 0, 100.0)
        rename(store, "unsw", NEXT)
        with pytest.raises(InputError, match="one that was called so"):
            other.note(NEW, [("added", {})])
        assert other.assets() == () and not other.windows(NEW)
        with pytest.raises(InputError):
            front_end.note(NEW, [])
        assert front_end.assets() == ("unsw",)
        assert {Names(front_end.database).asset_of(name) for name in ("unsw", NEW, NEXT)} == {"unsw"}


@pytest.mark.parametrize("turn", range(6))
def test_of_two_partitions_that_give_a_name_at_the_same_time_one_is_refused(fleet, turn):
    with taken(fleet, OWN) as store, taken(fleet, HASHED) as other:
        fakes.take(store, None, "unsw", 0, 100.0)
        together, done = threading.Barrier(2), []

        def act(what):
            together.wait()
            try:
                what()
                done.append(what)
            except InputError:
                pass

        acts = (lambda: rename(store, "unsw", NEW), lambda: other.note(NEW, [("added", {})]))
        threads = [threading.Thread(target=act, args=(what,)) for what in acts]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert len(done) == 1
        renamed = row(fleet)["label"] == NEW
        assert renamed != (NEW in other.assets()) and (row(fleet, NEW) is None) == renamed


# -- what a worker takes for its own ---------------------------------------------------------------------


def test_assets_of_the_settings_are_those_of_the_partition_that_has_their_name(tmp_path, fleet):
    here = next(name for n in range(99) if partition_of(name := f"gb-{n}", PARTITIONS) == HASHED)
    settings = Settings(assets=[NEW, here, "unsw"], data=tmp_path)
    with taken(fleet, OWN) as store, taken(fleet, HASHED) as other:
        fakes.take(store, None, "unsw", 0, 100.0)
        rename(store, "unsw", NEW)
        shown = {}
        for own, partition in ((store, OWN), (other, HASHED)):
            known = PartitionStreams(LAYOUT, partition)
            known.read(own.database)
            declare(settings, own, Names(own.database), known.refusal)
            shown[partition] = set(fakes.WrittenTable(own).names())
        assert shown == {OWN: {NEW}, HASHED: {here}}


def test_an_asset_that_takes_over_the_frames_of_another_is_in_its_partition(fleet):
    with taken(fleet, OWN) as store, taken(fleet, HASHED) as other:
        fakes.take(store, None, "unsw", 0, 100.0)
        Names(store.database).give_streams("unsw", NEW)
        assert row(fleet, NEW)["share"] == OWN and set(store.assets()) == {"unsw", NEW} and other.assets() == ()
        known = PartitionStreams(LAYOUT, HASHED)
        known.read(other.database)
        assert f"asset {NEW} is in partition {OWN}" in known.refusal(NEW)
        with pytest.raises(InputError, match=f"there is an asset '{NEW}' already"):
            other.note(NEW, [("added", {})])


@pytest.mark.parametrize("asks", [False, True])
def test_frames_that_belong_to_another_partition_are_left_out_and_nobody_is_asked_about_them(caplog, asks):
    known = PartitionStreams(LAYOUT, HASHED)
    unknown = UnknownAssets(asks=asks, elsewhere=known.refusal)
    unknown.begin(lambda stream: False, ["unsw"])
    for _ in range(3):
        assert not unknown.admits("unsw", "accel/y6")
    assert not unknown.asked("unsw") and not unknown.is_known("unsw")
    unknown.offered("unsw", {"name": "x"}, 10)
    assert unknown.entries() == {} and unknown.frames == 3
    expected = f"asset unsw is in partition {OWN}: publish it under fleet/{OWN:03d}/gearbox, which gear-twin fleet key"
    assert unknown.refusal("unsw").startswith(expected)
    assert caplog.text.count(expected) == 1
    assert (unknown.admits(NEW) is not asks and unknown.refusal(NEW) is None) or asks
