"""Metrics: all of the catalogue and nothing else is exported, bounded, and whatever the storage does."""

from __future__ import annotations

import asyncio
import re
import sqlite3
import threading
import time

import pytest
import service_fakes as fakes
from prometheus_client import generate_latest
from prometheus_client.parser import text_string_to_metric_families
from service_streams import RIG, free_port, service, wait_until, write_recording
from test_health import get

from service.api.collector import AssetCollector, registry
from service.errors import StorageUnavailable
from service.files.rig import load_rig
from service.operation.metric_catalogue import FLEET, METRICS, OTHERS
from service.operation.timing import Timing
from service.results.asset_table import AssetTable
from service.results.database import Database
from service.results.jobs import Jobs
from service.results.sql_store import SqlStore
from service.runtime.computing import Ask, Call, WindowToUse, carry_out
from service.runtime.replay import replay
from twin.observed import TRACING, observed_by, part

INPUTS = """schema = "gear-inputs/1"

[[inputs]]
unit = "degC"
topic = "plant/oil"
asset = "unsw"
channel = "temperature/oil"
"""


def families(text):
    """Type, and labels of all samples, by the name that the catalogue exports."""
    found = {}
    for family in text_string_to_metric_families(text):
        name = f"{family.name}_total" if family.type == "counter" else family.name
        found[name] = family.type, [s.labels for s in family.samples]
    return found


@pytest.mark.slow
def test_service_that_has_run_exports_all_of_the_catalogue_and_nothing_else(tmp_path):
    inputs = tmp_path / "inputs.toml"
    inputs.write_text(INPUTS, encoding="utf-8")
    opcua = f"opc.tcp://127.0.0.1:{free_port()}/gear-twin"
    recording = write_recording(tmp_path / "short.mcap", 4)
    given = {"MQTT": "mqtt://127.0.0.1:1", "MQTT_INPUTS": str(inputs), "OPCUA": opcua}
    given |= {"RAW_FOLDER": str(tmp_path / "raw"), "RAW_SPARE_GB": "0"}
    given |= {"RAW_URL": (tmp_path / "segments").as_uri()}
    catalogue = [entry for entry in METRICS.values() if entry.only != FLEET]
    with service(tmp_path / "data", **given) as running:
        replay(recording, [running.endpoint], 0)
        wait_until(lambda: len(running.windows()) == 4, 20.0)
        wait_until(lambda: "gear_twin_raw_store_unavailable" in running.text("/metrics"), 20.0)  # the recorder's
        exported = families(running.text("/metrics"))
    assert {name: kind for name, (kind, _) in exported.items()} == {e.shown: e.type for e in catalogue}
    for entry in catalogue:
        for labels in exported[entry.shown][1]:
            assert set(labels) - {"le"} == set(entry.labels), entry.name
    (lag,) = [labels for labels in exported["gear_twin_lag_seconds"][1] if labels]
    assert lag == {"asset": "unsw"}


def test_figure_that_is_not_in_the_catalogue_cannot_be_exported(store, board):
    collector = AssetCollector(board, fakes.jobs_of(store), lambda: {"invented": 1.0}, 10)
    with pytest.raises(KeyError, match="invented"):
        list(collector.collect())


def test_names_types_and_units_of_the_catalogue_follow_the_rules_of_prometheus():
    for entry in METRICS.values():
        assert re.fullmatch(r"[a-z][a-z0-9_]*", entry.name) and not entry.name.endswith("_total")
        assert entry.shown.endswith("_total") is (entry.type == "counter")
        assert entry.unit == "s" or not entry.name.endswith("_seconds")
        assert entry.unit == "byte" or not entry.name.endswith("_bytes")


def test_assets_beyond_the_bound_are_counted_together_and_those_within_it_keep_their_series(store, board):
    for number in range(5):
        fakes.take(store, board, f"m{number}", 0, 100.0)
    lag = {f"m{number}": float(number) for number in range(5)}
    collector = AssetCollector(board, fakes.jobs_of(store), lambda: {"lag_seconds": lag}, 2)

    def samples():
        return {(s.name, *s.labels.values()): s.value for family in collector.collect() for s in family.samples}

    found = samples()
    assert {name for _, name, *_ in (key for key in found if len(key) > 1)} == {"m0", "m1", OTHERS}
    graded = {key[2]: value for key, value in found.items() if key[:2] == ("gear_twin_windows_total", OTHERS)}
    assert sum(graded.values()) == 3.0
    assert found["gear_twin_lag_seconds", OTHERS] == 4.0  # the largest
    assert ("gear_twin_last_window_seconds", OTHERS) not in found
    assert found[("gear_twin_assets",)] == 5.0
    fakes.take(store, board, "a", 0, 100.0)  # sorted before those that have series
    assert ("gear_twin_updates_total", "m1") in samples() and ("gear_twin_updates_total", "a") not in samples()


