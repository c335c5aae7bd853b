"""What waits to be processed is bounded: the oldest windows of the asset with most waiting are left out, whole."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from types import SimpleNamespace

import fake_twin
import numpy as np
import pytest
import service_fakes as fakes
from segments import segment_of

from service.errors import StorageUnavailable
from service.results import window_jobs
from service.results.segment_file import read_segment
from service.results.store import StoredWindow
from service.results.window_jobs import WindowJobs, delete_file
from service.runtime.computing import carry_out
from service.runtime.lanes import SHED, Lanes
from service.runtime.outcomes import ClosedWindow
from service.runtime.packed_state import NEW
from service.runtime.reception import Reception
from service.runtime.spool import BacklogLimits, Spool
from service.runtime.storage_watch import StorageWatch
from service.stream.assembly import Assembler
from twin.rig import Rig
from twin.windows import Edges, Samples, Window

KB = 1024
ROOMY = BacklogLimits(windows=100, bytes=10**9, total_windows=1000, total_bytes=10**9, memory_bytes=10**9)


class Later:
    """Computing that is done when the test says so."""

    def __init__(self):
        self.calls = []

    def start(self, call, done):
        self.calls.append((call, done))

    def carry_out(self):
        while self.calls:
            call, done = self.calls.pop(0)
            done(carry_out(call))


class Committing:
    """A sink over a store, as far as windows and their files are concerned."""

    def __init__(self, store, life):
        self.store, self.life, self.outcomes = store, life, []

    def commit(self, outcome, job=None):
        waited = None
        with self.life.transaction():
            committed = self.store.commit(
                outcome.asset, outcome.window.start_time_ns, record=outcome.record, state=outcome.state.to_dict(),
                report=outcome.report, received_ns=1,
                events=outcome.events,
            )  # fmt: skip
            if outcome.waited is not None:
                waited = self.life.drop_waiting(outcome.waited)
        if waited is not None:
            delete_file(self.life.path_of(waited))
        self.outcomes.append(outcome)
        return isinstance(committed, StoredWindow)

    def publish(self, outcome):
        pass


@pytest.fixture
def parts(store, tmp_path):
    def make(**limits):
        clock = [0.0]
        life = WindowJobs(store.database, tmp_path / "segments")
        storage = StorageWatch("data", clock=lambda: clock[0])
        reception = Reception(lambda asset: Rig.from_mapping({}), lambda closed: spool.add(closed))
        sink, computing = Committing(store, life), Later()
        lanes = Lanes(
            reception, sink, computing, twin_of=lambda asset, rig: fake_twin.TWIN, new_state=lambda: NEW,
            storage=storage,
        )  # fmt: skip
        given = BacklogLimits(**{name: limits.get(name, getattr(ROOMY, name)) for name in BacklogLimits.__slots__})
        spool = Spool(life, store, reception, lanes, storage, given)
        return SimpleNamespace(**locals(), add=lambda asset, number: spool.add(closed(asset, number)))

    return make


def closed(asset, number):
    """A window whose frames take 32 kB in memory."""
    rng = np.random.default_rng(number)
    window = Window(
        start_time_ns=10**18 + number * 10**10,
        accelerations={"y6": Samples(rate=2000.0, start=0.0, values=rng.standard_normal(4096))},
        torques={"pinion": Samples(rate=2000.0, start=0.0, values=10.0 + rng.standard_normal(4096))},
        encoders={"pinion": Edges(per_rev=64, first_index=640 * number, times=np.arange(128) / 640)},
    )
    return ClosedWindow(asset=asset, segment=segment_of(window, asset), assembly=Assembler().to_dict())


def numbers(outcomes, refused):
    chosen = [o for o in outcomes if (o.record["quality"] == "refused") == refused]
    return [(o.asset, (o.window.start_time_ns - 10**18) // 10**10) for o in chosen]


def test_windows_over_an_assets_bound_are_left_out_oldest_first_but_not_the_one_in_work(parts):
    p = parts(windows=3)
    for number in range(8):
        p.add("a", number)
    assert numbers(p.sink.outcomes, refused=True) == [("a", 1), ("a", 2), ("a", 3), ("a", 4), ("a", 5)]
    assert p.lanes.backlog("a") == 3 == len(list((p.tmp_path / "segments").glob("*.mcap")))
    p.computing.carry_out()
    assert numbers(p.sink.outcomes, refused=False) == [("a", 0), ("a", 6), ("a", 7)]
    assert [o.index for o in p.sink.outcomes] == list(range(8)) and sum(lane.shed for lane in p.lanes.all()) == 5
    record = p.sink.outcomes[0].record
    assert "more windows of the asset waited" in record["reason"] and record["faults"][0]["kind"] == SHED
    assert p.lanes.of("a").counts.windows == {"good": 3, "repaired": 0, "degraded": 0, "refused": 5}
    assert p.store.asset("a").fault_totals[SHED, "all", "refused"] == (5, 5)
    assert not p.life.waiting("a") and not list((p.tmp_path / "segments").glob("*.mcap"))


def test_an_asset_that_floods_costs_no_other_a_window(parts):
    p = parts(total_windows=8)
    for number in range(2):
        p.add("quiet", number)
    for number in range(30):
        p.add("flood", number)
    assert {asset for asset, _ in numbers(p.sink.outcomes, refused=True)} == {"flood"}
    assert p.lanes.total_backlog == 8 and p.lanes.backlog("quiet") == 2
    p.computing.carry_out()
    assert numbers(p.sink.outcomes, refused=False)[:2] == [("quiet", 0), ("flood", 0)]


def test_bytes_are_bounded_too(parts):
    p = parts(bytes=60 * KB)
    for number in range(8):
        p.add("a", number)
    assert p.lanes.total_bytes <= 60 * KB + 30 * KB and sum(lane.shed for lane in p.lanes.all()) > 2


def broken(*given, **named):
    raise StorageUnavailable("disk full", reason="no space")


def test_windows_wait_in_memory_within_a_bound_and_keep_their_order_and_place(parts, monkeypatch):
    p = parts(memory_bytes=110 * KB)
    keep = p.store.keep
    monkeypatch.setattr(p.store, "keep", broken)
    for number in range(6):
        p.add("a", number)
    assert p.spool.unstored_from_ns("a") == 10**18 and p.spool.held_bytes <= 110 * KB
    assert p.lanes.backlog("a") == 0 and p.life.waiting("a") == () and "disk full" in p.storage.reason
    assert not list((p.tmp_path / "segments").glob("*.mcap"))  # of no transaction
    monkeypatch.setattr(p.store, "keep", keep)
    assert not p.spool.retry()  # not yet
    p.clock[0] += 100
    assert p.spool.retry() and p.spool.unstored_from_ns("a") is None and p.spool.held_bytes == 0
    p.computing.carry_out()
    assert numbers(p.sink.outcomes, refused=True) == [("a", 0), ("a", 1), ("a", 2)]
    assert numbers(p.sink.outcomes, refused=False) == [("a", 3), ("a", 4), ("a", 5)]
    assert "storage could not be used" in p.sink.outcomes[0].record["reason"]
    assert sum(lane.shed for lane in p.lanes.all()) == 3


def test_a_result_whose_commit_fails_is_committed_later_and_its_asset_waits(parts, monkeypatch):
    p = parts()
    for number in range(3):
        p.add("a", number)
    commit = p.store.commit
    monkeypatch.setattr(p.store, "commit", broken)
    p.computing.carry_out()
    assert p.sink.outcomes == [] and p.computing.calls == [] and p.lanes.backlog("a") == 3
    monkeypatch.setattr(p.store, "commit", commit)
    p.clock[0] += 100
    assert p.lanes.retry()
    p.computing.carry_out()
    assert numbers(p.sink.outcomes, refused=False) == [("a", 0), ("a", 1), ("a", 2)]
    assert [o.record["index"] for o in p.sink.outcomes] == [0, 1, 2]


def test_a_window_that_was_kept_without_an_answer_keeps_its_file_where_the_next_attempt_fails(parts, monkeypatch):
    """The file was deleted, and the window refused later, though the database named it."""
    p = parts()
    keep, transaction, within = p.store.keep, p.life.transaction, []

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
        patched.setattr(p.life, "transaction", unanswered)
        p.add("a", 0)
    assert len(p.life.waiting("a")) == 1 and p.spool.unstored_from_ns("a") is not None
    p.clock[0] += 100
    monkeypatch.setattr(p.store, "keep", broken)
    assert not p.spool.retry()
    monkeypatch.setattr(p.store, "keep", keep)
    p.clock[0] += 100
    assert p.spool.retry() and len(p.life.waiting("a")) == 1
    p.computing.carry_out()
    assert numbers(p.sink.outcomes, refused=False) == [("a", 0)] and p.life.waiting("a") == ()


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
    first, second = (each.write(closed("a", 0).segment) for each in (life, again))
    assert first.path != second.path and first.bytes == second.bytes
    assert life.add_waiting("a", second)
    first.path.write_bytes(b"torn")
    assert read_segment(life.path_of(life.waiting("a")[0])).start_ns == closed("a", 0).segment.start_ns
    assert WindowJobs(store.database, tmp_path / "segments").waiting("a")  # a start deletes what nothing names
    assert list((tmp_path / "segments").iterdir()) == [second.path]
