"""Frames over a link that loses, repeats and disorders datagrams: sent again in time, or named as lost."""

from __future__ import annotations

import json
import signal

import fake_twin
import pytest
from lossy_link import LossyLink
from service_streams import Service, free_port, wait_until, write_recording
from test_lost_links import ended, replaying

from service.json_text import plain
from service.runtime.assess import assess

WINDOWS = 8


@pytest.mark.slow
@pytest.mark.parametrize(("loss", "repeated", "late"), [(0.0, 0.2, 0.2), (0.05, 0.05, 0.05)])
def test_frames_that_the_link_loses_are_sent_again_or_named(tmp_path, loss, repeated, late):
    recording = write_recording(tmp_path / "campaign.mcap", WINDOWS)
    assessed = plain(assess(recording, twin=fake_twin.TWIN))
    port = free_port()
    listen = json.dumps([f"udp/127.0.0.1:{port}"])
    running = Service(tmp_path / "data", LISTEN=listen, IDLE_TIMEOUT="20").start()
    with LossyLink(port, free_port(), loss=loss, repeated=repeated, late=late, seed=4) as link:
        sending = replaying(recording, link.endpoint, speed=1.0)
        try:
            wait_until(lambda: running.get("/v1/assets/unsw") is not None)
            link.bad = True
            status, out, err = ended(sending, 150.0)
            windows = running.wait_for_windows(WINDOWS)
            if status == 0:
                assert "256 frames stored" in out, err
                assert windows == assessed["windows"]
            else:
                # Zenoh leaves out a datagram that another has overtaken, and sixteen frames of the channel came in good
                # order before the one that was sent again: so it is with both links where the machine is busy.
                assert status == 1 and " of 256 frames are not stored (" in err, err
                assert any(fault["kind"] == "gap" for window in windows for fault in window["faults"])
            assert link.passed > 300 and (link.dropped > 0) == (loss > 0)
        finally:
            sending.kill()
            print(link.passed, link.dropped, *running.end(signal.SIGKILL), sep="\n")
