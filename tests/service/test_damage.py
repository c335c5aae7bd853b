"""Damage of what is kept: it is found, said, and costs the row that it is in; never is it used as if it were sound."""

from __future__ import annotations

import random
import sqlite3
from contextlib import closing
from dataclasses import fields

import pytest
import service_fakes as fakes

from service.errors import DamageError, StorageUnavailable, StoreError
from service.results import json_columns
from service.results.alarm_store import AlarmStore
from service.results.jobs import Jobs
from service.results.json_columns import dump, load
from service.results.names import Names
from service.results.sql_store import SqlStore


@pytest.fixture(autouse=True)
def nothing_said_before(monkeypatch):
    monkeypatch.setattr(json_columns, "_said", set())


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "twin.sqlite"
    with SqlStore(path) as store:
        for index in range(3):
            fakes.take(store, None, "hurt", index, 100.0 * index)
            fakes.take(store, None, "sound", index, 100.0 * index)
    return path


def hurt(path, table, column, where, at=-9):
    """Flips one bit of a value in the file."""
    with closing(sqlite3.connect(path)) as db:
        (kept,) = db.execute(f"SELECT {column} FROM {table} WHERE {where}").fetchone()
        changed = kept ^ 1 if isinstance(kept, int) else bytes((*kept[:at], kept[at] ^ 1, *kept[at + 1 :][: -at - 1]))
        assert len(changed) == len(kept) if isinstance(kept, bytes) else True
        db.execute(f"UPDATE {table} SET {column} = ? WHERE {where}", (changed,))
        db.commit()


