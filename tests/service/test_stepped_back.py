"""A database that steps back behind what was acknowledged: it is said, and what is sent again makes all of it equal."""

from __future__ import annotations

import os
import shutil
import signal
import time
from contextlib import ExitStack, suppress

import fake_twin
import pytest
from postgresql_server import PostgresqlServer, programs
from service_streams import Service, wait_until, write_recording
from test_workers import Workers

from service.cli import run
from service.errors import DeliveryError, SteppedBack
from service.json_text import plain
from service.results.data_folder import DATABASE, SEGMENTS
from service.runtime.assess import assess
from service.runtime.replay import replay

WINDOWS = 6
pytestmark = pytest.mark.serve_only("puts back the database that one service has to itself")


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return write_recording(tmp_path_factory.mktemp("recording") / "short.mcap", WINDOWS)


class Files:
    """The database of a service in a folder."""

    while_it_runs = False

    def __init__(self, folder):
        self.folder, self.settings = folder, {}

    def copy(self):
        """The database as it is now, for `put_back`."""
        self.kept = {path.name: path.read_bytes() for path in self.folder.glob(f"{DATABASE}*")}

    def put_back(self, running):
        for path in self.folder.glob(f"{DATABASE}*"):
            path.unlink()
        for name, content in self.kept.items():
            (self.folder / name).write_bytes(content)


class Cut(Files):
    """The same, of which the newest of the write-ahead log is lost, as on a disk that confirms what it has not kept."""

    while_it_runs = True

    def copy(self):
        self.kept = {path.name: path.stat().st_size for path in self.folder.glob(f"{DATABASE}*")}

    def put_back(self, running):
        log = self.folder / f"{DATABASE}-wal"
        os.truncate(log, self.kept[log.name])


class Copies:
    """A database of a server."""

    while_it_runs = False

    def __init__(self, server, url, stack):
        self.server, self.stack, self.settings = server, stack, {"DATABASE": url}

    def copy(self):
        template = self.settings["DATABASE"].rpartition("/")[2]
        wait_until(lambda: not self.server.sql(f"SELECT 1 FROM pg_stat_activity WHERE datname = '{template}'"))
        self.url = self.stack.enter_context(self.server.new_database(template=template))

    def put_back(self, running):
        running.given["DATABASE"] = self.url


@pytest.fixture(params=["sqlite", "log", "postgresql"])
def database(request, tmp_path):
    if request.param != "postgresql":
        yield (Files if request.param == "sqlite" else Cut)(tmp_path)
        return
    with ExitStack() as stack:
        server, url = (request.getfixturevalue(name) for name in ("postgresql_server", "postgresql"))
        yield Copies(server, url, stack)


def killed_with_windows_that_wait(running, recording, done):
    """The service is killed once so many windows have been processed, where all have been acknowledged."""
    replay(recording, [running.endpoint], 0)
    running.wait_for_windows(done)
    running.end(signal.SIGKILL)
    assert len(list((running.folder / SEGMENTS).glob("*.mcap"))) == WINDOWS - done


def position(running):
    """How far the stream is stored."""
    found = running.get("/v1/assets/unsw/position")
    return {name: found[name] for name in ("settled_until_ns", "unsettled_from_ns", "channels", "backlog")}


def said(running):
    return [line for line in running.said()[1].splitlines() if "the database is older than" in line]


def put_back(running, recording, database, expected):
    """Puts the database back to when two windows were processed, after all were; the position before that."""
    replay(recording, [running.endpoint], 0)
    running.wait_for_windows(2)
    if not database.while_it_runs:
        running.end(signal.SIGKILL)
    database.copy()
    running.process_windows(WINDOWS)
    if not database.while_it_runs:
        running.start()
    assert running.wait_for_windows(WINDOWS) == expected and said(running) == []
    wait_until(lambda: position(running)["backlog"] == 0)
    before = position(running)
    running.end(signal.SIGKILL)
    database.put_back(running)
    running.start()
    return before


@pytest.mark.slow
def test_windows_that_a_database_put_back_does_not_have_are_stored_when_they_are_sent_again(
    tmp_path, recording, database
):
    """They were refused for good, as their files had gone when they were processed, and a repeat was left out."""
    expected = plain(assess(recording, twin=fake_twin.TWIN))["windows"]
    running = Service(tmp_path, most=2, SIGNAL_BYTES="0", **database.settings).start()
    try:
        before = put_back(running, recording, database, expected)
        (line,) = said(running)
        assert "unsw: " in line and "from 2023-11-14T22:15:20" in line and f"on, {WINDOWS - 2} windows" in line
        assert running.windows() == expected[:2]
        replay(recording, [running.endpoint], 0)
        assert running.wait_for_windows(WINDOWS) == expected
        wait_until(lambda: position(running) == before)
    finally:
        running.end(signal.SIGKILL)


@pytest.mark.slow
def test_windows_that_a_database_put_back_does_not_have_are_stored_at_once_where_their_signals_are_kept(
    tmp_path, recording, database
):
    expected = plain(assess(recording, twin=fake_twin.TWIN))["windows"]
    running = Service(tmp_path, most=2, **database.settings).start()
    try:
        before = put_back(running, recording, database, expected)
        assert running.wait_for_windows(WINDOWS) == expected and said(running) == []
        wait_until(lambda: position(running) == before)
        assert len(running.get("/v1/assets/unsw/signals")["windows"]) == WINDOWS
    finally:
        running.end(signal.SIGKILL)


