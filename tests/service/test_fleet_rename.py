"""A renamed asset stays in its partition, whatever its new name hashes to: one name, one asset, one place."""

from __future__ import annotations

import threading
import time

import httpx
import pytest
import service_fakes as fakes
import sqlalchemy as sa
from fleets import PARTITIONS, front, routed, row, taken, worker
from service_streams import wait_until, write_recording

from service.alarms.keeper import AlarmKeeper
from service.cli import run
from service.errors import DeliveryError, InputError
from service.fleet.databases import engine_of
from service.fleet.front_kept import FleetLife
from service.fleet.front_store import FleetStore
from service.fleet.layout import ASSETS, CURVES, NAMES, Layout, partition_of
from service.fleet.listener import Listener
from service.fleet.lookup import partition_in_use
from service.fleet.naming import Names
from service.fleet.notices import ALARM, announce, channel_of
from service.fleet.rows import RowWriter
from service.results.alarm_store import AlarmStore
from service.results.asset_life import AssetLife
from service.results.baseline_store import BaselineStore
from service.results.board import Board
from service.results.change_queue import ChangeQueue
from service.results.decision_queue import DecisionQueue
from service.results.unknown_assets import UnknownAssets
from service.runtime.begun import unknown_of
from service.runtime.replay import replay
from service.runtime.worker import Kept
from service.settings import Settings
from service.stream.frames import LENGTH_LIMITS

OWN = partition_of("unsw", PARTITIONS)
AWAY = [name for n in range(99) if partition_of(name := f"press-{n}", PARTITIONS) != OWN]
NEW, NEXT = AWAY[:2]
HASHED = partition_of(NEW, PARTITIONS)
LAYOUT = Layout(PARTITIONS)


@pytest.fixture
def fleet(postgresql_server, made_fleet):
    """The URL of the database of a fleet whose partitions have their tables."""
    with postgresql_server.new_database(template=made_fleet) as url:
        yield url


@pytest.fixture
def tables(fleet):
    engine = engine_of(fleet, poolclass=sa.NullPool)
    yield engine
    engine.dispose()


def place(tables, name):
    return partition_in_use(tables, LAYOUT, name)


def names(tables):
    with tables.connect() as db:
        return {name: partition for name, partition in db.execute(sa.select(NAMES.c.name, NAMES.c.partition))}


