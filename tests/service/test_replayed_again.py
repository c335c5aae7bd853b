"""Recordings that a service cannot store whole: status and counts of `replay` are what REST shows, restarted or not."""

from __future__ import annotations

import dataclasses
import random
import re

import numpy as np
import pytest
from service_streams import service, wait_until, write_recording

from service.cli import run
from service.stream.sources.mcap import Recording
from service.stream.sources.mcap_write import RecordingWriter
from service.stream.wire.codec import decode, encode

DAY = 86_400.0
COUNTS = {"conflict": 20, "past": 10, "undated": 10}


def rewritten(path, change=lambda number, frame: frame, **metadata):
    """The recording with each frame changed, and other metadata; how many frames it has."""
    with Recording(path) as recording:
        raws, rig, about = list(recording.messages()), recording.rig_text, dict(recording.metadata)
    with RecordingWriter(path, rig_text=rig, metadata=about | metadata) as writer:
        for number, raw in enumerate(raws):
            frame = change(number, decode(raw.channel, raw.payload))
            writer.write(raw.channel, frame.end_time_ns, encode(frame))
    return len(raws)


class Stored:
    """What a service has, and what replays to it say."""

    def __init__(self, running, folder, capsys):
        self.running, self.path, self.capsys = running, folder / "again.mcap", capsys
        self.windows = 2

    def replayed(self):
        """Exit status and the last line of a replay."""
        self.capsys.readouterr()
        status = run(["replay", str(self.path), "--connect", self.running.endpoint, "--speed", "0"])
        lines = self.capsys.readouterr().err.strip().splitlines()
        return status, lines[-1] if lines else ""

    def conflict(self, rng):
        """Some frames of stored windows differ; every other recording goes on with a window that is new."""
        windows = self.windows + rng.randrange(2)
        write_recording(self.path, windows)
        with Recording(self.path) as recording:
            accel = [i for i, raw in enumerate(recording.messages()) if raw.channel.kind == "accel"]
        own = len(accel) * self.windows // windows
        odd = set(rng.sample(accel[:own], rng.randrange(1, own + 1)))

        def louder(number, frame):
            return dataclasses.replace(frame, values=frame.values * np.float32(3)) if number in odd else frame

        frames = rewritten(self.path, louder)
        self.windows = windows
        return 1, rf"{len(odd)} of {frames} frames are not stored \({len(odd)} conflict: "

    def past(self, rng):
        """A whole recording that begins days before what is stored."""
        windows = rng.randrange(1, 4)
        write_recording(self.path, windows, later=-rng.randrange(2, 3000) * DAY, seed=rng.randrange(99))
        frames = rewritten(self.path)
        return 1, rf"{frames} of {frames} frames are not stored \({frames} past: "

    def undated(self, rng):
        """A recording of which nobody states when it was made."""
        write_recording(self.path, 1, later=rng.randrange(9) * DAY)
        rewritten(self.path, started="")
        return 2, r"when it was recorded is not known; import it again with --started"


@pytest.mark.slow
def test_what_of_a_recording_is_not_stored_is_counted_and_no_window_is_shown_that_was_not(tmp_path, capsys):
    rng = random.Random(35)
    kinds = [kind for kind, count in COUNTS.items() for _ in range(count)]
    with service(tmp_path / "data") as running:
        write_recording(tmp_path / "first.mcap", 2)
        assert run(["replay", str(tmp_path / "first.mcap"), "--connect", running.endpoint, "--speed", "0"]) == 0
        stored = Stored(running, tmp_path, capsys)
        running.wait_for_windows(stored.windows)
        for restarted in (False, True):
            if restarted:
                running.end()
                running.start()
            rng.shuffle(kinds)
            for kind in kinds:
                expected, sentence = getattr(stored, kind)(rng)
                status, said = stored.replayed()
                assert status == expected and re.search(sentence, said), (kind, status, said)
                running.wait_for_windows(stored.windows)
                shown = running.windows()
                assert len(shown) == stored.windows
                assert [w["start_time"] for w in shown] == sorted(w["start_time"] for w in shown)
                wait_until(lambda: running.get("/v1/assets/unsw/position")["backlog"] == 0)
