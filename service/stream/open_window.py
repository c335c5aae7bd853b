"""The window in progress: the frames, or parts of frames, that it has so far."""

from __future__ import annotations

import bisect
from dataclasses import dataclass, field

from service.stream.frames import Frame
from service.stream.pieces import Piece
from twin.windows import Fault


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
