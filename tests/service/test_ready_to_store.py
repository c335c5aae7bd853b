"""A service is ready where it can store, and only there: by what it writes, and by how long that takes."""

from __future__ import annotations

import os
import signal
import threading
import time
from contextlib import contextmanager, suppress

import fake_twin
import pytest
import service_fakes as fakes
from service_streams import Service, wait_until, write_recording

from service.errors import StorageUnavailable
from service.json_text import plain
from service.results import backends, claims
from service.results.data_folder import DATABASE, SEGMENTS
from service.results.sql_store import SqlStore
from service.results.storage_faults import is_away
from service.runtime.assess import assess
from service.runtime.replay import replay
from service.runtime.storage_watch import ANSWERED_WITHIN, StorageWatch

WINDOWS = 5
pytestmark = pytest.mark.serve_only("takes away the database that one service has to itself")
TOLD = 5.0  # within which `/readyz` says so [s]
WRITERS = "SELECT pid FROM pg_stat_activity WHERE application_name LIKE 'gear-twin service%%'"


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return write_recording(tmp_path_factory.mktemp("recording") / "short.mcap", WINDOWS)


@contextmanager
def frozen(processes):
    """Processes that are suspended; their sockets stay."""
    try:
        _tell(processes, signal.SIGSTOP)
        yield
    finally:
        _tell(processes, signal.SIGCONT)


def _tell(processes, number):
    for process in processes:
        with suppress(ProcessLookupError):
            os.kill(process, number)


@contextmanager
def started(folder, **settings):
    running = Service(folder, **settings).start()
    try:
        yield running
    finally:
        running.end(signal.SIGKILL)


def stays_unready(running, seconds=3.0):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        assert not running.ready() and running.get("/healthz") is not None
        time.sleep(0.2)


def test_storage_that_does_not_answer_is_unusable_while_it_is_waited_for():
    now = [0.0]
    watch = StorageWatch("data", clock=lambda: now[0])

    def slow():
        now[0] += ANSWERED_WITHIN / 2
        before = watch.unusable
        watch.attempt(lambda: None)  # something within it that does answer
        now[0] += ANSWERED_WITHIN
        return before, watch.unusable

    _, (before, after) = watch.attempt(slow)
    assert before is None and "data has not answered for 4 s" in after
    assert watch.unusable is None and watch.failures == 0


@pytest.mark.slow
@pytest.mark.parametrize("how", ["removed", "replaced"])
@pytest.mark.parametrize("asset", [False, True])
def test_a_file_that_is_taken_away_makes_a_service_unready_until_it_is_back(tmp_path, recording, how, asset):
    """Without assets nothing was tried, and what waited was said to have been kept while nothing could be."""
    with started(tmp_path) as running:
        if asset:
            replay(recording, [running.endpoint], 0)
            running.wait_for_windows(WINDOWS)
        file, away = tmp_path / DATABASE, tmp_path / "away"
        file.rename(away)
        if how == "replaced":
            file.write_bytes(away.read_bytes())
        wait_until(lambda: not running.ready(), TOLD)
        stays_unready(running)
        assert "can be used again" not in running.said()[1] and "removed or replaced" in running.said()[1]
        away.rename(file)
        wait_until(running.ready)
        assert running.said()[1].count("can be used again") == 1


@pytest.mark.slow
def test_a_folder_of_windows_that_cannot_be_written_makes_an_idle_service_unready(tmp_path):
    """It was seen with the next window, which had been sent to a service that said that it was ready."""
    with started(tmp_path) as running:
        folder = tmp_path / SEGMENTS
        folder.rename(tmp_path / "away")
        wait_until(lambda: not running.ready(), TOLD)
        stays_unready(running)
        (tmp_path / "away").rename(folder)
        wait_until(running.ready)
        assert not list(folder.glob("*.mcap")) and running.said()[1].count("can be used again") == 1


@pytest.mark.slow
@pytest.mark.parametrize("which", ["one session", "server"])
def test_a_server_that_is_suspended_while_a_recording_is_sent_is_said_and_waited_for(
    tmp_path, recording, postgresql, postgresql_server, which
):
    """It answered 200 for two minutes, as the connection stayed open."""
    with started(tmp_path, DATABASE=postgresql) as running:
        sent = threading.Thread(target=replay, args=(recording, [running.endpoint], 0), daemon=True)
        sent.start()
        running.wait_for_windows(1)
        sessions = [pid for (pid,) in postgresql_server.sql(WRITERS)]
        if which == "server":
            sessions = [pid for (pid,) in postgresql_server.sql("SELECT pid FROM pg_stat_activity")]
            sessions += [postgresql_server.first_process]
        with frozen(sessions):
            wait_until(lambda: not running.ready(), TOLD)
            stays_unready(running)
        wait_until(running.ready)
        assert running.wait_for_windows(WINDOWS) == plain(assess(recording, twin=fake_twin.TWIN))["windows"]
        sent.join(20)
        assert not sent.is_alive() and "Traceback" not in running.said()[1]


@pytest.mark.slow
def test_an_idle_service_says_that_its_open_connection_is_answered_no_more(tmp_path, postgresql, postgresql_server):
    with started(tmp_path, DATABASE=postgresql) as running:
        with frozen([pid for (pid,) in postgresql_server.sql(WRITERS)]):
            wait_until(lambda: not running.ready(), TOLD)
            stays_unready(running)
        wait_until(running.ready)


@pytest.mark.slow
def test_a_connection_that_is_not_answered_is_given_up_and_a_service_of_its_own_is_no_other(
    postgresql, postgresql_server, monkeypatch
):
    monkeypatch.setattr(backends, "STATEMENT_WAIT", 1.0)
    monkeypatch.setattr(backends, "ANSWER_WAIT", 0.5)
    monkeypatch.setattr(claims, "ENDED_WITHIN", 200)
    with SqlStore(postgresql, claimed=True) as store:
        fakes.take(store, None, "unsw", 0, 100.0)
        with frozen([pid for (pid,) in postgresql_server.sql(WRITERS)]):
            for _ in range(2):
                with pytest.raises(StorageUnavailable) as caught:
                    fakes.take(store, None, "unsw", 1, 200.0)
                assert is_away(caught.value)
        assert fakes.take(store, None, "unsw", 1, 200.0)
        assert [w.record["index"] for w in store.windows("unsw")] == [0, 1]
