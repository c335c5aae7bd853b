"""What waits to be processed is bounded: the oldest windows of the asset with most waiting are left out, whole."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import numpy as np
import pytest
import service_fakes as fakes
from loops import loop_of
from segments import segment_of

from service.errors import StorageUnavailable
from service.results import window_jobs
from service.results.segment_file import read_segment
from service.results.window_jobs import WindowJobs
from service.runtime import computing, work
from service.runtime.receiver_figures import shed_of
from service.runtime.window_outcomes import SHED
from twin.windows import Edges, Samples, Window

KB = 1024


@pytest.fixture
def parts(store, tmp_path):
    def make(**limits):
        loop = loop_of(store, tmp_path, **limits)
        loop.files = lambda: list((tmp_path / "segments").glob("*.mcap"))
        loop.add_segment, loop.add = loop.add, lambda asset, number: loop.add_segment(asset, segment(asset, number))
        return loop

    return make


def segment(asset, number):
    """A window whose frames take 32 kB in memory."""
    rng = np.random.default_rng(number)
    window = Window(
        start_time_ns=10**18 + number * 10**10,
        accelerations={"y6": Samples(rate=2000.0, start=0.0, values=rng.standard_normal(4096))},
        torques={"pinion": Samples(rate=2000.0, start=0.0, values=10.0 + rng.standard_normal(4096))},
        encoders={"pinion": Edges(per_rev=64, first_index=640 * number, times=np.arange(128) / 640)},
    )
    return segment_of(window, asset)


def numbers(store, refused, asset="a"):
    """Which windows were committed, in their order."""
    starts = [window.start_ns for window in store.windows(asset) if (window.record["quality"] == "refused") == refused]
    return [(start - 10**18) // 10**10 for start in starts]


def test_windows_over_an_assets_bound_are_left_out_oldest_first_but_not_the_one_in_work(parts):
    p = parts(windows=3)
    for number in range(8):
        p.add("a", number)
    assert p.backlogs.now("a").all_windows == 3 == len(p.files())
    p.carry_out()
    assert numbers(p.store, refused=True) == [1, 2, 3, 4, 5] and numbers(p.store, refused=False) == [0, 6, 7]
    windows = p.store.windows("a")
    assert [window.record["index"] for window in windows] == list(range(8))
    record = windows[1].record
    assert "more windows of the asset waited" in record["reason"] and record["faults"][0]["kind"] == SHED
    assert p.store.asset("a").making["windows"] == {"good": 3, "repaired": 0, "degraded": 0, "refused": 5}
    assert p.store.asset("a").fault_totals[SHED, "all", "refused"] == (5, 5) and shed_of(p.table, "a") == 5
    assert not p.windows.waiting("a") and not p.files()


def test_an_asset_that_floods_costs_no_other_a_window(parts):
    p = parts(total_windows=8)
    for number in range(2):
        p.add("quiet", number)
    for number in range(30):
        p.add("flood", number)
    assert p.backlogs.now("quiet").all_windows == 2 and p.backlogs.windows == 8
    p.carry_out()
    assert not numbers(p.store, refused=True, asset="quiet") and len(numbers(p.store, True, "flood")) == 24


def test_bytes_are_bounded_too(parts):
    p = parts(bytes=60 * KB)
    for number in range(8):
        p.add("a", number)
    assert p.backlogs.now("a").bytes <= 60 * KB + 40 * KB
    p.carry_out()
    assert shed_of(p.table, "a") > 2


def broken(*given, **named):
    raise StorageUnavailable("disk full", reason="no space")


def test_windows_wait_in_memory_within_a_bound_and_keep_their_order_and_place(parts, monkeypatch):
    p = parts(memory_bytes=110 * KB)
    keep = p.store.keep
    monkeypatch.setattr(p.store, "keep", broken)
    for number in range(6):
        p.add("a", number)
    assert p.spool.unstored_from_ns("a") == 10**18 and p.spool.held_bytes <= 110 * KB
    assert p.windows.waiting("a") == () and "disk full" in p.storage.reason
    assert not p.files()  # of no transaction
    monkeypatch.setattr(p.store, "keep", keep)
    assert not p.spool.retry()  # not yet
    p.clock[0] += 100
    assert p.spool.retry() and p.spool.unstored_from_ns("a") is None and p.spool.held_bytes == 0
    p.storage.worked()
    p.carry_out()
    assert numbers(p.store, refused=True) == [0, 1, 2] and numbers(p.store, refused=False) == [3, 4, 5]
    assert "storage could not be used" in p.store.windows("a")[0].record["reason"]
    assert shed_of(p.table, "a") == 3


def test_a_result_whose_commit_fails_is_committed_later_and_its_asset_waits(parts, monkeypatch):
    p = parts()
    for number in range(3):
        p.add("a", number)
    commit = p.store.commit
    monkeypatch.setattr(p.store, "commit", broken)
    with pytest.raises(StorageUnavailable):
        p.carry_out()
    assert not p.store.windows("a") and len(p.windows.waiting("a")) == 3
    monkeypatch.setattr(p.store, "commit", commit)
    monkeypatch.setattr(work, "carry_out", broken)  # the first is not computed again
    p.storage.worked()
    p.carry_out(1)
    monkeypatch.undo()
    p.carry_out()
    assert numbers(p.store, refused=False) == [0, 1, 2]
    assert [window.record["index"] for window in p.store.windows("a")] == [0, 1, 2]


def test_a_window_that_was_kept_without_an_answer_keeps_its_file_where_the_next_attempt_fails(parts, monkeypatch):
    """The file was deleted, and the window refused later, though the database named it."""
    p = parts()
    keep, transaction, within = p.store.keep, p.windows.transaction, []

    @contextmanager
    def unanswered():
        within.append(True)
        with transaction() as db:
            yield db
        within.pop()
        if within:
            return
        raise StorageUnavailable("connection lost", reason="connection lost", unknown=True)

    with monkeypatch.context() as patched:
        patched.setattr(p.windows, "transaction", unanswered)
        p.add("a", 0)
    assert len(p.windows.waiting("a")) == 1 and p.spool.unstored_from_ns("a") is not None
    p.clock[0] += 100
    monkeypatch.setattr(p.store, "keep", broken)
    assert not p.spool.retry()
    monkeypatch.setattr(p.store, "keep", keep)
    p.clock[0] += 100
    assert p.spool.retry() and len(p.windows.waiting("a")) == 1
    p.storage.worked()
    p.carry_out()
    assert numbers(p.store, refused=False) == [0] and p.windows.waiting("a") == ()


@pytest.mark.parametrize("slow", ["write_segment", "sync_folder"])
def test_nobody_who_writes_to_the_database_waits_for_the_file_of_a_window(parts, monkeypatch, slow):
    """A disk that took 6 s held up decisions, as the window's transaction was open meanwhile."""
    p, begun, go_on, real = parts(), threading.Event(), threading.Event(), getattr(window_jobs, slow)

    def waits(*given):
        begun.set()
        assert go_on.wait(20)
        return real(*given)

    monkeypatch.setattr(window_jobs, slow, waits)
    adding = threading.Thread(target=p.add, args=("a", 0))
    adding.start()
    assert begun.wait(20)
    elsewhere = ThreadPoolExecutor(1).submit(fakes.decide, p.store, "a", "misalignment", "pin")
    try:
        assert elsewhere.result(10) and p.spool.unstored_from_ns("a") is not None  # not acknowledged yet
    finally:
        go_on.set()
        adding.join()
    assert p.spool.unstored_from_ns("a") is None