def rename(store, asset, name):
    AssetLife(store.database).rename(asset, name)


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
def test_a_renamed_asset_is_served_under_all_its_names_and_nowhere_else(tmp_path, fleet, tables, capsys):
    first, second, third = (write_recording(tmp_path / f"{n}.mcap", n) for n in (2, 3, 4))  # each goes on from the last
    with (
        routed() as endpoint,
        worker(tmp_path / "own", fleet, endpoint) as own,
        worker(tmp_path / "hashed", fleet, endpoint, NEW) as hashed,
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
        assert decided.json()["done"] and (decided.json()["id"] - 1) % PARTITIONS == OWN
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
        assert names(tables) == dict.fromkeys(("unsw", NEW, NEXT), OWN)
        assert len(ask.get(f"/v1/assets/{NEXT}/windows").json()) == 4
        assert ask.post("/v1/assets", json={"asset": NEW}).status_code == 409  # it was called so
        with tables.connect() as db:
            assert db.exec_driver_sql(f"SELECT count(*) FROM p{HASHED:03d}.assets").scalar() == 0
        assert "frames are left out" in hashed.err.read_text()


def test_a_kill_right_after_a_rename_leaves_one_asset_with_one_name(tmp_path, fleet, tables):
    with taken(fleet, OWN) as store, FleetStore(fleet, LAYOUT) as at_front:
        fakes.take(store, None, "unsw", 0, 100.0)
        before = row(fleet)
        with store.database.transaction() as db:
            db.execute(sa.insert(CURVES), {"asset": "unsw", "name": "a", "data": b"x"})
        assert before["partition"] == OWN and at_front.assets() == ("unsw",)  # from its first transaction on
        rename(store, "unsw", NEW)  # and nothing else
        assert row(fleet) is None and at_front.assets() == (NEW,)
        assert store.database.rows(sa.select(CURVES.c.asset)) == [(NEW,)]
        after = row(fleet, NEW)
        assert after["partition"] == OWN and after["version"] > before["version"]
        assert after["summary"] == {**before["summary"], "asset": NEW} and NEW in after["words"]
        assert len(at_front.windows(NEW)) == 1 and place(tables, NEW) == place(tables, "unsw") == OWN
        number = at_front.add_decision(NEW, "crack", "confirm")
        assert [d.id for d in store.pending_decisions()] == [number]


def test_a_row_that_was_written_again_under_the_old_name_is_deleted_by_the_next_worker(fleet):
    with taken(fleet, OWN) as store:
        fakes.take(store, None, "unsw", 0, 100.0)
        kept = row(fleet)
        rename(store, "unsw", NEW)
        with store.database.transaction() as db:
            db.execute(sa.insert(ASSETS), dict(kept))
            db.execute(sa.insert(ASSETS), {**kept, "asset": "declared"})
            db.execute(sa.insert(ASSETS), {**kept, "asset": "of-another", "partition": HASHED})
        board = Board.from_store(store, store.all_assets())
        board.update("declared")
        writer = RowWriter(store.database, board, OWN)
        writer.start()
        wait_until(lambda: row(fleet) is None)
        writer.end()
        assert all(row(fleet, name) is not None for name in (NEW, "declared", "of-another"))


def test_the_row_of_a_former_name_is_not_written_again_while_the_board_still_shows_it(fleet):
    with taken(fleet, OWN) as store:
        fakes.take(store, None, "unsw", 0, 100.0)
        board = Board.from_store(store, store.all_assets())
        board.update("declared")
        rename(store, "unsw", NEW)  # is committed before the board is told
        writer = RowWriter(store.database, board, OWN)
        writer.start()
        wait_until(lambda: row(fleet, "declared") is not None)  # written in the same transaction
        assert row(fleet) is None
        board.rename("unsw", NEW)
        board.update("unsw-2")
        wait_until(lambda: row(fleet, "unsw-2") is not None)
        writer.end()
        assert row(fleet) is None and row(fleet, NEW)["partition"] == OWN


@pytest.mark.parametrize("said_before", [(), ("", "asset", "nothing unsw"), ("asset no\\such",)])
def test_an_alarm_that_was_signed_under_a_former_name_is_shown_under_the_present_one(tmp_path, fleet, said_before):
    """Whatever anybody has said on the channel before: one word alone ended the thread that listens."""
    with taken(fleet, OWN) as store:
        fakes.take(store, None, "unsw", 0, 100.0)
        board, alarms, looked = Board.from_store(store), AlarmKeeper(AlarmStore(store.database)), threading.Event()
        life = AssetLife(store.database)
        kept = Kept(
            store=store,
            board=board,
            decisions=DecisionQueue(store),
            life=life,
            changes=ChangeQueue(life),
            baselines=BaselineStore(store.database, tmp_path),
        )
        known = Names(LAYOUT, OWN, "gearbox")
        listener = Listener(fleet, OWN, kept, alarms, looked.set, lambda asset, rig: None, known)
        listener.start()
        assert looked.wait(20)  # its connection listens
        for payload in said_before:
            looked.clear()
            with store.database.transaction() as db:
                db.exec_driver_sql(f"NOTIFY {channel_of(OWN)}, '{payload}'")
            assert looked.wait(20) and listener.is_alive()
        rename(store, "unsw", NEW)
        board.rename("unsw", NEW)
        with board.follow() as changes:
            changes.take(0)  # all assets
            with store.database.transaction() as db:
                announce(db, OWN, ALARM, "unsw")
            assert changes.take(20) == (NEW,)
        listener.end()
        assert board.assets() == (NEW,)


# -- names that are taken --------------------------------------------------------------------------------


def test_a_name_that_an_asset_of_another_partition_has_or_had_is_refused(fleet, tables):
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
        assert store.assets() == ("unsw",) and other.assets() == (NEXT,)
        assert names(tables)[NEW] == HASHED and "unsw" not in names(tables)
        assert [place(tables, name) for name in ("unsw", NEW, NEXT)] == [OWN, HASHED, HASHED]


def test_a_name_that_was_given_elsewhere_begins_no_asset_where_it_hashes_to(fleet):
    with taken(fleet, OWN) as store, taken(fleet, HASHED) as other, FleetStore(fleet, LAYOUT) as at_front:
        fakes.take(store, None, "unsw", 0, 100.0)
        rename(store, "unsw", NEW)
        with pytest.raises(InputError, match=f"there is an asset '{NEW}' already"):
            fakes.take(other, None, NEW, 0, 100.0)
        rename(store, NEW, NEXT)
        with pytest.raises(InputError, match="one that was called so"):
            other.note(NEW, [("added", {})])
        assert other.assets() == () and not other.windows(NEW)
        with pytest.raises(InputError):
            at_front.stores.at(HASHED).note(NEW, [])
            at_front.places.note(NEW, HASHED)  # as another front end that has not heard of it
            at_front.note(NEW, [])
        assert at_front.assets() == (NEXT,) and FleetLife(at_front).routes() == {"unsw": NEXT, NEW: NEXT}


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
        assert (NEW in store.assets()) != (NEW in other.assets())
        assert row(fleet, NEW)["partition"] == (OWN if NEW in store.assets() else HASHED)


def test_a_decision_that_is_submitted_while_the_asset_is_renamed_waits_for_its_new_name(fleet, tables):
    """It made an asset of the earlier name again, and was lost to the renamed one."""
    with taken(fleet, OWN) as store, FleetStore(fleet, LAYOUT) as at_front:
        fakes.take(store, None, "unsw", 0, 100.0)
        at_front.places.note("unsw", OWN)
        submit = threading.Thread(target=at_front.add_decision, args=("unsw", "crack", "confirm"))
        with store.database.transaction():
            rename(store, "unsw", NEW)
            submit.start()
            wait_until(lambda: waits_for_a_lock(tables))
        submit.join()
        assert [d.asset for d in store.pending_decisions()] == [NEW] and store.assets() == (NEW,)


def waits_for_a_lock(tables):
    with tables.connect() as db:
        return db.exec_driver_sql("SELECT count(*) FROM pg_locks WHERE NOT granted").scalar() > 0


# -- what a worker takes for its own ---------------------------------------------------------------------


def test_assets_of_the_settings_are_those_of_the_partition_that_has_their_name(tmp_path, fleet):
    here = next(name for n in range(99) if partition_of(name := f"gb-{n}", PARTITIONS) == HASHED)
    settings = Settings(assets=[NEW, here, "unsw"], data=tmp_path)
    with taken(fleet, OWN) as store, taken(fleet, HASHED) as other:
        fakes.take(store, None, "unsw", 0, 100.0)
        rename(store, "unsw", NEW)
        shown = {}
        for own, partition in ((store, OWN), (other, HASHED)):
            known = Names(LAYOUT, partition, "gearbox")
            known.read(own.database)
            board = Board.from_store(own, own.all_assets())
            unknown_of(settings, board, AssetLife(own.database), known.refusal)
            shown[partition] = set(board.assets())
        assert shown == {OWN: {NEW}, HASHED: {here}}


@pytest.mark.parametrize("asks", [False, True])
def test_frames_that_belong_to_another_partition_are_left_out_and_nobody_is_asked_about_them(caplog, asks):
    known = Names(LAYOUT, HASHED, "gearbox")
    unknown = UnknownAssets(asks=asks, elsewhere=known.refusal)
    unknown.begin(lambda stream: False, ["unsw"])
    for _ in range(3):
        assert not unknown.admits("unsw", "accel/y6")
    assert not unknown.asked("unsw") and not unknown.is_known("unsw")
    unknown.offered("unsw", {"name": "x"}, 10)
    assert unknown.listed() == [] and unknown.find("unsw") is None and unknown.frames == 3
    expected = f"asset unsw is in partition {OWN}: publish it under fleet/{OWN:03d}/gearbox, which gear-twin fleet key"
    assert unknown.refusal("unsw").startswith(expected)
    assert caplog.text.count(expected) == 1
    assert (unknown.admits(NEW) is not asks and unknown.refusal(NEW) is None) or asks
