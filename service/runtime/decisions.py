"""Decisions on effects and inspections are carried out between two windows of their asset."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from typing import TypeVar

from service.alarms.keeper import AlarmKeeper
from service.contract.inspections import outcome_of, refusal
from service.results.board import Board, Snapshot
from service.results.decision_queue import DecisionQueue
from service.results.status_events import status_events
from service.results.store import ResultStore, StoredDecision, StoredInspection
from service.runtime.computing import Ask, Made
from service.runtime.in_order import Pending
from service.runtime.lane import Job, Lane
from service.runtime.lanes import Lanes
from service.runtime.outcomes import DecisionOutcome
from service.runtime.reception import Reception
from service.runtime.state_publication import StatePublication
from service.runtime.twin_port import Events
from twin.tracing.decisions import Decision

T = TypeVar("T", StoredDecision, StoredInspection)


class DecisionWorker:
    """Carries out the decisions and inspections that wait, each with all that it changes in one transaction."""

    def __init__(
        self,
        queue: DecisionQueue,
        reception: Reception,
        lanes: Lanes,
        store: ResultStore,
        board: Board,
        publication: StatePublication,
        alarms: AlarmKeeper | None = None,
    ) -> None:
        self._alarms = alarms
        self._queue, self._reception, self._lanes, self._store = queue, reception, lanes, store
        self._board, self._publication = board, publication
        self._begun: set[tuple[str, int]] = set()  # kind and number of what is on its way

    @property
    def asked(self) -> threading.Event:
        """Set while something may wait."""
        return self._queue.asked

    def pending(self) -> tuple[list[Pending], list[Pending]]:
        """The decisions that wait, and the inspections."""
        decisions, inspections = self._queue.pending(), self._queue.pending_inspections()
        return (
            [Pending(d.received_ns, partial(self._begin, ("decision", d.id), d, self._decision)) for d in decisions],
            [
                Pending(i.received_ns, partial(self._begin, ("inspection", i.id), i, self._inspection))
                for i in inspections
            ],
        )

    def _begin(self, key: tuple[str, int], waiting: T, job_of: Callable[[T], Job]) -> None:
        if key in self._begun:
            return
        job = job_of(waiting)

        def then(lane: Lane, made: Made) -> None:
            job.then(lane, made)
            self._end(key)

        def refuse(reason: str) -> None:
            job.refuse(reason)
            self._end(key)

        if self._lanes.find(waiting.asset) is None:
            refuse("no window has been processed yet")
        else:
            self._begun.add(key)
            self._lanes.do(waiting.asset, Job(ask=job.ask, then=then, refuse=refuse))

    def _end(self, key: tuple[str, int]) -> None:
        self._begun.discard(key)
        self._queue.done()

    def _decision(self, waiting: StoredDecision) -> Job:
        def then(lane: Lane, made: Made) -> None:
            outcome = lane.decided(made, self._reception.ended_ns(lane.asset))
            self._go_on(lane, outcome, partial(self._decided, waiting, outcome))

        return Job(
            ask=lambda lane: Ask("decide", Decision(name=waiting.name, verb=waiting.verb)),
            then=then,
            refuse=partial(self._store.refuse, waiting),
        )

    def _inspection(self, waiting: StoredInspection) -> Job:
        def then(lane: Lane, made: Made) -> None:
            outcome = lane.inspected(made, self._reception.ended_ns(lane.asset))
            self._go_on(lane, outcome, partial(self._inspected, waiting, outcome))

        return Job(
            ask=lambda lane: Ask("inspect", waiting.inspection),
            then=then,
            refuse=lambda reason: self._store.refuse_inspection(waiting, {**waiting.answer, **refusal(reason)}),
        )

    def _decided(self, waiting: StoredDecision, outcome: DecisionOutcome) -> bool:
        signed = {name: text for name, text in (("by", waiting.by), ("note", waiting.note)) if text is not None}
        events = [
            (kind, {**data, **signed} if kind == "effect" and data.get("action") == waiting.verb else data)
            for kind, data in outcome.events
        ]
        return self._store.carry_out(waiting, state=outcome.state.to_dict(), report=outcome.report, events=events)

    def _inspected(self, waiting: StoredInspection, outcome: DecisionOutcome) -> bool:
        before = self._board.get(outcome.asset)
        changed = outcome_of(waiting.inspection, before.report if before else None, outcome.report)
        return self._store.use_inspection(
            waiting,
            answer={**waiting.answer, **changed},
            state=outcome.state.to_dict(),
            report=outcome.report,
            events=(*outcome.events, ("inspection", {**waiting.inspection, **changed})),
        )

    def _go_on(self, lane: Lane, outcome: DecisionOutcome, keep: Callable[[], bool]) -> None:
        """Keeps all that an outcome changes, alarms too, in one transaction, and shows it; nothing a second time.

        keep  keeps the decision or inspection itself; False where it was done before
        """
        asset, report = outcome.asset, outcome.report
        before = self._board.get(asset) or Snapshot(asset=asset)
        opened = before.alarms
        with self._alarms.transaction() if self._alarms else nullcontext():
            first = keep()  # else an attempt of which that was not known has committed all of it
            events: Events = ()
            if self._alarms is not None:
                events = self._alarms.decision(asset, report) if first else ()
                opened = self._alarms.open(asset)
            if first:
                shown = replace(before, report=report, alarms=opened)
                self._store.note(asset, (*events, *status_events(before, *shown.health())))
            last = self._store.last_event_id(asset)
        lane.accept(outcome)
        self._board.update(asset, report=report, alarms=opened, last_event_id=last)
        self._publication.publish(asset)
