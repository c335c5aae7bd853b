"""Histories are kept whole, then thinned, then deleted; what is told of them stays right."""

from __future__ import annotations

from dataclasses import replace
from itertools import count, product

import pytest
from sqlalchemy import event, insert, update
from test_kept_signals import Loop, window

from service.alarms.engine import Change
from service.errors import StorageUnavailable
from service.results.alarm_store import AlarmStore
from service.results.json_columns import dump, seal
from service.results.retention import BATCH, DAY_NS, END_OF_EPOCH, Retention, delete_old
from service.results.schema import WINDOWS
from service.results.sql_store import SqlStore
from service.runtime import commits
from service.runtime.all_figures import database_figures

HOUR_NS = 3600 * 10**9
COUNT = 400  # windows, one an hour
RETENTION = Retention(whole_days=2, every=10, days=10, events=1000, history=5)
NOTABLE = UPDATED, FOUND, REFUSED, ALARM = 203, 211, 217, 229  # between 2 and 10 days before the newest


def commit(store, index, asset="unsw", **record):
    events = [("window", {"index": index})] + ([("effect", {"name": "tooth_crack"})] if index == FOUND else [])
    given = {"state": {"n": index}, "report": {"n": index}, "received_ns": 1}
    whole = {"index": index, "start_time": f"hour {index}", **record}
    assert store.commit(asset, index * HOUR_NS, record=whole, events=events, **given)


def clear(store, retention=RETENTION):
    rounds = 0
    while delete_old(store.database, "unsw", retention):
        rounds += 1
    return rounds


@pytest.fixture
def long(each_store):
    with each_store.database.transaction():
        for index in range(COUNT):
            commit(each_store, index, updated=index == UPDATED, quality="refused" if index == REFUSED else "good")
        each_store.note("unsw", (("alarm", {"verb": "raised"}),), ALARM * HOUR_NS)
        each_store.note("unsw", (), (ALARM + 1) * HOUR_NS)
    return each_store


def kept(store, **given):
    return [w.record["index"] for w in store.windows("unsw", **given)]


def expected(newest=COUNT - 1):
    whole = [i for i in range(newest + 1) if newest - i <= 48]
    thinned = [i for i in range(newest + 1) if 48 < newest - i <= 240 and (i % 10 == 0 or i in NOTABLE)]
    return [0, *thinned, *whole]


@pytest.mark.slow
def test_windows_are_whole_then_thinned_then_gone_and_what_was_notable_stays(long):
    before = long.asset("unsw"), long.next_index("unsw"), long.epochs("unsw"), long.latest_windows("unsw", 20)
    assert clear(long) > 1  # in small transactions
    assert kept(long) == expected()
    assert before == (
        long.asset("unsw"),
        long.next_index("unsw"),
        long.epochs("unsw"),
        long.latest_windows("unsw", 20),
    )
    assert long.epochs("unsw")[0] == {"epoch": 0, "windows": COUNT, "first": 0, "last": 399, "since": "hour 0"}
    assert clear(long) == 0
    commit(long, COUNT)
    assert long.asset("unsw").windows == COUNT + 1


