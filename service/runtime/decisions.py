"""Decisions on effects and inspections are carried out between frames, by the thread that owns the pipeline."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from functools import partial

from service.alarms.keeper import AlarmKeeper
from service.contract.inspections import outcome_of, refusal
from service.results.board import Board, Snapshot
from service.results.decision_queue import DecisionQueue
from service.results.status_events import status_events
from service.results.store import ResultStore, StoredDecision, StoredInspection
from service.runtime.pipeline import DecisionOutcome, Pipeline
from service.runtime.state_publication import StatePublication
from service.runtime.twin_port import Events
from twin.errors import TwinError


class Ended(Exception):
    """The service ends: whole windows that have not been processed are left to the next start."""


class DecisionWorker:
    """Carries out the decisions and inspections that wait, each with all that it changes in one transaction."""

    def __init__(
        self,
        queue: DecisionQueue,
        pipeline: Pipeline,
        store: ResultStore,
        board: Board,
        publication: StatePublication,
        ending: threading.Event,
        alarms: AlarmKeeper | None = None,
    ) -> None:
        self._alarms = alarms
        self._queue, self._pipeline, self._store = queue, pipeline, store
        self._board, self._publication, self._ending = board, publication, ending

    def __call__(self) -> None:
        """Carries out what waits; Ended where the service ends meanwhile."""
        if not self._queue.asked.is_set():
            return
        for waiting in self._queue.pending():
            if self._ending.is_set():
                raise Ended
            try:
                outcome = self._pipeline.decide(waiting.asset, waiting.name, waiting.verb)
            except TwinError as reason:
                self._store.refuse(waiting, str(reason))
                continue
            self._go_on(outcome, partial(self._decided, waiting, outcome))
        self._use_inspections()
        self._queue.done()

    def _use_inspections(self) -> None:
        for waiting in self._queue.pending_inspections():
            if self._ending.is_set():
                raise Ended
            try:
                outcome = self._pipeline.inspect(waiting.asset, waiting.inspection)
            except TwinError as reason:
                self._store.refuse_inspection(waiting, {**waiting.answer, **refusal(str(reason))})
                continue
            self._go_on(outcome, partial(self._inspected, waiting, outcome))

    def _decided(self, waiting: StoredDecision, outcome: DecisionOutcome) -> bool:
        signed = {name: text for name, text in (("by", waiting.by), ("note", waiting.note)) if text is not None}
        events = [
            (kind, {**data, **signed} if kind == "effect" and data.get("action") == waiting.verb else data)
            for kind, data in outcome.events
        ]
        return self._store.carry_out(waiting, state=outcome.state.to_dict(), report=outcome.report, events=events)

    def _inspected(self, waiting: StoredInspection, outcome: DecisionOutcome) -> bool:
        before = self._board.get(waiting.asset)
        changed = outcome_of(waiting.inspection, before.report if before else None, outcome.report)
        return self._store.use_inspection(
            waiting,
            answer={**waiting.answer, **changed},
            state=outcome.state.to_dict(),
            report=outcome.report,
            events=(*outcome.events, ("inspection", {**waiting.inspection, **changed})),
        )

    def _go_on(self, outcome: DecisionOutcome, keep: Callable[[], bool]) -> None:
        """Keeps all that an outcome changes, alarms too, in one transaction, and shows it; nothing a second time.

        keep  keeps the decision or inspection itself; False where it was done before
        """
        asset, report = outcome.asset, outcome.report
        before = self._board.get(asset) or Snapshot(asset=asset)
        shown = replace(before, report=report)
        with self._alarms.transaction() if self._alarms else nullcontext():
            if not keep():
                return
            events: Events = ()
            if self._alarms is not None:
                events = self._alarms.decision(asset, report)
                shown = replace(shown, alarms=self._alarms.open(asset))
            self._store.note(asset, (*events, *status_events(before, *shown.health())))
        self._board.update(asset, report=report, alarms=shown.alarms, last_event_id=self._store.last_event_id(asset))
        self._pipeline.accept(outcome)
        self._publication.publish(asset)
