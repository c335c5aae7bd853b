"""Frames in, the frames of whole windows out: a function of the set of frames, whatever their order within patience.

    for segment, resume in assembler.assemble(frame): ...
    for segment, resume in assembler.finish(): ...       at the end of a file, or when a stream falls silent

Frames come in bursts: a pause on all channels ends a window. A stream without a break is cut at
multiples of the window length on the Unix clock, where at least one length lies on either side, so that
any delivery of the same frames gives the same cuts and no burst shorter than two lengths is cut.

No clock of its own, no threads: who adds frames may say what the host's clock shows. Keys are put in order one by one
(`order`), merged in time as far as every key is known to be complete, and divided into windows, which `window` lays
out. A clock that has been set is detected, and the asset's windows go on at the new time (`clock`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from service.stream import order
from service.stream.channels import CHANNEL_KINDS
from service.stream.clock import Contradictions, said
from service.stream.frames import LENGTH_LIMITS, NS, Frame, SampleFrame
from service.stream.left_out import LeftOut, Missing
from service.stream.pieces import OpenWindow, Piece, size_of, split_index
from service.stream.position import ChannelPosition, Position, earliest, missing_of
from service.stream.quality import totals
from service.stream.repeats import Repeats
from service.stream.samples import MOST_SAMPLES, Span
from service.stream.segment import Segment
from service.stream.slow import SlowChannels
from service.stream.timeline import Timeline
from twin.rig import Rig
from twin.windows import Fault

MOST_CHANNELS = 256  # of one asset; frames of further ones are counted and left out ...
OTHER_CHANNELS = "other channels"  # ... under this name
_SILENT_AFTER = 4  # times the patience: frames of other keys after which one that sends nothing is not waited for

Closed = tuple[Segment, dict[str, Any]]
"""The frames of a window that has closed, and what a restart needs to go on after it: `to_dict` as of then."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AssemblySettings:
    """How frames of one asset become windows."""

    length: float = 10.0  # of the pieces an unbroken stream is cut into [s]
    gap: float = 1.0  # pause that ends a burst [s]
    patience: int = 256  # frames that a key lets pass while one is missing
    settle: int = 24  # frames in good order that prove a gap real
    max_bytes: int = 128 * 2**20  # held while waiting
    window_bytes: int = 8 * MOST_SAMPLES  # of one window with all its channels, and of the frames that make it
    expected: tuple[str, ...] = ()  # channels that are waited for before the first window: accel/y6, ...
    rig: Rig | None = None  # whose sensor ranges and operating points the values are held against
    clocked: bool = False  # whether who adds frames decides by a clock which channels are waited for no longer

    def waiting_for(self, labels: Iterable[str]) -> AssemblySettings:
        """The same, with these channels waited for as well."""
        return replace(self, expected=tuple(dict.fromkeys((*self.expected, *labels))))


DEFAULT = AssemblySettings()


