"""Full and read-only storage: the service stays up, acknowledges nothing, says so once, and goes on by itself."""

from __future__ import annotations

import itertools
import resource
import signal
import subprocess
import threading
import time
from contextlib import contextmanager

import fake_twin
import pytest
from fleets import at_front, routed, worker
from service_streams import Service, wait_until, write_recording
from sqlalchemy import select

from service.errors import StorageUnavailable
from service.json_text import plain
from service.results.data_folder import SEGMENTS
from service.results.schema import ROLES
from service.runtime.assess import assess
from service.runtime.receiver import LOOK
from service.runtime.replay import replay
from service.runtime.storage_watch import FIRST_PAUSE, LONGEST_PAUSE, StorageWatch

WINDOWS = 6


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return write_recording(tmp_path_factory.mktemp("recording") / "short.mcap", WINDOWS)


@pytest.fixture(scope="module")
def begun(tmp_path_factory):
    """The first window of the same."""
    return write_recording(tmp_path_factory.mktemp("begun") / "begun.mcap", 1)


def as_root(*command):
    """Runs a command; the test is skipped, with the reason, where it may not."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError as error:
        pytest.skip(f"{command[0]} cannot be run here: {error}")
    if done.returncode:
        pytest.skip(f"{' '.join(command)} is not possible here: {done.stderr.strip()}")


@contextmanager
def mounted(folder, *options):
    """A file system of its own."""
    folder.mkdir()
    as_root("mount", *options, str(folder))
    try:
        yield folder
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=False)


def sending(recording, running):
    """A replay in a thread of its own: it ends when all is stored."""
    thread = threading.Thread(target=_ignoring, args=(replay, recording, [running.endpoint], 0), daemon=True)
    thread.start()
    return thread


def _ignoring(call, *given):
    try:
        call(*given)
    except Exception as error:  # the service is ended under it
        assert error is not None


def not_ready(running):
    return running.get("/healthz") is not None and not running.ready()


def went_through_it(running, recording):
    """Nothing was lost, the cause and its end were said once each, and it is over."""
    wait_until(running.ready)
    assert running.wait_for_windows(WINDOWS) == plain(assess(recording, twin=fake_twin.TWIN))["windows"]
    wait_until(lambda: "gear_twin_storage_unavailable 0.0" in running.text("/metrics"))
    complained = running.said()[1]
    assert complained.count("it is tried again") == 1 and "Traceback" not in complained, complained
    assert complained.count("can be used again") == 1


@pytest.mark.slow
def test_a_full_disk_is_waited_for_and_nothing_is_lost(tmp_path, recording, begun):
    """The service ended with a traceback, and was started again in a loop."""
    with mounted(tmp_path / "disk", "-t", "tmpfs", "-o", "size=2m", "tmpfs") as disk:
        running = Service(tmp_path, DATA=str(disk)).start()
        try:
            replay(begun, [running.endpoint], 0)
            running.wait_for_windows(1)
            filler = disk / "filler"
            with filler.open("wb", buffering=0) as file, pytest.raises(OSError, match="No space"):
                while True:
                    file.write(bytes(4096))
            sent = sending(recording, running)
            wait_until(lambda: not_ready(running))
            time.sleep(2.0)
            assert len(running.windows()) == 1 == len(list((running.folder / SEGMENTS).glob("*.mcap")))
            assert sent.is_alive()
            filler.unlink()
            went_through_it(running, recording)
            sent.join(20)
            assert not sent.is_alive()
            assert running.end()[0] == 0
        finally:
            running.end(signal.SIGKILL)


@pytest.mark.serve_only("the results of a fleet are not on the disk of its data folder")
@pytest.mark.slow
def test_a_disk_that_becomes_read_only_is_waited_for(tmp_path, recording, begun):
    """As ext4 does after a fault of the disk; there it stays so until the service is started on a sound one."""
    image = tmp_path / "image"
    with image.open("wb") as file:
        file.truncate(32 * 2**20)
    as_root("mkfs.ext4", "-q", str(image))
    running = Service(tmp_path, DATA=str(tmp_path / "disk"))
    with mounted(tmp_path / "disk", "-o", "loop", str(image)) as disk:
        running.start()
        try:
            replay(begun, [running.endpoint], 0)
            running.wait_for_windows(1)
            as_root("mount", "-o", "remount,abort", str(disk))
            sending(recording, running)
            wait_until(lambda: not_ready(running))
            time.sleep(2.0)
            assert len(running.windows()) == 1
            status, _, complained = running.end()
            assert status == 0 and "Traceback" not in complained
            assert 1 <= complained.count("it is tried again") <= 2  # of the database, and of the windows' folder
        finally:
            running.end(signal.SIGKILL)
    (tmp_path / "disk").rmdir()
    with mounted(tmp_path / "disk", "-o", "loop", str(image)):
        running.start()
        try:
            assert len(running.windows()) == 1
            replay(recording, [running.endpoint], 0)
            assert running.wait_for_windows(WINDOWS) == plain(assess(recording, twin=fake_twin.TWIN))["windows"]
        finally:
            running.end(signal.SIGKILL)


@pytest.mark.serve_only("the limit would hold for the shared memory of the router in the same process, too")
@pytest.mark.slow
def test_a_limit_on_the_size_of_files_is_waited_for_as_a_full_disk_is(tmp_path, recording, begun):
    running = Service(tmp_path).start()
    try:
        replay(begun, [running.endpoint], 0)
        running.wait_for_windows(1)
        low = (50_000, resource.RLIM_INFINITY)
        for process in running.process.all:
            resource.prlimit(process, resource.RLIMIT_FSIZE, low)
        sending(recording, running)
        wait_until(lambda: not_ready(running))
        assert running.get("/healthz") is not None
        for process in running.process.all:
            resource.prlimit(process, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY,) * 2)
        wait_until(running.ready)
        assert running.wait_for_windows(WINDOWS) == plain(assess(recording, twin=fake_twin.TWIN))["windows"]
    finally:
        running.end(signal.SIGKILL)


# -- the watch -----------------------------------------------------------------------------------------


def full():
    raise StorageUnavailable("disk full", reason="no space")


def locked():
    raise StorageUnavailable("locked", reason="locked")


def test_a_cause_is_said_once_and_tried_again_with_growing_pauses(caplog):
    now, attempts = [0.0], []
    watch = StorageWatch("data", clock=lambda: now[0])

    def action():
        attempts.append(now[0])
        full()

    while now[0] < 300:
        assert watch.attempt(action) == (False, None)
        now[0] += 0.1
    pauses = [round(b - a) for a, b in itertools.pairwise(attempts)]
    assert attempts[1] <= 2 * FIRST_PAUSE and pauses == sorted(pauses) and pauses[-1] == LONGEST_PAUSE
    assert len(caplog.records) == 1 and "disk full" in watch.reason
    now[0] += LONGEST_PAUSE
    watch.attempt(locked)
    assert len(caplog.records) == 2  # another cause
    now[0] += LONGEST_PAUSE
    assert watch.attempt(lambda: 7) == (True, 7)
    watch.worked()
    watch.worked()
    assert watch.reason is None and [r.message for r in caplog.records[2:]] == [
        "the storage can be used again: what waited has been kept"
    ]


@pytest.mark.slow
def test_a_worker_whose_disk_is_full_goes_on_to_say_so(tmp_path, fleet):
    """Between attempts to keep windows, whose pauses grow, it would count as one that has ended."""

    def row():
        return next(iter(store.database.rows(select(ROLES.c.beat, ROLES.c.not_ready))), (0, None))

    with (
        mounted(tmp_path / "disk", "-t", "tmpfs", "-o", "size=2m", "tmpfs") as disk,
        routed() as endpoint,
        worker(tmp_path, fleet, endpoint, DATA=str(disk)),
        at_front(fleet) as store,
    ):
        wait_until(lambda: row()[0] > 0 and row()[1] is None)
        with (disk / "filler").open("wb", buffering=0) as file, pytest.raises(OSError, match="No space"):
            while True:
                file.write(bytes(4096))
        wait_until(lambda: "no space" in (row()[1] or ""))
        full = row()[0]
        wait_until(lambda: row()[0] >= full + 8, 10 * LOOK)
        assert "no space" in row()[1]
        (disk / "filler").unlink()
        wait_until(lambda: row()[1] is None)
