"""Windows are durable before they are processed: kills, damaged files, and assets that take long."""

from __future__ import annotations

import signal
import time
from dataclasses import replace
from functools import partial

import fake_twin
import pytest
from memory_transport import MemoryNetwork
from service_streams import Service, SqliteFile, wait_until, write_recording
from test_decisions import post
from test_other_parts import serving

from service.json_text import plain
from service.results.data_folder import SEGMENTS
from service.results.window_jobs import WindowJobs
from service.runtime.assess import assess
from service.runtime.replay import replay

WINDOWS = 5


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return write_recording(tmp_path_factory.mktemp("recording") / "short.mcap", WINDOWS)


def waiting(running):
    """The windows that wait by the database."""
    with running.store() as store:
        return WindowJobs(store.database).waiting("unsw")


@pytest.mark.slow
def test_windows_that_had_closed_are_processed_after_a_kill_without_being_sent_again(tmp_path, recording):
    """All that was in memory was lost: 16 of 25 schedules had windows missing though the replay had delivered them."""
    running = Service(tmp_path, slow=30.0).start()
    try:
        replay(recording, [running.endpoint], 0)
        wait_until(lambda: len(list((running.folder / SEGMENTS).glob("*.mcap"))) == WINDOWS)
        running.end(signal.SIGKILL)
        assert [w.start_ns for w in waiting(running)] == sorted(w.start_ns for w in waiting(running))
        running.slow = 0.0
        running.start()
        assert running.wait_for_windows(WINDOWS) == plain(assess(recording, twin=fake_twin.TWIN))["windows"]
        assert waiting(running) == ()
        replay(recording, [running.endpoint], 0)  # all of it is known
        time.sleep(1.0)
        assert len(running.windows()) == WINDOWS
    finally:
        running.end(signal.SIGKILL)
    assert waiting(running) == ()


@pytest.mark.slow
def test_a_window_whose_file_is_damaged_is_refused_and_counted_and_the_others_go_on(tmp_path, recording):
    running = Service(tmp_path, slow=30.0).start()
    try:
        replay(recording, [running.endpoint], 0)
        wait_until(lambda: len(list((running.folder / SEGMENTS).glob("*.mcap"))) == WINDOWS)
        running.end(signal.SIGKILL)
        for cut in sorted((running.folder / SEGMENTS).glob("*.mcap"))[1:3]:
            cut.write_bytes(cut.read_bytes()[:500])
        running.slow = 0.0
        running.start()
        windows = running.wait_for_windows(WINDOWS)
    finally:
        running.end(signal.SIGKILL)
    assert [w["quality"] for w in windows] == ["good", "refused", "refused", "good", "good"]
    assert [w["index"] for w in windows] == list(range(WINDOWS))
    assert all("file in which this window was kept cannot be read" in w["reason"] for w in windows[1:3])
    assert windows[1]["faults"][0]["kind"] == "stored_window"


def step_of_two(rig, state, window, options, *, seconds):
    """The machine called `slow` in its rig file takes long."""
    time.sleep(seconds if rig.get("name") == "slow" else 0.0)
    return fake_twin.step(rig, state, window, options)


@pytest.mark.slow
def test_an_asset_that_takes_long_holds_up_no_other_and_none_of_its_decisions(tmp_path, monkeypatch):
    monkeypatch.setattr(fake_twin, "TWIN", replace(fake_twin.TWIN, step=partial(step_of_two, seconds=120.0)))
    network = MemoryNetwork()
    slow = write_recording(
        tmp_path / "slow.mcap", WINDOWS, asset="slow", changed=(b'name = "unsw"', b'name = "slow"')
    )  # fmt: skip
    with serving(tmp_path, network, SqliteFile(tmp_path)) as running:
        replay(slow, (), 0, publish_to=network.open_publisher)
        wait_until(lambda: len(list((running.folder / SEGMENTS).glob("*.mcap"))) == WINDOWS)
        began = time.monotonic()
        replay(write_recording(tmp_path / "b.mcap", WINDOWS), (), 0, publish_to=network.open_publisher)
        assert len(running.wait_for_windows(WINDOWS)) == WINDOWS
        status, decided = post(running, "/v1/assets/unsw/effects/misalignment", {"decision": "pin"})
        assert (status, decided["done"]) == (200, True)
        assert time.monotonic() - began < 60
        assert running.windows("slow") == [] and running.get("/v1/assets/slow")["windows_total"] == 0


@pytest.mark.slow
def test_raw_signals_are_written_once_the_file_that_waited_becomes_the_one_that_is_kept(tmp_path, recording):
    running = Service(tmp_path, most=1).start()
    try:
        replay(recording, [running.endpoint], 0)
        wait_until(lambda: len(waiting(running)) >= 3)
        waited = {f.stat().st_ino for f in (running.folder / SEGMENTS).glob("*.mcap")}
        running.process_windows(WINDOWS)
        running.wait_for_windows(WINDOWS)
        assert waited <= {f.stat().st_ino for f in (running.folder / SEGMENTS).glob("*.mcap")}
        assert len(running.get("/v1/assets/unsw/signals")["windows"]) == WINDOWS
        assert running.get("/v1/assets/unsw/windows/4/signals/waveform") is not None
    finally:
        running.end(signal.SIGKILL)
