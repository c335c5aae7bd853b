"""Worker processes: what they compute, what their death costs, and how they end."""

from __future__ import annotations

import gc
import logging
import os
import signal
import time
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from functools import partial
from multiprocessing import forkserver
from pathlib import Path
from types import SimpleNamespace

import fake_twin
import numpy as np
import pytest
import worker_twins
from loops import loop_of, work_of
from segments import segment_of
from service_streams import HERE, Service, wait_until, write_recording
from test_asset_life import waiting
from test_decisions import post

from service.json_text import plain
from service.results.data_folder import SEGMENTS
from service.results.jobs import WINDOW, Jobs
from service.results.sql_store import SqlStore
from service.results.window_jobs import WindowJobs
from service.runtime.assess import assess
from service.runtime.computing import Turn
from service.runtime.replay import replay
from service.runtime.storage_watch import StorageWatch
from service.runtime.turns import Turns
from service.runtime.twin_port import gear_twin
from service.runtime.work import KEPT, Workplace
from service.runtime.worker_processes import Processes
from service.settings import Settings
from twin.windows import Edges, Samples, Window

WINDOWS = 4


def window(number=0):
    rng = np.random.default_rng(number)
    edges = Edges(per_rev=64, first_index=640 * number, times=np.arange(128) / 640)
    return Window(
        start_time_ns=10**18 + number * 10**10,
        accelerations={"y6": Samples(rate=2000.0, start=0.0, values=rng.standard_normal(400))},
        torques={"pinion": Samples(rate=2000.0, start=0.0, values=np.full(400, 10.0))},
        encoders={"pinion": edges},
    )


class Pool:
    """Worker processes over a database, and what they have done."""

    def __init__(self, folder, twin=None, **given):
        given = {"workers": 2, "task_limit": 60.0, "cache_bytes": 2**26, **given}
        twin, file = twin or worker_twins.make(None), folder / "twin.sqlite"
        self.store = SqlStore(file)
        self.waiting = WindowJobs(self.store.database, folder / SEGMENTS)
        opened = given.pop("open", partial(SqlStore, file, shared=True))
        place = Workplace(settings=Settings(data=folder), open=opened, make=twin.make, options=twin.options)
        self.processes, self.done = Processes(given.pop("workers"), place, **given, wake=lambda: None), []
        self.storage = StorageWatch("data")
        self.turns = Turns(self.processes, self.storage, self.done.append)

    def window(self, asset, name="plain", number=0):
        """A window of an asset is to be done, whose rig file has this name."""
        if (self.store.asset(asset).rig or {}).get("name") != name:
            self.store.keep_rig(asset, {"name": name})
        self.waiting.add_waiting(asset, self.waiting.write(segment_of(window(number))))
        self.turns.wake(asset)

    def wait(self, count, seconds=60.0):
        """What was done, once that is so much."""

        def collected():
            self.processes.collect()
            if self.storage.reason is not None and not self.storage.pausing and self.turns.retry():
                self.storage.worked()
            return len(self.done) >= count

        wait_until(collected, seconds)
        return self.done

    def records(self, asset):
        return [window.record for window in self.store.windows(asset)]

    def reasons(self, asset):
        """Why the windows of an asset were refused; None for each that was not."""
        return [record.get("reason") for record in self.records(asset)]

    def close(self):
        self.processes.close()
        self.store.close()


@pytest.fixture
def pool(request, tmp_path):
    made = Pool(tmp_path / "pool", **getattr(request, "param", {}))
    yield made
    made.close()


def test_a_worker_does_what_is_done_here_from_state_to_state(pool, tmp_path):
    with SqlStore(tmp_path / "here.sqlite") as store:
        here, waiting = (
            work_of(store, tmp_path, worker_twins.make(None)),
            WindowJobs(store.database, tmp_path / SEGMENTS),
        )
        store.keep_rig("a", {"name": "plain"})
        for number in range(3):
            pool.window("a", number=number)
            waiting.add_waiting("a", waiting.write(segment_of(window(number))))
            assert here.turn(Turn(asset="a")).index == number
            assert pool.wait(number + 1)[-1].index == number
        decision = {"name": "misalignment", "verb": "pin", "by": "Anna", "note": None}
        for jobs in (Jobs(pool.store.database), Jobs(store.database)):
            jobs.add("a", "decision", decision)
            jobs.add("a", "decision", {**decision, "name": "tooth_friction"})
        pool.turns.wake("a")
        pool.wait(5)
        assert here.turn(Turn(asset="a")).more and not here.turn(Turn(asset="a")).more
        for one, other in zip(pool.records("a"), [w.record for w in store.windows("a")], strict=True):
            assert without_pid([one]) == without_pid([other]) and one["pid"] != other["pid"]
        assert plain(pool.store.asset("a").state) == plain(store.asset("a").state)
        assert plain(store.asset("a").state)["decided"] == [["misalignment", "pin"]]
        (refused,) = [job.refused for job in Jobs(pool.store.database).of("a", "decision") if job.refused]
        assert "tooth_friction is not in the twin" in refused


