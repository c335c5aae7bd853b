"""The store: whole windows or nothing, each once, and none lost when the process is killed."""

from __future__ import annotations

import os
import signal
import sqlite3
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import pytest
import service_fakes as fakes

from service.errors import StorageUnavailable, StoreError
from service.results.sql_store import SqlStore

ROOT = Path(__file__).parents[2]


@pytest.fixture
def store(each_store):
    return each_store


def test_committed_window_is_read_back_whole(store):
    assert fakes.take(store, None, "unsw", 0, 1500.0, quality="degraded", faults=(fakes.FAULT,))
    (window,) = store.windows("unsw")
    entry = fakes.record(0, 1500.0)
    assert window.record == {**entry, "quality": "degraded", "faults": [fakes.FAULT]}
    assert window.figures["depth_um"] == fakes.report(1500.0, 1)["wear"]["max_depth_um"]
    asset = store.asset("unsw")
    assert asset.report == fakes.report(1500.0, 1)
    assert asset.state == {"windows_seen": 1, "memory": {}}
    assert asset.assembly == {"closed_until_ns": fakes.START_NS}
    assert asset.making["windows"] == {"good": 0, "degraded": 1, "refused": 0}
    assert [e.kind for e in store.events("unsw", 0)] == ["window", "rul", "data_fault"]


def test_window_committed_twice_counts_once_and_changes_nothing(store):
    assert fakes.take(store, None, "unsw", 0, 1500.0)
    before = (store.asset("unsw"), store.windows("unsw"), store.events("unsw", 0))
    assert not fakes.take(store, None, "unsw", 0, 1700.0, updated=True)
    assert (store.asset("unsw"), store.windows("unsw"), store.events("unsw", 0)) == before


def commit(store, start_ns, record, **changes):
    given = {"state": {}, "report": {}, "received_ns": start_ns, **changes}
    return store.commit("unsw", start_ns, record=record, **given)


def test_refused_window_is_kept_without_figures_of_its_own(store):
    fakes.take(store, None, "unsw", 0, 1500.0)
    report = store.asset("unsw").report
    refused = {"index": 1, "revolutions": None, "quality": "refused", "reason": "no samples"}
    window = commit(store, fakes.START_NS + 1, refused, report=report, events=[("data_fault", refused)])
    assert window.record == refused and window.figures == {}
    assert store.asset("unsw").report == report


def test_window_before_the_twins_first_report_leaves_none(store):
    commit(store, 1, {"index": 0, "quality": "refused"}, report=None)
    assert store.asset("unsw").report is None and len(store.windows("unsw")) == 1


def test_assets_do_not_mix(store):
    fakes.take(store, None, "a", 0, 100.0)
    fakes.take(store, None, "b", 0, 200.0)
    fakes.take(store, None, "a", 1, 300.0)
    assert [w.record["revolutions"] for w in store.windows("a")] == [100.0, 300.0]
    assert [w.record["revolutions"] for w in store.windows("b")] == [200.0]
    ids = [e.id for e in store.events("a", 0)]
    assert ids == sorted(ids) and not set(ids) & {e.id for e in store.events("b", 0)}


def test_window_that_cannot_be_written_leaves_no_part_behind(store):
    fakes.take(store, None, "unsw", 0, 1500.0)
    before = (store.asset("unsw"), store.windows("unsw"), store.events("unsw", 0))
    with pytest.raises(TypeError, match="not JSON serializable"):
        commit(store, 7, {"index": 1}, events=[("window", {"x": object()})])
    assert (store.asset("unsw"), store.windows("unsw"), store.events("unsw", 0)) == before


def test_numbers_that_are_not_finite_become_null(store):
    commit(store, 1, {"index": 0, "rms_predicted": float("nan"), "error_percent": float("inf")})
    assert store.windows("unsw")[0].record == {"index": 0, "rms_predicted": None, "error_percent": None}


def test_database_is_in_wal_mode(tmp_path):
    with SqlStore(tmp_path / "twin.sqlite") as store, closing(sqlite3.connect(store.path)) as peek:
        assert peek.execute("PRAGMA journal_mode").fetchone() == ("wal",)