class Assembler:
    """The assembly of one asset's frames."""

    def __init__(self, settings: AssemblySettings = DEFAULT):
        self.settings = settings
        self.counters: dict[str, dict[str, int]] = {}  # by channel and kind, since the asset was first seen
        self.left_out: Counter[str] = Counter()  # frames by cause, since the asset was first seen
        self._newest: dict[str, tuple[int, int]] = {}  # sequence and start of each channel's newest frame [ns]
        self._lanes: dict[str, order.Lane] = {}
        self._slow = SlowChannels()
        self.expect(settings.expected)
        self._open: OpenWindow | None = None
        self._contradictions = Contradictions()
        self._noted: dict[str, Fault] = {}  # faults of the clock since the last window, by channel
        self.repeats = Repeats()
        self._left_out = LeftOut()
        self.recorded = False  # whether frames are sent of a recording: one of the past is no clock that was set
        self._times_set = 0  # how often a clock was set
        self._latest = 0  # latest end of a window, before the clock was last set [ns]
        self.last_arrival_ns: int | None = None  # host's clock when the newest frame came, Unix time [ns]
        self._closed_until = 0  # frames that end before this time come too late [ns]
        self._known: set[str] = set()  # channels of the windows so far
        self._consumed: dict[str, tuple[int, int, int]] = {}  # sequence, start, end of the last frame in a window

    def assemble(self, frame: Frame, now_ns: int | None = None) -> Iterator[Closed]:
        """Takes one frame in; answers the windows that it completes, in time order, each with its resume state.

        now_ns  what the host's clock shows, Unix time [ns]; None where it has nothing to do with the frames
        """
        label = frame.channel.label
        if label not in self.counters and len(self.counters) >= MOST_CHANNELS:
            self.count(label, "too_many_channels")
            return
        self.count(label, "frames")
        self._newest[label] = (frame.sequence, frame.start_time_ns)
        if now_ns is not None:
            self.last_arrival_ns = now_ns
        if isinstance(frame, SampleFrame) and CHANNEL_KINDS[frame.channel.kind].slow:
            self._add_slow(label, frame, now_ns)
            return
        lane = self._lanes.setdefault(label, self._lane())
        fate, disorder = (order.CLOCK, False) if self._is_ahead(frame, now_ns) else lane.offer(frame)
        if disorder:
            self.count(label, "disorder")
        if fate == order.QUEUED:
            self.repeats.queued()
            if self._left_out.stretches and self._left_out.came(label, frame.sequence, frame.start_time_ns):
                lane.left_out -= lane.left_out > 0
        elif fate not in (order.CLOCK, order.CONFLICT) and self.repeats.left_out(frame, self._held(lane, frame)):
            fate = order.CONFLICT
        if fate == order.CLOCK and self.recorded and frame.start_time_ns < self._past_until(lane, now_ns):
            fate = order.PAST
        if fate == order.CLOCK:
            if self._contradictions.hold(frame):
                yield from self._resynchronise(now_ns)
        elif fate == order.QUEUED:
            self._leave_out_contradictions()
            yield from self._advance(label, lane)
        else:
            self._count_given_up(label, fate, 1)

    def _held(self, lane: order.Lane, frame: Frame) -> Frame | None:
        """The frame of a frame's time and number that is yet to be used."""
        return lane.held(frame) or (None if self._open is None else self._open.held(frame))

    def finish(self) -> Iterator[Closed]:
        """Closes everything that waits; what is missing is declared lost."""
        held, lanes = self._contradictions.held, self._lanes.values()
        if held and (self.recorded or not any(lane.last or lane.queue for lane in lanes)):  # nothing else will come
            yield from self._resynchronise(None)
        yield from self._force()
        if self._open is not None:
            for label, lane in self._lanes.items():
                lane.silent = label not in self._open.pieces
            yield self._close(self._open.end, cut=False)
        yield from self._refuse_left_out(float("inf"))

    def leave_out(self, missing: Missing) -> None:
        """Frames were left out before they came here."""
        for label, number in missing.frames.items():
            self.count(label, "shed" if missing.for_room else "left_out", number)
            if label in self._lanes:
                self._lanes[label].left_out += number
        begin = max(missing.begin_ns, self._closed_until) if missing.begin_ns > 0 else missing.end_ns
        if begin < missing.end_ns or missing.starts:  # not where none of the frames said a time
            self._left_out.add(missing._replace(begin_ns=begin))

    def leave_out_all_so_far(self, other: Assembler, cause: str) -> None:
        """What another assembler has received was not received here, and is not to be made windows of."""
        newest = other.position.channels
        if starts := [each.start_ns for each in newest.values()]:
            self._left_out.add(Missing(min(starts), max(starts) + 1, dict.fromkeys(newest, 1), cause))

    def _refuse_left_out(self, until: float) -> Iterator[Closed]:
        """The stretches before a time that have touched no window, as refused windows."""
        for span in self._left_out.alone(until, self._closed_until):
            self._open = OpenWindow(*span, {})
            yield self._close(span.end_ns, cut=False)

    def wait_only_for(self, labels: Iterable[str]) -> None:
        """Stops waiting for all other keys, of which nothing has come, until they send again."""
        sending = set(labels)
        for label, lane in self._lanes.items():
            if label not in sending and not lane.queue and not lane.released:
                lane.silent = True

    def hold(self, label: str, on: bool) -> None:
        """Lets the frames of a key that lie behind a gap wait for those before it, whatever comes; or no longer."""
        if label in self._lanes:
            self._lanes[label].holds = on

    def first_gap(self, label: str) -> tuple[int, int] | None:
        """The numbers that the frames of a key wait for first; None where they wait for none."""
        lane = self._lanes.get(label)
        if lane is None or lane.last is None or not lane.queue or lane.queue[0][1] <= lane.last[0] + 1:
            return None
        return lane.last[0] + 1, lane.queue[0][1] - 1

    def expect(self, labels: Iterable[str]) -> None:
        """Waits for these channels too before the first window; slow ones are never waited for."""
        for label in labels:
            kind = CHANNEL_KINDS.get(label.partition("/")[0])
            if kind is not None and not kind.slow:
                self._lanes.setdefault(label, self._lane())

    def count(self, label: str, kind: str, by: int = 1) -> None:
        """Counts something seen on a channel."""
        if label not in self.counters and len(self.counters) >= MOST_CHANNELS:
            label = OTHER_CHANNELS
        kinds = self.counters.setdefault(label, {})
        kinds[kind] = kinds.get(kind, 0) + by
        if kind in order.LEFT_OUT:
            self.left_out[kind] += by

    @property
    def position(self) -> Position:
        """What has been received, and from which time on it is held here only.

        Slow channels' frames are not waited for: they are part of the window that closes next.
        """
        lanes = self._lanes.values()
        pieces = self._open.pieces.values() if self._open is not None else ()
        held = [
            *(lane.queue[0][0] for lane in lanes if lane.queue),
            *(lane.released[0][0].start_time_ns for lane in lanes if lane.released),
            *(frame.start_time_ns for frame in self._contradictions.held),
            *(parts[0].frame.start_time_ns for parts in pieces if parts),
        ]
        newest = {label: (sequence, start) for label, (sequence, start, _) in self._consumed.items()} | self._newest
        missing = {label: missing_of(lane) for label, lane in self._lanes.items()}
        return Position(
            unsettled_from_ns=earliest([*held, self._left_out.earliest]),
            settled_until_ns=self._closed_until or None,
            channels={
                label: ChannelPosition(sequence=sequence, start_ns=start, missing=missing.get(label, ()))
                for label, (sequence, start) in newest.items()
            },
            left_out=dict(self.left_out),
            shed=self.shed,
        )

    @property
    def shed(self) -> int:
        """Windows that were left out for want of room, since the service was started."""
        return self._left_out.windows

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels that windows wait for: those that have come, and those that are expected; no slow ones."""
        return tuple(self._lanes)

    @property
    def waiting(self) -> bool:
        """Whether a flush would give anything."""
        held = self._open or self._left_out.earliest is not None or (self.recorded and self._contradictions.held)
        return bool(held) or any(lane.queue or lane.released for lane in self._lanes.values())

    def to_dict(self) -> dict[str, Any]:
        """Where the windows so far end, JSON-safe: what a restart needs to go on without counting twice."""
        return {
            "closed_until_ns": self._closed_until,
            "channels": sorted(self._known),
            "slow": self._slow.to_dict(),
            "marks": self.repeats.to_dict(),
            "timelines": {label: lane.timeline.to_dict() for label, lane in self._lanes.items()},
            "clock": {"times_set": self._times_set, "latest_ns": self._latest, "last_arrival_ns": self.last_arrival_ns},
            "last_frames": {
                label: {"sequence": q, "start_ns": s, "end_ns": e, "lost": [list(r) for r in self._lanes[label].lost]}
                for label, (q, s, e) in self._consumed.items()
            },
            "counters": {label: dict(kinds) for label, kinds in self.counters.items()},
            "left_out": dict(self.left_out),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], settings: AssemblySettings = DEFAULT) -> Assembler:
        """An assembler that goes on after the windows of `to_dict`."""
        self = cls(settings)
        self._closed_until = int(data["closed_until_ns"])
        self._known = set(data["channels"])
        self.counters = {label: dict(kinds) for label, kinds in data["counters"].items()}
        self.left_out = Counter(data["left_out"])
        self._slow = SlowChannels.from_dict(data["slow"])
        self.repeats = Repeats.from_dict(data["marks"])
        clock = data["clock"]
        self._times_set, self._latest = int(clock["times_set"]), int(clock["latest_ns"])
        self.last_arrival_ns = clock["last_arrival_ns"]
        for label, points in data["timelines"].items():
            self._lanes.setdefault(label, self._lane()).timeline = Timeline.from_dict(points)
        for label, last in data["last_frames"].items():
            lane = self._lanes.setdefault(label, self._lane())
            lane.last = (int(last["sequence"]), int(last["start_ns"]), int(last["end_ns"]))
            lane.lost = [(int(a), int(b)) for a, b in last["lost"]]
            self._consumed[label] = lane.last
        return self

    def _lane(self) -> order.Lane:
        return order.Lane(patience=self.settings.patience, settle=self.settings.settle)

    def _release(self, label: str, lane: order.Lane, force: bool = False) -> None:
        for kind, number in lane.release(force).items():
            if number:
                self._count_given_up(label, kind, number)

    def _count_given_up(self, label: str, kind: str, number: int) -> None:
        """Counts frames that are not used; those of a second publisher are a fault of the next window as well."""
        self.count(label, kind, number)
        if kind == order.CONFLICT:
            count = number + (self._noted[f"{label} {kind}"].count if f"{label} {kind}" in self._noted else 0)
            self._noted[f"{label} {kind}"] = Fault(
                kind=kind, channel=label, count=count, action="none",
                detail="frames left out: their number or time is that of others; do two publishers send on this key?",
            )  # fmt: skip

    def note(self, fault: Fault) -> None:
        """A fault of the next window, that was found elsewhere."""
        self._noted[f"{fault.channel} {fault.kind}"] = fault

    @property
    def closed_until_ns(self) -> int:
        """End of the newest window on the stream's own clock, Unix time [ns]; 0 before the first."""
        return self._closed_until

    def _add_slow(self, label: str, frame: SampleFrame, now_ns: int | None) -> None:
        if now_ns is not None and frame.end_time_ns > max(now_ns, self._closed_until) + self._contradictions.ahead_ns:
            self.count(label, order.CLOCK)
            self.left_out[order.CLOCK] += 1
        elif (fate := self._slow.offer(frame)) != order.QUEUED:
            self.count(label, fate)

    def _advance(self, label: str, lane: order.Lane) -> Iterator[Closed]:
        """What a frame put in order completes."""
        lane.silent = False
        self._release(label, lane)
        if not self.settings.clocked:
            self._forget_silent()
        if sum(each.pending_bytes for each in self._lanes.values()) > self.settings.max_bytes:
            yield from self._force()
        yield from self._merge()

    def _is_ahead(self, frame: Frame, now_ns: int | None) -> bool:
        """Whether a frame ends after the host's clock, though the asset's frames so far agree with that clock.

        A stream that already runs ahead (a recording made with a wrong clock, say) is not compared with the host's
        clock any more: there, the time until the next frame is a pause of the machine.
        """
        ahead = self._contradictions.ahead_ns
        if now_ns is None or frame.end_time_ns <= now_ns + ahead:
            return False
        queued = (lane.queue[-1][2].end_time_ns for lane in self._lanes.values() if lane.queue)
        released = (lane.last[2] for lane in self._lanes.values() if lane.last)
        newest = max(self._closed_until, *queued, *released, 0)
        return newest <= now_ns + ahead and frame.start_time_ns > newest + ahead

    def _past_until(self, lane: order.Lane, now_ns: int | None) -> int:
        """Time before which a recording is past: the newest that is not ahead of the host's clock itself [ns]."""
        latest = float("inf") if now_ns is None else now_ns + self._contradictions.ahead_ns
        return next((end for end in (lane.last[2] if lane.last else 0, self._latest) if end <= latest), 0)

    def _leave_out_contradictions(self) -> None:
        """The frames held for their times are given up, since others go on as before."""
        if not self._contradictions.held:
            return
        for frame in self._contradictions.clear():
            lane = self._lanes[frame.channel.label]
            behind = lane.last is not None and 0 < lane.last[1] - frame.start_time_ns < LENGTH_LIMITS[1] * NS
            self.count(frame.channel.label, order.OVERLAP if behind else order.CLOCK)
            self.left_out[order.OVERLAP if behind else order.CLOCK] += 1
            if not behind:
                self._note(
                    frame, "none", f"frame left out: its time {said(frame.start_time_ns)} contradicts the others"
                )

    def _resynchronise(self, now_ns: int | None) -> Iterator[Closed]:
        """Closes what is open, and goes on at the time of the frames held, whose clock has been set."""
        frames = self._contradictions.clear()
        before = max(self._closed_until, *(x.last[2] for x in self._lanes.values() if x.last), 0)
        yield from self.finish()
        for lane in self._lanes.values():
            lane.begin_again()
        self._latest = max(self._latest, self._closed_until)
        self._closed_until, self._consumed, self._slow = 0, {}, SlowChannels()
        self._left_out = LeftOut(windows=self._left_out.windows)
        self._times_set += 1
        for each in {f.channel.label: f for f in reversed(frames)}.values():
            self.count(each.channel.label, order.CLOCK)
            host = "" if now_ns is None else f"; the host's clock shows {said(now_ns)}"
            went = f"from {said(before)} to {said(each.start_time_ns)}" if before else f"to {said(each.start_time_ns)}"
            self._note(each, "repaired", f"the stream's clock was set {went}{host}")
        for each in frames:
            lane = self._lanes[each.channel.label]
            if lane.offer(each)[0] == order.QUEUED:
                yield from self._advance(each.channel.label, lane)

    def _note(self, frame: Frame, action: str, detail: str) -> None:
        label = frame.channel.label
        count = self._noted[label].count + 1 if label in self._noted else 1
        self._noted[label] = Fault(kind=order.CLOCK, channel=label, count=count, action=action, detail=detail)

    def _force(self) -> Iterator[Closed]:
        """Lets everything go that waits, without regard to what may be missing."""
        for label, lane in self._lanes.items():
            self._release(label, lane, force=True)
        yield from self._merge(known=float("inf"))

    def _forget_silent(self) -> None:
        """Stops waiting for keys of which nothing has come while another has gone on for very long."""
        backlog = max(len(lane.released) for lane in self._lanes.values())
        if backlog >= _SILENT_AFTER * self.settings.patience:
            self.wait_only_for(label for label, lane in self._lanes.items() if lane.released)

    def _merge(self, known: float | None = None) -> Iterator[Closed]:
        """Takes released frames in time order as far as every key is complete, or up to a given time [ns]."""
        if known is None:
            known = min((x.watermark for x in self._lanes.values() if not x.silent), default=float("inf"))
        while True:
            heads = [(x.released[0][0].start_time_ns, label) for label, x in self._lanes.items() if x.released]
            start, label = min(heads, default=(known, ""))
            if not heads or start > known:
                return
            frame, lost = self._lanes[label].take()
            yield from self._place(label, frame, lost)

    def _place(self, label: str, frame: Frame, lost: int) -> Iterator[Closed]:
        """Puts one frame into the window in progress, after closing what it shows to be over."""
        begin, size = split_index(frame, self._closed_until), size_of(frame)
        late = frame.end_time_ns <= self._closed_until if size else frame.start_time_ns < self._closed_until
        if begin == size and late:
            self.count(label, order.LATE)
            return
        current = self._open
        if current is not None and frame.start_time_ns > current.end + self.settings.gap * NS:
            yield self._close(current.end, cut=False)
            current = None
        if current is None and self._left_out.stretches:
            yield from self._refuse_left_out(frame.start_time_ns - self.settings.gap * NS)
        start = max(frame.start_time_ns, self._closed_until)
        if current is None:
            current = self._open = OpenWindow(start, start, {})
        current.end = max(current.end, frame.end_time_ns)
        if current.bytes + frame.nbytes > self.settings.window_bytes:
            current.refused[label] = current.refused.get(label, 0) + 1
        else:
            current.bytes += frame.nbytes
            current.pieces.setdefault(label, []).append(Piece(frame, begin, size, lost))
        length = round(self.settings.length * NS)
        while self._open is not None:
            cut = -(-(self._open.start + length) // length) * length
            if frame.start_time_ns < cut or self._open.end < cut + length:
                return
            yield self._close(cut, cut=True)

    def _close(self, end: int, *, cut: bool) -> Closed:
        """The window in progress up to its end; what a cut leaves over opens the next."""
        current = self._open
        assert current is not None
        now: dict[str, list[Piece]] = {}
        rest: dict[str, list[Piece]] = {}
        for label, pieces in current.pieces.items():
            used: list[Frame] = []
            for piece in pieces:
                frame = piece.frame
                after = cut and frame.start_time_ns >= end
                at = min(max(split_index(frame, end), piece.begin), piece.end) if cut else piece.end
                if not after:
                    now.setdefault(label, []).append(Piece(frame, piece.begin, at, piece.lost))
                if at < piece.end or after:
                    rest.setdefault(label, []).append(Piece(frame, at, piece.end, piece.lost if after else 0))
                else:
                    self._consumed[label] = (frame.sequence, frame.start_time_ns, frame.end_time_ns)
                    self._lanes[label].timeline.note(frame.start_time_ns, frame.sequence)
                    used.append(frame)
            if used:
                self.repeats.used(label, used)
        most = self.settings.window_bytes // 8
        # A window's start is its name: one in a time that was passed before begins some nanoseconds off the old names.
        start = current.start + (self._times_set if current.start < self._latest else 0)
        span, faults = Span(start, end), [*self._noted.values(), *current.faults(self.settings.window_bytes)]
        self._noted = {}
        gap = round(self.settings.gap * NS)
        longest = max((p.frame.end_time_ns - p.frame.start_time_ns for parts in now.values() for p in parts), default=0)
        faults += self._left_out.faults(span, 0 if current.continued else gap, 0 if cut else gap, longest)
        slow = self._slow.at(span, faults)
        known = tuple(sorted(self._known))
        segment = Segment(span=span, pieces=now, known=known, slow=slow, faults=tuple(faults), most=most)
        for (label, kind), number in totals(faults).items():
            self.count(label, kind, number)
        self._known |= set(now)
        self._closed_until = end
        self._left_out.forget(end - gap, round(LENGTH_LIMITS[1] * NS))
        left = sum(piece.frame.nbytes for pieces in rest.values() for piece in pieces)
        self._open = OpenWindow(end, current.end, rest, left, continued=True) if cut else None
        return segment, self.to_dict()