def test_assets_of_which_a_process_has_something_at_hand_are_bounded_and_the_latest_stay(store, tmp_path):
    work = work_of(store, tmp_path)
    for number in range(KEPT + 10):
        work._at_hand(SimpleNamespace(asset=f"a{number}"), 1)
    assert len(work._places) == KEPT and f"a{KEPT + 9}" in work._places


def test_collectors_of_workers_leave_alone_what_was_loaded_for_all_of_them(pool):
    pool.window("a")
    pool.wait(1)
    executor = next(worker.executor for worker in pool.processes._workers if worker.executor is not None)
    assert executor.submit(gc.get_freeze_count).result() > 50_000
    assert executor.submit(gc.isenabled).result()


def test_an_asset_stays_with_its_worker_and_a_state_of_elsewhere_is_loaded(pool):
    for number in range(4):
        pool.window(f"asset {number % 2}", number=number)
        pool.wait(number + 1)
    pids = [{record["pid"] for record in pool.records(f"asset {n}")} for n in range(2)]
    assert all(len(own) == 1 for own in pids) and pids[0] != pids[1] and os.getpid() not in pids[0] | pids[1]
    stored = {**worker_twins.make(None).new_state().to_dict(), "total": 41.0}
    pool.store.keep("asset 0", state=stored)
    pool.store.renew("asset 0")
    pool.window("asset 0", number=9)
    pool.wait(5)
    assert pool.records("asset 0")[-1]["rms_predicted"] > 30


def test_a_job_that_another_process_has_done_meanwhile_is_not_done_twice(pool, tmp_path):
    """A worker that was suspended goes on, or its server has given its asset to another one."""
    mark = tmp_path / "begun"
    pool.window("a", f"slow 1 {mark}")
    wait_until(lambda: pool.processes.collect() or mark.exists())
    other = work_of(pool.store, tmp_path / "pool", fake_twin.TWIN)
    assert other.turn(Turn(asset="a")).index == 0
    pool.wait(1)
    assert [(done.job, done.index) for done in pool.done] == [(1, 0)] and len(pool.records("a")) == 1


@pytest.mark.parametrize("where", ["within", "after"])
@pytest.mark.parametrize("kind", [WINDOW, "renamed"])
def test_a_job_whose_worker_dies_with_its_transaction_is_done_once_and_told(tmp_path, where, kind):
    """Of one that had just been committed nobody was told: the new name's frames were those of an unknown asset."""
    pool = Pool(tmp_path / "pool", worker_twins.make(None, f"{where} {kind} {signal.SIGKILL:d} {tmp_path / 'mark'}"))
    try:
        renamed = Jobs(pool.store.database).add("a", "renamed", {"name": "b", "by": "Anna"})
        pool.window("a")
        pool.window("a", number=1)
        told = [(done.job, done.kind, done.index) for done in pool.wait(3)]
        assert told == [(renamed, "renamed", -1), (renamed + 1, WINDOW, 0), (renamed + 2, WINDOW, 1)]
        assert pool.processes.figures()["worker_deaths"] == 1 and pool.reasons("a") == [None, None]
    finally:
        pool.close()


@pytest.mark.parametrize("where", ["within", "after"])
def test_a_window_that_a_worker_cannot_store_now_is_stored_later_and_computed_once(tmp_path, where, caplog):
    """The worker's answer could not be read, and that was taken for its death."""
    pool = Pool(tmp_path / "pool", worker_twins.make(None, f"{where} {WINDOW} 0 {tmp_path / 'mark'}"))
    try:
        pool.window("a")
        assert pool.wait(1)[0].index == 0 and pool.reasons("a") == [None] and not pool.turns.stopped
        assert pool.processes.figures()["worker_deaths"] == 0 and "the disk is full" in caplog.text
    finally:
        pool.close()


