"""Frames of times for which frames have already been used: the same ones again, or those of something else.

A recording that is replayed once more is left out frame by frame, as it should be. Frames of another machine, or of a
recording made earlier, may lie at the same times; they would be left out just as silently. So the content of used
frames of every key is remembered by a checksum: of the first ones, of the latest, which are the recording that may be
sent again and be counted frame by frame, and of every eighth before those, so that a part of a stream that a publisher
sends again after its link was lost is recognised wherever it begins.
"""

from __future__ import annotations

from base64 import b64decode, b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any
from zlib import compress, crc32, decompress

import numpy as np

from service.stream.frames import EncoderFrame, Frame
from twin.thresholds import deciding

Marks = np.ndarray[Any, np.dtype[np.uint64]]  # start [ns], sequence and checksum of remembered frames (n, 3)
FIRST, LATEST = 4, 256  # frames of a key that are remembered
NONE: Marks = np.empty((0, 3), dtype=np.uint64)
EVERY, BETWEEN = 8, 16  # of the frames between, every eighth is remembered, so many at most


@dataclass(frozen=True, slots=True, kw_only=True)
class RepeatThresholds:
    """When frames that are left out are another machine's."""

    run: int = deciding(
        64,
        unit="frames",
        meaning="frames of all keys in a row that are left out because of their time, from which people are asked",
        source="not derived: several seconds of a stream, and less than one measurement window of four keys",
    )


DEFAULT = RepeatThresholds()


@dataclass(slots=True)
class Repeats:
    """What is remembered of used frames, and the frames that have been left out since the latest that was used."""

    marks: dict[str, Marks] = field(default_factory=dict)  # by channel
    run: int = 0  # frames left out in a row
    same: int = 0  # of them, those that are the very frames that were used
    other: int = 0  # of them, those that are not, though their number and time are those of a used frame
    verdicts: dict[str, bool] = field(default_factory=dict)  # by channel: whether its latest one of the run was other
    ignored: bool = False  # whether people have said that the run is of no interest

    def used(self, label: str, frames: Sequence[Frame]) -> None:
        """Frames of one channel have gone into a window, one after the other; those between need no checksum."""
        before = self.marks.get(label, NONE)
        first = frames[: max(FIRST - len(before), 0)]
        rest = frames[len(first) :]
        place = crc32(label.encode())  # so that not every key's remembered frames are of the same time
        between = [frame for frame in rest[:-LATEST] if _remembered(frame.sequence, place)]
        kept = [(f.start_time_ns, f.sequence, checksum(f)) for f in (*first, *between, *rest[-LATEST:])]
        marks = np.concatenate((before, np.array(kept, dtype=np.uint64).reshape(-1, 3)))
        if len(marks) > FIRST + LATEST:
            older = [mark for mark in marks[FIRST:-LATEST] if _remembered(int(mark[1]), place)][-BETWEEN:]
            marks = np.concatenate((marks[:FIRST], np.reshape(older, (-1, 3)).astype(np.uint64), marks[-LATEST:]))
        self.marks[label] = marks

    def queued(self) -> None:
        """A frame of a new time has come: the run is over."""
        self.run = self.same = self.other = 0
        self.verdicts.clear()
        self.ignored = False

    def left_out(self, frame: Frame, held: Frame | None = None) -> bool:
        """A frame has been left out because of its time; whether it is another than the one of its number.

        One of which no checksum is remembered is what the one before it was.

        held  the frame of its time and number that is yet to be used
        """
        self.run += 1
        kept = checksum(held) if held is not None else self._mark(frame)
        if kept is None:
            return self.verdicts.get(frame.channel.label, False)
        same = kept == checksum(frame)
        self.same, self.other = self.same + same, self.other + (not same)
        self.verdicts[frame.channel.label] = not same
        return not same

    def _mark(self, frame: Frame) -> int | None:
        """What is remembered of the used frame of a time and number."""
        marks = self.marks.get(frame.channel.label, NONE)
        same = (marks[:, 0] == np.uint64(frame.start_time_ns)) & (marks[:, 1] == np.uint64(frame.sequence))
        return int(marks[same.argmax(), 2]) if same.any() else None

    def suspicious(self, limits: RepeatThresholds = DEFAULT) -> int:
        """How many frames in a row were left out that are not the used ones again; 0 where there is no such sign."""
        if self.ignored or self.run < limits.run or (self.same and not self.other):
            return 0
        return self.run

    def to_dict(self) -> dict[str, str]:
        """What outlives a restart, JSON-safe."""
        return {label: _packed(marks) for label, marks in self.marks.items()}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Repeats:
        return cls(marks={label: _marks(found) for label, found in data.items()})


def _packed(marks: Marks) -> str:
    """Marks as a text: starts and numbers by their second differences, which are few where a stream is even."""
    steps = np.diff(marks[:, :2], n=2, axis=0, prepend=np.zeros((2, 2), dtype=np.uint64))
    return b64encode(compress(steps.tobytes() + marks[:, 2].astype("<u4").tobytes(), 1)).decode()


def _marks(found: str) -> Marks:
    """The marks of a text that `_packed` made."""
    raw = decompress(b64decode(found))
    steps = np.frombuffer(raw, dtype=np.uint64, count=2 * (len(raw) // 20)).reshape(-1, 2)
    columns = np.cumsum(np.cumsum(steps, axis=0, dtype=np.uint64), axis=0, dtype=np.uint64)
    sums = np.frombuffer(raw, dtype="<u4", offset=steps.nbytes).astype(np.uint64)
    return np.column_stack((columns, sums))


def _remembered(sequence: int, place: int) -> bool:
    return (sequence + place) % EVERY == 0


def checksum(frame: Frame) -> int:
    """A number that differs where frames differ."""
    if isinstance(frame, EncoderFrame):
        return crc32(frame.edge_offsets_ns.tobytes(), frame.first_edge_index & 0xFFFFFFFF)
    return crc32(frame.values.tobytes())
