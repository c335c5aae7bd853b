"""Closed windows → the twin → committed and published outcomes: an asset at a time in order, assets side by side.

    lanes.put(asset, entry)     a window that has closed
    lanes.do(asset, turn)       a decision, an inspection or a change: between two windows of its asset

Each asset has a lane. What is asked of its twin is carried out elsewhere (`Computing`), one call of an asset at a time;
what it led to is committed and published by the thread that drives the lanes. An asset advances to the state after a
window only once that window has been committed.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from service.contract.status import shown_question
from service.errors import FAULT, InputError, StorageUnavailable, StoreError
from service.operation.journey import Arrived, nobody
from service.results.window_jobs import delete_file
from service.runtime.computing import Ask, Call, Computing, Made, WindowToUse
from service.runtime.lane import Entry, Lane, Turn
from service.runtime.outcomes import Checkpoint, Outcome, ResultSink
from service.runtime.packed_state import StoredState
from service.runtime.questions import COUNT_FELL, REPEATED, count_fell, frames_repeat, waiting
from service.runtime.reception import Reception
from service.runtime.storage_watch import StorageWatch
from service.runtime.twin_port import Twin
from service.runtime.window_outcomes import outcome_of
from service.steady_clock import later_time_ns
from service.stream.quality import Counts
from service.stream.repeats import Repeats
from twin.errors import TwinError
from twin.rig import Rig
from twin.windows import Window

log = logging.getLogger(__name__)

SHED = "shed"  # kind of the fault of a window that was left out because too much waited
LEFT_OUT = (SHED, "all")  # kind and channel of that fault where the window had been received whole
ONE_DISTURBED = (
    "the revolution count of this window alone lies far below that of the windows before and after it: it is taken for "
    "a disturbance of the counter"
)


class Lanes:
    """The lanes of all assets. Driven by one thread.

    asks     whether people can be asked; else windows that would wait for their answer are refused
    storage  that is waited for where it cannot be used; None where that ends the program
    arrived  called with each window that has been shown
    timed    called with what was asked of a twin and how long its parts took [s]
    """

    def __init__(
        self,
        reception: Reception,
        sink: ResultSink,
        computing: Computing,
        *,
        twin_of: Callable[[str, Rig], Twin],
        new_state: Callable[[], Any],
        asks: bool = False,
        storage: StorageWatch | None = None,
        arrived: Arrived = nobody,
        timed: Callable[[str, Mapping[str, float]], object] = lambda verb, parts: None,
    ) -> None:
        self._storage, self._arrived, self._timed = storage, arrived, timed
        self._reception, self._sink, self._computing, self._asks = reception, sink, computing, asks
        self._twin_of, self._new_state = twin_of, new_state
        self._lanes: dict[str, Lane] = {}
        self._unsettled: list[tuple[Lane, Callable[[], None]]] = []
        self.stopped: list[tuple[str, str]] = []  # assets of which nothing more is processed, and why
        self.forget: Callable[[int], object] = lambda number: None  # ends the wait of a window on disk
        self.faults = 0  # of the program, each of which cost a window, a decision or a change

    # -- work ----------------------------------------------------------------------------------------

    def put(self, asset: str, entry: Entry, assembly: Mapping[str, Any]) -> None:
        """A window that has closed, and where the stream's windows end with it; processed after those before it."""
        lane = self.of(asset)
        lane.assembly = assembly
        lane.entries.append(entry)
        self._turn(lane)

    def do(self, asset: str, turn: Turn) -> None:
        """Something to be done before the asset's next window."""
        lane = self.of(asset)
        lane.jobs.append(turn)
        self._turn(lane)

    def go(self) -> None:
        """Goes on with what waits, of all assets."""
        for lane in list(self._lanes.values()):
            self._turn(lane)

    def retry(self) -> bool:
        """Tries again to commit what the storage could not keep before; whether nothing is left."""
        unsettled, self._unsettled = self._unsettled, []
        for lane, action in unsettled:
            self._settle(lane, action)
        return not self._unsettled

    def backlog(self, asset: str) -> int:
        """How many windows of an asset wait to be processed, or for an answer."""
        return len(self._lanes[asset].entries) if asset in self._lanes else 0

    def unprocessed(self, asset: str) -> int:
        """How many windows of an asset wait to be processed; those that wait for an answer are not among them."""
        lane = self._lanes.get(asset)
        return 0 if lane is None else max(len(lane.entries) - lane.held, 0)

    def all(self) -> list[Lane]:
        """All lanes as of now, for any thread."""
        return list(self._lanes.values())

    def find(self, asset: str) -> Lane | None:
        """An asset's lane, where it has one."""
        return self._lanes.get(asset)

    def of(self, asset: str) -> Lane:
        """An asset's lane."""
        if asset not in self._lanes:
            rig = self._reception.rig(asset)
            self._lanes[asset] = Lane(
                asset=asset, rig=rig, twin=self._twin_of(asset, rig), state=self._new_state()
            )  # fmt: skip
        return self._lanes[asset]

    def restore(self, asset: str, checkpoint: Checkpoint, entries: Sequence[Entry] = ()) -> None:
        """Goes on where an earlier run ended, with the windows of an asset that it has left; `go` begins with them."""
        if checkpoint.assembly:
            self._reception.resume(asset, checkpoint.assembly, checkpoint.quality or {})
        lane = self.of(asset)
        lane.assembly = checkpoint.assembly or {}
        lane.make_from(checkpoint.making)
        lane.entries.extend(entries)
        if checkpoint.question is not None:
            lane.held = min(checkpoint.question["waiting"], len(lane.entries))
        lane.state, lane.report = checkpoint.state, checkpoint.report
        lane.index, lane.question, lane.shed = checkpoint.index + 1, checkpoint.question, checkpoint.shed

    def leave(self, asset: str, entries: Sequence[Entry]) -> None:
        """Windows that an earlier run has left of an asset of which nothing else is known; `go` begins with them."""
        if entries:
            self.of(asset).entries.extend(entries)

    # -- bounds --------------------------------------------------------------------------------------

    @property
    def total_backlog(self) -> int:
        """How many windows of all assets wait."""
        return sum(len(lane.entries) for lane in self.all())

    @property
    def total_bytes(self) -> int:
        """What the windows of all assets that wait take on disk."""
        return sum(lane.bytes for lane in self.all())

    def most_waiting(self) -> str:
        """The asset whose windows that wait take most."""
        return max(self._lanes.values(), key=lambda lane: (lane.bytes, len(lane.entries))).asset

    def shed(self, asset: str, as_left_out: Callable[[Entry], Window]) -> bool:
        """Leaves the oldest window of an asset out that waits, as a refused record; False where none can be.

        as_left_out  the window as it is committed, with a fault that says why
        """
        lane = self._lanes[asset]
        entry = next((entry for entry in lane.entries if entry is not lane.current), None)
        if entry is None:
            return False
        window = as_left_out(entry)
        made = Made(window=window, refused=window.faults[-1].detail, signals=False)
        try:
            self._commit(lane, entry, made, shed=True)
        except StorageUnavailable as error:
            if error.reason != "damaged" or entry.number is None:
                raise
            self.forget(entry.number)  # its record cannot be kept either
            delete_file(entry.file)
            lane.remove(entry)
            lane.shed += 1
        return True

    # -- turns ---------------------------------------------------------------------------------------

    def _turn(self, lane: Lane) -> None:
        """Starts what comes next, unless something of the asset is under way."""
        if lane.turning:
            return
        lane.turning = True
        try:
            while not lane.busy and (start := self._next(lane)) is not None:
                start()
        finally:
            lane.turning = False

    def _next(self, lane: Lane) -> Callable[[], None] | None:
        if isinstance(lane.state, StoredState) and (lane.jobs or lane.next_entry() is not None):
            return partial(self._settle, lane, partial(_load, lane))
        if lane.jobs:
            return partial(self._start_job, lane, lane.jobs.popleft())
        entry = lane.next_entry()
        if entry is None:
            return None
        if lane.all_wait and self._asks:
            assert lane.question is not None
            return partial(self._settle, lane, partial(self._hold, lane, lane.question, None))
        return partial(self._start_window, lane, entry)

    def _ask(self, lane: Lane, ask: Ask, done: Callable[[Made], None]) -> None:
        def noted(made: Made) -> None:
            self.faults += (made.refused or "").startswith(FAULT)
            self._timed(ask.verb, made.parts)
            done(made)

        lane.busy = True
        self._computing.start(Call(asset=lane.asset, twin=lane.twin, rig=lane.rig, state=lane.state, ask=ask), noted)

    def _settle(self, lane: Lane, action: Callable[[], None]) -> None:
        """Does what commits something, and goes on; where the storage cannot be used, the asset waits for it."""
        lane.busy = True
        if self._storage is None:
            action()
        elif not self._storage.attempt(partial(self._unless_damaged, lane, action))[0]:
            self._unsettled.append((lane, action))
            return
        if lane.stopped is not None:
            return
        lane.busy, lane.current = False, None
        self._turn(lane)

    def _unless_damaged(self, lane: Lane, action: Callable[[], None]) -> None:
        """Does what commits something; what is kept of one asset and is damaged holds up that asset alone."""
        try:
            action()
        except StorageUnavailable as error:
            if error.reason != "damaged":
                raise
            self._stop(lane, str(error))

    def _stop(self, lane: Lane, reason: str) -> None:
        """Nothing more is processed of an asset until the next start; its windows wait."""
        lane.stopped = reason
        self.stopped.append((lane.asset, reason))
        log.error("%s", reason, extra={"asset": lane.asset})

    # -- jobs ----------------------------------------------------------------------------------------

    def _start_job(self, lane: Lane, turn: Turn) -> None:
        try:
            ask = turn.kind.ask(lane, turn.job)
        except StoreError:
            raise
        except (TwinError, InputError) as reason:
            self._settle(lane, partial(turn.refuse, str(reason)))
            return
        if ask is None:
            self._end_job(lane, turn, Made())
        else:
            self._ask(lane, ask, partial(self._end_job, lane, turn))

    def _end_job(self, lane: Lane, turn: Turn, made: Made) -> None:
        refused = made.refused if made.unreadable is None else _unreadable(lane, made.unreadable)

        outcome: Outcome | None = None

        def end() -> None:
            nonlocal outcome  # made once, also where it is committed again because nobody knows whether it was
            if refused is not None:
                turn.refuse(refused)
                return
            try:
                outcome = outcome or turn.kind.then(lane, turn.job, made)
                self._sink.commit(outcome, turn.job)
            except StoreError:
                raise
            except (TwinError, InputError) as reason:
                turn.refuse(str(reason))
                return
            self._accept(lane, outcome)
            turn.ended(replace(turn.job, done=True, outcome=outcome.led_to))

        self._settle(lane, end)

    # -- windows -------------------------------------------------------------------------------------

    def _start_window(self, lane: Lane, entry: Entry) -> None:
        lane.current, entry.journey.started_ns = entry, later_time_ns()
        given = WindowToUse(
            start_ns=entry.start_ns, segment=entry.segment, file=entry.file, before=lane.encoders, refuse=entry.refuse
        )
        self._ask(lane, Ask("window", given), partial(self._end_window, lane, entry))

    def _end_window(self, lane: Lane, entry: Entry, made: Made) -> None:
        """One window to the sink, or to where it waits for an answer by people."""
        entry.journey.made_ns, entry.journey.parts = later_time_ns(), made.parts
        if made.unreadable is not None:
            self._stop(lane, _unreadable(lane, made.unreadable))
            return
        fell = made.fell
        if fell is None:
            self._settle(lane, partial(self._commit, lane, entry, made))
        elif self._asks and not fell.ignored:
            question = lane.question or count_fell(fell.seen, fell.fallen, entry.start_ns)
            self._settle(lane, partial(self._hold, lane, question, made.state))
        else:
            self._settle(lane, partial(self._commit, lane, entry, replace(made, refused=fell.reason)))

    def _commit(self, lane: Lane, entry: Entry, made: Made, *, shed: bool = False) -> None:
        question, refuse = lane.question, None
        if _is_one_disturbed(lane, entry, made):
            question, refuse = None, ONE_DISTURBED
        elif shed and question is not None and lane.entries.index(entry) < lane.held:
            question = waiting(question, lane.held - 1, left_out=1)
        outcome = replace(outcome_of(lane, made), waited=entry.number)
        if question is not lane.question:
            outcome = replace(outcome, changed={"question": question}, refuse=refuse)
        committed = self._sink.commit(outcome)
        lane.remove(entry)
        if not committed:
            return
        entry.journey.stored_ns = later_time_ns()
        lane.shed += any((fault["kind"], fault["channel"]) == LEFT_OUT for fault in outcome.record["faults"])
        self._accept(lane, outcome)
        entry.journey.published_ns = later_time_ns()
        self._arrived(lane.asset, outcome.index, outcome.record["quality"], entry.journey)

    def _accept(self, lane: Lane, outcome: Outcome) -> None:
        """Goes on from what has been committed, and shows it."""
        lane.accept(outcome)
        self._sink.publish(outcome)
        outcome.after()

    # -- questions -----------------------------------------------------------------------------------

    def _hold(self, lane: Lane, question: Mapping[str, Any], state: Any) -> None:
        """The next window waits for an answer."""
        held = Outcome(
            asset=lane.asset,
            held=True,
            state=state,
            changed={"question": waiting(question, lane.held + 1)},
            events=(("question", dict(question)),) if lane.question is None else (),
        )
        self._sink.commit(held)
        self._accept(lane, held)

    def question(self, asset: str) -> Mapping[str, Any] | None:
        """The question about an asset that is open."""
        return self._lanes[asset].question if asset in self._lanes else None

    def ask(self, asset: str, question: Mapping[str, Any] | None) -> None:
        """Opens a question, or ends it: what waited for its answer is next then. That is committed, and shown."""
        events = () if question is None else (("question", shown_question(question) or {}),)
        outcome = Outcome(asset=asset, changed={"question": question}, events=events)
        self._sink.commit(outcome)
        if question is not None:
            log.warning("%s: %s", asset, question["detail"], extra={"asset": asset})
        self._accept(self.of(asset), outcome)

    def look_for_repeats(self, asset: str, repeats: Repeats) -> None:
        """Asks where nothing but frames of passed times is received, and ends that question where others come."""
        question = self.question(asset)
        if not self._asks or (question is not None and question["kind"] != REPEATED):
            return
        frames = repeats.suspicious()
        if frames and question is None:
            ended_ns = self._reception.ended_ns(asset)
            self.ask(asset, frames_repeat(frames, bool(repeats.other), ended_ns))
        elif question is not None and not repeats.run:
            self.ask(asset, None)
            self._turn(self.of(asset))

    # -- life ----------------------------------------------------------------------------------------

    def give(self, asset: str, name: str, *, fresh: bool) -> None:
        """The windows of an asset that wait are a new asset's, which goes on with its stream.

        fresh  whether the new asset has not used any of the stream so far: the windows stay where they are
        """
        old, new = self.of(asset), self.of(name)
        old.release()
        if fresh:
            return
        new.entries.extend(old.entries)
        old.entries.clear()
        new.assembly, new.encoders = old.assembly, old.encoders
        new.counts = Counts(found=old.counts.copy().found)
        self._turn(new)

    def reopen(self, asset: str) -> None:
        """Goes on with the rig file and the options that the asset has now."""
        if asset in self._lanes:
            lane = self._lanes[asset]
            lane.rig = self._reception.rig(asset)
            lane.twin = self._twin_of(asset, lane.rig)


def _load(lane: Lane) -> None:
    """Reads what an asset's twin remembers, now that it is needed."""
    lane.state = lane.state.pack()


def _unreadable(lane: Lane, reason: str) -> str:
    return f"the stored state of {lane.asset} cannot be read: {reason}"


def _is_one_disturbed(lane: Lane, entry: Entry, made: Made) -> bool:
    """Whether a window shows that the one before it, which waits for an answer, was a disturbance of the counter."""
    question = lane.question
    return (
        question is not None
        and question["kind"] == COUNT_FELL
        and question["waiting"] == 1
        and not entry.again
        and made.refused is None
        and made.answer is not None
        and made.answer.record.get("revolutions") is not None
    )
