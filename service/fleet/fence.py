"""Who may write what a partition's machines send: the one that took it last, and nobody who had it before.

Each partition has a row with a token (`layout.PARTITIONS`). Whoever takes the partition raises the token. Each of its
transactions locks the row first and compares: one whose token is no longer the present one commits nothing more,
whether its process was cut off, suspended or only slow. What is computed is fenced by the marks of the assets.
"""

from __future__ import annotations

import logging
import os
import uuid
from collections.abc import Callable
from dataclasses import dataclass
from typing import NoReturn

import sqlalchemy as sa
from sqlalchemy import Connection, bindparam

from service.errors import StorageUnavailable, StoreError
from service.fleet.layout import PARTITIONS, expect_revision
from service.results.commit_marks import Mark, marked
from service.results.roles import INGEST, forget, ident_of

log = logging.getLogger(__name__)

FENCED = 75  # exit status of a process whose partition another one has: EX_TEMPFAIL
ABANDONED = 15_000  # after which a session that stands still within a transaction is ended by the server [ms]
_TAKE = (
    sa.update(PARTITIONS)
    .where(PARTITIONS.c.number == bindparam("of"))
    .values(token=PARTITIONS.c.token + 1)
    .returning(PARTITIONS.c.token)
)
_HOST = sa.select(PARTITIONS.c.host).where(PARTITIONS.c.number == bindparam("of"))
_LOCK = sa.select(PARTITIONS.c.token).where(PARTITIONS.c.number == bindparam("of")).with_for_update()
_HELD = _LOCK.where(PARTITIONS.c.token == bindparam("held"))
_END_OTHERS = sa.text(
    "SELECT pg_terminate_backend(pid) FROM pg_stat_activity "
    "WHERE application_name LIKE :named AND application_name <> :own AND datname = current_database()"
)


def leave_at_once() -> None:
    """Ends the process: its partition is another's, and nothing that it could still write would be right."""
    log.error("the partition has been taken by another process: this one ends")
    logging.shutdown()
    os._exit(FENCED)


class Fenced(StoreError):
    """The partition has been taken by another process: this one can commit nothing more."""


@dataclass(slots=True, kw_only=True)
class Fence:
    """One process's right to write what a partition's machines send.

    host  that is to have the partition; None for any
    lost  called when another process has the partition, before Fenced is raised
    """

    partition: int
    host: str | None = None
    lost: Callable[[], None] = lambda: None
    application: str = ""
    token: int | None = None

    def __post_init__(self) -> None:
        self.application = f"{named(self.partition)} {uuid.uuid4().hex[:12]}"

    def take(self, db: Connection) -> int:
        """Takes the partition from whoever has it, within a transaction; the token.

        Raises StoreError where the fleet's tables are of another release, and StorageUnavailable where the partition is
        another host's.
        """
        expect_revision(db)
        if self.host is not None and db.execute(_HOST, {"of": self.partition}).scalar() != self.host:
            raise StorageUnavailable(f"partition {self.partition} is another host's by now", reason="locked")
        db.execute(_END_OTHERS, {"named": f"{named(self.partition)} %", "own": self.application})
        self.token = db.execute(_TAKE, {"of": self.partition}).scalar_one()
        forget(db, ident_of(INGEST, self.partition))  # until this process says how it is
        return self.token

    def marked(self, db: Connection, writer: str, number: int) -> Mark:
        """At the begin of a transaction: its mark; Fenced where another process has taken the partition since."""
        mark = marked(db, writer, number, _HELD, {"of": self.partition, "held": self.token})
        return mark or self._refuse()

    def _refuse(self) -> NoReturn:
        self.lost()
        raise Fenced(f"partition {self.partition} has been taken by another process: nothing more is committed here")


def named(partition: int) -> str:
    """How the sessions of whoever has a partition begin their names at the server."""
    return f"gear-twin p{partition:03d}"
