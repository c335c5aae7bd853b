"""Worker processes: what they compute, what their death costs, and how they end."""

from __future__ import annotations

import os
import re
import signal
import time
from contextlib import suppress
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import fake_twin
import numpy as np
import pytest
import worker_twins
from forked_processes import started_by
from loops import loop_of, work_of
from segments import segment_of
from service_streams import HERE, Service, wait_until, write_recording
from test_asset_life import waiting
from test_decisions import post
from worker_pool import Processes

from service.errors import StorageUnavailable
from service.json_text import plain
from service.results.asset_table import AssetTable
from service.results.data_folder import SEGMENTS
from service.results.jobs import Jobs
from service.results.schema import WINDOW
from service.results.sql_store import SqlStore
from service.results.window_jobs import WindowJobs
from service.runtime.assess import assess
from service.runtime.computing import Turned
from service.runtime.replay import replay
from service.runtime.twin_port import gear_twin
from service.runtime.work import KEPT, Workplace
from service.runtime.workers import work_given
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
    """Worker processes over a database."""

    def __init__(self, folder, twin=None, *, workers=2, task_limit=60.0, opened=None, failures=0):
        twin, file = twin or worker_twins.make(None), folder / "twin.sqlite"
        self.store = SqlStore(file)
        self.waiting, self.jobs = WindowJobs(self.store.database, folder / SEGMENTS), Jobs(self.store.database)
        settings = Settings(data=folder, workers=workers, task_limit=task_limit)
        opened = opened or partial(SqlStore, file, shared=True)
        place = Workplace(settings=settings, open=opened, make=twin.make, options=twin.options)
        self.processes = Processes(folder, work_given(settings, place), failures)

    def window(self, asset, name="plain", number=0):
        """A window of an asset is to be done, whose rig file has this name."""
        if (self.store.asset(asset).rig or {}).get("name") != name:
            self.store.keep_rig(asset, {"name": name})
        self.waiting.add_waiting(asset, self.waiting.write(segment_of(window(number))))

    def wait(self, asset, count, seconds=60.0):
        """Waits until so many windows of an asset are done."""
        wait_until(lambda: len(self.records(asset)) >= count, seconds)

    def records(self, asset):
        return [window.record for window in self.store.windows(asset)]

    def reasons(self, asset):
        """Why the windows of an asset were refused; None for each that was not."""
        return [record.get("reason") for record in self.records(asset)]

    def deaths(self):
        return self.processes.figures()["worker_deaths"]

    def workers(self):
        """The processes of the workers."""
        return alive(started_by(self.role()))

    def role(self):
        """The process that makes the workers."""
        return self.processes.role

    def close(self):
        self.processes.end()
        self.store.close()


@pytest.fixture
def pool(request, tmp_path):
    made = Pool(tmp_path / "pool", **getattr(request, "param", {}))
    yield made
    made.close()


def test_a_worker_does_what_is_done_here_from_state_to_state(pool, tmp_path):
    with SqlStore(tmp_path / "here.sqlite") as store:
        loop = loop_of(store, tmp_path, worker_twins.make(None))
        store.keep_rig("a", {"name": "plain"})
        for number in range(3):
            pool.window("a", number=number)
            loop.add("a", segment_of(window(number)))
        loop.carry_out()
        pool.wait("a", 3)
        decision = {"name": "misalignment", "verb": "pin", "by": "Anna", "note": None}
        for jobs in (pool.jobs, Jobs(store.database)):
            jobs.add("a", "decision", decision)
            jobs.add("a", "decision", {**decision, "name": "tooth_friction"})
        loop.carry_out()
        wait_until(lambda: not pool.jobs.pending())
        for one, other in zip(pool.records("a"), [w.record for w in store.windows("a")], strict=True):
            assert without_pid([one]) == without_pid([other]) and one["pid"] != other["pid"]
        assert plain(pool.store.asset("a").state) == plain(store.asset("a").state)
        assert plain(store.asset("a").state)["decided"] == [["misalignment", "pin"]]
        (refused,) = [job.refused for job in pool.jobs.of("a", "decision") if job.refused]
        assert "tooth_friction is not in the twin" in refused


