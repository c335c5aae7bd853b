"""A power cut: the disk as it is at that moment, without what the file system had yet to write."""

from __future__ import annotations

import filecmp
import os
import shutil
import signal
import subprocess
import tempfile
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import fake_twin
import pytest
from postgresql_server import SETTINGS, PostgresqlServer, programs
from service_streams import NS, PAUSE_S, Service, wait_until, write_recording
from test_storage_unavailable import as_root, mounted

from service.json_text import plain
from service.runtime.assess import assess
from service.runtime.replay import replay

WINDOWS = 6
pytestmark = [
    pytest.mark.serve_only("the results of a fleet are not on the disk of its data folder"),
    pytest.mark.slow,
]


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return write_recording(tmp_path_factory.mktemp("recording") / "short.mcap", WINDOWS)


@contextmanager
def on_a_disk(tmp_path, kind):
    """A service whose data and database are on a disk of their own, and what cuts its power and lets it start again."""
    image = tmp_path / "image"
    with image.open("wb") as file:
        file.truncate(96 * 2**20)
    as_root("mkfs.ext4", "-q", str(image))
    with ExitStack() as stack:
        above = Path(stack.enter_context(tempfile.TemporaryDirectory(ignore_cleanup_errors=True)))
        above.chmod(0o755)  # whose owner is not that of the server
        folder = above / "disk"
        disk, settings, server = stack.enter_context(mounted(folder, "-o", "loop", str(image))), {}, None
        if kind == "postgresql":
            if programs() is None:
                pytest.skip("PostgreSQL is not installed (Debian's package postgresql)")
            disk.chmod(0o755)
            kept = tuple(s for s in SETTINGS if not s.startswith(("fsync", "synchronous_commit")))
            server = stack.enter_context(PostgresqlServer(disk, (*kept, "min_wal_size=32MB", "max_wal_size=32MB")))
            as_root("sync", "-f", str(disk))  # the files of the server, which is made without
            settings["DATABASE"] = server.url("postgres")
        running = Service(tmp_path, DATA=str(disk / "data"), **settings)

        def cut():
            processes = [*_stopped(running.process.pid), *(_stopped(server.first_process) if server else ())]
            _copy_of_one_moment(image, tmp_path / "copy")
            for process in processes:
                with suppress(ProcessLookupError):  # a role ends with its supervisor
                    os.kill(process, signal.SIGKILL)
            running.process.wait(20)
            subprocess.run(["umount", "-l", str(folder)], check=True)
            as_root("mount", "-o", "loop", str(tmp_path / "copy"), str(folder))
            if server:
                for lock in (server.data / "postmaster.pid", *server.folder.glob(".s.PGSQL.*")):
                    lock.unlink()  # of a process that no computer runs after a power cut
                server.start()

        try:
            yield running, cut
        finally:
            running.end(signal.SIGKILL)


def _stopped(process):
    """Stops a process and all that it has started, each before it can start another; those that are stopped."""
    try:
        os.kill(process, signal.SIGSTOP)
    except ProcessLookupError:  # it has ended meanwhile
        return []
    own = subprocess.run(["pgrep", "-P", str(process)], capture_output=True, text=True).stdout.split()
    return [process, *(one for child in own for one in _stopped(int(child)))]


def _copy_of_one_moment(image, copy):
    """Copies a disk to which the kernel may be writing: again until nothing was written meanwhile."""
    shutil.copy(image, copy)
    while not filecmp.cmp(image, copy, shallow=False):
        shutil.copy(image, copy)


@pytest.mark.parametrize("kind", ["sqlite", "postgresql"])
@pytest.mark.parametrize("slow", [30.0, 0.3])
def test_what_was_acknowledged_before_a_power_cut_is_there_after_it(tmp_path, recording, kind, slow):
    """A window was gone: its file had been written, and its name had not."""
    expected = plain(assess(recording, twin=fake_twin.TWIN))["windows"]
    with on_a_disk(tmp_path, kind) as (running, cut):
        running.slow = slow
        running.start()
        replay(recording, [running.endpoint], 0)
        cut()
        running.slow = 0.0
        running.start()
        assert running.wait_for_windows(WINDOWS) == expected
        assert "the database is older" not in running.said()[1]
        settled = 1_700_000_000 * NS + round((WINDOWS - 1) * PAUSE_S * NS)
        wait_until(lambda: running.get("/v1/assets/unsw/position")["settled_until_ns"] > settled)
