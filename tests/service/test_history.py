"""A long history costs no more than a short one: what a board holds and reads is bounded, the rest is paged."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import pytest
import service_fakes as fakes
from sqlalchemy import Engine, event
from test_api import Client

from service.alarms.keeper import AlarmKeeper
from service.api import assets, create_app
from service.results.alarm_store import AlarmStore
from service.results.asset_table import AssetTable
from service.results.inspections import compare
from service.results.snapshot import TAIL, has_point, trend_point
from service.results.sparkline import POINTS
from service.results.sql_store import SqlStore
from service.results.store import StoredWindow
from service.results.window_jobs import WindowJobs
from service.runtime.receiver import restore
from service.runtime.reception import Reception
from service.runtime.rigs import GivenRigs, Rigs
from service.runtime.state_publication import StatePublication
from service.stream.assembly import Assembler
from twin.rig import Rig

LONG = 350
ASSEMBLY = Assembler().to_dict() | {"closed_until_ns": 1}


class Counted(dict):
    """A record that counts how often it is read or copied."""

    reads = 0

    def __getitem__(self, key):
        Counted.reads += 1
        return super().__getitem__(key)

    def keys(self):
        Counted.reads += 1
        return super().keys()

    def get(self, key, default=None):
        Counted.reads += 1
        return super().get(key, default)


def window(index):
    return StoredWindow(start_ns=index, record=Counted(fakes.record(index, 10.0 * index)), figures={})


def reads_of_one_more(count):
    """How many reads of records adding one window to `count` costs."""
    board = fakes.scratch_table()
    for index in range(count):
        board.add_window("unsw", window(index))
    before = Counted.reads
    board.add_window("unsw", window(count))
    board.update("unsw", quality={})
    return Counted.reads - before


def test_adding_a_window_reads_as_many_records_after_a_thousand_windows_as_after_a_hundred():
    assert reads_of_one_more(1000) == reads_of_one_more(TAIL)


@pytest.fixture(scope="module")
def history(tmp_path_factory):
    """A store with a long history, and the board that has shown it all."""
    with SqlStore(tmp_path_factory.mktemp("history") / "twin.sqlite") as store:
        board = fakes.WrittenTable(store)
        for index in range(LONG):
            fakes.take(store, board, "unsw", index, 10.0 * index, updated=index % 7 == 3,
                       faults=(fakes.FAULT,) if index % 5 == 0 else ())  # fmt: skip
        yield store, board


@pytest.fixture
def store(history):
    return history[0]


@pytest.fixture
def long(history):
    return history[1]


@pytest.mark.slow
def test_asset_carries_its_latest_windows_and_says_how_many_there_are(store, long):
    whole = Client(create_app(long, store)).get("/v1/assets/unsw").json()
    assert [w["index"] for w in whole["windows"]] == list(range(LONG - TAIL, LONG))
    assert whole["windows_total"] == LONG
    assert long.get("unsw").summary()["windows"] == LONG


def test_every_window_is_read_by_cursor(store, long):
    client, after, seen = Client(create_app(long, store)), -1, []
    while page := client.get(f"/v1/assets/unsw/windows?after={after}&limit=64").json():
        seen += [w["index"] for w in page]
        after = seen[-1]
    assert seen == list(range(LONG))


@pytest.mark.parametrize("part", ["windows", "trend"])
def test_a_long_history_is_thinned_evenly_and_ends_with_the_newest_window(store, long, part):
    client = Client(create_app(long, store))

    def indices(query):
        return [w["index"] for w in client.get(f"/v1/assets/unsw/{part}?{query}").json()]

    assert indices("every=100") == [0, 100, 200, 300, LONG - 1]
    thinned = indices("resolution=50")
    assert {*range(0, LONG, 32), LONG - 1} <= set(thinned) and 25 <= len(thinned) <= 50
    assert thinned == sorted(set(thinned))
    assert indices(f"after={LONG - 11}&resolution=50") == list(range(LONG - 10, LONG))
    assert indices(f"resolution={LONG}") == list(range(LONG))


def test_a_restart_reads_the_newest_windows_alone_and_shows_the_same(store, long, monkeypatch):
    read = []
    rows = store._windows
    monkeypatch.setattr(store, "_windows", lambda *given: read.append(len(found := rows(*given))) or found)

    def count(_db, _cursor, sql, *_):
        if "COUNT(" in sql.upper():
            read.append(sql)

    alarms = AlarmKeeper(AlarmStore(store.database))
    event.listen(Engine, "before_cursor_execute", count)
    try:
        again = fakes.WrittenTable(store, alarms)
        reception = Reception(lambda asset: Rig.from_mapping({}), None)
        known = {s.asset: replace(s, assembly=ASSEMBLY) for s in store.all_assets()}
        restore(reception, SimpleNamespace(goes_on=lambda asset, assembly: None), known)
    finally:
        event.remove(Engine, "before_cursor_execute", count)
    assert len(read) <= 3 and read[0] == TAIL and all(count <= POINTS + 1 for count in read[1:])
    assert again.get("unsw") == long.get("unsw")
    assert reception.position("unsw") is not None


def statements_of_a_start(folder, assets):
    """How many statements that are about no windows a start makes."""
    made = []

    def count(_db, _cursor, sql, *_):
        made.append(sql)

    with SqlStore(folder / f"{assets}.sqlite") as store:
        for n in range(assets):
            store.keep(f"machine-{n}", rig={"name": "a"}, assembly=ASSEMBLY, quality={})
        event.listen(Engine, "before_cursor_execute", count)
        try:
            board = AssetTable(store, AlarmKeeper(AlarmStore(store.database)), most=None)
            known = {stored.asset: stored for stored in board.load()}
            rigs = Rigs(store, board, GivenRigs())
            rig_of = partial(rigs.of, offered=None)
            reception = Reception(lambda asset: rig_of(asset, stored=known.get(asset)), None)
            restore(reception, SimpleNamespace(goes_on=lambda asset, assembly: None), known)
            WindowJobs(store.database, folder / "segments").backlogs()
        finally:
            event.remove(Engine, "before_cursor_execute", count)
        assert all(board.get(f"machine-{n}").rig == {"name": "a"} for n in range(assets))
        assert len(reception.assets) == assets
    return sum("FROM windows" not in sql.split("WHERE")[0] for sql in made)


def test_a_start_reads_what_is_kept_of_all_assets_at_once_and_once(tmp_path):
    assert statements_of_a_start(tmp_path, 12) == statements_of_a_start(tmp_path, 2)


def test_the_state_on_the_network_carries_no_window_list(store, long):
    class Silent:
        def announce(self, asset):
            pass

    state = json.loads(StatePublication(Silent(), long).state_text("unsw"))
    assert "windows" not in state and state["windows_total"] == LONG
    assert state["wear"] == long.get("unsw").whole["wear"]


def test_an_inspection_of_an_early_window_is_compared_with_the_twin_of_that_time(store, long):
    client = Client(create_app(long, store))
    given = {"revolutions": 105.0, "max_depth_um": 150.0, "flank": "combined", "std_um": 4.0}
    twin = client.call("POST", "/v1/assets/unsw/inspections", json=given).json()["twin"]
    expected = (fakes.depth_um(100.0) + fakes.depth_um(110.0)) / 2
    assert twin["max_depth_um"]["median"] == pytest.approx(expected)
    assert (twin["from_revolutions"], twin["to_revolutions"]) == (0.0, 10.0 * (LONG - 1))


@pytest.mark.parametrize("revolutions", [0.0, 35.0, 1234.0, 1300.0, 2555.0, 3489.0, 3490.0, 5000.0])
def test_an_inspection_needs_few_points_of_the_trend_and_leads_to_what_all_would(store, long, monkeypatch, revolutions):
    monkeypatch.setattr(assets, "AROUND", 20)
    monkeypatch.setattr(assets, "PAGE", 10)
    given = {"revolutions": revolutions, "max_depth_um": 150.0, "flank": "combined", "std_um": 4.0}
    every = [trend_point(w) for w in store.windows("unsw") if has_point(w)]
    few = assets.trend_around(store, "unsw", revolutions)
    assert compare(given, few) == compare(given, every) and len(few) < len(every)
