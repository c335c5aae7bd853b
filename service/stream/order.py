"""One key's frames put in order by their sequence numbers: what is contiguous is complete.

A frame leaves when the one before it has left. Where a number is missing, the frames behind it wait
until it comes, until as many frames as prove the gap real have come in good order (`settle`), or
until patience ends. The same holds for the first frame seen, since a lower one may still come.
"""

from __future__ import annotations

import bisect
from collections import deque
from dataclasses import dataclass, field

from service.stream.frames import NS, Frame

QUEUED, DUPLICATE, LATE, OVERLAP = "queued", "duplicate", "late", "overlap"
LOST, TIME_JUMP = "lost", "time_jump"
_LONGEST_PAUSE_NS = 400 * 86400 * NS  # beyond it, a lone frame is a clock's fault ...
_BELIEVED = 3  # ... and so many frames are a machine that was taken up again
_LOST_RANGES = 64  # gaps remembered, so that a frame that comes after all is called late


@dataclass(slots=True)
class Lane:
    """The frames of one key between arrival and release."""

    patience: int
    settle: int
    queue: list[tuple[int, int, Frame]] = field(default_factory=list)  # by (start, sequence)
    released: deque[tuple[Frame, int]] = field(default_factory=deque)  # with the frames lost before each
    last: tuple[int, int, int] | None = None  # sequence, start, end of the newest released [ns]
    lost: list[tuple[int, int]] = field(default_factory=list)  # sequence ranges given up, [first, last]
    newest_arrival: int | None = None
    highest: int | None = None
    run: int = 0  # arrivals in good order, up to the newest: a shuffled stream has no long run
    silent: bool = False  # nothing has come for so long that others no longer wait for it
    pending_bytes: int = 0

    @property
    def watermark(self) -> float:
        """Time up to which all starts of this key's frames are known [ns]."""
        return self.last[1] if self.last else float("-inf")

    def offer(self, frame: Frame) -> tuple[str, bool]:
        """Takes a frame in; answers what became of it, and whether it came out of order."""
        sequence, start = frame.sequence, frame.start_time_ns
        if self.last is not None:
            newest, last_start, last_end = self.last
            if any(a <= sequence <= b for a, b in self.lost) and start < last_end:
                return LATE, False
            if sequence <= newest and start < max(last_end, last_start + 1):
                return DUPLICATE, False
            if start < last_start:
                return OVERLAP, False
        key = (start, sequence)
        at = bisect.bisect_left(self.queue, key, key=lambda item: item[:2])
        if at < len(self.queue) and self.queue[at][:2] == key:
            return DUPLICATE, False
        self.queue.insert(at, (start, sequence, frame))
        self.pending_bytes += frame.nbytes
        in_order = self.newest_arrival is None or sequence == self.newest_arrival + 1
        self.run = self.run + 1 if in_order else 1
        self.newest_arrival = sequence
        disorder = self.highest is not None and sequence < self.highest and at < len(self.queue) - 1
        self.highest = sequence if self.highest is None or at == len(self.queue) - 1 else max(self.highest, sequence)
        return QUEUED, disorder

    def release(self, force: bool = False) -> dict[str, int]:
        """Lets go what is contiguous or has waited long enough; answers what was given up, by kind."""
        given_up, taken = {LOST: 0, TIME_JUMP: 0}, 0
        while taken < len(self.queue):
            start, sequence, frame = self.queue[taken]
            waiting = len(self.queue) - taken
            newest = self.last[0] if self.last else None
            lost = 0
            if self.last and start - self.last[2] > _LONGEST_PAUSE_NS and waiting < _BELIEVED:
                if not force:
                    break
                given_up[TIME_JUMP] += waiting
                self.pending_bytes -= sum(frame.nbytes for _, _, frame in self.queue[taken:])
                taken = len(self.queue)
                break
            if newest is None or sequence <= newest:  # a first frame: of the key, or after its counter restarted
                if not (force or sequence == 0 or waiting >= self.patience or self.run >= self.settle):
                    break
            elif sequence > newest + 1:
                if not (force or waiting >= self.patience or self.run >= self.settle):
                    break
                lost = sequence - newest - 1
                given_up[LOST] += lost
                self.lost = [*self.lost[1 - _LOST_RANGES :], (newest + 1, sequence - 1)]
            self.last = (sequence, start, frame.end_time_ns)
            self.released.append((frame, lost))
            taken += 1
        del self.queue[:taken]
        return given_up

    def take(self) -> tuple[Frame, int]:
        """The next released frame and the frames lost before it."""
        frame, lost = self.released.popleft()
        self.pending_bytes -= frame.nbytes
        return frame, lost
