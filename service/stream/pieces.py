"""Pieces of frames: which part of a frame belongs to which window, and the window in progress."""

from __future__ import annotations

import bisect
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import ceil
from typing import Generic, TypeVar

import numpy as np

from service.stream.frames import NS, EncoderFrame, Frame, SampleFrame
from twin.windows import Fault

_SAME_RATE = 1e-5  # relative: a rate measured frame by frame is not a change of rate

F = TypeVar("F", SampleFrame, EncoderFrame, Frame)


@dataclass(frozen=True)
class Piece(Generic[F]):
    """Values `begin` to `end` (exclusive) of one frame, and the frames lost directly before it."""

    frame: F
    begin: int
    end: int
    lost: int = 0

    @property
    def start_ns(self) -> float:
        """Unix time of the piece's first value [ns]."""
        if isinstance(self.frame, EncoderFrame):
            return self.frame.start_time_ns
        return self.frame.start_time_ns + self.begin / self.frame.sample_rate * NS

    @property
    def size(self) -> int:
        return self.end - self.begin


def size_of(frame: Frame) -> int:
    """Number of a frame's values."""
    return frame.values.size if isinstance(frame, SampleFrame) else frame.edge_offsets_ns.size


def split_index(frame: Frame, time_ns: int) -> int:
    """Number of the frame's values that lie before a time."""
    ahead = time_ns - frame.start_time_ns
    if isinstance(frame, EncoderFrame):
        return int(np.searchsorted(np.maximum.accumulate(frame.edge_offsets_ns), ahead)) if ahead > 0 else 0
    return min(max(ceil(ahead / NS * frame.sample_rate - 1e-6), 0), frame.values.size)


def of_one_rate(
    label: str,
    parts: Sequence[Piece[F]],
    value: Callable[[Piece[F]], float],
    unit: str,
    faults: list[Fault],
) -> list[Piece[F]]:
    """The pieces that agree with the rate most values have; the others count as a rate change."""
    sizes: dict[float, int] = {}
    for part in parts:
        sizes[value(part)] = sizes.get(value(part), 0) + part.size + 1
    rate = max(sizes, key=lambda r: (sizes[r], r))
    keep = [p for p in parts if abs(value(p) - rate) <= _SAME_RATE * rate]
    if len(keep) < len(parts):
        others = ", ".join(f"{r:g}" for r in sorted(sizes) if r != rate)
        detail = f"{others} {unit} among {rate:g} {unit}: those frames were left out"
        dropped = len(parts) - len(keep)
        faults.append(Fault(kind="rate_change", channel=label, count=dropped, action="degraded", detail=detail))
    return keep


@dataclass(slots=True)
class OpenWindow:
    """The window in progress."""

    start: int  # [ns]
    end: int  # [ns]
    pieces: dict[str, list[Piece]]
    bytes: int = 0  # of the frames of all pieces
    continued: bool = False  # whether it goes on where a cut ended the window before
    refused: dict[str, int] = field(default_factory=dict)  # frames by channel for which the window had no room

    def held(self, frame: Frame) -> Frame | None:
        """The frame of a frame's time and number."""
        pieces = self.pieces.get(frame.channel.label, ())
        at = bisect.bisect_left(pieces, frame.start_time_ns, key=lambda piece: piece.frame.start_time_ns)
        found = pieces[at].frame if at < len(pieces) else None
        same = found is not None and (found.start_time_ns, found.sequence) == (frame.start_time_ns, frame.sequence)
        return found if same else None

    def faults(self, most: int) -> list[Fault]:
        """The frames for which there was no room."""
        detail = f"frames left out: those of one window exceed {most} bytes; too many channels, or too high a rate?"
        return [
            Fault(kind="too_large", channel=label, count=count, action="degraded", detail=detail)
            for label, count in sorted(self.refused.items())
        ]
