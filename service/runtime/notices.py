"""Notices: what who receives frames has seen of an asset, judged by whoever computes, between the asset's other jobs.

| about | seen | what it may lead to |
| --- | --- | --- |
| `stale` | since when, and why; no `reason` where frames come again | the asset is shown so, with an event and alarms |
| `alarms` | nothing | those of its data are raised again as long as it is stale |
| `frames_repeat` | how many frames of passed times; 0 where others come | a question to people, or its end |
| `gears_differ` | another rig file, and where it is from; null where none is given | a question to people, or its end |

One that holds no more when it is judged leads to nothing.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Any

from service.alarms.keeper import AlarmKeeper
from service.contract.status import shown_question
from service.results.asset_table import AssetTable
from service.results.jobs import ALARMS, NOTICE, STALE, Job, Jobs
from service.results.snapshot import Stale
from service.results.sql_store import SqlStore
from service.runtime.computing import Made
from service.runtime.outcomes import Outcome
from service.runtime.place import JobKind, Place
from service.runtime.questions import GEARS_DIFFER, REPEATED, frames_repeat, gears_differ
from service.runtime.rigs import named_differences
from service.runtime.twin_port import Events

log = logging.getLogger(__name__)


class Notices:
    """How notices are judged: `kinds`."""

    def __init__(self, jobs: Jobs, store: SqlStore, table: AssetTable) -> None:
        self._jobs, self._store, self._table = jobs, store, table
        self._judges = {
            STALE: self._stale,
            ALARMS: self._alarms,
            REPEATED: self._repeated,
            GEARS_DIFFER: self._gears_differ,
        }
        self.kinds: Mapping[str, JobKind] = {NOTICE: JobKind(self._judge, refused=_not_judged, begins=True)}

    def _judge(self, place: Place, notice: Job, made: Made) -> Outcome | None:
        return self._judges[notice.given["about"]](place, notice)

    def _stale(self, place: Place, notice: Job) -> Outcome | None:
        """The asset's figures do not say any more how the machine is, or do so again."""
        seen, shown = notice.given, self._table.get(place.asset)
        if shown is None or shown.retired is not None:
            return None
        found = None
        if seen["reason"] is not None:
            found = Stale(since_ns=seen["since_ns"], reason=seen["reason"], notice=notice.id)
        if found == shown.stale:
            return (
                None if found is None else _judging_data(place.asset, changed={"stale": found})
            )  # rules may be others
        events: Events = ()
        if found is not None:
            log.warning("%s: %s", place.asset, found.reason, extra={"asset": place.asset})
            fault = {
                "window": None, "kind": "stale", "channel": "all", "count": 1, "action": "none",
                "detail": found.reason,
            }  # fmt: skip
            events = (("data_fault", fault),)
        return _judging_data(place.asset, changed={"stale": found}, events=events)

    def _alarms(self, place: Place, notice: Job) -> Outcome | None:
        """An alarm was cleared, of which the cause may last."""
        shown = self._table.get(place.asset)
        return None if shown is None or shown.stale is None else _judging_data(place.asset)

    def _repeated(self, place: Place, notice: Job) -> Outcome | None:
        """Nothing but frames of passed times is received; or others are."""
        seen, question = notice.given, place.question
        if seen["frames"] and question is None:
            return _asked(place, frames_repeat(seen["frames"], seen["differ"], seen["ended_ns"]))
        if not seen["frames"] and question is not None and question["kind"] == REPEATED:
            return _asked(place, None)
        return None

    def _gears_differ(self, place: Place, notice: Job) -> Outcome | None:
        """A rig file may describe other gears than those that the asset's state was learned with."""
        seen, question, rig = notice.given, place.question, notice.given["rig"]
        differences = [] if rig is None else named_differences(self._store.shown_asset(place.asset), rig)
        if not differences and seen["settings"] and asked_of_settings(question):
            return _asked(place, None)
        if not differences or question is not None or self._ignored(place.asset, differences):
            return None
        found = gears_differ(differences, seen["where"], seen["ended_ns"])
        return _asked(place, {**found, "rig": rig, "settings": seen["settings"]})

    def _ignored(self, asset: str, differences: list[str]) -> bool:
        """Whether people have said before that the earlier rig file holds."""
        return any(
            job.outcome is not None and job.outcome.get("differences") == differences
            for job in self._jobs.of(asset, "ignore")
        )


def asked_of_settings(question: Mapping[str, Any] | None) -> bool:
    """Whether a question is about the rig file of the settings."""
    return question is not None and question["kind"] == GEARS_DIFFER and bool(question.get("settings"))


def _judging_data(asset: str, **given: Any) -> Outcome:
    """An outcome with which the alarms of the asset's data are judged."""

    def judge(alarms: AlarmKeeper, data: Mapping[str, Any]) -> Events:
        return alarms.data(asset, data)

    return Outcome(asset=asset, judge=judge, **given)


def _asked(place: Place, question: Mapping[str, Any] | None) -> Outcome:
    """Opens a question, or ends it: what waited for its answer is next then."""
    events = () if question is None else (("question", shown_question(question) or {}),)
    if question is not None:
        log.warning("%s: %s", place.asset, question["detail"], extra={"asset": place.asset})
    return Outcome(asset=place.asset, changed={"question": question}, events=events)


def _not_judged(notice: Job, reason: str) -> None:
    log.error("%s: what was noticed cannot be judged: %s", notice.asset, reason, extra={"asset": notice.asset})
