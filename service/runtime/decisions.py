"""Decisions on effects are carried out between frames, by the thread that owns the pipeline."""

from __future__ import annotations

import threading

from service.results.board import Board
from service.results.decision_queue import DecisionQueue
from service.results.store import ResultStore
from service.runtime.pipeline import Pipeline
from service.runtime.state_publication import StatePublication
from service.runtime.status_events import status_events
from twin.errors import TwinError


class Ended(Exception):
    """The service ends: whole windows that have not been processed are left to the next start."""


class DecisionWorker:
    """Carries out the decisions that wait, each with all that it changes in one transaction."""

    def __init__(
        self,
        queue: DecisionQueue,
        pipeline: Pipeline,
        store: ResultStore,
        board: Board,
        publication: StatePublication,
        ending: threading.Event,
    ) -> None:
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
            before = self._board.get(waiting.asset)
            changed = status_events(before, *before.health_after(report=outcome.report)) if before else ()
            if self._store.carry_out(
                waiting,
                state=outcome.state.to_dict(),
                report=outcome.report,
                events=(*outcome.events, *changed),
            ):
                self._pipeline.accept(outcome)
                last = self._store.last_event_id(waiting.asset)
                self._board.update(waiting.asset, report=outcome.report, last_event_id=last)
                self._publication.publish(waiting.asset)
        self._queue.done()