def test_assets_of_which_a_process_has_something_at_hand_are_bounded_and_the_latest_stay(store, tmp_path):
    work = work_of(store, tmp_path)
    for number in range(KEPT + 10):
        work._at_hand(SimpleNamespace(asset=f"a{number}"), 1)
    assert len(work._places) == KEPT and f"a{KEPT + 9}" in work._places


def test_an_asset_stays_with_its_worker_and_a_state_of_elsewhere_is_loaded(pool):
    for number in range(4):
        pool.window("asset", number=number)
        pool.wait("asset", number + 1)
    pids = {record["pid"] for record in pool.records("asset")}
    assert len(pids) == 1 and os.getpid() not in pids
    stored = {**worker_twins.make(None).new_state().to_dict(), "total": 41.0}
    pool.store.keep("asset", state=stored)
    pool.store.keep_rig("asset", {"name": "plain"})
    pool.window("asset", number=9)
    pool.wait("asset", 5)
    assert pool.records("asset")[-1]["rms_predicted"] > 30


def test_a_job_that_another_process_has_done_meanwhile_is_not_done_twice(pool, tmp_path):
    """A worker that was suspended goes on, or its server has given its asset to another one."""
    mark = tmp_path / "begun"
    pool.window("a", f"slow 1 {mark}")
    wait_until(mark.exists)
    other = work_of(pool.store, tmp_path / "pool", fake_twin.TWIN)
    assert other.turn("a").index == 0
    wait_until(lambda: pool.processes.at_work() == ("a",))
    wait_until(lambda: pool.processes.at_work() == ())
    assert len(pool.records("a")) == 1 and pool.deaths() == 0


def test_an_asset_is_worked_on_by_one_at_a_time(store, tmp_path):
    loop = loop_of(store, tmp_path)
    loop.add("a", segment_of(window()))
    claims = store.database.at_work()
    assert not claims.take("a") or store.path is not None  # one process cannot exclude itself by a file
    claims.give_back("a")
    assert loop.loop._claims.take("a") and not loop.loop._claims.take("a")
    loop.carry_out()
    assert not store.windows("a")
    loop.loop._claims.give_back("a")
    loop.carry_out()
    assert len(store.windows("a")) == 1


def test_whoever_does_not_look_for_changes_reads_an_asset_each_time(store, tmp_path):
    loop, there = loop_of(store, tmp_path), AssetTable(store)
    for number in range(2):
        loop.add("a", segment_of(window(number)))
        loop.carry_out()
        assert there.latest("a").windows_total == number + 1
    there.look()
    loop.add("a", segment_of(window(2)))
    loop.carry_out()
    assert there.latest("a").windows_total == 2
    there.look()
    assert there.latest("a").windows_total == 3


def test_a_state_that_was_read_while_somebody_else_committed_is_not_gone_on_from(store, tmp_path, monkeypatch):
    """It was taken for that of the mark before: a database put back to that mark had a window counted twice."""
    loop = loop_of(store, tmp_path)
    loop.add("a", segment_of(window(0)))
    with SqlStore(store.path, shared=True) as other:
        late = work_of(other, tmp_path)
        read = late._read
        monkeypatch.setattr(late, "_read", lambda asset: (loop.carry_out(), read(asset))[1])
        assert late.turn("a") == Turned(asset="a") and "a" not in late._places
    assert len(store.windows("a")) == 1


def test_new_gears_begin_the_next_epoch_whoever_has_carried_the_earlier_ones_out(store, tmp_path):
    """A worker took the epoch, and the revolutions of the change, from what it had seen last of the asset."""
    loop, jobs = loop_of(store, tmp_path), Jobs(store.database)
    with SqlStore(store.path, shared=True) as other:
        works = (loop.work, work_of(other, tmp_path))
        for number in range(4):
            loop.add("a", segment_of(window(number)))
            works[number % 2].turn("a")
            jobs.add("a", "gears_replaced", {"by": "Anna"})
            works[1 - number % 2].turn("a")
    (*windows,) = store.windows("a", epoch=0)
    effects = [job.outcome for job in jobs.of("a", "gears_replaced")]
    assert [effect["epoch"] for effect in effects] == [1, 2, 3, 4]
    assert effects[0]["revolutions"] == windows[-1].record["revolutions"]


