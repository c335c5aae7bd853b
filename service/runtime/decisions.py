"""Decisions on effects, and measured depths: jobs that ask the twin."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from service.alarms.keeper import AlarmKeeper
from service.contract.inspections import outcome_of, refusal
from service.contract.status import with_status_since
from service.results.jobs import DECISION, INSPECTION, Job
from service.runtime.computing import Ask, Made
from service.runtime.lane import JobKind, Lane
from service.runtime.outcomes import Outcome
from service.runtime.reception import Reception
from service.runtime.twin_port import Events
from twin.tracing.decisions import Decision


class Decisions:
    """How decisions and inspections are carried out: `kinds`."""

    def __init__(self, reception: Reception) -> None:
        self._reception = reception
        self.kinds: Mapping[str, JobKind] = {
            DECISION: JobKind(self._decide, _decision),
            INSPECTION: JobKind(self._inspect, _inspection, _not_used),
        }

    def _decide(self, lane: Lane, job: Job, made: Made) -> Outcome:
        assert made.answer is not None
        signed = {name: job.given[name] for name in ("by", "note") if job.given[name] is not None}
        events = tuple(
            (kind, {**data, **signed} if kind == "effect" and data.get("action") == job.given["verb"] else data)
            for kind, data in made.answer.events
        )
        return decided(lane, made, self._reception.ended_ns(lane.asset), events=events)

    def _inspect(self, lane: Lane, job: Job, made: Made) -> Outcome:
        assert made.answer is not None
        report = {**(lane.report or {}), **made.answer.report}
        inspection = job.given["inspection"]
        changed = outcome_of(inspection, lane.report, report)
        events = (*made.answer.events, ("inspection", {**inspection, **changed}))
        led_to = {**job.given["answer"], **changed}
        ended_ns = self._reception.ended_ns(lane.asset)
        return decided(lane, made, ended_ns, report=report, events=events, led_to=led_to)


def decided(lane: Lane, made: Made, ended_ns: int, *, report: Mapping[str, Any] | None = None, **more: Any) -> Outcome:
    """What the twin has made of what a person has said; the asset's windows end at `ended_ns`.

    report  the twin's answer; None for its answer as it is
    """
    assert made.answer is not None
    said = with_status_since(lane.report, made.answer.report if report is None else report, ended_ns, None)

    def judge(alarms: AlarmKeeper, data: Mapping[str, Any]) -> Events:
        return alarms.decision(lane.asset, said)

    return Outcome(asset=lane.asset, state=made.state, report=said, **{"judge": judge, **more})


def _decision(lane: Lane, job: Job) -> Ask:
    return Ask("decide", Decision(name=job.given["name"], verb=job.given["verb"]))


def _inspection(lane: Lane, job: Job) -> Ask:
    return Ask("inspect", job.given["inspection"])


def _not_used(job: Job, reason: str) -> Mapping[str, Any]:
    """The answer to an inspection that cannot become part of the estimate."""
    return {**job.given["answer"], **refusal(reason)}