def test_scrape_is_two_queries_however_many_assets_there_are(store, board):
    for number in range(7):
        fakes.take(store, board, f"m{number}", 0, 100.0)
    asked = []
    with SqlStore(Database(store.path, took=lambda what, seconds: asked.append(what))) as another:
        table, jobs = AssetTable(another), fakes.jobs_of(another)
        table.look()  # as a process that follows what others commit
        table.every()  # makes the snapshots
        asked.clear()
        list(AssetCollector(table, jobs, dict, 10).collect())
        table.close()
    assert asked == ["read", "read"]  # which assets have changed, and what people have decided


def test_scrape_is_answered_while_the_storage_cannot_be_used(store, board, monkeypatch):
    fakes.take(store, board, "unsw", 0, 100.0)
    fakes.decide(store, "unsw", "misalignment", "pin")
    fakes.carry_out(store, fakes.jobs_of(store).pending()[0], state={}, report=board.get("unsw").report, events=[])
    collector = AssetCollector(board, fakes.jobs_of(store), dict, 10)
    before = [family.samples for family in collector.collect()]

    def unavailable(jobs):
        raise StorageUnavailable("locked", reason="locked") from sqlite3.OperationalError("locked")

    monkeypatch.setattr(Jobs, "decision_counts", unavailable)
    assert [family.samples for family in collector.collect()] == before
    assert get(board, store, "/metrics").status_code == 200


def test_computation_and_tracing_are_timed_where_they_happen():
    class Tracing:
        def process(self, rig, state, window):
            with part(TRACING):
                pass
            return state, None

    made = carry_out(
        Call(
            asset="m",
            twin=Tracing(),
            rig=load_rig(RIG),
            state=object(),
            ask=Ask("window", WindowToUse(start_ns=0, segment=fakes.SEGMENT)),
        )
    )
    assert set(made.parts) == {"total", TRACING} and made.parts["total"] >= made.parts[TRACING] > 0
    timing = Timing()
    timing.computed("window", made.parts)
    sums = {
        s.name: s.value for f in timing.figures().values() for m in f.collect() for s in m.samples if "count" in s.name
    }
    assert sums["gear_twin_trace_seconds_count"] == sums["gear_twin_processing_seconds_count"] == 1.0
    with observed_by(lambda name: pytest.fail(name)):
        pass
    with part("outside"):
        pass


def test_what_is_exported_of_an_asset_does_not_grow_with_its_history(store, board):
    sizes = []
    for index in range(30):
        fakes.take(store, board, "unsw", index, 100.0 * (index + 1))
        collector = AssetCollector(board, fakes.jobs_of(store), dict, 10)
        sizes.append(sum(len(family.samples) for family in collector.collect()))
    assert len(set(sizes[1:])) == 1, sizes


@pytest.mark.slow
def test_scrape_of_200_assets_takes_little_of_the_processor_and_leaves_the_event_loop_free(store, board):
    for number in range(200):
        fakes.take(store, board, f"m{number:03d}", 0, 100.0, faults=(fakes.FAULT,))
    found, times, waits = registry(board, fakes.jobs_of(store), dict, 500), [], []

    def scrape():
        for _ in range(5):
            began = time.thread_time()
            assert len(generate_latest(found)) > 100_000
            times.append(time.thread_time() - began)

    async def turn():
        thread = threading.Thread(target=scrape)
        thread.start()
        while thread.is_alive():
            began = time.monotonic()
            await asyncio.sleep(0.01)
            waits.append(time.monotonic() - began - 0.01)

    asyncio.run(turn())
    assert min(times) < 0.2  # [s]; 0.05 s where it was written
    assert sorted(waits)[len(waits) // 2] < 0.05  # [s]: nobody waits for the end of a scrape
