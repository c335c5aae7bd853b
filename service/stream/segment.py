"""The frames of one window, and what its stream knew when it closed: all that a window is made of by `window_of`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from service.stream.pieces import Piece
from service.stream.samples import MOST_SAMPLES, Span
from twin.windows import Fault, SlowValue


@dataclass(frozen=True, slots=True, kw_only=True)
class Segment:
    """The frames of one window, not laid out yet."""

    span: Span
    pieces: Mapping[str, Sequence[Piece]] = field(default_factory=dict)  # by channel label
    known: tuple[str, ...] = ()  # channels that earlier windows had
    slow: Mapping[str, SlowValue] = field(default_factory=dict)  # by channel label
    faults: tuple[Fault, ...] = ()  # found before it is laid out
    most: int = MOST_SAMPLES  # of all its channels together
    left_out: bool = False  # whether its frames have been left out since, for the reason of its last fault

    @property
    def start_ns(self) -> int:
        """The window's start, which is its name [ns]."""
        return self.span.start_ns

    @property
    def nbytes(self) -> int:
        """What its frames take in memory."""
        return sum(piece.frame.nbytes for pieces in self.pieces.values() for piece in pieces)

    def without_frames(self, fault: Fault) -> Segment:
        """The same once its frames had to be left out."""
        return replace(self, pieces={}, faults=(*self.faults, fault), left_out=True)
