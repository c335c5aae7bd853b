"""Worker processes: what they compute, what their death costs, and how they end."""

from __future__ import annotations

import gc
import logging
import os
import signal
import time
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from multiprocessing import forkserver
from pathlib import Path

import numpy as np
import pytest
import worker_twins
from segments import segment_of
from service_streams import HERE, Service, wait_until, write_recording

from service.json_text import JsonText, plain
from service.results.data_folder import SEGMENTS
from service.results.json_columns import dump, load, load_text
from service.results.segment_file import write_segment
from service.runtime.assess import assess
from service.runtime.computing import Ask, Call, WindowToUse
from service.runtime.packed_state import NEW, PackedState, StoredState
from service.runtime.replay import replay
from service.runtime.twin_port import gear_twin
from service.runtime.worker_processes import Processes
from service.stream.edge_counts import EncoderCounts
from service.stream.window import window_of
from twin.rig import Rig
from twin.tracing.decisions import Decision
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
    """Processes, and what they have made."""

    def __init__(self, **given):
        self.made = []
        given = {"workers": 2, "task_limit": 60.0, "cache_bytes": 2**26, **given}
        self.processes = Processes(**given, wake=lambda: None)
        self.twin = worker_twins.make(None)

    def ask(self, asset, ask, name="plain", state=NEW):
        rig = Rig.from_mapping({"name": name})
        call = Call(asset=asset, twin=self.twin, rig=rig, state=state, ask=ask)
        self.processes.start(call, lambda made: self.made.append((asset, made)))

    def window(self, asset, name="plain", number=0, state=NEW):
        given = WindowToUse(start_ns=10**18 + number * 10**10, segment=segment_of(window(number)))
        self.ask(asset, Ask("window", given), name, state)

    def wait(self, count, seconds=30.0):
        def collected():
            self.processes.collect()
            return len(self.made) >= count

        wait_until(collected, seconds)
        return [made for _, made in self.made]


@pytest.fixture
def pool(request):
    made = Pool(**getattr(request, "param", {}))
    yield made
    made.processes.close()


def test_a_worker_makes_what_the_twin_makes_here_from_state_to_state(pool, tmp_path):
    state, packed = worker_twins.make(None).new_state(), NEW
    for number in range(3):
        file = tmp_path / f"{number}.mcap"
        segment = segment_of(window(number))
        sent = window_of(segment, Rig.from_mapping({}), EncoderCounts()).window
        write_segment(file, segment)
        pool.ask("a", Ask("window", WindowToUse(start_ns=0, file=file)), state=packed)
        made = pool.wait(number + 1)[-1]
        state, _ = worker_twins.step(Rig.from_mapping({"name": "plain"}), state, sent, None)
        packed = made.state
        assert plain(packed.to_dict()) == plain(state.to_dict())
        assert not made.window.accelerations and made.window.start_time_ns == window(number).start_time_ns
    pool.ask("a", Ask("decide", Decision(name="misalignment", verb="pin")), state=packed)
    assert plain(pool.wait(4)[-1].state.to_dict())["decided"] == [["misalignment", "pin"]]
    pool.ask("a", Ask("decide", Decision(name="tooth_friction", verb="pin")), state=packed)
    assert "tooth_friction is not in the twin" in pool.wait(5)[-1].refused


def test_collectors_of_workers_leave_alone_what_was_loaded_for_all_of_them(pool):
    pool.window("a")
    pool.wait(1)
    executor = next(worker.executor for worker in pool.processes._workers if worker.executor is not None)
    assert executor.submit(gc.get_freeze_count).result() > 50_000
    assert executor.submit(gc.isenabled).result()


def test_an_asset_stays_with_its_worker_and_a_state_of_elsewhere_is_loaded(pool):
    for number in range(4):
        pool.window(f"asset {number % 2}", number=number)
        made = pool.wait(number + 1)
    pids = {asset: {m.answer.record["pid"] for a, m in pool.made if a == asset} for asset in ("asset 0", "asset 1")}
    assert all(len(own) == 1 for own in pids.values()) and pids["asset 0"] != pids["asset 1"]
    assert os.getpid() not in {m.answer.record["pid"] for m in made}
    stored = {**worker_twins.make(None).new_state().to_dict(), "windows_seen": 41}
    pool.window("asset 0", number=9, state=StoredState(lambda: stored).pack())
    assert pool.wait(5)[-1].answer.record["index"] == 41


