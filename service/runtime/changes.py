"""Changes of assets are carried out between frames, by the thread that owns the pipeline.

| kind | what it does |
| --- | --- |
| gears_replaced, sensor_moved, oil_changed, counter_reset, reassembled | ends what twin/machine_changes.py says |
| other_machine | answers a question: the windows that wait, and the stream, are those of a new asset |
| ignore | answers a question: the windows of the fallen count are not used; the earlier rig file is kept |
| renamed | the asset with its whole history has another name; frames under the old name go on to it |
| baseline_given, baseline_removed | the asset has a healthy baseline of its own, or that of the settings again |
| retired, reinstated | no frames are expected, and those that come are left out; and the reverse |

Each is one transaction with all that it changes. The windows that waited for its answer are processed afterwards, one
transaction each; those that a kill leaves are processed by the next start.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from service.alarms.keeper import AlarmKeeper
from service.contract.base import iso_time
from service.errors import InputError
from service.results.asset_life import AssetLife, StoredChange
from service.results.baseline_store import BaselineStore
from service.results.board import Board
from service.results.change_queue import ChangeQueue
from service.results.signal_store import SignalStore
from service.results.sparkline import Sparkline
from service.results.status_events import status_events
from service.results.store import ResultStore
from service.runtime.decisions import Ended
from service.runtime.intake import Intake
from service.runtime.pipeline import Pipeline
from service.runtime.questions import GEARS_DIFFER, REPEATED
from service.runtime.state_publication import StatePublication
from service.runtime.streams import Streams
from service.runtime.twin_port import Events
from twin.errors import TwinError
from twin.machine_change import MachineChange

IGNORED = "windows of this revolution count are not used, as decided when it had fallen"


class ChangeWorker:
    """Carries out the changes that wait."""

    def __init__(
        self,
        queue: ChangeQueue,
        pipeline: Pipeline,
        store: ResultStore,
        life: AssetLife,
        board: Board,
        publication: StatePublication,
        *,
        streams: Streams,
        intake: Intake,
        signals: SignalStore | None,
        alarms: AlarmKeeper | None,
        baselines: BaselineStore,
        ending: threading.Event,
    ) -> None:
        self._queue, self._pipeline, self._store, self._life = queue, pipeline, store, life
        self._board, self._publication, self._ending = board, publication, ending
        self._streams, self._intake, self._signals = streams, intake, signals
        self._alarms, self._baselines = alarms, baselines
        self._kinds: Mapping[str, Callable[[StoredChange], None]] = {
            "other_machine": self._other_machine,
            "ignore": self._ignore,
            "renamed": self._rename,
            "retired": self._retire,
            "reinstated": self._retire,
            "baseline_given": self._baseline,
            "baseline_removed": self._baseline,
        }

    def resume(self) -> None:
        """Processes the windows whose question was answered before the service ended."""
        for asset in self._store.assets():
            if self._pipeline.question(asset) is None and self._life.waiting_total(asset)[0]:
                self._pipeline.use_waiting(asset)

    def __call__(self) -> None:
        """Carries out what waits; Ended where the service ends meanwhile."""
        if not self._queue.asked.is_set():
            return
        for change in self._queue.pending():
            if self._ending.is_set():
                raise Ended
            try:
                self._kinds.get(change.kind, self._machine)(change)
            except (TwinError, InputError) as reason:
                self._life.refuse_change(change.id, str(reason))
            self._queue.done()
        self._queue.done()

    # -- the kinds -----------------------------------------------------------------------------------

    def _machine(self, change: StoredChange) -> None:
        """A change of the machine: what it ends of the twin's memory begins again."""
        asset, given = change.asset, change.given
        made = MachineChange(
            kind=change.kind, sensor=given.get("sensor"), at=given.get("revolutions"), began=given.get("count") or 0.0
        )
        if made.sensor is not None:
            self._demand_sensor(asset, made.sensor)
        question = self._pipeline.question(asset)
        answers = question is not None and change.kind in question["answers"]
        outcome = self._pipeline.follow(asset, made)
        epoch = self._store.asset(asset).epoch + (change.kind == "gears_replaced")
        first = self._pipeline.next_index(asset)
        effect = {"epoch": epoch, "revolutions": self._revolutions(asset), "from_window": first}
        rig = question.get("rig") if answers and question is not None and change.kind == "gears_replaced" else None
        with self._life.transaction():
            if not self._life.change_done(change.id, effect):
                return
            parts = {"question": None} if answers else {}
            self._store.keep(asset, state=outcome.state.to_dict(), report=outcome.report, epoch=epoch, **parts)
            if rig is not None:
                self._store.keep_rig(asset, rig)
            opened, alarms = self._alarms_after(asset, made, outcome.report)
            then = {"report": outcome.report, "question": None if answers else question, "alarms": opened}
            events = (*outcome.events, *alarms, *self._status_events(asset, **then))
            self._store.note(asset, [_event(change, effect), *events])
        self._pipeline.accept(outcome)
        blank = {"records": (), "latest": {}, "windows_total": 0, "updates": 0, "sparkline": Sparkline()}
        shown = blank if change.kind == "gears_replaced" else {}
        self._show(asset, report=outcome.report, alarms=opened, epoch=epoch, **shown)
        if rig is not None:
            self._pipeline.reopen(asset)
        if answers:
            self._answered(asset)

    def _other_machine(self, change: StoredChange) -> None:
        """The stream is another machine's from now on, with the windows that wait."""
        asset, name = change.asset, change.given["name"]
        question = self._open_question(change)
        self._demand_new(name)
        state = self._pipeline.forgotten(asset)
        rig = question.get("rig") or self._store.asset(asset).rig
        effect = {"asset": name}
        with self._life.transaction():
            if not self._life.change_done(change.id, effect):
                return
            self._store.keep(asset, question=None, **({} if state is None else {"state": state.to_dict()}))
            self._store.note(name, [("change", {"kind": "created", "from": asset})])
            if rig is not None:
                self._store.keep_rig(name, rig)
            self._life.give_waiting(asset, name)
            self._life.route(asset, name)
            self._store.note(asset, [_event(change, effect), *self._status_events(asset, question=None)])
        self._streams.reload()
        self._pipeline.ask(asset, None)
        if state is not None:
            self._pipeline.set_state(asset, state)
        self._show(asset)
        self._pipeline.split(asset, name, fresh=question["kind"] == REPEATED)
        self._intake.know(name)
        self._board.update(name, rig=rig, last_event_id=self._store.last_event_id(name))
        self._publication.publish(name)
        self._pipeline.use_waiting(name)

    def _ignore(self, change: StoredChange) -> None:
        """The question is closed without a change."""
        asset, question = change.asset, self._open_question(change)
        by_count = question["kind"] not in (GEARS_DIFFER, REPEATED)
        state = self._pipeline.ignoring(asset) if by_count else None
        effect = {"question": question["kind"], "differences": question.get("differences", [])}
        with self._life.transaction():
            if not self._life.change_done(change.id, effect):
                return
            self._store.keep(asset, question=None, **({} if state is None else {"state": state.to_dict()}))
            self._store.note(asset, [_event(change, effect), *self._status_events(asset, question=None)])
        if question["kind"] == REPEATED:
            self._pipeline.ignore_repeats(asset)
        if state is not None:
            self._pipeline.set_state(asset, state)
            self._pipeline.ask(asset, None)
            self._pipeline.refuse_waiting(asset, IGNORED)
        self._answered(asset)

    def _rename(self, change: StoredChange) -> None:
        """The asset has another name, and all its history with it."""
        old, name = change.asset, change.given["name"]
        self._demand_new(name)
        with self._life.transaction():
            if not self._life.change_done(change.id, {"asset": name, "was": old}):
                return
            self._life.rename(old, name)
            self._store.note(name, [_event(change, {"asset": name, "was": old})])
        self._streams.reload()
        self._pipeline.rename(old, name)
        self._intake.rename(old, name)
        if self._signals is not None:
            self._signals.rename(old, name)
        self._board.rename(old, name)
        self._publication.withdraw(old)
        self._show(name)

    def _retire(self, change: StoredChange) -> None:
        """The asset is out of use, or in use again."""
        asset, retired = change.asset, None
        if change.kind == "retired":
            retired = {"since": iso_time(change.received_ns)} | {k: change.given.get(k) for k in ("by", "note")}
        with self._life.transaction():
            if not self._life.change_done(change.id, {}):
                return
            self._store.keep(asset, retired=retired)
            self._store.note(asset, [_event(change, {})])
        self._show(asset, retired=retired)

    def _baseline(self, change: StoredChange) -> None:
        """The asset has another healthy baseline of its own, or none."""
        asset, given = change.asset, change.given
        before = self._baselines.path(asset)
        file = given.get("file")
        if file is not None and not self._baselines.exists(file):
            raise InputError("the baseline that was to be used has been deleted meanwhile: learn it again")
        about = {name: given[name] for name in ("by", "note", "windows", "added") if given.get(name) is not None}
        with self._life.transaction():
            if not self._life.change_done(change.id, about):
                return
            if file is None:
                self._baselines.remove(asset)
            else:
                self._baselines.use(asset, file, {**about, "at": iso_time(change.received_ns)})
            self._store.note(asset, [("change", {"id": change.id, "kind": change.kind, **about})])
        self._pipeline.renew_twin(asset)
        self._baselines.delete(before)
        self._show(asset)

    # -- within --------------------------------------------------------------------------------------

    def _answered(self, asset: str) -> None:
        """Closes the question, and processes what waited for its answer."""
        self._pipeline.ask(asset, None)
        self._show(asset)
        self._pipeline.use_waiting(asset)

    def _show(self, asset: str, **parts: Any) -> None:
        last = self._store.last_event_id(asset)
        question = self._pipeline.question(asset)
        self._board.update(asset, last_event_id=last, question=question, **parts)
        self._publication.publish(asset)

    def _alarms_after(
        self, asset: str, made: MachineChange, report: Mapping[str, Any]
    ) -> tuple[tuple[Mapping[str, Any], ...], Events]:
        """Open alarms after a change, and their events; limits that were learned before it are learned again."""
        if self._alarms is None:
            return (), ()
        if made.kind in ("gears_replaced", "reassembled", "sensor_moved"):
            memory = self._alarms.store.memory(asset)
            memory.forget_learned(made.sensor or "")
            self._alarms.store.keep_memory(asset, memory)
        events = self._alarms.decision(asset, report)
        return self._alarms.open(asset), events

    def _status_events(self, asset: str, **changes: Any) -> Events:
        """The event where a change of what is shown changes the status."""
        before = self._board.get(asset)
        return () if before is None else status_events(before, *replace(before, **changes).health())

    def _open_question(self, change: StoredChange) -> Mapping[str, Any]:
        question = self._pipeline.question(change.asset)
        if question is None or change.kind not in question["answers"]:
            raise InputError(f"{change.kind} answers a question, and none that it answers is open for {change.asset}")
        return question

    def _demand_new(self, name: str) -> None:
        if name in self._store.assets() or self._streams.asset_of(name) != name:
            raise InputError(f"there is an asset {name!r} already, or one that was called so: give another name")

    def _demand_sensor(self, asset: str, sensor: str) -> None:
        channels = self._pipeline.quality(asset).get("channels") or {}
        known = sorted(label.partition("/")[2] for label in channels if label.startswith("accel/"))
        if known and sensor not in known:
            raise InputError(f"no accelerometer {sensor!r} of {asset} has sent a frame; known: {', '.join(known)}")

    def _revolutions(self, asset: str) -> float | None:
        snapshot = self._board.get(asset)
        return None if snapshot is None else snapshot.latest.get("revolutions")


def _event(change: StoredChange, effect: Mapping[str, Any]) -> tuple[str, Mapping[str, Any]]:
    return "change", {"id": change.id, "kind": change.kind, **change.given, "effect": dict(effect)}
