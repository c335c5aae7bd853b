"""Decisions on effects, and measured depths: jobs that ask the twin."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from service.alarms.keeper import AlarmKeeper
from service.contract.inspections import outcome_of, refusal
from service.results.board import Board, Snapshot
from service.results.jobs import DECISION, INSPECTION, Job, Jobs
from service.results.sql_store import SqlStore
from service.results.status_events import status_events
from service.runtime.computing import Ask, Made
from service.runtime.job_worker import JobKind, once
from service.runtime.lane import Lane
from service.runtime.outcomes import DecisionOutcome
from service.runtime.reception import Reception
from service.runtime.state_publication import StatePublication
from service.runtime.twin_port import Events
from twin.tracing.decisions import Decision


class Decisions:
    """How decisions and inspections are carried out: `kinds`."""

    def __init__(
        self,
        jobs: Jobs,
        reception: Reception,
        store: SqlStore,
        board: Board,
        publication: StatePublication,
        alarms: AlarmKeeper | None = None,
    ) -> None:
        self._jobs, self._reception, self._store, self._alarms = jobs, reception, store, alarms
        self._board, self._publication = board, publication
        self.kinds: Mapping[str, JobKind] = {
            DECISION: JobKind(self._decide, _decision),
            INSPECTION: JobKind(self._inspect, _inspection, _not_used),
        }

    def _decide(self, lane: Lane, job: Job, made: Made) -> None:
        outcome = lane.decided(made, self._reception.ended_ns(lane.asset))
        signed = {name: job.given[name] for name in ("by", "note") if job.given[name] is not None}
        events = tuple(
            (kind, {**data, **signed} if kind == "effect" and data.get("action") == job.given["verb"] else data)
            for kind, data in outcome.events
        )
        self._keep(lane, job, outcome, events)

    def _inspect(self, lane: Lane, job: Job, made: Made) -> None:
        outcome, inspection = lane.inspected(made, self._reception.ended_ns(lane.asset)), job.given["inspection"]
        before = self._board.get(lane.asset)
        changed = outcome_of(inspection, before.report if before else None, outcome.report)
        events = (*outcome.events, ("inspection", {**inspection, **changed}))
        self._keep(lane, job, outcome, events, {**job.given["answer"], **changed})

    def _keep(
        self,
        lane: Lane,
        job: Job,
        outcome: DecisionOutcome,
        events: Events,
        led_to: Mapping[str, Any] | None = None,
    ) -> None:
        """Keeps all that a job changes, alarms too, in one transaction, and shows it; nothing a second time."""
        asset, report = outcome.asset, outcome.report
        before = self._board.get(asset) or Snapshot(asset=asset)
        opened = before.alarms
        with once(self._jobs, job, led_to) as first:
            if first:
                self._store.keep(asset, state=outcome.state.to_dict(), report=report)
                raised = () if self._alarms is None else self._alarms.decision(asset, report)
            if self._alarms is not None:
                opened = self._alarms.open(asset)
            if first:
                shown = replace(before, report=report, alarms=opened)
                self._store.note(asset, (*events, *raised, *status_events(before, *shown.health())))
            last = self._store.last_event_id(asset)
        lane.accept(outcome)
        self._board.update(asset, report=report, alarms=opened, last_event_id=last)
        self._publication.publish(asset)


def _decision(lane: Lane, job: Job) -> Ask:
    return Ask("decide", Decision(name=job.given["name"], verb=job.given["verb"]))


def _inspection(lane: Lane, job: Job) -> Ask:
    return Ask("inspect", job.given["inspection"])


def _not_used(job: Job, reason: str) -> Mapping[str, Any]:
    """The answer to an inspection that cannot become part of the estimate."""
    return {**job.given["answer"], **refusal(reason)}