@pytest.mark.parametrize("where", ["turn", "hand_on"])
def test_a_worker_gives_an_asset_back_whatever_fails(store, tmp_path, monkeypatch, where):
    """A live worker that kept it left it to nobody until the next start."""
    loop = loop_of(store, tmp_path)
    loop.add("a", segment_of(window()))

    def failing(*given, **named):
        raise StorageUnavailable("the connection is lost", reason="connection lost")

    with monkeypatch.context() as patched:
        if where == "hand_on":
            patched.setattr(loop.work, "turn", lambda asset, hand_back: Turned(asset=asset, search=True))
            patched.setattr(loop.loop._jobs, "hand_on", failing)
        else:
            patched.setattr(loop.work, "turn", failing)
        with pytest.raises(StorageUnavailable):
            loop.loop.turn()
    loop.carry_out()
    assert len(store.windows("a")) == 1


@pytest.mark.parametrize("where", ["within", "after"])
@pytest.mark.parametrize("kind", [WINDOW, "renamed"])
def test_a_job_whose_worker_dies_with_its_transaction_is_done_once(tmp_path, where, kind):
    pool = Pool(tmp_path / "pool", worker_twins.make(None, f"{where} {kind} {signal.SIGKILL:d} {tmp_path / 'mark'}"))
    try:
        renamed = pool.jobs.add("a", "renamed", {"name": "b", "by": "Anna"})
        pool.window("a")
        pool.window("a", number=1)
        pool.wait("a", 2)
        assert pool.jobs.job(renamed).done and pool.jobs.job(renamed).refused is None
        assert [record["index"] for record in pool.records("a")] == [0, 1] and pool.reasons("a") == [None, None]
        wait_until(lambda: pool.deaths() == 1)
    finally:
        pool.close()


@pytest.mark.parametrize("where", ["within", "after"])
def test_a_window_that_a_worker_cannot_store_now_is_stored_later_and_computed_once(tmp_path, where):
    """The worker's answer could not be read, and that was taken for its death."""
    pool = Pool(tmp_path / "pool", worker_twins.make(None, f"{where} {WINDOW} 0 {tmp_path / 'mark'}"))
    try:
        pool.window("a")
        pool.wait("a", 1)
        wait_until((tmp_path / "mark").exists)  # made after the commit
        assert pool.reasons("a") == [None] and pool.deaths() == 0
    finally:
        pool.close()


def test_an_asset_whose_worker_cannot_open_the_storage_now_goes_on_later(tmp_path):
    """Nothing was done of it until the next start."""
    opened = partial(worker_twins.opened, tmp_path / "pool" / "twin.sqlite", tmp_path / "mark")
    pool = Pool(tmp_path / "pool", opened=opened)
    try:
        pool.window("a")
        pool.wait("a", 1)
    finally:
        pool.close()


def test_workers_that_end_before_they_have_begun_anything_stop_no_asset(tmp_path):
    """Nothing was done of the asset until the next start."""
    pool = Pool(tmp_path / "pool", worker_twins.make(None, str(tmp_path / "marks")), workers=1)
    try:
        pool.window("a")
        pool.wait("a", 1)
        wait_until(lambda: pool.deaths() == 3)
    finally:
        pool.close()


