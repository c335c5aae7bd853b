"""A recording of any length from a bundled one: its last measurement window, again and again.

The rig turns on between two copies: by 52 turns of the pinion and 19 of the gear, after which the same teeth meet at
the same encoder edges, so that each copy is what the machine would have given had it not worn. Accelerations are
resampled to twice their rate, 25.6 kHz.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.signal import resample_poly

from service.stream.frames import NS, EncoderFrame, Frame, SampleFrame
from service.stream.sources.mcap import Recording
from service.stream.sources.mcap_write import RecordingWriter
from service.stream.wire.codec import encode

SOURCE = Path(__file__).parents[1] / "recordings" / "short-campaign.mcap"
TURNS = {"pinion": 52, "gear": 19}
PAUSE = 1.5  # least pause between two windows [s]: it ends a burst


def bursts(frames: Iterable[Frame]) -> list[list[Frame]]:
    """The frames by measurement window, in order of time."""
    out: list[list[Frame]] = []
    end = 0
    for frame in sorted(frames, key=lambda f: f.start_time_ns):
        if not out or frame.start_time_ns > end + NS:
            out.append([])
        out[-1].append(frame)
        end = max(end, frame.end_time_ns)
    return out


def at_twice_the_rate(burst: list[Frame]) -> list[Frame]:
    """The burst with its accelerations at twice the rate."""
    kept = [f for f in burst if f.channel.kind != "accel"]
    for channel in {f.channel for f in burst if f.channel.kind == "accel"}:
        frames = [f for f in burst if f.channel == channel and isinstance(f, SampleFrame)]
        values = resample_poly(np.concatenate([f.values for f in frames]).astype(float), 2, 1)
        ends = 2 * np.cumsum([f.values.size for f in frames])
        for frame, part in zip(frames, np.split(values, ends[:-1]), strict=True):
            kept.append(replace(frame, sample_rate=2 * frame.sample_rate, values=part.astype(np.float32)))
    return sorted(kept, key=lambda f: f.end_time_ns)


def repeated(burst: list[Frame], seconds: float) -> Iterator[Frame]:
    """Copies of one burst until they hold so many seconds of signal."""
    length = max(f.end_time_ns for f in burst) - burst[0].start_time_ns
    counts = {f.channel: sum(g.channel == f.channel for g in burst) for f in burst}
    speed = next(_speed(f) for f in burst if isinstance(f, EncoderFrame) and f.channel.label == "encoder/pinion")
    turns = TURNS["pinion"] * int(np.ceil((length / NS + PAUSE) * speed / TURNS["pinion"]))
    period = round(turns / speed * NS)
    for copy in range(1, 1 + int(np.ceil(seconds * NS / length))):
        for frame in burst:
            start = frame.start_time_ns + copy * period
            sequence = frame.sequence + copy * counts[frame.channel]
            if isinstance(frame, EncoderFrame):
                shaft = TURNS[frame.channel.label.partition("/")[2]] * turns // TURNS["pinion"]
                first = frame.first_edge_index + copy * shaft * frame.edges_per_rev
                yield replace(frame, start_time_ns=start, sequence=sequence, first_edge_index=first)
            else:
                yield replace(frame, start_time_ns=start, sequence=sequence)


def _speed(frame: EncoderFrame) -> float:
    offsets = frame.edge_offsets_ns
    return (offsets.size - 1) / frame.edges_per_rev / ((offsets[-1] - offsets[0]) / NS)


def write_long_recording(path: Path, seconds: float) -> None:
    """The source's campaign, then its last window for so many seconds of signal."""
    with Recording(SOURCE) as recording:
        campaign = [at_twice_the_rate(b) for b in bursts(recording.frames(_refuse))]
        rig_text, metadata = recording.rig_text, recording.metadata
    with RecordingWriter(path, rig_text=rig_text, metadata=metadata) as writer:
        for burst in campaign:
            for frame in burst:
                writer.write(frame.channel, frame.end_time_ns, encode(frame))
        for frame in repeated(campaign[-1], seconds):
            writer.write(frame.channel, frame.end_time_ns, encode(frame))


def _refuse(channel: object, error: Exception) -> None:
    raise error