def test_an_asset_whose_worker_cannot_open_the_storage_now_goes_on_later(tmp_path):
    """Nothing was done of it until the next start."""
    opened = partial(worker_twins.opened, tmp_path / "pool" / "twin.sqlite", tmp_path / "mark")
    pool = Pool(tmp_path / "pool", open=opened)
    try:
        pool.window("a")
        assert pool.wait(1)[0].index == 0 and not pool.turns.stopped
    finally:
        pool.close()


def test_workers_that_end_before_they_have_begun_anything_stop_no_asset(tmp_path):
    """Nothing was done of the asset until the next start."""
    pool = Pool(tmp_path / "pool", worker_twins.make(None, str(tmp_path / "marks")), workers=1)
    try:
        pool.window("a")
        assert pool.wait(1)[0].index == 0 and pool.processes.figures()["worker_deaths"] == 3
    finally:
        pool.close()


def test_a_call_that_ends_its_worker_is_tried_once_more_and_costs_no_other_anything(pool, tmp_path):
    pool.window("kills", "dies")
    pool.window("unlucky", f"once {tmp_path / 'mark'}")
    for number in range(3):
        pool.window("bystander", number=number)
    pool.wait(5)
    assert pool.reasons("kills") == ["internal error: ended its worker process, 2 times"]
    assert pool.store.windows("kills")[0].start_ns == 10**18
    assert pool.reasons("unlucky") == [None] and pool.reasons("bystander") == [None] * 3
    assert pool.processes.figures()["worker_deaths"] == 3
    pool.window("kills", number=1)
    pool.wait(6)
    assert pool.reasons("kills")[-1] is None


def test_what_people_ask_meanwhile_is_not_refused_in_place_of_the_window_that_ends_workers(store, tmp_path):
    loop = loop_of(store, tmp_path)
    loop.add("a", segment_of(window()))
    (waits,) = loop.windows.waiting("a")
    jobs, reason = Jobs(store.database), "internal error: ended its worker process, 2 times"
    again = Turn(asset="a", tried=waits.id, refuse=reason)
    jobs.add("a", "renamed", {"name": "b", "by": "Anna"})
    assert loop.computing.work.turn(again).kind == "renamed"
    (renamed,) = jobs.of("a", "renamed")
    assert renamed.done and renamed.refused is None
    assert loop.computing.work.turn(again).fault
    assert store.windows("a")[0].record["reason"] == reason


def test_a_window_for_which_a_worker_had_no_memory_is_tried_once_more_in_a_new_one(pool, tmp_path, caplog):
    pool.window("a", f"starved {tmp_path / 'mark'}")
    pool.wait(1)
    assert pool.reasons("a") == [None] and pool.processes.figures()["worker_deaths"] == 1
    assert "had too little memory" in caplog.text


@pytest.mark.slow
def test_a_worker_that_cannot_be_started_now_is_started_later_and_ends_nothing(pool, monkeypatch, caplog):
    """The server that makes processes may just have been killed, or there is no memory: once this ended the service."""
    failures = [
        ConnectionRefusedError("no fork server"),
        EOFError(),
        OSError(12, "no memory"),
        RuntimeError("no thread"),
    ]
    submit = ProcessPoolExecutor.submit

    def failing(executor, *given):
        if failures:
            raise failures.pop(0)
        return submit(executor, *given)

    monkeypatch.setattr(ProcessPoolExecutor, "submit", failing)
    pool.window("a")
    pool.window("a", number=1)
    pool.wait(2)
    assert pool.reasons("a") == [None, None]
    assert not failures and "cannot be started now" in caplog.text and pool.processes.unusable() is None


def server():
    """The process that makes worker processes."""
    return forkserver._forkserver._forkserver_pid


def longest_turn(pool, seconds):
    """The longest turn of a loop that looks after the workers for a time [s]."""
    longest, until = 0.0, time.monotonic() + seconds
    while time.monotonic() < until:
        began = time.monotonic()
        pool.processes.collect()
        longest = max(longest, time.monotonic() - began)
        time.sleep(0.02)
    return longest