def test_a_call_that_ends_its_worker_is_tried_once_more_and_costs_no_other_anything(pool, tmp_path):
    pool.window("kills", "dies")
    pool.window("unlucky", f"once {tmp_path / 'mark'}")
    for number in range(3):
        pool.window("bystander", number=number)
    for asset, count in (("kills", 1), ("unlucky", 1), ("bystander", 3)):
        pool.wait(asset, count)
    (reason,) = pool.reasons("kills")  # the other worker may begin it before the first death is noted
    assert re.fullmatch("internal error: ended its worker process, [23] times", reason)
    assert pool.store.windows("kills")[0].start_ns == 10**18
    assert pool.reasons("unlucky") == [None] and pool.reasons("bystander") == [None] * 3
    wait_until(lambda: pool.deaths() in (3, 4))
    pool.window("kills", number=1)
    pool.wait("kills", 2)
    assert pool.reasons("kills")[-1] is None


def test_what_people_ask_meanwhile_is_not_refused_in_place_of_the_window_that_ends_workers(store, tmp_path):
    loop, jobs = loop_of(store, tmp_path), Jobs(store.database)
    loop.add("a", segment_of(window()))
    (waits,) = loop.windows.waiting("a")
    for _ in range(2):
        jobs.failed(waits.id, "ended its worker process")
    jobs.add("a", "renamed", {"name": "b", "by": "Anna"})
    loop.carry_out(1)
    (renamed,) = jobs.of("a", "renamed")
    assert renamed.done and renamed.refused is None
    loop.carry_out()
    assert store.windows("a")[0].record["reason"] == "internal error: ended its worker process, 2 times"


def test_a_window_for_which_a_worker_had_no_memory_is_tried_once_more_in_a_new_one(pool, tmp_path):
    pool.window("a", f"starved {tmp_path / 'mark'}")
    pool.wait("a", 1)
    assert pool.reasons("a") == [None]
    wait_until(lambda: pool.deaths() == 1)
    assert "had too little memory" in pool.processes.said


@pytest.mark.slow
def test_workers_whose_role_cannot_be_started_now_are_started_later(tmp_path):
    """There may be no memory: once this ended the service."""
    pool = Pool(tmp_path / "pool", failures=2)
    try:
        pool.window("a")
        pool.wait("a", 1)
        assert pool.processes.said.count("can be started now: OSError: [Errno 12] no memory") == 2
        wait_until(lambda: pool.processes.unusable() is None)
    finally:
        pool.close()


@pytest.mark.slow
@pytest.mark.parametrize("goes_on", [True, False])
def test_a_suspended_role_is_replaced_or_goes_on(tmp_path, goes_on):
    """The loop of the service once waited for it without end."""
    pool = Pool(tmp_path / "pool", workers=1)
    try:
        pool.window("a")
        pool.wait("a", 1)
        role = pool.role()
        (worker,) = pool.workers()
        os.kill(role, signal.SIGSTOP)
        os.kill(worker, signal.SIGKILL)
        pool.window("a", number=1)
        if goes_on:
            time.sleep(1.0)
            assert len(pool.records("a")) == 1
            os.kill(role, signal.SIGCONT)
        pool.wait("a", 2)
        assert pool.reasons("a") == [None, None]
        assert pool.processes.replaced == (not goes_on) and (pool.role() == role) == goes_on
        assert ("it is killed" in pool.processes.said) == (not goes_on)
    finally:
        with suppress(ProcessLookupError):
            os.kill(role, signal.SIGCONT)
        pool.close()


@pytest.mark.slow
def test_a_role_that_is_killed_is_there_again_within_seconds_and_its_workers_end_with_it(pool, tmp_path):
    mark = tmp_path / "begun"
    pool.window("a", f"slow 3 {mark}")
    wait_until(mark.exists)
    before = pool.workers()
    os.kill(pool.role(), signal.SIGKILL)
    wait_until(lambda: not alive(before), 2.0)
    pool.wait("a", 1)
    assert pool.reasons("a") == [None]


