"""The roles of a service are processes: whichever is killed is there again at once, and the others go on."""

from __future__ import annotations

import os
import re
import signal
import threading

import fake_twin
import pytest
from forked_processes import role_of
from service_streams import Service, wait_until, write_recording

from service.json_text import plain
from service.runtime.assess import assess
from service.runtime.replay import replay
from service.stream.sources.mcap import Recording

WINDOWS = 6
BACK_WITHIN = 5.0  # of a role that was killed, on a busy machine [s]; `tests.chaos` measures it
pytestmark = [pytest.mark.slow, pytest.mark.serve_only("the roles of `serve`")]


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return write_recording(tmp_path_factory.mktemp("recording") / "short.mcap", WINDOWS)


def received(running):
    """How many frames have come, by /metrics."""
    return float(re.search(r"^gear_twin_received_frames_total (\S+)$", running.text("/metrics"), re.MULTILINE)[1])


@pytest.mark.parametrize("role", ["ingest", "answer"])
def test_a_killed_role_is_there_again_while_a_recording_is_sent_and_nothing_is_missing(tmp_path, recording, role):
    running, delivered = Service(tmp_path, IDLE_TIMEOUT="5").start(), []
    pace = {"speed": 4.0, "max_pause": 1.5}
    sending = threading.Thread(target=lambda: delivered.append(replay(recording, [running.endpoint], **pace)))
    sending.start()
    try:
        acknowledged = running.wait_for_windows(2)
        others = {each: role_of(running.process.pid, each) for each in ("ingest", "answer") if each != role}
        os.kill(role_of(running.process.pid, role), signal.SIGKILL)
        wait_until(lambda: running.ready(), BACK_WITHIN)
        assert running.windows()[: len(acknowledged)] == acknowledged
        sending.join(30)
        assert delivered, "the replay did not end"
        assert running.wait_for_windows(WINDOWS) == plain(assess(recording, twin=fake_twin.TWIN))["windows"]
        assert {each: role_of(running.process.pid, each) for each in others} == others
        assert f"{role}: process" in running.said()[1] and "it is started again in 0.1 s" in running.said()[1]
    finally:
        running.end(signal.SIGKILL)
        sending.join(60)


def test_who_answers_says_that_nobody_receives_frames_and_goes_on_answering(tmp_path, recording):
    running = Service(tmp_path).start()
    try:
        replay(recording, [running.endpoint], 0)
        windows = running.wait_for_windows(WINDOWS)
        ingest = role_of(running.process.pid, "ingest")
        os.kill(ingest, signal.SIGSTOP)
        assert running.windows() == windows  # a role that is suspended holds up no other
        os.kill(ingest, signal.SIGKILL)
        wait_until(lambda: role_of(running.process.pid, "ingest") not in (None, ingest))
        wait_until(lambda: running.ready(), BACK_WITHIN)
        assert running.windows() == windows
    finally:
        running.end(signal.SIGKILL)


def test_metrics_are_of_the_time_at_which_they_are_asked_for(tmp_path, recording):
    with Recording(recording) as opened:
        frames = list(opened.messages())
    running = Service(tmp_path).start()
    try:
        replay(recording, [running.endpoint], 0)  # ends once all is stored
        assert received(running) >= len(frames)
        ingest = role_of(running.process.pid, "ingest")
        os.kill(ingest, signal.SIGSTOP)
        assert received(running) >= len(frames)  # as they were
        os.kill(ingest, signal.SIGCONT)
    finally:
        running.end(signal.SIGKILL)


def test_a_role_that_alone_was_sent_a_signal_to_end_is_started_again(tmp_path):
    running = Service(tmp_path).start()
    try:
        before = role_of(running.process.pid, "answer")
        os.kill(before, signal.SIGTERM)
        wait_until(lambda: role_of(running.process.pid, "answer") not in (None, before))
        wait_until(lambda: running.ready(), BACK_WITHIN)
        assert running.end()[0] == 0
    finally:
        running.end(signal.SIGKILL)
