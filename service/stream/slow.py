"""Slow channels (an oil temperature): one value a window, never waited for.

A window shows the summary of the values whose times lie in it and that have come by its end; where none has, the last
known value with its age. Slow frames neither open nor end a window.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from service.stream import order
from service.stream.channels import kind_of
from service.stream.frames import NS, SampleFrame
from service.stream.samples import Span
from twin.windows import Fault, SlowValue

_MOST_BYTES = 2**20  # of one channel's frames held for windows to come; beyond, the oldest are given up


@dataclass(slots=True)
class _Slow:
    """One channel: frames of windows to come, and the newest value before them."""

    frames: list[SampleFrame] = field(default_factory=list)  # by start
    bytes: int = 0
    last: tuple[int, float] | None = None  # Unix time [ns] and value, in SI


class SlowChannels:
    """The slow channels of one asset, by label."""

    def __init__(self) -> None:
        self._channels: dict[str, _Slow] = {}

    def offer(self, frame: SampleFrame) -> str:
        """Takes one frame in; answers what became of it."""
        channel = self._channels.setdefault(frame.channel.label, _Slow())
        newest = channel.last[0] if channel.last else -1
        if frame.end_time_ns <= newest or any(f.start_time_ns == frame.start_time_ns for f in channel.frames):
            return order.DUPLICATE
        channel.frames.append(frame)
        channel.frames.sort(key=lambda f: f.start_time_ns)
        channel.bytes += frame.nbytes
        while channel.bytes > _MOST_BYTES:
            oldest = channel.frames.pop(0)
            channel.bytes -= oldest.nbytes
            self._take_over(channel, *_values(oldest, []))
        return order.QUEUED

    def at(self, span: Span, faults: list[Fault]) -> dict[str, SlowValue]:
        """The values of a window by label; what it has used is forgotten."""
        found = {}
        for label, channel in sorted(self._channels.items()):
            before = [f for f in channel.frames if f.start_time_ns < span.end_ns]
            times, values = _joined(before, faults)
            inside = values[(times >= span.start_ns) & (times < span.end_ns)]
            past = times < span.end_ns
            self._take_over(channel, times[past], values[past])
            channel.frames = [f for f in channel.frames if f.end_time_ns >= span.end_ns]
            channel.bytes = sum(f.nbytes for f in channel.frames)
            if channel.last is not None:
                summary = float(kind_of(label).summary(inside)) if inside.size else channel.last[1]
                age = (span.end_ns - channel.last[0]) / NS
                found[label] = SlowValue(value=summary, count=int(inside.size), age=age)
        return found

    def to_dict(self) -> dict[str, Any]:
        """The last known values, JSON-safe."""
        return {label: list(c.last) for label, c in self._channels.items() if c.last is not None}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> SlowChannels:
        self = cls()
        for label, (time, value) in data.items():
            self._channels[label] = _Slow(last=(int(time), float(value)))
        return self

    @staticmethod
    def _take_over(channel: _Slow, times: np.ndarray, values: np.ndarray) -> None:
        if times.size and (channel.last is None or times[-1] > channel.last[0]):
            channel.last = (int(times[-1]), float(values[-1]))


def _joined(frames: list[SampleFrame], faults: list[Fault]) -> tuple[np.ndarray, np.ndarray]:
    """Times [ns] and usable values in SI of some frames, in order of time."""
    parts = [_values(frame, faults) for frame in frames]
    times = np.concatenate([np.empty(0, dtype=np.int64), *(t for t, _ in parts)])
    values = np.concatenate([np.empty(0), *(v for _, v in parts)])
    by_time = np.argsort(times, kind="stable")
    return times[by_time], values[by_time]


def _values(frame: SampleFrame, faults: list[Fault]) -> tuple[np.ndarray, np.ndarray]:
    """Times [ns] and usable values in SI of one frame."""
    kind = kind_of(frame.channel.label)
    values = frame.doubles
    low, high = kind.values
    usable = (values >= low) & (values <= high)  # NaN is neither
    if not usable.all():
        count = int(np.count_nonzero(~usable))
        detail = f"values outside [{low:g}, {high:g}] {kind.unit}, or not finite, were left out"
        faults.append(
            Fault(kind="out_of_range", channel=frame.channel.label, count=count, action="repaired", detail=detail)
        )
    times = frame.start_time_ns + np.round(np.arange(values.size) / frame.sample_rate * NS).astype(np.int64)
    return times[usable], values[usable] + kind.si_offset
