"""What of a recording is not stored is told, and the command fails: conflicts, the past, the future."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from streams import ACCEL, ASSET, T0, bursts, content
from test_delivery import Stand, stored

from service.errors import DeliveryError, InputError
from service.runtime.replay import replay
from service.stream.frames import NS
from service.stream.sources.mcap_write import RecordingWriter
from service.stream.wire.codec import encode

DAY = 86400 * NS


class Replayed(Stand):
    """A service that frames are replayed to, each from a session that asks what is stored."""

    def __init__(self, **given):
        super().__init__(**given)
        self.declared = []

    def declare(self, channels):
        self.declared = channels

    def arrive(self, frame):
        from service.stream.wire.topics import topic_of

        self.inbox.offer(topic_of(frame.channel), frame.payload, "a-session/1")
        self.positions.moved(ASSET)

    def start(self):
        super().start()
        self.pump._asks = lambda sender: sender == "a-session"


@pytest.fixture
def replayed(tmp_path):
    """Replays frames; how many are stored, or what is told."""
    from contextlib import nullcontext

    def run(stand, frames, name="a", **given):
        path = tmp_path / f"{name}.mcap"
        with RecordingWriter(path) as writer:
            for frame in frames:
                writer.write(frame.channel, frame.end_time_ns, encode(frame))
        import service.runtime.replay as module
        from service.runtime.delivery import Delivery

        def on_its_clock(publisher, **each):
            return Delivery(publisher, **each, clock=lambda: stand.now, sleep=stand.sleep)

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(module, "Delivery", on_its_clock)
            return replay(path, ["tcp/x"], 0, publish_to=lambda *_: nullcontext(stand), **given)

    return run


def moved(frames, by, numbered=0):
    return [dataclasses.replace(f, start_time_ns=f.start_time_ns + by, sequence=f.sequence + numbered) for f in frames]


def louder(frames):
    return [dataclasses.replace(f, values=f.values * np.float32(3)) if f.channel.kind == "accel" else f for f in frames]


@pytest.fixture(params=[False, True], ids=["", "after a restart"])
def restarted(request):
    return lambda stand: stand.start() if request.param else None


def test_frames_that_differ_from_stored_ones_are_conflicts_in_all_counts(replayed, restarted):
    """60 of 84 frames that differed were once called duplicates, and the command ended well."""
    stand, frames = Replayed(), bursts(3, frames=30)
    assert replayed(stand, frames) == len(frames)
    restarted(stand)
    accel = sum(f.channel == ACCEL for f in frames)
    with pytest.raises(DeliveryError, match=rf"^{accel} of {len(frames)} frames are not stored \({accel} conflict: "):
        replayed(stand, louder(frames))
    assert stored(stand) == content([o.window for o in stand.committed[:3]])


def test_the_same_recording_again_is_stored_already(replayed, restarted):
    stand, frames = Replayed(), bursts(3, frames=30)
    replayed(stand, frames)
    restarted(stand)
    assert replayed(stand, frames) == len(frames)
    assert len(stand.committed) == 3


@pytest.mark.parametrize("by", [-DAY, -3000 * DAY])
@pytest.mark.parametrize("numbered", [0, 10_000])
def test_a_recording_of_the_past_never_becomes_the_latest(replayed, restarted, by, numbered):
    """It once was taken for a clock that had been set back, and became the latest window."""
    stand, frames = Replayed(), bursts(2, frames=20)
    replayed(stand, frames)
    before = stored(stand)
    restarted(stand)
    with pytest.raises(DeliveryError, match=r"^160 of 160 frames are not stored \(160 past: .* before what is stored"):
        replayed(stand, moved(frames, by, numbered))
    assert stored(stand) == before


def test_a_recording_between_the_windows_of_another_is_told_and_left_out(replayed, restarted):
    stand, frames = Replayed(), bursts(3, frames=12, pause=60.0)
    replayed(stand, frames)
    before = stored(stand)
    restarted(stand)
    with pytest.raises(DeliveryError, match=r"^48 of 48 frames are not stored"):
        replayed(stand, moved(bursts(1, frames=12), 30 * NS, 5000))
    assert stored(stand) == before


def test_a_later_recording_is_stored_whole_though_its_numbers_begin_anew(replayed, restarted):
    stand, frames = Replayed(), bursts(2, frames=20)
    replayed(stand, frames)
    restarted(stand)
    assert replayed(stand, moved(frames, DAY)) == len(frames)
    assert len(stand.committed) == 4


def test_too_few_frames_of_a_time_far_away_are_told(replayed):
    """A piece of 500 days later was left out without a word."""
    stand, frames = Replayed(), bursts(1, frames=20)
    replayed(stand, frames)
    with pytest.raises(DeliveryError, match=r"^8 of 8 frames are not stored \(8 time_jump"):
        replayed(stand, moved(bursts(1, frames=2), 500 * DAY, 1000))


def test_a_recording_of_the_future_is_refused_with_its_date(replayed):
    stand = Replayed()
    until = (T0 - DAY) / NS
    with pytest.raises(InputError, match="begins at 2023-11-14 22:13:20 UTC, which is in the future"):
        replayed(stand, bursts(1), until=until)
    assert stand.committed == [] and json.dumps(stand.published) == "[]"
