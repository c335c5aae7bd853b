"""Files of windows' frames: what was written comes back, or the file is refused in one way."""

from __future__ import annotations

import random

import numpy as np
import pytest
from segments import made, segment_of
from streams import ACCEL, bursts, frame, unbroken
from test_workers import window

from service.results.segment_file import read_segment, write_segment
from service.stream.assembly import Assembler, AssemblySettings
from service.stream.edge_counts import EncoderCounts
from service.stream.sources.mcap import Recording
from service.stream.window import laid_out
from service.stream.wire.codec import decode, encode
from twin.windows import Fault, SlowValue


def same(one, other):
    for field in ("accelerations", "torques", "encoders"):
        a, b = getattr(one, field), getattr(other, field)
        assert a.keys() == b.keys()
        for name in a:
            for attribute in type(a[name]).__slots__:
                np.testing.assert_array_equal(getattr(a[name], attribute), getattr(b[name], attribute))
    return all(getattr(one, name) == getattr(other, name) for name in ("start_time_ns", "slow", "faults", "quality"))


def closed(frames, **settings):
    """The segments of frames that came as bytes."""
    assembler = Assembler(AssemblySettings(settle=3, **settings))
    came = [decode(each.channel, encode(each)) for each in frames]
    return [s for each in came for s, _ in assembler.assemble(each)] + [s for s, _ in assembler.finish()]


@pytest.mark.parametrize(
    "segments",
    [closed(bursts(3)), closed(unbroken(8.0), length=1.1), closed([f for f in bursts(4) if f.sequence not in (4, 9)])],
    ids=["bursts", "cut frames", "lost frames"],
)
def test_the_window_of_a_file_is_that_of_the_frames_to_the_last_bit(tmp_path, segments):
    here = there = EncoderCounts()
    assert len(segments) >= 3
    for number, segment in enumerate(segments):
        assert write_segment(tmp_path / "one.mcap", segment) == (tmp_path / "one.mcap").stat().st_size
        read = read_segment(tmp_path / "one.mcap")
        one, other = laid_out(segment, None, here), laid_out(read, None, there)
        assert same(one.window, other.window) and one.found == other.found, number
        here, there = one.counts, other.counts
    assert here == there and here.counted


def test_what_the_stream_knew_comes_back_and_payloads_lie_in_the_file_as_they_came(tmp_path):
    sent = frame(ACCEL, 3, 0.75)
    slow = {"temperature/oil": SlowValue(value=341.5, count=3, age=0.2)}
    faults = (Fault(kind="too_large", channel="accel/y6", count=3, action="degraded", detail="3 frames"),)
    segment = segment_of(window(), faults=faults, most=17, slow=slow, known=("accel/y6", "torque/gear"))
    write_segment(tmp_path / "one.mcap", segment)
    read = read_segment(tmp_path / "one.mcap")
    assert (read.span, read.known, read.faults, read.most) == (segment.span, segment.known, faults, 17)
    assert read.slow == segment.slow and not read.left_out
    (sound, *_) = closed([decode(ACCEL, encode(sent))])
    write_segment(tmp_path / "two.mcap", sound)
    with Recording(tmp_path / "two.mcap") as recording:
        assert [each.payload for each in recording.messages()] == [encode(sent)] and not recording.faults


def test_a_window_whose_frames_were_left_out_is_refused_for_that_reason_and_says_nothing_of_channels(tmp_path):
    fault = Fault(kind="shed", channel="all", count=1, action="refused", detail="no room")
    write_segment(tmp_path / "one.mcap", segment_of(window(), known=("accel/y6",)).without_frames(fault))
    found = made(read_segment(tmp_path / "one.mcap"))
    assert found.faults == (fault,) and found.quality == "refused" and not found.accelerations


def test_a_damaged_file_is_refused_as_unreadable_or_gives_what_was_written(tmp_path):
    path = tmp_path / "window.mcap"
    write_segment(path, segment_of(window()))
    sound, data, refused = made(read_segment(path)), path.read_bytes(), 0
    for seed in range(600):
        rng, damaged = random.Random(seed), bytearray(data)
        for _ in range(rng.choice((1, 1, 2, 8))):
            at = rng.randrange(len(damaged)) if rng.random() < 0.5 else -1 - rng.randrange(700)
            damaged[at] ^= 1 << rng.randrange(8)
        path.write_bytes(damaged if rng.random() < 0.9 else damaged[: rng.randrange(len(damaged))])
        try:
            found = read_segment(path)
        except (OSError, ValueError):
            refused += 1
            continue
        assert same(made(found), sound)
    assert refused > 400


def test_a_file_that_is_none_or_of_another_recording_is_refused_as_unreadable(tmp_path):
    path = tmp_path / "window.mcap"
    write_segment(path, segment_of(window()))
    whole = path.read_bytes()
    for content in (b"", b"\x89MCAP0\r\n", bytes(4096), whole[:8] + whole[-60:], whole[: len(whole) // 2]):
        path.write_bytes(content)
        with pytest.raises((OSError, ValueError)):
            read_segment(path)
