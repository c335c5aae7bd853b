"""One job of an asset, from its row to its transaction: what whoever computes does, in whatever process.

    turned = work.turn("press-7")

People's jobs and notices come before windows, and windows in the order in which they closed; those that wait for an
answer by people are passed over. What a job goes on from is at hand where this process has committed the asset's last
job, and is read else. What could not be committed is committed by the next turn, without being computed again.
"""

from __future__ import annotations

import logging
import threading
from collections import OrderedDict
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

from service.alarms.keeper import AlarmKeeper
from service.alarms.rules import rules_at
from service.errors import FAULT, InputError, SteppedBack, StorageUnavailable, StoreError
from service.results.alarm_store import AlarmStore
from service.results.asset_table import AssetTable
from service.results.baseline_store import BaselineStore
from service.results.data_folder import BASELINES, SEGMENTS
from service.results.jobs import TRIES, Job, Jobs
from service.results.kept_signals import KeptSignals
from service.results.names import Names
from service.results.retention import Retention
from service.results.schema import WINDOW
from service.results.snapshot import Stale
from service.results.sql_store import SqlStore, Superseded, new_mark
from service.results.window_jobs import WaitingWindow, WindowJobs
from service.runtime.asset_twins import AssetTwins
from service.runtime.changes import Changes
from service.runtime.commits import Commits, Marks
from service.runtime.computing import Ask, Call, Made, Turned, WindowToUse, carry_out
from service.runtime.decisions import Decisions
from service.runtime.notices import Notices
from service.runtime.outcomes import Outcome
from service.runtime.place import JobKind, Place
from service.runtime.questions import ALL_WAIT, COUNT_FELL, count_fell, one_left_out
from service.runtime.twin_port import Twin, guarded
from service.runtime.window_outcomes import given_up, left_out, outcome_of
from service.settings import Settings
from service.steady_clock import later_time_ns
from twin.errors import TwinError
from twin.rig import Rig

log = logging.getLogger(__name__)

KEPT = 64  # assets whose place is at hand; those of others are read again
NO_WINDOW = "no window has been processed yet"
OTHER_VERSION = "it was written by another version of gear-twin; use that version, or another --data directory"
DAMAGED = "it is damaged, or this is an internal error; restore a backup, or report it"
ONE_DISTURBED = (
    "the revolution count of this window alone lies far below that of the windows before and after it: it is taken for "
    "a disturbance of the counter"
)


PUT_BACK = "the database was put back, or another server took its place; the service begins anew from what is there"


class Stopped(Exception):
    """An asset that cannot go on from what is kept of it; it is tried again now and then."""


