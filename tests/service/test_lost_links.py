"""Replays end with all frames stored, whatever happens to the service, the router and the link meanwhile."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time

import fake_twin
import pytest
from service_streams import ROOT, Service, free_port, wait_until, write_recording

from service.json_text import plain
from service.runtime.assess import assess

pytestmark = pytest.mark.slow
WINDOWS = 8
IDLE = {"IDLE_TIMEOUT": "5"}  # a sender that is paused for less ends no window [s]


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return write_recording(tmp_path_factory.mktemp("recording") / "campaign.mcap", WINDOWS)


@pytest.fixture(scope="module")
def assessed(recording):
    return plain(assess(recording, twin=fake_twin.TWIN))


def replaying(recording, endpoint, speed=2.0):
    """The command in a process of its own."""
    arguments = ["replay", str(recording), "--connect", endpoint, "--speed", str(speed), "--max-pause", "1.5"]
    return subprocess.Popen(
        [sys.executable, "-m", "service", *arguments],
        cwd=ROOT, env=os.environ | {"PYTHONPATH": str(ROOT)}, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def ended(process, seconds=90.0):
    out, err = process.communicate(timeout=seconds)
    return process.returncode, out, err


def router(endpoint):
    """A router of its own process, in whose place the service embeds none."""
    code = (
        "import sys, time; from service.transport.zenoh_session import open_session\n"
        f"with open_session(listen=[{endpoint!r}]): print('up', flush=True); time.sleep(600)"
    )
    started = subprocess.Popen([sys.executable, "-c", code], cwd=ROOT, stdout=subprocess.PIPE, text=True)
    assert started.stdout.readline() == "up\n"
    return started


def stopped(process):
    process.kill()
    process.wait()
    process.stdout.close()


def test_a_service_that_is_suspended_for_25_seconds(tmp_path, recording, assessed):
    running = Service(tmp_path, **IDLE).start()
    sending = replaying(recording, running.endpoint)
    try:
        running.wait_for_windows(2)
        time.sleep(1.0)  # in the middle of a burst, or between two
        running.process.send_signal(signal.SIGSTOP)
        time.sleep(25.0)
        running.process.send_signal(signal.SIGCONT)
        status, out, err = ended(sending)
        assert status == 0 and "256 frames stored" in out, err
        assert running.wait_for_windows(WINDOWS) == assessed["windows"]
    finally:
        sending.kill()
        running.end(signal.SIGKILL)


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM])
def test_a_service_that_ends_twice_and_comes_back(tmp_path, recording, assessed, how):
    running = Service(tmp_path, **IDLE).start()
    sending = replaying(recording, running.endpoint)
    try:
        for windows in (2, 5):
            running.wait_for_windows(windows)
            running.end(how)
            time.sleep(1.5)
            running.start()
        status, out, err = ended(sending)
        assert status == 0 and "256 frames stored" in out, err
        assert running.wait_for_windows(WINDOWS) == assessed["windows"]
    finally:
        sending.kill()
        running.end(signal.SIGKILL)


def test_what_has_been_said_to_be_stored_is_there_after_a_kill(tmp_path, recording, assessed):
    """A replay once said `delivered` and 15 of 16 windows were gone with the service."""
    running = Service(tmp_path, slow=0.5).start()
    try:
        status, _, err = ended(replaying(recording, running.endpoint, speed=0))
        running.end(signal.SIGKILL)
        assert status == 0, err
        running.start()
        assert running.wait_for_windows(WINDOWS) == assessed["windows"]
    finally:
        running.end(signal.SIGKILL)


@pytest.mark.parametrize("away", [2.0, 12.0])
def test_a_router_that_ends_and_comes_back(tmp_path, recording, away):
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    between = router(endpoint)
    running = Service(tmp_path, CONNECT=json.dumps([endpoint]), LISTEN="[]", **IDLE).start()
    sending = replaying(recording, endpoint)
    try:
        wait_until(lambda: running.get("/v1/assets/unsw") is not None)
        time.sleep(4.0)  # in the midst of a window: that nothing comes while the link is lost does not end it
        stopped(between)
        time.sleep(away)
        between = router(endpoint)
        status, out, err = ended(sending, 150.0)
        assert status == 0 and "256 frames stored" in out, err
        windows = running.wait_for_windows(WINDOWS)
        assert [w["quality"] for w in windows] == ["good"] * WINDOWS
        assert all("gap" not in {f["kind"] for f in w["faults"]} for w in windows)
    finally:
        sending.kill()
        running.end(signal.SIGKILL)
        stopped(between)


def test_a_service_that_stays_away_is_said_with_what_is_not_stored(tmp_path, recording):
    running = Service(tmp_path, **IDLE).start()
    arguments = [
        "replay",
        str(recording),
        "--connect",
        running.endpoint,
        "--speed",
        "2",
        "--max-pause",
        "1.5",
        "--wait",
        "4",
    ]
    sending = subprocess.Popen(
        [sys.executable, "-m", "service", *arguments],
        cwd=ROOT, env=os.environ | {"PYTHONPATH": str(ROOT)}, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        running.wait_for_windows(1)
        running.end(signal.SIGKILL)
        begun = time.monotonic()
        status, _, err = ended(sending)
        assert status == 1 and "frames are not stored: no subscriber for gearbox/unsw/" in err
        assert "Traceback" not in err and time.monotonic() - begun < 40
    finally:
        sending.kill()
        running.end(signal.SIGKILL)