def test_a_suspended_worker_that_goes_on_writes_into_no_file_of_the_one_that_took_its_folder(store, tmp_path):
    life, again = (WindowJobs(store.database, tmp_path / "segments") for _ in range(2))
    first, second = (each.write(segment("a", 0)) for each in (life, again))
    assert first.path != second.path and first.bytes == second.bytes
    assert life.add_waiting("a", second)
    first.path.write_bytes(b"torn")
    assert read_segment(life.path_of(life.waiting("a")[0])).start_ns == segment("a", 0).start_ns
    assert WindowJobs(store.database, tmp_path / "segments").waiting("a")  # a start deletes what nothing names
    assert list((tmp_path / "segments").glob("*.mcap")) == [second.path]


def test_a_window_that_is_left_out_while_it_is_begun_is_counted_as_that(parts, monkeypatch):
    p, read = parts(), computing.read_segment
    for number in range(2):
        p.add("a", number)
    p.carry_out(1)
    (waits,) = p.windows.waiting("a")

    def late(file):
        monkeypatch.undo()
        p.windows.leave_out(waits, "left out: no room")
        return read(file)

    monkeypatch.setattr(computing, "read_segment", late)
    p.carry_out()
    assert p.store.windows("a")[1].record["reason"] == "left out: no room" and shed_of(p.table, "a") == 1