def test_a_call_that_ends_its_worker_is_tried_once_more_and_costs_no_other_anything(pool, tmp_path):
    pool.window("kills", "dies")
    pool.window("unlucky", f"once {tmp_path / 'mark'}")
    for number in range(3):
        pool.window("bystander", number=number)
    pool.wait(5)
    made = dict(pool.made)
    assert made["kills"].refused == "internal error: ended its worker process, 2 times"
    assert made["kills"].window.start_time_ns == 10**18
    assert made["unlucky"].refused is None and made["bystander"].refused is None
    assert pool.processes.figures()["worker_deaths"] == 3
    pool.window("kills")
    assert pool.wait(6)[-1].refused is None


def test_a_window_for_which_a_worker_had_no_memory_is_tried_once_more_in_a_new_one(pool, tmp_path, caplog):
    pool.window("a", f"starved {tmp_path / 'mark'}")
    (made,) = pool.wait(1)
    assert made.refused is None and pool.processes.figures()["worker_deaths"] == 1
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
    assert [made.refused for made in pool.wait(2)] == [None, None]
    assert not failures and "cannot be started now" in caplog.text and pool.processes.unusable() is None


def server():
    """The process that makes worker processes."""
    return forkserver._forkserver._forkserver_pid


def turns(pool, seconds):
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
        assert turns(pool, 1.0) < 10.0 and len(pool.made) == 1
        assert "no worker process could be started for " in pool.processes.unusable()
        if goes_on:
            os.kill(stopped, signal.SIGCONT)
        assert pool.wait(2, 60.0)[-1].refused is None
        assert pool.processes.unusable() is None
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
    pool.window("a", f"slow 2 {mark}")
    wait_until(mark.exists)
    os.kill(stopped, signal.SIGSTOP)
    try:
        (worker,) = pool.processes._workers[0].executor._processes
        os.kill(worker, signal.SIGKILL)
        assert pool.wait(2, 60.0)[-1].refused is None and server() != stopped
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
    assert turns(pool, 0.5) < 4.0 and len(pool.made) == 1
    if goes_on:
        os.kill(worker, signal.SIGCONT)
    assert pool.wait(2, 60.0)[-1].refused is None
    assert pool.processes.figures()["worker_deaths"] == (not goes_on)


@pytest.mark.slow
@pytest.mark.parametrize("pool", [{"task_limit": 1.0, "workers": 1}], indirect=True)
def test_a_call_that_takes_too_long_is_given_up(pool):
    pool.window("stuck", "slow 60")
    assert pool.wait(1)[-1].refused == "internal error: took longer than 1 s, 2 times"


@pytest.mark.slow
def test_an_asset_moves_where_its_worker_is_busy_for_long_and_another_is_idle(pool):
    for asset in ("first", "second"):  # one on each worker
        pool.window(asset)
    pool.wait(2)
    pool.window("third")  # with the first
    pool.wait(3)
    began = time.monotonic()
    pool.window("first", "slow 20")
    pool.window("third", number=1)
    assert pool.wait(4)[-1].refused is None and time.monotonic() - began < 18
    assert pool.made[-1][0] == "third"


@pytest.mark.slow
def test_what_is_logged_and_warned_of_in_a_worker_is_in_the_log_of_the_service(pool, caplog):
    with caplog.at_level(logging.WARNING):
        pool.window("a", "complains")
        pool.window("b", "fails")
        pool.wait(2)
    made = dict(pool.made)
    assert made["b"].refused == "internal error: ZeroDivisionError: a defect"
    by_asset = {record.message.splitlines()[0]: record.asset for record in caplog.records if hasattr(record, "asset")}
    assert by_asset["the twin of complains complains"] == "a"
    assert any("a warning of a library" in message for message in by_asset)
    (fault,) = [r for r in caplog.records if r.exc_text]
    assert "ZeroDivisionError: a defect" in fault.exc_text and fault.asset == "b"


def test_state_text_passes_from_the_worker_to_the_database_as_it_is():
    state = PackedState.of({"n": 1.5, "list": [1, None]})
    assert isinstance(state.to_dict(), JsonText)
    assert load_text(dump(state.to_dict())).text == state.to_dict().text == '{"n":1.5,"list":[1,null]}'
    assert load(dump(state.to_dict())) == {"n": 1.5, "list": [1, None]} == dict(state.to_dict())
    assert PackedState.of(state.to_dict()) == state
    assert StoredState(lambda: None).pack() == NEW and StoredState(lambda: {"n": 1}).pack().to_dict() == {"n": 1}


def test_the_real_twin_can_be_made_in_a_worker():
    pool = Pool(workers=1)
    pool.twin = gear_twin()
    try:
        pool.window("a", number=1)
        assert "at least 3 are needed" in pool.wait(1)[-1].refused  # as the real one says of so short a window
    finally:
        pool.processes.close()


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
