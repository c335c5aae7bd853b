"""Streams of frames made for the tests: bursts of all channels of one machine, known exactly."""

from __future__ import annotations

import hashlib
import random
from collections.abc import Iterable, Iterator

import numpy as np

from service.stream.frames import NS, EncoderFrame, Frame, SampleFrame
from service.stream.sources.mcap import RawFrame
from service.stream.wire.topics import Channel

ASSET = "rig-1"
T0 = 1_700_000_000 * NS  # Unix time of the first burst [ns]; a multiple of 10 s
ACCEL, TORQUE = Channel(ASSET, "accel", "y6"), Channel(ASSET, "torque", "pinion")
PINION, GEAR = Channel(ASSET, "encoder", "pinion"), Channel(ASSET, "encoder", "gear")
CHANNELS = (ACCEL, TORQUE, PINION, GEAR)
RATES = {ACCEL: 1000.0, TORQUE: 200.0}
SPEEDS = {PINION: 10.0, GEAR: 4.0}  # [Hz]
EDGES = {PINION: 64, GEAR: 128}  # a revolution
LENGTH = 0.25  # of a frame [s]
FIRST = {ACCEL: 7, TORQUE: 300, PINION: 41, GEAR: 5}  # sequence numbers begin anywhere


def signal(channel: Channel, times: np.ndarray) -> np.ndarray:
    """What a channel measures at times after T0 [s]; different at every sample."""
    scale = {"accel": 5.0, "torque": 0.1}[channel.kind]
    return (scale * np.sin(37.0 * times) + 1e-3 * times + (10.0 if channel is TORQUE else 0.0)).astype(np.float32)


def frame(channel: Channel, number: int, start: float) -> Frame:
    """Frame `number` of a channel, which starts `start` seconds after T0."""
    begin, sequence = T0 + round(start * NS), FIRST[channel] + number
    if channel.kind != "encoder":
        rate = RATES[channel]
        times = start + np.arange(round(LENGTH * rate)) / rate
        return SampleFrame(
            channel=channel, start_time_ns=begin, sequence=sequence, sample_rate=rate, values=signal(channel, times)
        )
    edge_rate = SPEEDS[channel] * EDGES[channel]
    first = int(np.ceil(start * edge_rate - 1e-9))
    count = int(np.ceil((start + LENGTH) * edge_rate - 1e-9)) - first
    offsets = (first + np.arange(count)) / edge_rate - start
    return EncoderFrame(
        channel=channel,
        start_time_ns=begin,
        sequence=sequence,
        edges_per_rev=EDGES[channel],
        first_edge_index=1000 + first,
        edge_offsets_ns=np.maximum(offsets, 0.0) * NS,
    )


def bursts(count: int, frames: int = 6, pause: float = 5.0, channels: tuple[Channel, ...] = CHANNELS) -> list[Frame]:
    """All frames of `count` bursts of `frames` each, in the order in which they end."""
    out = []
    for burst in range(count):
        for i in range(frames):
            start = burst * (frames * LENGTH + pause) + i * LENGTH
            out += [frame(channel, burst * frames + i, start) for channel in channels]
    return out


def unbroken(seconds: float, channels: tuple[Channel, ...] = CHANNELS) -> list[Frame]:
    """All frames of a stream without a pause."""
    return bursts(1, round(seconds / LENGTH), channels=channels)


def _digest(values: np.ndarray) -> str:
    return hashlib.sha256(values.tobytes()).hexdigest()[:16]


def content(windows) -> list:
    """Windows as comparable data, the arrays by their digest so that a difference can be read."""
    return [
        (
            window.start_time_ns,
            window.quality,
            window.faults,
            {k: (s.rate, s.start, s.values.size, _digest(s.values)) for k, s in window.accelerations.items()},
            {k: (s.rate, s.start, s.values.size, _digest(s.values)) for k, s in window.torques.items()},
            {k: (e.per_rev, e.first_index, e.times.size, _digest(e.times)) for k, e in window.encoders.items()},
        )
        for window in windows
    ]


def twice(frames: Iterable[RawFrame]) -> Iterator[RawFrame]:
    """Every frame two times in a row."""
    for frame in frames:
        yield frame
        yield frame


def shuffled(frames: Iterable[RawFrame], horizon: int, seed: int = 0) -> Iterator[RawFrame]:
    """Frames in disorder: each taken at random from the next `horizon`."""
    rng, waiting = random.Random(seed), []
    for frame in frames:
        waiting.append(frame)
        if len(waiting) >= horizon:
            yield waiting.pop(rng.randrange(len(waiting)))
    rng.shuffle(waiting)
    yield from waiting