def test_file_that_is_no_database_is_refused_by_name(tmp_path):
    path = tmp_path / "twin.sqlite"
    path.write_bytes(b"not a database at all, but long enough to be read as one" * 40)
    with pytest.raises(StoreError, match=r"twin\.sqlite cannot be used.*not a database"):
        SqlStore(path)


def test_assets_from_the_store_equal_those_that_were_published(store):
    board = fakes.WrittenTable(store)
    fakes.campaign(store, board)
    again = fakes.WrittenTable(store)
    assert again.assets() == board.assets()
    assert again.get("unsw") == board.get("unsw")


WRITER = """
import sys
from pathlib import Path
sys.path[:0] = sys.argv[2:4]
import service_fakes as fakes
from service.results.sql_store import SqlStore
where = sys.argv[1]
store = SqlStore(where if "://" in where else Path(where))
index = len(store.windows("unsw"))
while True:
    assert fakes.take(store, None, "unsw", index, 100.0 * index)
    print(index, flush=True)
    index += 1
"""


@pytest.mark.slow
def test_killed_process_loses_no_acknowledged_window_and_counts_none_twice(where):
    acknowledged = -1
    for stop_after in (3, 7, 20, 55):
        writer = subprocess.Popen(
            [sys.executable, "-c", WRITER, str(where), str(ROOT), str(Path(__file__).parent)],
            stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        with writer:
            for _, line in zip(range(stop_after), writer.stdout, strict=False):
                acknowledged = int(line)
            os.kill(writer.pid, signal.SIGKILL)  # between commits or within one
            acknowledged = int([str(acknowledged), *writer.stdout.read().split()][-1])
        assert writer.returncode == -signal.SIGKILL
        with SqlStore(where) as store:
            indices = [w.record["index"] for w in store.windows("unsw")]
            assert indices == list(range(len(indices)))
            assert len(indices) in (acknowledged + 1, acknowledged + 2)  # the last may be in, not yet said
            assert store.asset("unsw").state["windows_seen"] == len(indices)
            told = [e.data["index"] for e in store.events("unsw", 0, 10_000) if e.kind == "window"]
            assert told == indices
            acknowledged = len(indices) - 1


def test_reading_does_not_wait_for_a_transaction_of_another_thread(store):
    fakes.take(store, None, "unsw", 0, 100.0)
    with ThreadPoolExecutor(1) as other, store.database.transaction():
        fakes.take(store, None, "unsw", 1, 200.0)
        assert len(store.windows("unsw")) == 2  # within the transaction
        assert len(other.submit(store.windows, "unsw").result(5)) == 1  # outside of it
    assert len(store.windows("unsw")) == 2


def test_threads_that_write_wait_for_one_another(store):
    with ThreadPoolExecutor(4) as threads:
        taken = list(threads.map(lambda i: fakes.take(store, None, f"asset-{i % 4}", i // 4, 10.0 * i), range(40)))
    assert all(taken)
    assert [len(store.windows(f"asset-{i}")) for i in range(4)] == [10] * 4


def test_epochs_say_since_when(store):
    for index in range(3):
        fakes.take(store, None, "unsw", index, 100.0 * index)
    store.keep("unsw", epoch=1)
    fakes.take(store, None, "unsw", 3, 1.0)
    first, second = store.epochs("unsw")
    assert first == {"epoch": 0, "windows": 3, "first": 0, "last": 2, "since": fakes.record(0, 0.0)["start_time"]}
    assert second["epoch"] == 1 and second["first"] == second["last"] == 3
    assert store.asset("unsw").windows == 1 and store.next_index("unsw") == 4
    assert [w.record["index"] for w in store.windows("unsw", epoch=0, every=2)] == [0, 2]


def test_url_that_names_another_kind_of_database_is_refused_without_its_password():
    with pytest.raises(StoreError, match="names mysql; it must be postgresql://") as caught:
        SqlStore("mysql://me:secret@host/name")
    assert "secret" not in str(caught.value)


def test_server_that_is_not_there_is_one_line_without_the_password():
    with pytest.raises(StorageUnavailable, match="connection lost") as caught:
        SqlStore("postgresql://me:secret@127.0.0.1:9/name")
    assert caught.value.reason == "connection lost"
    assert "secret" not in str(caught.value) and "\n" not in str(caught.value)