def test_pages_of_a_thinned_history_are_those_of_the_whole(long):
    clear(long)
    for every, limit in product((1, 7, 10, 25, 1000), (3, 1000)):
        whole, pages, after = kept(long, every=every), [], -1
        while page := kept(long, every=every, limit=limit, after=after):
            pages += page
            after = page[-1]
        assert pages == whole, (every, limit)
        first = {i // every: i for i in reversed(expected())}
        assert whole == sorted({*first.values(), COUNT - 1}), (every, limit)


@pytest.mark.slow
def test_whole_history_is_thinned_for_an_answer_at_multiples_as_ever(long):
    assert kept(long, every=100) == [0, 100, 200, 300, 399]
    assert kept(long, every=100, after=100) == [200, 300, 399]
    assert kept(long, every=100, after=150) == [200, 300, 399]


def test_ends_of_epochs_stay_for_ever(each_store):
    store = each_store
    for epoch, indices in ((0, range(5)), (1, range(5, 9)), (2, range(9, 12))):
        store.keep("unsw", epoch=epoch)
        for index in indices:
            commit(store, index * 1000)
    before = store.epochs("unsw")
    clear(store)
    assert store.epochs("unsw") == before and [e["first"] for e in before] == [0, 5000, 9000]
    assert kept(store, epoch=0) == [0, 4000] and kept(store, epoch=1) == [5000, 8000]
    assert kept(store) == [9000, 11000]


@pytest.mark.slow
def test_newest_events_stay_and_their_numbers_go_on(long):
    with long.database.transaction():
        for number in range(1500):
            if number % 500 == 0:
                long.note("other", [("status", {})])
            long.note("unsw", [("status", {"number": number})])
    last = long.last_event_id("unsw")
    clear(long)
    events = long.events("unsw", 0, 10_000)
    assert len(events) == 1000 and events[-1].id == last and events[-1].data == {"number": 1499}
    assert len(long.events("other", 0)) == 3
    long.note("unsw", [("status", {})])
    assert long.last_event_id("unsw") > last


def test_history_of_an_alarm_is_bounded(each_store):
    alarms = AlarmStore(each_store.database)
    commit(each_store, 0)
    given = {
        "key": "rms", "rule": "rms", "quantity": "rms", "place": "y6", "value": 3.0, "limit": 2.0, "unit": "m/s²",
        "reason": "it is high", "action": "look",
    }  # fmt: skip
    for number in range(20):
        verb, level = ("raised", "watch") if number == 0 else ("escalated", "alarm")
        alarms.apply("unsw", Change(verb=verb, level=level, **given), f"at {number}", number)
    clear(each_store)
    (alarm,) = alarms.listed("unsw")
    assert [entry["at"] for entry in alarm["history"]] == [f"at {number}" for number in range(15, 20)]


@pytest.mark.slow
def test_file_does_not_grow_with_the_history(tmp_path):
    """Pages of deleted rows are used again."""
    retention = Retention(whole_days=100 / 24, every=10, days=200 / 24, events=1000)
    sizes = []
    with SqlStore(tmp_path / "twin.sqlite") as store:
        for part in range(8):
            with store.database.transaction():
                for index in range(part * 250, part * 250 + 250):
                    commit(store, index, text=str(hash((index, "x"))) * 40)
            clear(store, retention)
            sizes.append((tmp_path / "twin.sqlite").stat().st_size)
    assert sizes[-1] <= 1.1 * sizes[2]


def test_whoever_commits_a_window_deletes_what_it_makes_old_and_says_how_much(long, tmp_path):
    loop = Loop(long, tmp_path / "segments", retention=RETENTION)
    loop.commit(COUNT, window(start_time_ns=COUNT * HOUR_NS))
    assert kept(long) == expected(COUNT)
    assert database_figures(long)["old_rows_deleted"] == COUNT + 1 - len(kept(long))


def test_a_failure_to_delete_what_is_old_costs_no_window_and_is_made_up_for(long, tmp_path, monkeypatch, caplog):
    def fails(*given, **named):
        raise StorageUnavailable("the database cannot be used now (away)", reason="away")

    loop = Loop(long, tmp_path / "segments", retention=RETENTION)
    with monkeypatch.context() as away:
        away.setattr(commits, "delete_old", fails)
        loop.commit(COUNT, window(start_time_ns=COUNT * HOUR_NS))
    assert "nothing old could be deleted" in caplog.text and len(kept(long)) == COUNT + 1
    loop.commit(COUNT + 1, window(start_time_ns=(COUNT + 1) * HOUR_NS))
    assert kept(long) == expected(COUNT + 1)


def test_nothing_is_deleted_of_a_machine_that_stands_still(long):
    assert BATCH < COUNT
    forever = Retention(whole_days=COUNT * HOUR_NS / DAY_NS, every=10, days=1, events=1000)
    assert clear(long, forever) == 0 and len(kept(long)) == COUNT


def commit_days(store, *days, first=0):
    """One window a day, at these days."""
    for index, day in enumerate(days, first):
        given = {"state": {}, "report": {}, "received_ns": 1}
        assert store.commit("unsw", int(day * DAY_NS), record={"index": index}, **given)


def clear_at(store, day):
    while delete_old(store.database, "unsw", RETENTION, clock=lambda: day * DAY_NS):
        pass


def test_a_clock_that_was_set_back_loses_nothing_and_the_wrong_times_go_with_their_neighbours(each_store):
    """The windows stay while the clock is wrong, and after it was set right until those around them are old."""
    commit_days(each_store, 1000, 1000.5, 1001, 100, 100.5, 101, 101.5)
    clear_at(each_store, 1003)
    assert kept(each_store) == list(range(7)) and each_store.next_index("unsw") == 7
    commit_days(each_store, 1002, first=7)
    clear_at(each_store, 1003)
    assert kept(each_store) == list(range(8))
    commit_days(each_store, 1012.5, 1013, first=8)
    clear_at(each_store, 1013)
    assert kept(each_store) == [0, 8, 9]


def test_a_clock_that_was_ahead_loses_nothing_and_the_wrong_times_go_with_their_neighbours(each_store):
    commit_days(each_store, 1000, 1000.5, 1001, 1001.5, 5000, 5000.5)
    clear_at(each_store, 1002)
    assert kept(each_store) == list(range(6))
    commit_days(each_store, 1002.6, 1003, first=6)
    clear_at(each_store, 1003)
    assert kept(each_store) == [0, *range(2, 8)]  # window 1 is more than two days old, and thinned
    commit_days(each_store, 1004.5, first=8)
    clear_at(each_store, 1005)
    assert kept(each_store) == [0, *range(4, 9)]  # the windows ahead are younger than those before them
    commit_days(each_store, 1005, first=9)
    clear_at(each_store, 1005)
    assert kept(each_store) == [0, 7, 8, 9]  # and older than those after them


def test_a_stream_that_is_ahead_of_the_service_for_good_loses_nothing(each_store):
    commit_days(each_store, *range(5000, 5020))
    clear_at(each_store, 1000)
    assert kept(each_store) == list(range(20))
    commit_days(each_store, 1001, first=20)  # its clock is set right
    clear_at(each_store, 1001)
    assert kept(each_store) == list(range(21))


def test_an_epoch_that_ends_while_its_windows_are_looked_at_keeps_its_last(each_store, monkeypatch):
    commit_days(each_store, 1, 2, 3)
    commit_days(each_store, 4, first=3)
    rows, clock = each_store.database.rows, count()

    def read(query, values=None):
        found = rows(query, values)
        if "notable" in str(query) and next(clock) == 0:
            with each_store.database.transaction() as db:
                db.execute(update(WINDOWS).where(WINDOWS.c.number == 1).values(notable=END_OF_EPOCH))
        return found

    monkeypatch.setattr(each_store.database, "rows", read)
    commit_days(each_store, 500, first=4)
    clear_at(each_store, 501)
    assert kept(each_store) == [0, 1, 4]


def test_the_newest_closed_alarms_stay_and_open_ones_for_ever(each_store):
    alarms = AlarmStore(each_store.database)
    commit(each_store, 0)
    given = {
        "rule": "rms", "quantity": "rms", "place": "y6", "level": "watch", "value": 3.0, "limit": 2.0, "unit": "m/s²",
        "reason": "it is high", "action": "look",
    }  # fmt: skip
    signed = {"by": "Anna", "note": "", "at": "later"}
    with each_store.database.transaction():
        for number in range(30):
            alarm = alarms.apply("unsw", Change(verb="raised", key=f"rms-{number}", **given), f"at {number}", number)
            if number not in (2, 29):
                alarms.sign("unsw", alarm["id"], "cleared", signed)
    assert clear(each_store, replace(RETENTION, alarms=5)) == 1  # in one batch
    left = sorted(alarm["window"] for alarm in alarms.listed("unsw", closed=True))
    assert left == [2, 24, 25, 26, 27, 28, 29] and len(alarms.open("unsw")) == 2
    assert all(len(alarm["history"]) >= 1 for alarm in alarms.listed("unsw", closed=True))


@pytest.mark.slow
def test_a_thinned_answer_costs_the_database_as_much_after_forty_thousand_windows_as_after_two_thousand(tmp_path):
    few, many = _steps(tmp_path / "few.sqlite", 2_000), _steps(tmp_path / "many.sqlite", 40_000)
    assert {name: steps <= 1.5 * few[name] for name, steps in many.items()} == dict.fromkeys(many, True), (few, many)


def _steps(path, count):
    """Steps of SQLite's machine that each reading takes, with so many windows of an asset."""
    with SqlStore(path) as store:
        store.note("unsw", [])
        kept = {n: dump({"index": n}) for n in range(10)}
        rows = [
            {"asset": "unsw", "start_ns": n, "number": n, "epoch": 0, "seal": seal(n, n, 0), "record": kept[n % 10],
             "figures": kept[0]}
            for n in range(count)
        ]  # fmt: skip
        with store.database.transaction() as db:
            db.execute(insert(WINDOWS), rows)
        readings = {
            "epochs": lambda: store.epochs("unsw"),
            "thinned": lambda: store.windows("unsw", -1, 101, -(-count // 100)),
            "end of thinned": lambda: store.windows("unsw", count - 300, 101, 3),
            "page": lambda: store.windows("unsw", count // 2, 100),
            "latest": lambda: store.latest_windows("unsw", 100),
            "next": lambda: store.next_index("unsw"),
        }
        return {name: _steps_of(store, reading) for name, reading in readings.items()}


def _steps_of(store, reading):
    steps = [0]

    def counted(connection, *_):
        connection.set_progress_handler(lambda: steps.__setitem__(0, steps[0] + 1), 10)

    event.listen(store.database._reader, "checkout", counted)
    try:
        assert reading()
    finally:
        event.remove(store.database._reader, "checkout", counted)
    return steps[0]
