"""The audit log: every change that people or programs made, or tried to make: who, when, what, why, with what outcome.

An entry is written in the transaction of the change; the numbers rise in the order in which they are committed. Entries
are added and read; nothing changes one, and only the oldest are removed, beyond the number that is kept. A change that
is queued is carried out later: its entry refers to the job, and its outcome is read from there.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import AbstractContextManager
from typing import Any

from sqlalchemy import bindparam, delete, select

from service.access.roles import Who
from service.results.jobs import Jobs
from service.results.json_columns import dump, salvage
from service.results.schema import AUDIT
from service.results.store import Tables

DONE, WAITS = "done", "queued"
PRUNE_EVERY = 100  # entries
ENTERING = 7_219_434  # lock of whoever adds an entry; other numbers are in `claims`, `migrate` and `layout`
LONGEST = 2000  # characters of a note or outcome

_COLUMNS = (
    "id",
    "at_ns",
    "kind",
    "action",
    "outcome",
    "name",
    "role",
    "address",
    "asset",
    "note",
    "job",
)
_PAGE = (
    select(*(AUDIT.c[name] for name in _COLUMNS), AUDIT.c.what)
    .where(AUDIT.c.id > bindparam("after"))
    .order_by(AUDIT.c.id)
    .limit(bindparam("most"))
)
_NEWEST = select(AUDIT.c.id).order_by(AUDIT.c.id.desc()).limit(1).offset(bindparam("back"))
_REFERRED = select(AUDIT.c.note).where(AUDIT.c.action == "key")


class AuditLog:
    """Entries in the results' database; `keep` of them are kept."""

    def __init__(self, database: Tables, keep: int = 100_000) -> None:
        self._database, self._keep, self._jobs = database, keep, Jobs(database)
        self.entered = 0  # entries since the start
        self.keys_seen: object = None  # version of the list of keys that is entered

    def transaction(self) -> AbstractContextManager[Any]:
        """A transaction that the entry and the change are both part of."""
        return self._database.transaction()

    def enter(
        self,
        who: Who,
        action: str,
        *,
        asset: str | None = None,
        note: str | None = None,
        what: Mapping[str, Any] | None = None,
        outcome: str = DONE,
        job: int | None = None,
    ) -> int:
        """Adds an entry; its number.

        job  that was submitted, whose outcome is to be read when the entry is
        """
        row = {
            "at_ns": time.time_ns(),
            "kind": who.kind,
            "name": who.name,
            "role": None if who.role is None else who.role.value,
            "address": who.address,
            "action": action,
            "asset": asset,
            "note": None if note is None else note[:LONGEST],
            "outcome": outcome[:LONGEST],
            "job": job,
            "what": dump(dict(what or {})),
        }
        with self._database.transaction() as db:
            if db.dialect.name == "postgresql":  # where several front ends write
                db.exec_driver_sql(f"SELECT pg_advisory_xact_lock({ENTERING})")
            number = self._database.add(db, AUDIT, row)
            if number % PRUNE_EVERY == 0:
                db.execute(delete(AUDIT).where(AUDIT.c.id <= number - self._keep))
        self.entered += 1
        return number

    def figures(self) -> dict[str, float]:
        """Figures for /metrics."""
        return {"audit_entries": self.entered}

    def entries(self, after: int = 0, limit: int = 1000) -> list[dict[str, Any]]:
        """Entries behind a number, oldest first."""
        rows = self._database.rows(_PAGE, {"after": after, "most": limit})
        return [self._entry(dict(zip((*_COLUMNS, "what"), row, strict=True))) for row in rows]

    def latest(self, count: int) -> int:
        """The number behind which the newest so many entries are."""
        rows = self._database.rows(_NEWEST, {"back": count})
        return rows[0][0] if rows else 0

    def keys_entered(self) -> set[str]:
        """What was entered about keys."""
        return {note for (note,) in self._database.rows(_REFERRED)}

    def _entry(self, row: dict[str, Any]) -> dict[str, Any]:
        number = row.pop("job")
        row["what"] = salvage(row["what"], f"entry {row['id']} of the audit log") or {}
        if number is not None:
            job = self._jobs.job(number)
            row["outcome"] = f"refused: {job.refused}" if job.refused else DONE if job.done else WAITS
        return row
