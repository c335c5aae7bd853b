"""What a stream can make the service hold is bounded, whatever its frames claim."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from streams import ACCEL, ASSET, T0, TORQUE, bursts, content, unbroken

from service.errors import FrameError
from service.stream.assembly import AssemblySettings
from service.stream.frames import NS, EncoderFrame, SampleFrame
from service.stream.windows import Windows
from service.stream.wire import gearbox_pb2 as pb
from service.stream.wire.codec import decode
from service.stream.wire.topics import Channel

MEGABYTE = 10**6


def frame(channel, start, rate, size, sequence):
    return SampleFrame(
        channel=channel,
        start_time_ns=T0 + round(start * NS),
        sequence=sequence,
        sample_rate=rate,
        values=np.zeros(size, np.float32),
    )


def peak(work):
    """What a piece of work allocates at most [bytes], and its result."""
    tracemalloc.start()
    try:
        result = work()
        return tracemalloc.get_traced_memory()[1], result
    finally:
        tracemalloc.stop()


@pytest.mark.slow
def test_frames_that_claim_100_megahertz_are_refused_before_a_window_is_laid_out():
    """Two such frames, 8 s apart with torque between them, once took 14.7 GB."""

    def attack():
        assembler, refused = Windows(), 0
        for i, start in enumerate((0.0, 8.0)):
            payload = pb.SampleFrame(
                start_time_ns=T0 + round(start * NS), sample_rate_hz=1e8, sequence=i, values=np.ones(1_000_000, "f4")
            ).SerializeToString()
            try:
                assembler.add(decode(ACCEL, payload))
            except FrameError as error:
                assert "sample_rate_hz = 1e+08 is outside (0, 1e+06] Hz" in str(error)
                refused += 1
        for i in range(32):
            assembler.add(frame(TORQUE, 0.25 * i, 200.0, 50, i))
        return refused, assembler.flush()

    most, (refused, windows) = peak(attack)
    assert refused == 2 and len(windows) == 1
    assert most < 60 * MEGABYTE


def test_a_channel_of_few_samples_at_a_huge_rate_is_left_out_with_one_reason():
    def attack():
        assembler = Windows(AssemblySettings(length=100.0))
        for i in range(240):
            assembler.add(frame(TORQUE, 0.5 * i, 200.0, 100, i))
        for i, start in enumerate((0.0, 110.0)):
            assembler.add(frame(ACCEL, start, 1e6, 10_000, i))
        return assembler, assembler.flush()

    most, (assembler, (window,)) = peak(attack)
    assert most < 20 * MEGABYTE
    assert "y6" not in window.accelerations and "pinion" in window.torques
    (fault,) = [f for f in window.faults if f.kind == "too_large"]
    assert (fault.channel, fault.count, fault.action) == ("accel/y6", 2, "degraded")
    assert "1.1e+08 samples at 1e+06 Hz, of which 20000 have come" in fault.detail
    assert assembler.counters["accel/y6"]["too_large"] == 2


def test_a_window_holds_no_more_frames_than_it_may_and_says_so():
    def attack():
        assembler = Windows(AssemblySettings(length=10.0, window_bytes=4 * MEGABYTE))
        for i in range(60):
            for sensor in range(40):
                assembler.add(frame(Channel(ASSET, "accel", f"s{sensor}"), 0.25 * i, 40_000.0, 10_000, i))
        return assembler, assembler.flush()

    most, (assembler, windows) = peak(attack)
    assert most < 150 * MEGABYTE  # frames that wait to be put in order have a bound of their own
    assert all(sum(s.values.nbytes for s in w.accelerations.values()) <= 4 * MEGABYTE for w in windows)
    assert sum(kinds.get("too_large", 0) for kinds in assembler.counters.values()) > 1000


def test_edges_that_jump_ahead_in_small_steps_make_no_huge_gap():
    channel = Channel(ASSET, "encoder", "pinion")

    def attack():
        assembler = Windows()
        for i in range(400):
            assembler.add(
                EncoderFrame(
                    channel=channel,
                    start_time_ns=T0 + i * 10_000_000,
                    sequence=i,
                    edges_per_rev=64,
                    first_edge_index=i * 8000,
                    edge_offsets_ns=np.arange(10) * 1e6,
                )
            )
        return assembler.flush()

    most, (window,) = peak(attack)
    assert most < 10 * MEGABYTE
    assert window.encoders == {} and "reversed" in {f.kind for f in window.faults}


@pytest.mark.parametrize("stream", [bursts(3), unbroken(25.0)])
def test_the_bounds_change_nothing_in_an_ordinary_stream(stream):
    def windows(settings):
        assembler = Windows(settings)
        return [w for f in stream for w in assembler.add(f)] + assembler.flush()

    assert content(windows(AssemblySettings(window_bytes=10**12))) == content(windows(AssemblySettings()))
