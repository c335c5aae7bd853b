"""Frames of times for which frames have already been used: the same ones again, or those of something else.

A recording that is replayed once more is left out frame by frame, as it should be. Frames of another machine, or of a
recording made earlier, may lie at the same times; they would be left out just as silently. So the content of a few used
frames of every key is remembered by a checksum: of the first ones, of the latest, and of every eighth before those, so
that a part of a stream that a publisher sends again after its link was lost is recognised wherever it begins.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any
from zlib import crc32

from service.stream.frames import EncoderFrame, Frame
from twin.thresholds import deciding

Mark = tuple[int, int, int]  # start [ns], sequence, checksum
FIRST, LATEST = 4, 12  # frames of a key that are remembered
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

    marks: dict[str, list[Mark]] = field(default_factory=dict)  # by channel
    run: int = 0  # frames left out in a row
    same: int = 0  # of them, those that are the very frames that were used
    other: int = 0  # of them, those that are not, though their number and time are those of a used frame
    verdicts: dict[str, bool] = field(default_factory=dict)  # by channel: whether its latest one of the run was other
    ignored: bool = False  # whether people have said that the run is of no interest

    def used(self, label: str, frames: Sequence[Frame]) -> None:
        """Frames of one channel have gone into a window, one after the other; those between need no checksum."""
        marks = self.marks.setdefault(label, [])
        first = frames[: max(FIRST - len(marks), 0)]
        rest = frames[len(first) :]
        place = crc32(label.encode())  # so that not every key's remembered frames are of the same time
        between = [frame for frame in rest[:-LATEST] if _remembered(frame.sequence, place)]
        kept = (*first, *between, *rest[-LATEST:])
        marks += [(frame.start_time_ns, frame.sequence, checksum(frame)) for frame in kept]
        if len(marks) > FIRST + LATEST:
            marks[FIRST:-LATEST] = [mark for mark in marks[FIRST:-LATEST] if _remembered(mark[1], place)][-BETWEEN:]

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
        wanted = frame.start_time_ns, frame.sequence
        return next((kept for *mark, kept in self.marks.get(frame.channel.label, ()) if tuple(mark) == wanted), None)

    def suspicious(self, limits: RepeatThresholds = DEFAULT) -> int:
        """How many frames in a row were left out that are not the used ones again; 0 where there is no such sign."""
        if self.ignored or self.run < limits.run or (self.same and not self.other):
            return 0
        return self.run

    def to_dict(self) -> dict[str, list[list[int]]]:
        """What outlives a restart, JSON-safe."""
        return {label: [list(mark) for mark in marks] for label, marks in self.marks.items()}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Repeats:
        marks = {label: [(int(a), int(b), int(c)) for a, b, c in found] for label, found in data.items()}
        return cls(marks=marks)


def _remembered(sequence: int, place: int) -> bool:
    return (sequence + place) % EVERY == 0


def checksum(frame: Frame) -> int:
    """A number that differs where frames differ."""
    if isinstance(frame, EncoderFrame):
        return crc32(frame.edge_offsets_ns.tobytes(), frame.first_edge_index & 0xFFFFFFFF)
    return crc32(frame.values.tobytes())
