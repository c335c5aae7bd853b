"""Frames: what one key carried in 0.01 to 10 s, as frozen data, within the contract's limits and its kind's.

Values keep the precision they had on the wire (float32 samples, float64 edge offsets). NaN among
samples is allowed here: it is a fault of the data, counted when the window is built, not of the frame.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field

import numpy as np

from service.errors import FrameError
from service.stream.channels import CHANNEL_KINDS
from service.stream.wire.topics import Channel, topic_of

NS = 1_000_000_000
LENGTH_LIMITS = (0.01, 10.0)  # of a frame [s]
_LENGTH_SLACK = 1e-6  # relative: a rate such as 25641.03 Hz cannot give 10 s exactly
_UINT64 = 2**64
LATEST_START = 2**63 - 86_400 * NS  # the first Unix time that is none [ns]: a day later numbers of 64 bits end


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SampleFrame:
    """Evenly sampled values of one channel, in its kind's unit."""

    channel: Channel
    start_time_ns: int  # Unix time of the first sample [ns]
    sequence: int
    sample_rate: float  # [Hz]
    values: np.ndarray  # (n,) float32
    end_time_ns: int = field(init=False)  # one sample after the last [ns]; of a slow channel, of the last
    payload: bytes | None = field(init=False, default=None)  # as it came, which the values lie in

    def __post_init__(self) -> None:
        _check_head(self.channel, self.start_time_ns, self.sequence)
        kind = CHANNEL_KINDS[self.channel.kind]
        _within(self.channel, "sample_rate_hz", self.sample_rate, *kind.rate, "Hz")
        if self.values.ndim != 1 or self.values.size == 0:
            raise _error(self.channel, "values", "nothing", "must hold at least one value")
        length, (low, high) = self.values.size / self.sample_rate, LENGTH_LIMITS
        if kind.slow:  # each value is that of an instant, and one alone may stand for any time
            length, low = (self.values.size - 1) / self.sample_rate, 0.0
        if not low * (1 - _LENGTH_SLACK) <= length <= high * (1 + _LENGTH_SLACK):
            raise _error(
                self.channel,
                "values",
                f"{self.values.size} at {self.sample_rate:g} Hz = {length:g} s",
                f"must cover {low:g} to {high:g} s; a wrong sample_rate_hz?",
            )
        object.__setattr__(self, "end_time_ns", self.start_time_ns + round(length * NS))

    @property
    def doubles(self) -> np.ndarray:
        """The values as float64, (n,); a signalling NaN is one like any other."""
        with np.errstate(invalid="ignore"):
            return self.values.astype(float)

    @property
    def nbytes(self) -> int:
        return self.values.nbytes + 200


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EncoderFrame:
    """Times at which the edges of one shaft encoder passed."""

    channel: Channel
    start_time_ns: int  # Unix time at which the frame starts [ns]
    sequence: int
    edges_per_rev: int
    first_edge_index: int  # edges counted before this frame's first, since the gears were new
    edge_offsets_ns: np.ndarray  # (n,) float64, after start_time_ns [ns]
    end_time_ns: int = field(init=False)  # of the last edge [ns]; the frame's start where no edge passed
    payload: bytes | None = field(init=False, default=None)  # as it came, which the edges lie in

    def __post_init__(self) -> None:
        _check_head(self.channel, self.start_time_ns, self.sequence)
        _within(self.channel, "edges_per_rev", self.edges_per_rev, *CHANNEL_KINDS[self.channel.kind].rate, "edges")
        _within(self.channel, "first_edge_index", self.first_edge_index, -1, _UINT64 - 1, "edges")
        offsets, high = self.edge_offsets_ns, LENGTH_LIMITS[1] * (1 + _LENGTH_SLACK) * NS
        latest = float(offsets.max(initial=0.0)) if offsets.ndim == 1 else np.nan
        if not (latest <= high and offsets.min(initial=0.0) >= 0):  # not of NaN
            bad = offsets[~((offsets >= 0) & (offsets <= high))] if offsets.ndim == 1 else offsets.ravel()
            raise _error(
                self.channel,
                "edge_offset_ns",
                f"{bad[0]:g} ns",
                f"must lie in [0, {high:.3g}] ns; seconds or Unix time?",
            )
        object.__setattr__(self, "end_time_ns", self.start_time_ns + round(latest))

    @property
    def rises(self) -> bool:
        """Whether every edge passed after the one before it; an encoder that runs backwards does not."""
        return bool(np.all(np.diff(self.edge_offsets_ns) > 0))

    @property
    def nbytes(self) -> int:
        return self.edge_offsets_ns.nbytes + 200


Frame = SampleFrame | EncoderFrame


def in_channel(frame: Frame, channel: Channel) -> Frame:
    """A frame, as it came, of another asset's channel."""
    other = copy(frame)
    object.__setattr__(other, "channel", channel)
    return other


def _error(channel: Channel, field: str, value: str, rule: str) -> FrameError:
    return FrameError(f"{topic_of(channel)}: {field} = {value} {rule}")


def _within(channel: Channel, field: str, value: float, above: float, upto: float, unit: str) -> None:
    if not above < value <= upto:  # NaN fails too
        raise _error(channel, field, f"{value:g}", f"is outside ({above:g}, {upto:g}] {unit}")


def _check_head(channel: Channel, start_time_ns: int, sequence: int) -> None:
    if not 0 < start_time_ns < LATEST_START:
        raise _error(
            channel,
            "start_time_ns",
            str(start_time_ns),
            f"is outside (0, {LATEST_START}) ns of Unix time, which ends in April 2262; not set, or not in ns?",
        )
    if not 0 <= sequence < _UINT64:
        raise _error(channel, "sequence", str(sequence), "is outside [0, 2^64)")
