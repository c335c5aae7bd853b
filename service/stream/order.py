"""One key's frames put in order by their sequence numbers: what is contiguous is complete.

A frame leaves when the one before it has left. Where a number is missing, the frames behind it wait
until it comes, until as many frames as prove the gap real have come in good order (`settle`), or
until patience ends; neither counts while the missing frames are being asked for. The same holds for
the first frame seen, since a lower one may still come.

A frame that lies before those released and is none of them contradicts the key's clock; the assembler decides what
becomes of it.
"""

from __future__ import annotations

import bisect
from collections import deque
from dataclasses import dataclass, field

from service.stream.frames import LENGTH_LIMITS, NS, Frame
from service.stream.repeats import checksum
from service.stream.timeline import Timeline

QUEUED, DUPLICATE, LATE, OVERLAP, CLOCK = "queued", "duplicate", "late", "overlap", "clock"
LOST, TIME_JUMP, SEQUENCE_JUMP, CONFLICT, PAST = "lost", "time_jump", "sequence_jump", "conflict", "past"
LEFT_OUT = {"invalid", "shed", "too_many_channels", LATE, LOST, DUPLICATE, CONFLICT, TIME_JUMP, SEQUENCE_JUMP, PAST}
_LONGEST_PAUSE_NS = 400 * 86400 * NS  # beyond it, a lone frame is a clock's fault ...
_BELIEVED = 3  # ... and so many frames are a machine that is measured again after a long time
_OVERLAP = 0.5  # share of a frame by which another one may not lie in the same time, unless their numbers follow
_NEAR = 8  # frames of other publishers among which the next one is looked for
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
    holds: bool = False  # the frames before a gap have been asked for: those behind it wait for the answer
    silent: bool = False  # nothing has come for so long that others no longer wait for it
    pending_bytes: int = 0
    left_out: int = 0  # frames that had come and were left out for want of room: their numbers will be missing
    timeline: Timeline = field(default_factory=Timeline)  # of the frames released

    @property
    def watermark(self) -> float:
        """Time up to which all starts of this key's frames are known [ns]."""
        return self.last[1] if self.last else float("-inf")

    def offer(self, frame: Frame) -> tuple[str, bool]:
        """Takes a frame in; answers what became of it, and whether it came out of order."""
        sequence, start = frame.sequence, frame.start_time_ns
        if self.timeline.held_before(start, sequence):
            return DUPLICATE, False
        if self.last is not None:
            newest, last_start, last_end = self.last
            if any(a <= sequence <= b for a, b in self.lost) and start < last_end:
                return LATE, False
            if sequence > newest + 1 and last_start <= start < last_end and _overlap(frame, last_end) > _OVERLAP:
                return CONFLICT, False
            if start < last_start or (sequence <= newest and start < max(last_end, last_start + 1)):
                known = self.timeline.holds(start, sequence, (last_start, newest))
                return DUPLICATE if known else CONFLICT if start >= last_start else CLOCK, False
        key = (start, sequence)
        at = bisect.bisect_left(self.queue, key, key=lambda item: item[:2])
        if at < len(self.queue) and self.queue[at][:2] == key:
            return DUPLICATE if checksum(self.queue[at][2]) == checksum(frame) else CONFLICT, False
        self.queue.insert(at, (start, sequence, frame))
        self.pending_bytes += frame.nbytes
        in_order = self.newest_arrival is None or sequence == self.newest_arrival + 1
        self.run = self.run + 1 if in_order else 1
        self.newest_arrival = sequence
        disorder = self.highest is not None and sequence < self.highest and at < len(self.queue) - 1
        self.highest = sequence if self.highest is None or at == len(self.queue) - 1 else max(self.highest, sequence)
        return QUEUED, disorder

    def held(self, frame: Frame) -> Frame | None:
        """The frame of a frame's time and number that has not been taken yet."""
        wanted = frame.start_time_ns, frame.sequence
        waiting = (*(each for *_, each in self.queue), *(each for each, _ in self.released))
        return next((each for each in waiting if (each.start_time_ns, each.sequence) == wanted), None)

    def release(self, force: bool = False) -> dict[str, int]:
        """Lets go what is contiguous or has waited long enough; answers what was given up, by kind."""
        given_up = {LOST: 0, TIME_JUMP: 0, SEQUENCE_JUMP: 0, CONFLICT: 0}
        taken = 0
        self.holds = self.holds and not force
        while taken < len(self.queue):
            start, sequence, frame = self.queue[taken]
            waiting = len(self.queue) - taken
            patient = self.holds or not (force or waiting >= self.patience or self.run >= self.settle)
            lost = 0
            if self._is_anothers(taken):
                given_up[CONFLICT] += 1
                self.pending_bytes -= frame.nbytes
                del self.queue[taken]
                continue
            if self.last and start - self.last[2] > _LONGEST_PAUSE_NS and waiting < _BELIEVED:
                if force:
                    given_up[TIME_JUMP] += waiting
                    self.pending_bytes -= sum(frame.nbytes for _, _, frame in self.queue[taken:])
                    taken = len(self.queue)
                break
            if self.last is None or sequence <= self.last[0]:  # the key's first, or after its counter restarted
                restarted = sequence == 0 and (self.last is None or self.run >= _BELIEVED)
                if patient and not restarted:
                    break
            elif sequence > self.last[0] + 1:
                if patient:
                    break
                lost = self._give_up(start, sequence, given_up)
            if self.last is None:
                self.timeline.note(start, sequence)
            self.last = (sequence, start, frame.end_time_ns)
            self.released.append((frame, lost))
            taken += 1
        del self.queue[:taken]
        return given_up

    def _is_anothers(self, place: int) -> bool:
        """Whether a frame that waits contradicts the newest that was released, or the one that follows it."""
        if self.last is None:
            return False
        start, sequence, frame = self.queue[place]
        newest, last_start, last_end = self.last
        if sequence == newest + 1:
            return False
        if last_start <= start < last_end and _overlap(frame, last_end) > _OVERLAP:
            return True
        nearby = self.queue[place + 1 : place + 1 + _NEAR]
        return any(number == newest + 1 and begin < frame.end_time_ns for begin, number, _ in nearby)

    def _give_up(self, start: int, sequence: int, given_up: dict[str, int]) -> int:
        """The numbers before a frame that are waited for no longer: how many frames were lost.

        More than can have been sent in the time between are none: the counter has jumped.
        """
        assert self.last is not None
        newest, _, last_end = self.last
        lost = sequence - newest - 1
        if lost > max(start - last_end, 0) / (LENGTH_LIMITS[0] * NS) + 2:
            given_up[SEQUENCE_JUMP] += 1
            return 0
        self.lost = [*self.lost[1 - _LOST_RANGES :], (newest + 1, sequence - 1)]
        known = min(lost, self.left_out)
        self.left_out -= known
        given_up[LOST] += lost - known
        return lost - known

    def begin_again(self) -> None:
        """Starts at a clock that has been set; what was released stays known."""
        if self.last is not None:
            self.timeline.note(self.last[1], self.last[0])
        self.queue, self.released, self.last, self.lost = [], deque(), None, []
        self.newest_arrival = self.highest = None
        self.run = self.pending_bytes = 0
        self.timeline.begin_stretch()

    def take(self) -> tuple[Frame, int]:
        """The next released frame and the frames lost before it."""
        frame, lost = self.released.popleft()
        self.pending_bytes -= frame.nbytes
        return frame, lost


def _overlap(frame: Frame, end: int) -> float:
    """Share of a frame that lies before a time [ns]."""
    length = frame.end_time_ns - frame.start_time_ns
    return (end - frame.start_time_ns) / length if length > 0 else 0.0
