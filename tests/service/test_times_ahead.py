"""Times of measurements ahead of the host's clock, by a day or to the end of times: nothing waits for them for good."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from service_streams import service, write_recording

from service.cli import run

SINCE = 1_700_000_000  # when recordings of the tests begin, Unix time [s]
DAY = 86_400.0
ENDS = 2**63 / 1e9  # the last Unix time of 64 bits in nanoseconds [s]


@pytest.fixture
def replayed(tmp_path, capsys):
    """Replays a recording of so many windows that begins at a time; its exit status and last line."""

    def by(running, at, windows=1, **given):
        path = at
        if not isinstance(at, Path):
            path = write_recording(tmp_path / "recording.mcap", windows, later=at - SINCE, **given)
        capsys.readouterr()
        status = run(["replay", str(path), "--connect", running.endpoint, "--speed", "0", "--future"])
        return status, (capsys.readouterr().err.strip().splitlines() or [""])[-1]

    return by


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("length", [1.0, 2.0, 0.5])
def test_a_recording_dated_a_day_ahead_is_stored_and_blocks_none_that_are_made_afterwards(
    tmp_path, replayed, monkeypatch, length
):
    """One of fewer frames than show a set clock was waited for without end; those of today were "past" for a day."""
    now = time.time()
    with service(tmp_path / "data", NEW_ASSETS="adopt") as running:
        assert replayed(running, now - DAY) == (0, "")
        monkeypatch.setattr("service_streams.WINDOW_S", length)
        assert replayed(running, now + DAY, seed=8) == (0, "")
        running.wait_for_windows(2)
        monkeypatch.setattr("service_streams.WINDOW_S", 3.0)
        assert replayed(running, now - 600, seed=9) == (0, "")
        shown = running.wait_for_windows(3)
        assert shown[-1]["start_time"] < shown[-2]["start_time"]
        assert all(
            any("the stream's clock was set from" in fault["detail"] for fault in window["faults"])
            for window in shown[-2:]
        )
        status, said = replayed(running, now - 300 * DAY, seed=10)
        assert status == 1 and "past: " in said


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("before", [1.9, 3.0, 3600.0])
def test_measurements_at_the_end_of_times_are_refused_and_hold_up_nothing(tmp_path, replayed, monkeypatch, before):
    """Their windows ended beyond the numbers of 64 bits."""
    with service(tmp_path / "data", RAW_FOLDER=str(tmp_path / "raw")) as running:
        with monkeypatch.context() as anything:
            anything.setattr("service.stream.frames.LATEST_START", 2**63)
            write_recording(path := tmp_path / "last.mcap", 1, later=ENDS - before - SINCE)
        status, said = replayed(running, path)
        assert status == 1 and "32 of 32 frames are not stored" in said
        assert replayed(running, time.time() - DAY, 2) == (0, "")
        running.wait_for_windows(2)
        assert running.get("/readyz")["status"] == "ready"