@pytest.mark.slow
@pytest.mark.parametrize(
    ("pool", "goes_on"),
    [({"workers": 1, "start_limit": 60.0}, True), ({"workers": 1, "start_limit": 3.0}, False)],
    ids=["goes on", "is replaced"],
    indirect=["pool"],
)
def test_a_stopped_fork_server_holds_up_no_loop_and_is_replaced_or_goes_on(pool, goes_on, monkeypatch, caplog):
    """The loop of the service once waited for it without end."""
    pool.window("a")
    pool.wait(1, 60.0)
    monkeypatch.setattr("service.runtime.worker_processes.SLOW_START", 0.5)
    stopped, replaced = server(), pool.processes.figures()["worker_servers_replaced"]
    caplog.clear()
    os.kill(stopped, signal.SIGSTOP)
    try:
        pool.processes._discard(pool.processes._workers[0])
        began = time.monotonic()
        pool.window("a", number=1)
        assert time.monotonic() - began < 10.0
        assert longest_turn(pool, 1.0) < 10.0 and len(pool.done) == 1
        assert "no worker process could be started for " in pool.processes.unusable()
        if goes_on:
            os.kill(stopped, signal.SIGCONT)
        pool.wait(2, 60.0)
        assert pool.reasons("a") == [None, None] and pool.processes.unusable() is None
        assert bool(pool.processes.figures()["worker_servers_replaced"] - replaced) == (not goes_on)
        assert (server() == stopped) == goes_on
        assert ("does not answer, and is replaced" in caplog.text) == (not goes_on)
    finally:
        with suppress(ProcessLookupError):
            os.kill(stopped, signal.SIGCONT)


@pytest.mark.slow
@pytest.mark.parametrize("pool", [{"workers": 1}], indirect=True)
def test_a_worker_that_dies_while_the_fork_server_is_stopped_is_noticed(pool, monkeypatch, tmp_path):
    monkeypatch.setattr("service.runtime.worker_processes.UNNOTICED", 0.5)
    mark = tmp_path / "begun"
    pool.window("a")
    pool.wait(1, 60.0)
    stopped = server()
    pool.window("a", f"slow 2 {mark}", number=1)
    wait_until(mark.exists)
    os.kill(stopped, signal.SIGSTOP)
    try:
        (worker,) = pool.processes._workers[0].executor._processes
        os.kill(worker, signal.SIGKILL)
        pool.wait(2, 60.0)
        assert pool.reasons("a") == [None, None] and server() != stopped
    finally:
        with suppress(ProcessLookupError):
            os.kill(stopped, signal.SIGCONT)


@pytest.mark.slow
@pytest.mark.parametrize("pool", [{"task_limit": 8.0, "workers": 1}], indirect=True)
@pytest.mark.parametrize("goes_on", [True, False])
def test_a_stopped_worker_goes_on_or_is_replaced_after_the_time_of_one_call(pool, goes_on):
    pool.window("a")
    pool.wait(1, 60.0)
    (worker,) = pool.processes._workers[0].executor._processes
    os.kill(worker, signal.SIGSTOP)
    pool.window("a", number=1)
    assert longest_turn(pool, 0.5) < 4.0 and len(pool.done) == 1
    if goes_on:
        os.kill(worker, signal.SIGCONT)
    pool.wait(2, 60.0)
    assert pool.reasons("a") == [None, None]
    assert pool.processes.figures()["worker_deaths"] == (not goes_on)


@pytest.mark.slow
@pytest.mark.parametrize("pool", [{"workers": 1}], indirect=True)
def test_a_worker_that_is_suspended_is_replaced_whatever_its_turn_may_take(pool, monkeypatch):
    """In the midst of a transaction it would hold up everybody who writes."""
    monkeypatch.setattr("service.runtime.worker_processes.SUSPENDED", 1.0)
    pool.window("a")
    pool.wait(1, 60.0)
    (worker,) = pool.processes._workers[0].executor._processes
    os.kill(worker, signal.SIGSTOP)
    pool.window("a", number=1)
    pool.wait(2, 60.0)
    assert pool.reasons("a") == [None, None] and pool.processes.figures()["worker_deaths"] == 1


@pytest.mark.slow
@pytest.mark.parametrize("pool", [{"task_limit": 1.0, "workers": 1}], indirect=True)
def test_a_call_that_takes_too_long_is_given_up(pool):
    pool.window("stuck", "slow 60")
    pool.wait(1)
    assert pool.reasons("stuck") == ["internal error: took longer than 1 s, 2 times"]


@pytest.mark.slow
def test_an_asset_moves_where_its_worker_is_busy_for_long_and_another_is_idle(pool):
    for asset in ("first", "second"):  # one on each worker
        pool.window(asset)
    pool.wait(2)
    pool.window("third")  # with the first
    pool.wait(3)
    began = time.monotonic()
    pool.window("first", "slow 20", number=1)
    pool.window("third", number=1)
    assert pool.wait(4)[-1].asset == "third" and time.monotonic() - began < 18