@pytest.mark.slow
def test_a_service_whose_server_fails_over_to_one_that_lags_ends_and_goes_on_from_what_is_there(tmp_path, recording):
    """It went on from what it remembered: windows that the server had lost were never stored again."""
    expected = plain(assess(recording, twin=fake_twin.TWIN))["windows"]
    if programs() is None:
        pytest.skip("PostgreSQL is not installed (Debian's package postgresql)")
    with PostgresqlServer() as server, server.new_database() as url:
        running = Service(tmp_path, most=2, DATABASE=url).start()
        try:
            replay(recording, [running.endpoint], 0)
            running.wait_for_windows(2)
            server.stop("immediate")
            shutil.copytree(server.data, server.folder / "lagging")
            _owned_as(server.folder / "lagging", server.data)
            server.start()
            running.process_windows(WINDOWS)
            assert running.wait_for_windows(WINDOWS) == expected
            server.stop("immediate")
            server.data.rename(server.folder / "first")
            (server.folder / "lagging").rename(server.data)
            server.start()
            assert running.process.wait(30) == 1
            assert "does not have what it had confirmed" in running.said()[1]
            running.start()
            replay(recording, [running.endpoint], 0)
            assert running.wait_for_windows(WINDOWS) == expected
        finally:
            running.end(signal.SIGKILL)


def _lose_what_only_others_wrote(server, url):
    """All marks go but those of whoever writes while nothing comes, and all connections."""
    name, since = url.rpartition("/")[2], time.time_ns()
    newer = f"FROM commits WHERE writer NOT LIKE 'probe %%' AND written_ns > {since}"
    wait_until(lambda: server.sql(f"SELECT count(*) {newer}", name)[0][0] > 0)
    server.sql(f"DELETE FROM commits WHERE writer NOT LIKE 'probe %%' AND writer NOT IN (SELECT writer {newer})", name)
    others = f"FROM pg_stat_activity WHERE datname = '{name}' AND pid <> pg_backend_pid()"
    server.sql(f"SELECT count(pg_terminate_backend(pid)) {others}", name)


@pytest.mark.slow
def test_a_server_that_lacks_only_what_a_worker_process_had_committed_is_found_out_by_that_worker(
    tmp_path, postgresql_server, postgresql
):
    """Whoever receives writes every two seconds while nothing comes, and may have lost nothing of its own."""
    recording = write_recording(tmp_path / "short.mcap", WINDOWS, changed=(b'name = "unsw"', b'name = "plain"'))
    running = Workers(tmp_path / "data", WORKERS="1", DATABASE=postgresql).start()
    try:
        replay(recording, [running.endpoint], 0)
        expected = running.wait_for_windows(WINDOWS)
        _lose_what_only_others_wrote(postgresql_server, postgresql)
        write_recording(tmp_path / "other.mcap", 2, "other", changed=(b'name = "unsw"', b'name = "plain"'))
        with suppress(DeliveryError):  # the service may end before all is stored
            replay(tmp_path / "other.mcap", [running.endpoint], 0, wait=10.0)
        assert running.process.wait(30) == 1
        assert "does not have what it had confirmed" in running.said()[1]
        running.start()
        assert running.wait_for_windows(WINDOWS) == expected
        replay(tmp_path / "other.mcap", [running.endpoint], 0)
        running.wait_for_windows(2, "other")
    finally:
        running.end(signal.SIGKILL)


def test_a_service_that_ends_because_its_database_stepped_back_is_one_that_is_to_be_started_again(monkeypatch, capsys):
    """Exit status 2 is that of mistakes in the settings, after which nobody starts it again."""

    def ended(settings):
        raise SteppedBack("the database does not have what it had confirmed", reason="connection lost")

    monkeypatch.setattr("service.runtime.serve.run", ended)
    assert run(["serve"]) == 1
    assert capsys.readouterr().err == "gear-twin: the database does not have what it had confirmed\n"


def _owned_as(copy, folder):
    owner = folder.stat()
    for path in (copy, *copy.rglob("*")):
        os.chown(path, owner.st_uid, owner.st_gid, follow_symlinks=False)


@pytest.mark.slow
def test_an_asset_of_which_nothing_was_committed_begins_anew(tmp_path, recording):
    expected = plain(assess(recording, twin=fake_twin.TWIN))["windows"]
    running = Service(tmp_path, slow=30.0).start()
    try:
        killed_with_windows_that_wait(running, recording, 0)
        for path in (running.folder / SEGMENTS).glob("*.mcap"):
            path.unlink()
        running.slow = 0.0
        running.start()
        assert len(said(running)) == 1 and running.windows() == []
        replay(recording, [running.endpoint], 0)
        assert running.wait_for_windows(WINDOWS) == expected
    finally:
        running.end(signal.SIGKILL)


@pytest.mark.slow
def test_windows_before_the_first_without_a_file_are_processed_and_those_behind_it_come_again(tmp_path, recording):
    """In their order, so that the twin sees the same as without it."""
    expected = plain(assess(recording, twin=fake_twin.TWIN))["windows"]
    running = Service(tmp_path, slow=30.0).start()
    try:
        killed_with_windows_that_wait(running, recording, 0)
        sorted((running.folder / SEGMENTS).glob("*.mcap"))[2].unlink()
        running.slow = 0.0
        running.start()
        assert f"{WINDOWS - 2} windows" in said(running)[0]
        assert running.wait_for_windows(2) == expected[:2]
        replay(recording, [running.endpoint], 0)
        assert running.wait_for_windows(WINDOWS) == expected
    finally:
        running.end(signal.SIGKILL)