class Ended(Exception):
    """Nothing is committed here any more."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Due:
    """What is to be committed, and what is answered then."""

    place: Place
    outcome: Outcome
    job: Job | None
    marks: Marks
    turned: Turned


class Work:
    """The jobs of any asset; those of one asset are asked for one after the other.

    begun  called with the row that is gone on with, and whether it is only to be refused
    name   of whoever carries jobs out here
    """

    def __init__(
        self,
        store: SqlStore,
        table: AssetTable,
        twin: Twin,
        *,
        windows: WindowJobs,
        names: Names,
        baselines: BaselineStore,
        signals: KeptSignals | None = None,
        alarms: AlarmKeeper | None = None,
        retention: Retention | None = None,
        begun: Callable[[int, bool], object] = lambda row, refused: None,
        name: str | None = None,
    ) -> None:
        self._begun = begun
        self.database = store.database
        self._store, self._table, self._windows, self._jobs = store, table, windows, Jobs(store.database)
        self._commits = Commits(store, table, windows, signals, alarms, worker=name, retention=retention)
        self._twins = AssetTwins(twin, baselines)
        changes = Changes(self._jobs, windows, store, table, names=names, baselines=baselines)
        notices = Notices(self._jobs, store, table)
        self._kinds: Mapping[str, JobKind] = {**Decisions(store).kinds, **changes.kinds, **notices.kinds}
        self._places: OrderedDict[str, tuple[int, Place]] = OrderedDict()  # with the asset's mark
        self._lock = threading.Lock()  # of those: several threads have assets side by side
        self._due: dict[str, _Due] = {}  # by asset
        self.ended = threading.Event()  # nothing is committed any more

    def turn(self, asset: str, *, hand_back: bool = False) -> Turned:
        """Carries the next job of an asset out.

        hand_back  whether nothing is done where it leads to a search for effects, which may take long
        """
        try:
            return self._turn(asset, hand_back)
        except Ended:
            return Turned(asset=asset)
        except Stopped as reason:
            return self._stopped(asset, reason)
        except StorageUnavailable as error:
            if error.reason == "damaged":
                return self._stopped(asset, error)
            return Turned(asset=asset, unstored=error)
        except (StoreError, OSError) as error:
            return Turned(asset=asset, unstored=error)

    def _stopped(self, asset: str, reason: Exception) -> Turned:
        """Nothing is done of an asset now: it is shown so."""
        shown = self._table.get(asset)
        if shown is None or shown.damaged is None or shown.damaged.reason != str(reason):  # nobody has said so yet
            log.error("%s", reason, extra={"asset": asset})
            self._table.note(asset, damaged=Stale(since_ns=later_time_ns(), reason=str(reason)))
        with suppress(StoreError):
            self._table.write_noted()
        return Turned(asset=asset, stopped=str(reason))

    def curves(self, asset: str) -> Mapping[Any, Any]:
        """The wear curves of an asset that are at hand, by their keys."""
        _, place = self._places.get(asset, (0, None))
        return {} if place is None or place.twin.curves is None else place.twin.curves(place.rig, place.state)

    # -- turns ---------------------------------------------------------------------------------------

    def _turn(self, asset: str, hand_back: bool) -> Turned:
        mark = self._store.mark(asset)
        due = self._due.get(asset)
        if due is not None and mark in due.marks:
            return self._commit(due)
        self._due.pop(asset, None)
        job = self._jobs.next(asset)
        window = self._windows.next(asset) if job is None else None
        waits = job or window
        if waits is None:
            return Turned(asset=asset)
        self._begun(waits.id, waits.tries >= TRIES)
        try:
            return self._carry_out(asset, mark, job, window, hand_back)
        except (StoreError, OSError, Stopped, Ended):
            raise
        except MemoryError:
            self._jobs.failed(waits.id, "had too little memory")
            raise
        except Exception as error:
            log.exception("%s: what was to be done next", asset, extra={"asset": asset})
            self._jobs.failed(waits.id, f"{type(error).__name__}: {error}")
            return Turned(asset=asset, job=waits.id)

    def _carry_out(
        self, asset: str, mark: int, job: Job | None, window: WaitingWindow | None, hand_back: bool
    ) -> Turned:
        waits, place = job or window, self._place(asset, mark)
        assert waits is not None
        if place is None:
            return Turned(asset=asset)
        marks = Marks(mark, new_mark())
        refuse = f"{FAULT}: {waits.fault}, {waits.tries} times" if waits.tries >= TRIES else None
        if job is not None:
            return self._people(place, marks, job, refuse, hand_back)
        assert window is not None
        return self._window(place, marks, window, refuse, hand_back)

    def _place(self, asset: str, mark: int) -> Place | None:
        """Where the asset's jobs have come to; None where somebody has committed one while that was read."""
        known, place = self._places.get(asset, (None, None))
        if place is None or known != mark:
            place = self._read(asset)
            if self._store.mark(asset) != mark:
                return None
        self._at_hand(place, mark)
        return place

    def _at_hand(self, place: Place, mark: int) -> None:
        with self._lock:
            self._places[place.asset] = mark, place
            self._places.move_to_end(place.asset)
            if len(self._places) > KEPT:
                self._places.popitem(last=False)

    def _read(self, asset: str) -> Place:
        stored = self._store.asset(asset)
        if stored.damaged is not None:
            self._store.demand_sound(asset)
        rig = Rig.from_mapping(stored.rig or {})
        twin = self._twins.of(asset, rig)
        try:
            state = twin.load_state(stored.state) if stored.state is not None else twin.new_state()
        except TwinError as error:
            raise Stopped(f"the stored state of {asset} cannot be read: {error}: {OTHER_VERSION}") from error
        except ValueError as error:
            raise Stopped(f"the stored state of {asset} cannot be read: {error}: {DAMAGED}") from error
        index = self._store.next_index(asset)
        place = Place(asset=asset, rig=rig, twin=twin, state=state, index=index, report=stored.report)
        place.question, place.begun = stored.question, stored.state is not None or index > 0
        place.make_from(stored.making or {})
        return place

    def _commit(self, due: _Due) -> Turned:
        """Keeps what a job has led to, and goes on from it."""
        asset, outcome = due.place.asset, due.outcome
        if self.ended.is_set():
            raise Ended
        self._due[asset] = due
        try:
            is_new = self._commits.commit(outcome, due.job, due.marks)
        except Superseded:
            del self._due[asset]
            return Turned(asset=asset)
        except (StoreError, OSError):
            raise
        except BaseException:
            del self._due[asset]
            raise
        del self._due[asset]
        due.place.accept(outcome)
        if not is_new or (due.job is not None and due.job.changes):
            with self._lock:
                self._places.pop(asset, None)  # nothing has moved on, or its rig file or baseline may be another one
        else:
            self._at_hand(due.place, due.marks.after)
        outcome.after()
        return due.turned

    # -- people's jobs, and notices ------------------------------------------------------------------

    def _people(self, place: Place, marks: Marks, job: Job, refused: str | None, hand_back: bool) -> Turned:
        kind, turned, stages = self._kinds[job.kind], Turned(asset=place.asset, job=job.id, kind=job.kind), {}
        refused = refused or (None if kind.begins or place.begun else NO_WINDOW)
        try:
            if refused is None:
                ask = kind.ask(place, job)
                made = Made() if ask is None else self._carried_out(place, ask, hand_back)
                if made.handed_back:
                    return Turned(asset=place.asset, search=True)
                if ask is not None:
                    stages = {"verb": ask.verb, "parts": made.parts}
                refused = made.refused
            if refused is None:
                outcome = kind.then(place, job, made)
                if outcome is None:
                    self._jobs.end(job)
                    return turned
                outcome = replace(outcome, stages=stages)
                return self._commit(_Due(place=place, outcome=outcome, job=job, marks=marks, turned=turned))
        except StoreError:
            raise
        except (TwinError, InputError) as reason:
            refused = str(reason)
        self._jobs.refuse(job, refused, kind.refused(job, refused))
        return turned

    def _carried_out(self, place: Place, ask: Ask, hand_back: bool) -> Made:
        return carry_out(
            Call(asset=place.asset, twin=place.twin, rig=place.rig, state=place.state, ask=ask, hand_back=hand_back)
        )

    # -- windows -------------------------------------------------------------------------------------

    def _window(self, place: Place, marks: Marks, window: WaitingWindow, refuse: str | None, hand_back: bool) -> Turned:
        turned, started_ns = Turned(asset=place.asset, job=window.id, kind=WINDOW), later_time_ns()
        question, file = place.question, self._windows.path_of(window)
        if question is not None and question["kind"] in ALL_WAIT and file is not None:
            return self._hold(place, marks, window, question, None, turned)
        if file is None:
            made = left_out(window.start_ns, window.refuse or "")
        elif refuse is not None:
            made = given_up(window.start_ns, refuse)
        else:
            given = WindowToUse(start_ns=window.start_ns, file=file, before=place.encoders, refuse=window.refuse)
            made = self._carried_out(place, Ask("window", given), hand_back)
        if made.handed_back:
            return Turned(asset=place.asset, search=True)
        if made.refused is not None and file is not None and not file.exists():
            again = self._windows.next(place.asset)
            if again is not None and again.id == window.id and again.file is None:  # it has been left out meanwhile
                return self._window(place, marks, again, refuse, hand_back)
            if again == window:  # a file is deleted after the commit by which its row names it no more
                self._windows.demand_folder()
                raise SteppedBack(
                    f"a window waits whose file is not there ({file}): {PUT_BACK}", reason="input or output"
                )
        stages = {"verb": "window", "job": window.id, "started_ns": started_ns, "made_ns": later_time_ns()}
        fell = made.fell
        if fell is not None and not fell.ignored:
            asked = question or count_fell(fell.seen, fell.fallen, window.start_ns)
            return self._hold(place, marks, window, asked, made.state, turned)
        if fell is not None:
            made = replace(made, refused=fell.reason)
        outcome = replace(outcome_of(place, made), waited=window, stages=stages | {"parts": made.parts})
        if self._is_one_disturbed(question, window, made):
            outcome = replace(outcome, changed={"question": None}, refuse=ONE_DISTURBED)
        elif file is None and window.again and question is not None:
            outcome = replace(outcome, changed={"question": one_left_out(question)})
        turned = replace(turned, index=outcome.index)
        return self._commit(_Due(place=place, outcome=outcome, job=None, marks=marks, turned=turned))

    def _hold(
        self,
        place: Place,
        marks: Marks,
        window: WaitingWindow,
        question: Mapping[str, Any],
        state: Any,
        turned: Turned,
    ) -> Turned:
        """A window waits for an answer by people."""
        held = Outcome(
            asset=place.asset,
            held=True,
            waited=window,
            state=state,
            changed={"question": question},
            events=(("question", dict(question)),) if place.question is None else (),
        )
        return self._commit(_Due(place=place, outcome=held, job=None, marks=marks, turned=turned))

    def _is_one_disturbed(self, question: Mapping[str, Any] | None, window: WaitingWindow, made: Made) -> bool:
        """Whether a window shows that the one before it, which waits for an answer, was a fault of the counter."""
        goes_on = made.refused is None and made.answer is not None and made.answer.record.get("revolutions") is not None
        fell = question is not None and question["kind"] == COUNT_FELL
        return fell and goes_on and not window.again and self._windows.held(window.asset) == 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Workplace:
    """Where another process finds what it works on; can be handed to it.

    open  the results, which a service of which that process is a part has opened before
    make  makes the twin of its options
    """

    settings: Settings
    open: Callable[[], SqlStore]
    make: Callable[[Any], Twin]
    options: Any

    def work(self, begun: Callable[[int, bool], object], name: str) -> Work:
        """What is done there; `begun` and `name` are those of `Work`."""
        store, data = self.open(), self.settings.data
        alarms = AlarmKeeper(AlarmStore(store.database), rules_at(self.settings.alarm_rules), self.settings.webhooks)
        segments = data / SEGMENTS
        return Work(
            store,
            AssetTable(store, alarms),
            guarded(self.make(self.options), passed=(MemoryError,)),  # another process may have enough
            windows=WindowJobs(store.database, segments, sweeps=False),
            names=Names(store.database),
            baselines=BaselineStore(store.database, data / BASELINES, clears=False),
            signals=KeptSignals(store.database, segments, self.settings.signal_bytes),
            alarms=alarms,
            retention=Retention.of(self.settings),
            begun=begun,
            name=name,
        )