@pytest.mark.slow
def test_of_several_workers_one_makes_no_search_and_nobody_waits_for_one_for_long(pool, tmp_path):
    """Searches on all workers once held up windows of assets that needed none."""
    pool.processes._next(pool.processes._workers[0])
    for asset in ("first", "second", "third"):
        pool.window(asset, f"searches {tmp_path / 'made'} 20")
    wait_until(lambda: pool.processes.collect() or (tmp_path / "made").exists())
    began = time.monotonic()
    pool.window("quiet")
    assert pool.wait(1)[0].asset == "quiet" and time.monotonic() - began < 10


@pytest.mark.slow
def test_what_is_logged_and_warned_of_in_a_worker_is_in_the_log_of_the_service(pool, caplog):
    with caplog.at_level(logging.WARNING):
        pool.window("a", "complains")
        pool.window("b", "fails")
        pool.wait(2)
    assert pool.reasons("b") == ["internal error: ZeroDivisionError: a defect"]
    by_asset = {record.message.splitlines()[0]: record.asset for record in caplog.records if hasattr(record, "asset")}
    assert by_asset["the twin of complains complains"] == "a"
    assert any("a warning of a library" in message for message in by_asset)
    (fault,) = [r for r in caplog.records if r.exc_text]
    assert "ZeroDivisionError: a defect" in fault.exc_text and fault.asset == "b"


def test_the_real_twin_can_be_made_in_a_worker(tmp_path):
    pool = Pool(tmp_path, gear_twin(), workers=1)
    try:
        pool.window("a", number=1)
        pool.wait(1)
        assert "at least 3 are needed" in pool.reasons("a")[0]  # as the real one says of so short a window
    finally:
        pool.close()


# -- the service ---------------------------------------------------------------------------------------


class Workers(Service):
    """A service whose twin is computed by processes."""

    program = HERE / "worker_twins.py"


def recorded(path, name="plain", windows=WINDOWS, **given):
    return write_recording(path, windows, changed=(b'name = "unsw"', f'name = "{name}"'.encode()), **given)


def children(pid):
    """The processes that a process has started, and those that they have."""
    found = []
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        with suppress(OSError):  # a thread that has ended meanwhile
            for child in task.read_text().split():
                found += [int(child), *children(int(child))]
    return found


def alive(pids):
    found = []
    for pid in pids:
        with suppress(OSError):  # it has ended
            if Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z":
                found.append(pid)
    return found


def without_pid(windows):
    return [{key: value for key, value in window.items() if key != "pid"} for window in windows]


@pytest.mark.slow
def test_a_service_with_workers_gives_what_assess_gives_and_leaves_no_process_behind_when_killed(tmp_path):
    recording = recorded(tmp_path / "a.mcap")
    running = Workers(tmp_path / "data", WORKERS="2").start()
    try:
        replay(recording, [running.endpoint], 0)
        expected = plain(assess(recording, twin=worker_twins.make(None)))
        assert without_pid(running.wait_for_windows(WINDOWS)) == without_pid(expected["windows"])
        assert running.get("/v1/assets/unsw")["rul"] == expected["rul"]
        started = children(running.process.pid)
        assert alive(started)
        running.end(signal.SIGKILL)
        wait_until(lambda: not alive(started), 10.0)
    finally:
        running.end(signal.SIGKILL)


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGINT])
def test_a_service_ends_in_time_whatever_its_workers_do_and_goes_on_with_their_windows(tmp_path, how):
    mark = tmp_path / "begun"
    recording = recorded(tmp_path / "a.mcap", f"slow 60 {mark}")
    running = Workers(tmp_path / "data", WORKERS="1").start()
    try:
        replay(recording, [running.endpoint], 0)
        wait_until(lambda: len(list((running.folder / SEGMENTS).glob("*.mcap"))) == WINDOWS)
        wait_until(mark.exists)
        wait_until(lambda: "gear_twin_workers_busy 1.0" in running.text("/metrics"))
        started = children(running.process.pid)
        began = time.monotonic()
        for pid in started if how == signal.SIGINT else ():  # a terminal sends it to all
            os.kill(pid, how)
        status, _, complained = running.end(how)
        assert (status, complained) == (0, "") and time.monotonic() - began < 10
        wait_until(lambda: not alive(started), 10.0)
        assert len(list((running.folder / SEGMENTS).glob("*.mcap"))) == WINDOWS
    finally:
        running.end(signal.SIGKILL)


