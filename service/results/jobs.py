"""Jobs: what people ask of an asset, and its windows that wait for their turn, in one table and one order.

A job is a row from when it is submitted. It is carried out between two windows of its asset, in one transaction with
all that it changes; rows of people's jobs stay with their outcome, those of windows (`window_jobs.py`) go with the
transaction that processes the window. A kill loses no job and carries none out twice.

| kind | given | outcome |
| --- | --- | --- |
| `decision` | `name` and `verb` of an effect; `by`, `note` | |
| `inspection` | `inspection`, a measured depth; `answer`, the twin's own figure | the answer with what it changed |
| `window` | where the asset's stream went on before it | |
| others | a change of the asset: `by`, `note`, `at`, and what the kind needs | what it changed |
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Connection, Select, bindparam, func, select, text, update

from service.results.json_columns import dump, salvage
from service.results.schema import JOBS, PEOPLES
from service.results.store import Tables
from service.steady_clock import later_time_ns

DECISION, INSPECTION, WINDOW = "decision", "inspection", "window"
RIG_ACCEPTED, RIG_REJECTED = "rig_accepted", "rig_rejected"  # changes: what becomes of a proposal
NO_CHANGES = (DECISION, INSPECTION, WINDOW)  # kinds that change nothing about the asset itself

_JOB = select(JOBS).order_by(JOBS.c.id)
_PENDING = _JOB.where(text(PEOPLES))
_NEXT = _PENDING.where(JOBS.c.asset == bindparam("of")).limit(1)
_STANDS = select(JOBS.c.kind, JOBS.c.done, JOBS.c.held).where(JOBS.c.id == bindparam("number"))
_ASKED = select(JOBS.c.asset).where(text(PEOPLES)).distinct()
_END = update(JOBS).where(JOBS.c.id == bindparam("number"), JOBS.c.done == 0)
_VERBS = (
    select(JOBS.c.asset, JOBS.c.verb, func.count())
    .where(JOBS.c.kind == DECISION, JOBS.c.done == 1, JOBS.c.refused.is_(None))
    .group_by(JOBS.c.asset, JOBS.c.verb)
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """Something that people ask of an asset."""

    id: int
    asset: str
    received_ns: int  # Unix time [ns]
    kind: str
    given: Mapping[str, Any]
    done: bool  # carried out, or refused
    refused: str | None  # why it could not be carried out
    outcome: Mapping[str, Any] | None  # what it led to, once it is carried out

    @property
    def changes(self) -> bool:
        """Whether it is a change of the asset."""
        return self.kind not in NO_CHANGES


class Jobs:
    """People's jobs of all assets, in the results' database."""

    def __init__(self, database: Tables) -> None:
        self._database = database

    def transaction(self) -> AbstractContextManager[Connection]:
        """A transaction of the database, which other stores in it share."""
        return self._database.transaction()

    def add(self, asset: str, kind: str, given: Mapping[str, Any]) -> int:
        """Keeps a job that waits to be carried out; its id."""
        with self.transaction() as db:
            self._database.ensure(db, asset)
            row = {"asset": asset, "received_ns": later_time_ns(), "kind": kind, "given": dump(given)}
            return self._database.add(db, JOBS, row | {"verb": given.get("verb")})

    def end(self, number: int, outcome: Mapping[str, Any] | None = None) -> bool:
        """Marks a job as carried out; False where it was done before. Call it within the transaction."""
        with self.transaction() as db:
            return bool(db.execute(_END.values(done=1, outcome=dump(outcome)), {"number": number}).rowcount)

    def refuse(self, number: int, reason: str, outcome: Mapping[str, Any] | None = None) -> None:
        """Ends a job that cannot be carried out."""
        with self.transaction() as db:
            db.execute(_END.values(done=1, refused=reason, outcome=dump(outcome)), {"number": number})

    def job(self, number: int) -> Job:
        (found,) = self._read(_JOB.where(JOBS.c.id == number))
        return found

    def stands(self, number: int) -> Any:
        """The kind of a job, and whether it is `done` or `held`; None of a window that has been processed."""
        return next(iter(self._database.rows(_STANDS, {"number": number})), None)

    def pending(self) -> tuple[Job, ...]:
        """Those that wait to be carried out here, oldest first."""
        return self._read(_PENDING.where(self._database.own(JOBS.c.asset)))

    def next(self, asset: str) -> Job | None:
        """The oldest of an asset that waits."""
        return next(iter(self._read(_NEXT, {"of": asset})), None)

    def asked(self) -> tuple[str, ...]:
        """The assets of which something waits to be carried out here."""
        return tuple(asset for (asset,) in self._database.rows(_ASKED.where(self._database.own(JOBS.c.asset))))

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
        names = ("id", "asset", "received_ns", "kind", "refused")
        found = []
        for row in (r._mapping for r in self._database.rows(query, values)):
            what = f"{row['kind']} {row['id']} of {row['asset']}"
            given = salvage(row["given"], what)
            if given is not None:
                outcome = salvage(row["outcome"], f"the outcome of {what}")
                found.append(Job(**{n: row[n] for n in names}, done=bool(row["done"]), given=given, outcome=outcome))
        return tuple(found)