@pytest.mark.slow
@pytest.mark.parametrize("pool", [{"workers": 1}], indirect=True)
@pytest.mark.parametrize("goes_on", [True, False])
def test_a_suspended_worker_goes_on_or_is_replaced(pool, goes_on):
    """In the midst of a transaction it would hold up everybody who writes."""
    pool.window("a")
    pool.wait("a", 1)
    (worker,) = pool.workers()
    os.kill(worker, signal.SIGSTOP)
    pool.window("a", number=1)
    if goes_on:
        time.sleep(1.0)
        assert len(pool.records("a")) == 1
        os.kill(worker, signal.SIGCONT)
    pool.wait("a", 2)
    assert pool.reasons("a") == [None, None]
    wait_until(lambda: pool.deaths() == (not goes_on))


@pytest.mark.slow
@pytest.mark.parametrize("pool", [{"task_limit": 1.0, "workers": 1}], indirect=True)
def test_a_call_that_takes_too_long_is_given_up(pool):
    pool.window("stuck", "slow 60")
    pool.wait("stuck", 1)
    assert pool.reasons("stuck") == ["internal error: took longer than 1 s, 2 times"]


@pytest.mark.slow
def test_an_asset_moves_where_its_worker_is_busy_for_long_and_another_is_idle(pool):
    for number in range(2):
        pool.window("first", number=number)
        pool.window("second", number=number)
    pool.wait("first", 2)
    pool.wait("second", 2)
    begun = pool.records("second")[-1]["pid"]
    pool.window("first", "slow 20", number=2)
    wait_until(lambda: pool.processes.at_work() == ("first",))
    pool.window("third")
    pool.window("second", number=2)
    pool.wait("third", 1, 15.0)
    pool.wait("second", 3, 15.0)
    assert pool.records("third")[0]["pid"] == pool.records("second")[-1]["pid"]
    assert begun in {record["pid"] for asset in ("first", "second") for record in pool.records(asset)}


@pytest.mark.slow
def test_of_several_workers_one_makes_no_search_and_nobody_waits_for_one_for_long(pool, tmp_path):
    """Searches on all workers once held up windows of assets that needed none."""
    for asset in ("first", "second", "third"):
        pool.window(asset, f"searches {tmp_path / 'made'} 20")
    wait_until((tmp_path / "made").exists)
    pool.window("quiet")
    pool.wait("quiet", 1, 10.0)
    assert not any(pool.records(asset) for asset in ("first", "second", "third"))


@pytest.mark.slow
def test_what_is_logged_and_warned_of_in_a_worker_is_in_the_log_of_the_service(pool):
    pool.window("a", "complains")
    pool.window("b", "fails")
    pool.wait("a", 1)
    pool.wait("b", 1)
    wait_until(lambda: "ZeroDivisionError: a defect" in pool.processes.said)
    assert pool.reasons("b") == ["internal error: ZeroDivisionError: a defect"]
    said = pool.processes.said
    assert "WARNING:worker_twins:the twin of complains complains" in said and "nothing that" not in said
    assert "a warning of a library" in said and said.count("Traceback") == 1


def test_the_real_twin_can_be_made_in_a_worker(tmp_path):
    pool = Pool(tmp_path, gear_twin(), workers=1)
    try:
        pool.window("a", number=1)
        pool.wait("a", 1)
        assert "at least 3 are needed" in pool.reasons("a")[0]  # as the real one says of so short a window
    finally:
        pool.close()


# -- the service ---------------------------------------------------------------------------------------


class Workers(Service):
    """A service whose twin is computed by processes."""

    program = HERE / "worker_twins.py"


def recorded(path, name="plain", windows=WINDOWS, **given):
    return write_recording(path, windows, changed=(b'name = "unsw"', f'name = "{name}"'.encode()), **given)


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
        started = started_by(running.process.pid)
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
        started = started_by(running.process.pid)
        for pid in started if how == signal.SIGINT else ():  # a terminal sends it to all
            os.kill(pid, how)
        status, _, complained = running.end(how)
        assert (status, complained) == (0, "")
        wait_until(lambda: not alive(started), 10.0)
        assert len(list((running.folder / SEGMENTS).glob("*.mcap"))) == WINDOWS
    finally:
        running.end(signal.SIGKILL)


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
        assert status == 201 and answer["done"]
        wait_until((tmp_path / "mark").exists)
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