@pytest.mark.slow
def test_a_service_whose_fork_server_is_stopped_answers_and_goes_on_by_itself(tmp_path):
    running = Workers(tmp_path / "data", WORKERS="1").start()
    try:
        replay(recorded(tmp_path / "a.mcap"), [running.endpoint], 0)
        running.wait_for_windows(WINDOWS)
        (stopped,) = (
            p
            for p in children(running.process.pid)
            if b"forkserver" in Path(f"/proc/{p}/cmdline").read_bytes() and children(p)
        )
        (worker,) = children(stopped)
        os.kill(stopped, signal.SIGSTOP)
        os.kill(worker, signal.SIGKILL)
        replay(recorded(tmp_path / "b.mcap", windows=WINDOWS + 2), [running.endpoint], 0)  # is stored all the same
        waits = []
        for _ in range(20):
            began = time.monotonic()
            running.get("/v1/assets")
            waits.append(time.monotonic() - began)
        assert max(waits) < 2.0
        assert len(running.wait_for_windows(WINDOWS + 2)) == WINDOWS + 2
        wait_until(lambda: "gear_twin_worker_servers_replaced_total 1.0" in running.text("/metrics"))
    finally:
        _, _, complained = running.end(signal.SIGTERM)
    assert "does not answer, and is replaced" in complained


@pytest.mark.slow
def test_a_window_that_ends_its_worker_is_refused_and_the_others_are_not(tmp_path):
    recording = recorded(tmp_path / "a.mcap", "dies", windows=2)
    other = recorded(tmp_path / "b.mcap", asset="other")
    running = Workers(tmp_path / "data", WORKERS="1").start()
    try:
        replay(recording, [running.endpoint], 0)
        replay(other, [running.endpoint], 0)
        windows = running.wait_for_windows(2)
        assert [w["quality"] for w in windows] == ["refused"] * 2
        assert all(w["reason"] == "internal error: ended its worker process, 2 times" for w in windows)
        assert [w["quality"] for w in running.wait_for_windows(WINDOWS, "other")] == ["good"] * WINDOWS
        wait_until(lambda: "gear_twin_program_faults_total 2.0" in running.text("/metrics"))
        assert len(running.get("/v1/assets/unsw/signals")["windows"]) == 2  # to be looked into
    finally:
        running.end(signal.SIGKILL)


@pytest.mark.slow
@pytest.mark.parametrize("where", ["within", "after"])
def test_a_name_whose_worker_dies_with_it_is_answered_and_the_stream_follows(tmp_path, monkeypatch, where):
    monkeypatch.setenv("STRUCK", f"{where} renamed {signal.SIGKILL:d} {tmp_path / 'mark'}")
    running = Workers(tmp_path / "data", WORKERS="1").start()
    try:
        replay(recorded(tmp_path / "a.mcap"), [running.endpoint], 0)
        running.wait_for_windows(WINDOWS)
        given = {"kind": "renamed", "name": "press-7", "by": "Anna"}
        status, answer = post(running, "/v1/assets/unsw/changes", given)
        assert status == 201 and answer["done"] and (tmp_path / "mark").exists()
        replay(recorded(tmp_path / "b.mcap", asset="press-7", windows=2, later=86_400.0), [running.endpoint], 0)
        wait_until(lambda: waiting(running, "press-7") == 2)  # the count has fallen: people are asked
    finally:
        running.end(signal.SIGKILL)


@pytest.mark.slow
def test_a_worker_that_is_suspended_in_a_transaction_ends_with_a_service_that_is_killed(tmp_path, monkeypatch):
    """It held the database locked, and the next start ended for that, until somebody found the worker."""
    mark = tmp_path / "mark"
    monkeypatch.setenv("STRUCK", f"within {WINDOW} {signal.SIGSTOP:d} {mark}")
    running = Workers(tmp_path / "data", WORKERS="1").start()
    try:
        replay(recorded(tmp_path / "a.mcap"), [running.endpoint], 0)
        wait_until(mark.exists)
        running.end(signal.SIGKILL)
        wait_until(lambda: not alive([int(mark.read_text())]), 10.0)
        running.start()
        assert [w["quality"] for w in running.wait_for_windows(WINDOWS)] == ["good"] * WINDOWS
    finally:
        with suppress(ProcessLookupError, FileNotFoundError):
            os.kill(int(mark.read_text()), signal.SIGKILL)
        running.end(signal.SIGKILL)
