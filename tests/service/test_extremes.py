"""A thinned history shows the lowest and the highest values of every part of it, at a cost that does not grow."""

from __future__ import annotations

import random

import pytest
import service_fakes as fakes
import sqlalchemy as sa
from test_api import Client

from service.api import create_app
from service.results.extremes import FAN_OUT, KEPT_LEVEL, LEVELS, Bucket, bucket_for, extremes_of
from service.results.retention import DAY_NS, Retention, delete_old
from service.results.schema import EXTREMES

COUNT = 1500
HOUR_NS = DAY_NS // 24
EMPTY = {"state": {}, "report": {}}


def record(index, rms, kurtosis=3.0, quality="good"):
    sensors = {"y6": {"kurtosis": kurtosis}, "y7": {"kurtosis": 2.9}}
    return {"index": index, "quality": quality, "rms_measured": rms, "revolutions": 10.0 * index, "indicators": sensors,
            "kind": "measurement", "start_time": "2026-01-01T00:00:00+00:00", "updated": False}  # fmt: skip


def commit(store, index, found, asset="unsw"):
    assert store.commit(asset, index * HOUR_NS, record=found, received_ns=index, **EMPTY)


def noise(count=COUNT, seed=1):
    draw = random.Random(seed)
    return [record(i, 5.0 + draw.random(), 3.0 + draw.random()) for i in range(count)]


def filled(store, records):
    with store.database.transaction():
        for index, found in enumerate(records):
            commit(store, index, found)


def indices(windows):
    return [w.record["index"] for w in windows]


@pytest.fixture
def store(each_store):
    return each_store


@pytest.mark.slow
@pytest.mark.parametrize("most", [8, 50, 100, 333, 1000])
def test_no_peak_of_a_thinned_history_is_left_out(store, most):
    records = noise()
    records[777]["rms_measured"], records[1001]["rms_measured"] = 50.0, 0.1
    records[303]["indicators"]["y7"]["kurtosis"] = 40.0
    records[555].update(quality="refused", rms_measured=99.0)
    filled(store, records)
    shown = store.outline("unsw", most)
    assert {0, 303, 777, 1001, COUNT - 1} <= set(indices(shown)) and 555 not in indices(shown)
    assert indices(shown) == sorted(set(indices(shown)))
    assert most / 5 <= len(shown) <= most + 6
    size = bucket_for(COUNT, most).size
    usable = [r for r in records if r["quality"] != "refused"]
    for start in range(0, COUNT, size):
        own = [r for r in usable if start <= r["index"] < start + size]
        for best in (min, max):
            assert best(own, key=lambda r: r["rms_measured"])["index"] in indices(shown)
        loudest = max(own, key=lambda r: max(s["kurtosis"] for s in r["indicators"].values()))
        assert loudest["index"] in indices(shown)


def test_all_windows_are_shown_where_there_are_no_more_than_asked_for(store):
    filled(store, noise(40))
    assert indices(store.outline("unsw", 40)) == list(range(40))
    assert indices(store.outline("unsw", 10, after=29)) == list(range(30, 40))
    assert store.outline("unknown", 10) == ()


@pytest.mark.slow
def test_a_spike_is_in_the_trend_that_the_page_draws(store):
    records = [found | {"indicators": None} for found in noise(900)]
    records[777]["rms_measured"] = 50.0
    filled(store, records)
    board = fakes.WrittenTable(store)
    for part in ("trend", "windows"):
        shown = Client(create_app(board, store)).get(f"/v1/assets/unsw/{part}?resolution=100").json()
        assert max(point["rms_measured"] for point in shown) == 50.0 and len(shown) <= 106


def test_each_epoch_has_extremes_of_its_own(store):
    records = noise(600)
    records[100]["rms_measured"] = 50.0
    with store.database.transaction():
        for index, found in enumerate(records):
            if index == 300:
                store.keep("unsw", epoch=1)
            commit(store, index, found)
    assert (
        100 in indices(store.outline("unsw", 20, epoch=0)) and max(indices(store.outline("unsw", 20, epoch=0))) == 299
    )
    assert min(indices(store.outline("unsw", 20))) == 300


def test_windows_without_level_are_thinned_evenly(store):
    filled(store, [record(i, None, None) | {"indicators": None} for i in range(400)])
    assert store.database.rows(sa.select(sa.func.count()).select_from(EXTREMES))[0][0] == 0
    assert indices(store.outline("unsw", 40)) == [*range(0, 400, 48), 399]


@pytest.mark.parametrize(("windows", "most", "expected"), [
    (101, 100, Bucket(1, 2)), (1000, 1000, Bucket(1, 1)), (52_560, 100, Bucket(5, 3)), (525_600, 600, Bucket(6, 1)),
    (10**9, 100, Bucket(LEVELS, 39)),
])  # fmt: skip
def test_a_history_is_divided_into_few_parts(windows, most, expected):
    found = bucket_for(windows, most)
    assert found == expected and found.size * most >= windows


def test_values_that_are_no_numbers_are_no_extremes():
    assert extremes_of(record(0, float("nan"), float("inf")))["highest_kurtosis"] == 2.9
    assert extremes_of(record(0, 1.0, quality="refused")) is None
    assert extremes_of({"rms_measured": None}) is None


@pytest.mark.slow
def test_as_many_rows_are_read_of_a_long_history_as_of_a_short_one(store, monkeypatch):
    filled(store, noise())
    read = []
    rows = store._rows
    monkeypatch.setattr(store, "_rows", lambda *given: read.append(len(found := rows(*given))) or found)
    for after in (-1, COUNT - 200):
        read.clear()
        store.outline("unsw", 100, after)
        assert sum(read) <= 100 + 106 + 40 + FAN_OUT * 100 / 4


@pytest.mark.slow
def test_a_spike_stays_when_a_history_is_thinned_by_retention_and_goes_with_what_is_dropped(store):
    records = noise()
    records[333]["rms_measured"] = 50.0
    filled(store, records)
    thinning = Retention(whole_days=10, every=10, days=10_000, events=10_000)
    while delete_old(store.database, "unsw", thinning):
        pass
    left = indices(store.windows("unsw", limit=10_000))
    assert 333 in left and len([i for i in left if i < 1200]) <= 1200 / 10 + 5 * 3 + 1
    assert 333 in indices(store.outline("unsw", 20)) and FAN_OUT**KEPT_LEVEL == 256
    dropping = Retention(whole_days=10, every=10, days=20, events=10_000)
    while delete_old(store.database, "unsw", dropping):
        pass
    assert indices(store.windows("unsw", limit=10_000))[:2] == [0, 1020]
    parts = store.database.rows(sa.select(EXTREMES.c.level, sa.func.min(EXTREMES.c.part)).group_by(EXTREMES.c.level))
    assert {level: first for level, first in parts} == {n: 1020 // FAN_OUT**n for n in range(1, LEVELS + 1)}
    assert max(indices(store.outline("unsw", 20))) == COUNT - 1


def test_a_window_that_is_committed_twice_changes_nothing(store):
    filled(store, noise(20))
    before = store.database.rows(sa.select(EXTREMES))
    assert store.commit("unsw", 3 * HOUR_NS, record=record(3, 500.0), received_ns=3, **EMPTY) is None
    assert store.database.rows(sa.select(EXTREMES)) == before
    assert {(row.level, row.part) for row in before} == {
        (level, number // FAN_OUT**level) for level in range(1, LEVELS + 1) for number in range(20)
    }