def test_no_flipped_bit_gives_another_value():
    value = {"wear_depth_um": 156.25, "name": "unsw", "list": [1, 2.5, None, True]}
    kept = dump(value)
    assert load(kept) == value
    unnoticed = 0
    for bit in range(8 * len(kept)):
        changed = bytearray(kept)
        changed[bit // 8] ^= 1 << bit % 8
        try:
            assert load(bytes(changed), "the state") == value
            unnoticed += 1
        except DamageError as error:
            assert "the state is damaged" in str(error)
    assert unnoticed <= 1  # the format has one bit that means nothing
    for end in range(len(kept)):
        with pytest.raises(DamageError):
            load(kept[:end])


@pytest.mark.parametrize("column", ["record", "figures", "number", "epoch"])
def test_damaged_window_is_left_out_and_said_and_the_others_are_there(path, column, caplog):
    hurt(path, "windows", column, "asset = 'hurt' AND number = 2")
    with SqlStore(path) as store:
        assert [w.record["index"] for e in (0, 1) for w in store.windows("hurt", epoch=e)] == [0, 1]
        assert len(store.windows("sound")) == 3
        assert fakes.take(store, None, "hurt", 3, 300.0)
    assert "window" in caplog.text and "of hurt is damaged" in caplog.text


@pytest.mark.parametrize("column", ["state", "assembly", "quality", "windows", "epoch", "received_ns"])
def test_asset_that_cannot_go_on_waits_and_the_others_go_on(path, column, caplog):
    hurt(path, "assets", column, "asset = 'hurt'")
    with SqlStore(path) as store:
        board = fakes.WrittenTable(store)
        assert "hurt" in caplog.text and "damaged" in caplog.text
        damaged = board.get("hurt").damaged
        assert damaged is not None and "of hurt cannot be read from the database any more" in damaged.reason
        assert store.asset("sound").damaged is None
        with pytest.raises(StorageUnavailable, match="until a backup has been restored") as caught:
            fakes.take(store, None, "hurt", 3, 300.0)
        assert caught.value.reason == "damaged"
        assert fakes.take(store, None, "sound", 3, 300.0)
        assert len(store.latest_windows("sound", 9)) == 4


def test_damaged_report_is_written_anew_by_the_next_window(path, caplog):
    hurt(path, "assets", "report", "asset = 'hurt'")
    with SqlStore(path) as store:
        assert store.asset("hurt").report is None and "report of hurt is damaged" in caplog.text
        assert fakes.take(store, None, "hurt", 3, 300.0)
        assert store.asset("hurt").report is not None


def test_damaged_event_is_left_out(path, caplog):
    with SqlStore(path) as store:
        ids = [e.id for e in store.events("hurt", 0)]
    hurt(path, "events", "data", f"id = {ids[1]}")
    with SqlStore(path) as store:
        assert [e.id for e in store.events("hurt", 0)] == [ids[0], *ids[2:]]
    assert f"event {ids[1]} of hurt is damaged" in caplog.text


def test_damaged_memory_of_the_alarms_begins_anew(path, caplog):
    with SqlStore(path) as store:
        alarms = AlarmStore(store.database)
        alarms.keep_memory("hurt", alarms.memory("hurt"))
    hurt(path, "alarm_memory", "memory", "asset = 'hurt'")
    with SqlStore(path) as store:
        alarms = AlarmStore(store.database)
        assert alarms.memory("hurt") == alarms.memory("sound")
    assert "what the alarms remember of hurt is damaged" in caplog.text


# -- flips in the file -----------------------------------------------------------------------------------

FLIPS = 150


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """A database with something in every table, as one file."""
    data = tmp_path_factory.mktemp("sound")
    path = data / "sound.sqlite"
    with SqlStore(path) as store:
        fakes.fill(store, data)
    with closing(sqlite3.connect(path)) as db:
        db.execute("PRAGMA journal_mode = DELETE")
        db.execute("VACUUM")
    return path


def whole(path):
    """All that a database answers, by what it is; None for what is damaged."""
    found = {}
    with SqlStore(path) as store:
        fakes.WrittenTable(store)
        jobs = Jobs(store.database)
        for asset in store.assets():
            stored = store.asset(asset)
            for part in fields(stored):
                if part.name != "damaged":
                    found["asset", asset, part.name] = None if stored.damaged else getattr(stored, part.name)
            for epoch in store.epochs(asset):
                found["epoch", asset, epoch["epoch"]] = None if epoch["since"] is None else epoch
                for window in store.windows(asset, epoch=epoch["epoch"]):
                    found["window", asset, window.start_ns] = window
            for kind, rows in (
                ("event", store.events(asset, 0, 10_000)), ("decision", jobs.of(asset, "decision")),
                ("change", jobs.changes(asset)), ("inspection", jobs.of(asset, "inspection")),
            ):  # fmt: skip
                found |= {(kind, row.id): row for row in rows}
        for alarm in AlarmStore(store.database).listed(closed=True):
            found["history", alarm["id"]] = alarm.pop("history")
            found["alarm", alarm["id"]] = alarm
        found["routes",] = Names(store.database).routes()
    return found


@pytest.mark.slow
def test_flipped_bits_of_the_file_are_found_or_meant_nothing(sound, tmp_path):
    """A refusal in one line, or all that is read is what was written and what is missing has been said."""
    data, expected = sound.read_bytes(), whole(sound)
    refused = said = 0
    for seed in range(FLIPS):
        draw = random.Random(seed)
        changed = bytearray(data)
        changed[draw.randrange(len(data))] ^= 1 << draw.randrange(8)
        path = tmp_path / f"{seed}.sqlite"
        path.write_bytes(changed)
        json_columns._said.clear()
        try:
            found = whole(path)
        except StoreError as error:
            assert "\n" not in str(error)
            refused += 1
            continue
        finally:
            for left in tmp_path.iterdir():
                left.unlink()
        other = {key for key in expected if found.get(key) != expected[key]}
        assert not other or json_columns._said, f"seed {seed}: {other} differs, and nothing was said"
        lists = ("change", "inspection", "history")  # of which a damaged entry is left out
        shown = {key for key in other if found.get(key) is not None and key[0] not in lists}
        assert not shown, f"seed {seed}: {shown} is another than was written"
        said += bool(other)
    assert refused and said
