"""Decisions on effects, and measured depths: jobs that ask the twin."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from service.alarms.keeper import AlarmKeeper
from service.contract.inspections import outcome_of, refusal
from service.contract.status import with_status_since
from service.results.jobs import DECISION, INSPECTION, Job
from service.results.sql_store import SqlStore
from service.runtime.computing import Ask, Made
from service.runtime.outcomes import Outcome
from service.runtime.place import JobKind, Place
from service.runtime.twin_port import Events
from twin.tracing.decisions import Decision


class Decisions:
    """How decisions and inspections are carried out: `kinds`."""

    def __init__(self, store: SqlStore) -> None:
        self._store = store
        self.kinds: Mapping[str, JobKind] = {
            DECISION: JobKind(self._decide, _decision),
            INSPECTION: JobKind(self._inspect, _inspection, _not_used),
        }

    def _decide(self, place: Place, job: Job, made: Made) -> Outcome:
        assert made.answer is not None
        signed = {name: job.given[name] for name in ("by", "note") if job.given[name] is not None}
        events = tuple(
            (kind, {**data, **signed} if kind == "effect" and data.get("action") == job.given["verb"] else data)
            for kind, data in made.answer.events
        )
        return decided(place, made, self._store.ended_ns(place.asset), events=events)

    def _inspect(self, place: Place, job: Job, made: Made) -> Outcome:
        assert made.answer is not None
        report = {**(place.report or {}), **made.answer.report}
        inspection = job.given["inspection"]
        changed = outcome_of(inspection, place.report, report)
        events = (*made.answer.events, ("inspection", {**inspection, **changed}))
        led_to = {**job.given["answer"], **changed}
        ended_ns = self._store.ended_ns(place.asset)
        return decided(place, made, ended_ns, report=report, events=events, led_to=led_to)


def decided(
    place: Place, made: Made, ended_ns: int, *, report: Mapping[str, Any] | None = None, **more: Any
) -> Outcome:
    """What the twin has made of what a person has said; the asset's windows end at `ended_ns`.

    report  the twin's answer; None for its answer as it is
    """
    assert made.answer is not None
    said = with_status_since(place.report, made.answer.report if report is None else report, ended_ns, None)

    def judge(alarms: AlarmKeeper, data: Mapping[str, Any]) -> Events:
        return alarms.decision(place.asset, said)

    return Outcome(asset=place.asset, state=made.state, report=said, **{"judge": judge, **more})


def _decision(place: Place, job: Job) -> Ask:
    return Ask("decide", Decision(name=job.given["name"], verb=job.given["verb"]))


def _inspection(place: Place, job: Job) -> Ask:
    return Ask("inspect", job.given["inspection"])


def _not_used(job: Job, reason: str) -> Mapping[str, Any]:
    """The answer to an inspection that cannot become part of the estimate."""
    return {**job.given["answer"], **refusal(reason)}
