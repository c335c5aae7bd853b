"""Jobs: what people ask of an asset, what is noticed of it, and its windows that wait: in one table and one order.

A job is a row from when it is submitted. It is carried out between two windows of its asset, in one transaction with
all that it changes; rows of people's jobs stay with their outcome, those of windows (`window_jobs.py`) and of notices
go with the transaction that ends the job. A kill loses no job and carries none out twice.

| kind | given | outcome |
| --- | --- | --- |
| `decision` | `name` and `verb` of an effect; `by`, `note` | |
| `inspection` | `inspection`, a measured depth; `answer`, the twin's own figure | the answer with what it changed |
| `window` | where the asset's stream went on before it | |
| `notice` | `about` what, and what was seen by who receives frames | |
| others | a change of the asset: `by`, `note`, `at`, and what the kind needs | what it changed |
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Connection, Select, bindparam, delete, func, or_, select, text, update

from service.results.json_columns import dump, salvage
from service.results.schema import ASSETS, ENDED, JOBS, PEOPLES, WINDOW
from service.results.store import Tables
from service.steady_clock import later_time_ns

DECISION, INSPECTION, NOTICE = "decision", "inspection", "notice"
RIG_ACCEPTED, RIG_REJECTED = "rig_accepted", "rig_rejected"  # changes: what becomes of a proposal
NO_CHANGES = (DECISION, INSPECTION, WINDOW, NOTICE)  # kinds that change nothing about the asset itself
STREAMS = (  # kinds that streams follow
    "other_machine", "renamed", "ignore", "gears_replaced", "retired", "reinstated", RIG_ACCEPTED,
)  # fmt: skip
DUE_AT_ONCE = 64  # assets that whoever looks for a job is told of
MOVE_AFTER_NS = 2 * 10**9  # how long a job waits for whoever has carried out its asset's last one [ns]
SEARCH = "search"  # in place of a worker: the next job is one that leads to a search for effects
STALE, ALARMS = "stale", "alarms"  # what notices may be about
TRIES = 2  # how often a job may end whoever carries it out, before it is refused

_JOB = select(JOBS).order_by(JOBS.c.id)
_PENDING = _JOB.where(text(PEOPLES))
_NEXT = _PENDING.where(JOBS.c.asset == bindparam("of")).limit(1)
_END = update(JOBS).where(JOBS.c.id == bindparam("number"), JOBS.c.done == 0)
_END_THIS = _END.where(JOBS.c.received_ns == bindparam("received"))  # a database that was put back numbers others so
_NOTICES = JOBS.c.kind == NOTICE, JOBS.c.verb == bindparam("about")
_NOTICED = select(JOBS.c.given).where(JOBS.c.asset == bindparam("of"), *_NOTICES)
_FORGET = delete(JOBS).where(JOBS.c.asset == bindparam("of"), *_NOTICES)
_DROP = delete(JOBS).where(JOBS.c.id == bindparam("number"), JOBS.c.received_ns == bindparam("received"))
_FAILED = _END.values(tries=JOBS.c.tries + 1, fault=bindparam("why"))
_ENDED = _JOB.where(text(ENDED))
_UNFOLLOWED = _ENDED.where(JOBS.c.asset == bindparam("of"), JOBS.c.kind.in_(STREAMS)).limit(1)
_FOLLOWED = update(JOBS).where(JOBS.c.id == bindparam("number")).values(followed=1)
_DUE = (
    select(ASSETS.c.asset)
    .where(
        ASSETS.c.due.is_not(None),
        or_(
            ASSETS.c.worker.is_(None),
            ASSETS.c.worker.in_((bindparam("by"), bindparam("search"))),
            ASSETS.c.due < bindparam("long_ago"),
            ASSETS.c.due > bindparam("ahead"),  # by a clock that has been set back since
        ),
    )
    .order_by(ASSETS.c.due)
    .limit(DUE_AT_ONCE)
)
_DUE_BUT_SEARCHES = _DUE.where(or_(ASSETS.c.worker.is_(None), ASSETS.c.worker != bindparam("search")))
_HAND_ON = update(ASSETS).where(ASSETS.c.asset == bindparam("of")).values(worker=bindparam("search"))
_WINDOWS = select(func.count()).where(JOBS.c.asset == bindparam("of"), JOBS.c.kind == WINDOW)
_VERBS = (
    select(JOBS.c.asset, JOBS.c.verb, func.count())
    .where(JOBS.c.kind == DECISION, JOBS.c.done == 1, JOBS.c.refused.is_(None))
    .group_by(JOBS.c.asset, JOBS.c.verb)
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Notice:
    """What was seen of an asset and is to be judged: of each thing the newest waits."""

    asset: str
    about: str
    seen: Mapping[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """Something that people ask of an asset, or that was noticed of it."""

    id: int
    asset: str
    received_ns: int  # Unix time [ns]
    kind: str
    given: Mapping[str, Any]
    done: bool  # carried out, or refused
    refused: str | None  # why it could not be carried out
    outcome: Mapping[str, Any] | None  # what it led to, once it is carried out
    tries: int = 0  # how often it has ended whoever carried it out ...
    fault: str | None = None  # ... and how the last time
    stages: Mapping[str, Any] | None = None  # how long it took
    followed: bool = False  # whether who receives frames has followed what it led to

    @property
    def settled(self) -> bool:
        """Whether it has ended, and frames are received as it says."""
        return self.done and (self.followed or self.refused is not None or self.kind not in STREAMS)

    @property
    def changes(self) -> bool:
        """Whether it is a change of the asset."""
        return self.kind not in NO_CHANGES


class Jobs:
    """People's jobs and notices of all assets, in the results' database."""

    def __init__(self, database: Tables) -> None:
        self._database, own = database, database.own(ASSETS.c.asset)
        self._due = {True: _DUE.where(own), False: _DUE_BUT_SEARCHES.where(own)}  # by whether searches are among them
        own_jobs = database.own(JOBS.c.asset)
        self._ended = _ENDED.where(own_jobs)
        self._noticed = select(JOBS.c.asset).where(own_jobs, *_NOTICES).order_by(JOBS.c.asset)

    def transaction(self) -> AbstractContextManager[Connection]:
        """A transaction of the database, which other stores in it share."""
        return self._database.transaction()

    def add(self, asset: str, kind: str, given: Mapping[str, Any]) -> int:
        """Keeps a job that waits to be carried out; its id."""
        with self.transaction() as db:
            self._database.update_due(db, asset)
            row = {"asset": asset, "received_ns": later_time_ns(), "kind": kind, "given": dump(given)}
            return self._database.add(db, JOBS, row | {"verb": given.get("verb")})

    def notice(self, *notices: Notice) -> None:
        """Keeps what was noticed, each in place of what waits about the same; one that waits already is not kept."""
        with self.transaction() as db:
            for each in sorted(notices, key=lambda notice: notice.asset):
                self._database.ensure(db, each.asset)
                given, named = dump({"about": each.about, **each.seen}), {"of": each.asset, "about": each.about}
                if db.execute(_NOTICED, named).scalar() == given:
                    continue
                db.execute(_FORGET, named)
                row = {"asset": each.asset, "received_ns": later_time_ns(), "kind": NOTICE, "given": given}
                self._database.add(db, JOBS, row | {"verb": each.about})
                self._database.update_due(db, each.asset)

    def forget(self, about: str) -> None:
        """Drops all notices about something that wait here: whoever receives frames sees anew what there is."""
        with self.transaction() as db:
            for asset in db.execute(self._noticed, {"about": about}).scalars().all():
                self._database.update_due(db, asset)
                db.execute(_FORGET, {"of": asset, "about": about})

    def end(self, job: Job, outcome: Mapping[str, Any] | None = None, stages: Mapping[str, Any] | None = None) -> bool:
        """Marks a job as carried out; False where it waits no more. Call it within the transaction."""
        return self._end(job, outcome=dump(outcome), stages=dump(stages))

    def refuse(self, job: Job, reason: str, outcome: Mapping[str, Any] | None = None) -> None:
        """Ends a job that cannot be carried out."""
        self._end(job, refused=reason, outcome=dump(outcome))

    def _end(self, job: Job, **values: Any) -> bool:
        with self.transaction() as db:
            self._database.update_due(db, job.asset)
            ended = _DROP if job.kind == NOTICE else _END_THIS.values(done=1, **values)
            return bool(db.execute(ended, {"number": job.id, "received": job.received_ns}).rowcount)

    def failed(self, number: int, why: str) -> None:
        """A job, if it has not ended, has ended whoever carried it out."""
        with self.transaction() as db:
            db.execute(_FAILED, {"number": number, "why": why})

    def ended(self) -> tuple[Job, ...]:
        """Those that have ended and were not followed yet, by who receives frames here, oldest first."""
        return self._read(self._ended)

    def unfollowed(self, asset: str) -> bool:
        """Whether streams of an asset are no longer what they were, and nobody has followed that yet."""
        return bool(self._database.rows(_UNFOLLOWED, {"of": asset}))

    def follow(self, *jobs: Job) -> None:
        """Who receives frames has followed these jobs."""
        if jobs:
            with self.transaction() as db:
                for asset in sorted({job.asset for job in jobs}):
                    self._database.ensure(db, asset)  # whoever waits for them is told
                db.execute(_FOLLOWED, [{"number": job.id} for job in jobs])

    def job(self, number: int) -> Job:
        (found,) = self._read(_JOB.where(JOBS.c.id == number))
        return found

    def pending(self) -> tuple[Job, ...]:
        """Those that wait to be carried out, oldest first."""
        return self._read(_PENDING)

    def windows(self, asset: str) -> int:
        """How many windows of an asset wait, those that people are asked of, too."""
        return int(self._database.rows(_WINDOWS, {"of": asset})[0][0])

    def next(self, asset: str) -> Job | None:
        """The oldest of an asset that waits."""
        return next(iter(self._read(_NEXT, {"of": asset})), None)

    def due(self, worker: str, *, searches: bool = True) -> tuple[str, ...]:
        """Assets of which a job can be carried out, that which has waited longest first; those of people before all.

        An asset waits a moment for who has carried out its last job, and has its wear curves.

        worker    who asks
        searches  whether it carries out jobs that lead to a search for effects
        """
        now = later_time_ns()
        given = {"by": worker, "search": SEARCH, "long_ago": now - MOVE_AFTER_NS, "ahead": now + MOVE_AFTER_NS}
        return tuple(asset for (asset,) in self._database.rows(self._due[searches], given))

    def hand_on(self, asset: str) -> None:
        """An asset's next job leads to a search: it is for a worker that carries those out."""
        with self.transaction() as db:
            self._database.ensure(db, asset)
            db.execute(_HAND_ON, {"of": asset, "search": SEARCH})

    def of(self, asset: str, kind: str, after: int = 0, limit: int | None = None) -> tuple[Job, ...]:
        """The jobs of one kind with an id above `after`, oldest first."""
        return self._read(_JOB.where(JOBS.c.asset == asset, JOBS.c.kind == kind, JOBS.c.id > after).limit(limit))

    def changes(self, asset: str) -> tuple[Job, ...]:
        """All changes of an asset, oldest first."""
        return self._read(_JOB.where(JOBS.c.asset == asset, JOBS.c.kind.not_in(NO_CHANGES)))

    def rejected_rigs(self, asset: str) -> list[str]:
        """Digests of the rig files that people have rejected for an asset."""
        return [job.given["digest"] for job in self.of(asset, RIG_REJECTED) if job.refused is None]

    def decision_counts(self) -> dict[str, dict[str, int]]:
        """How many decisions on effects were carried out, by asset and verb; one query for all assets."""
        counts: dict[str, dict[str, int]] = {}
        for asset, verb, count in self._database.rows(_VERBS.where(self._database.own(JOBS.c.asset))):
            counts.setdefault(asset, {})[verb] = count
        return counts

    def _read(self, query: Select, values: Mapping[str, Any] | None = None) -> tuple[Job, ...]:
        """The jobs that a query answers; one that is damaged is left out."""
        names = ("id", "asset", "received_ns", "kind", "refused", "tries", "fault")
        found = []
        for row in (r._mapping for r in self._database.rows(query, values)):
            what = f"{row['kind']} {row['id']} of {row['asset']}"
            given = salvage(row["given"], what)
            if given is not None:
                outcome = salvage(row["outcome"], f"the outcome of {what}")
                stages = salvage(row["stages"], f"the stages of {what}")
                named = {n: row[n] for n in names} | {n: bool(row[n]) for n in ("done", "followed")}
                found.append(Job(**named, given=given, outcome=outcome, stages=stages))
        return tuple(found)
