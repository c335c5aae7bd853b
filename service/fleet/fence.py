"""Who may commit the results of a partition: the one that took it last, and nobody who had it before.

Each partition has a row with a token (`layout.PARTITIONS`). Whoever takes the partition raises the token. Every
transaction of a worker that writes locks the row first and compares: a worker whose token is no longer the present one
commits nothing more, whether it was cut off, suspended or only slow. The lock also lets the transactions that write to
the assets of one partition follow one another, those of the front ends as well, so that the order of the numbers of an
asset is the order in which they were committed.
"""

from __future__ import annotations

import logging
import os
import socket
import time
import uuid
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NoReturn

import sqlalchemy as sa
from sqlalchemy import Connection, bindparam

from service.errors import StoreError
from service.fleet.layout import PARTITIONS, expect_revision
from service.results.commit_marks import Mark, marked
from service.results.schema import ASSETS

log = logging.getLogger(__name__)

FENCED = 75  # exit status of a process whose partition another worker has: EX_TEMPFAIL
ABANDONED = 15_000  # after which a session that stands still within a transaction is ended by the server [ms]
_TAKE = (
    sa.update(PARTITIONS)
    .where(PARTITIONS.c.number == bindparam("of"))
    .values(token=PARTITIONS.c.token + 1, worker=bindparam("by"), node=bindparam("at"), taken_ns=bindparam("now"))
    .returning(PARTITIONS.c.token)
)
_LOCK = sa.select(PARTITIONS.c.token).where(PARTITIONS.c.number == bindparam("of")).with_for_update()
_SHARE = sa.select(ASSETS.c.share).where(ASSETS.c.asset == bindparam("asset")).scalar_subquery()
_LOCK_OF = (
    sa.select(PARTITIONS.c.number)
    .where(PARTITIONS.c.number == sa.func.coalesce(_SHARE, bindparam("hashed")))
    .with_for_update(of=PARTITIONS)
)
_HELD = _LOCK.where(PARTITIONS.c.token == bindparam("held"))
_END_OTHERS = sa.text(
    "SELECT pg_terminate_backend(pid) FROM pg_stat_activity "
    "WHERE application_name LIKE :named AND application_name <> :own AND datname = current_database()"
)


def leave_at_once() -> None:
    """Ends the process: its partition is another worker's, and nothing that it could still write would be right."""
    log.error("the partition has been given to another worker: this process ends")
    logging.shutdown()
    os._exit(FENCED)


class Fenced(StoreError):
    """The partition has been given to another worker: this one can commit nothing more."""


def here() -> str:
    """This process, as a person finds it."""
    return f"{socket.gethostname()}:{os.getpid()}"


@dataclass(slots=True, kw_only=True)
class Fence:
    """One worker's right to commit a partition's results.

    lost  called when another worker has the partition, before Fenced is raised
    """

    partition: int
    node: str = ""
    worker: str = field(default_factory=here)
    lost: Callable[[], None] = lambda: None
    application: str = ""
    token: int | None = None

    def __post_init__(self) -> None:
        self.application = f"{named(self.partition)} {uuid.uuid4().hex[:12]}"

    def take(self, db: Connection) -> int:
        """Takes the partition from whoever has it, within a transaction; the token.

        Raises StoreError where the fleet's tables are of another release.
        """
        expect_revision(db)
        db.execute(_END_OTHERS, {"named": f"{named(self.partition)} %", "own": self.application})
        given = {"of": self.partition, "by": self.worker, "at": self.node, "now": time.time_ns()}
        self.token = db.execute(_TAKE, given).scalar_one()
        return self.token

    def marked(self, db: Connection, writer: str, number: int) -> Mark:
        """At the begin of a transaction: its mark; Fenced where another worker has taken the partition since."""
        mark = marked(db, writer, number, _HELD, {"of": self.partition, "held": self.token})
        return mark or self._refuse()

    def _refuse(self) -> NoReturn:
        self.lost()
        raise Fenced(f"partition {self.partition} has been given to another worker: nothing more is committed here")


def named(partition: int) -> str:
    """How a worker's sessions begin their names at the server."""
    return f"gear-twin p{partition:03d}"


def locked(db: Connection, asset: str, hashed: int) -> int:
    """The partition of an asset, for those who only add rows that its worker then acts on: their turn among its
    transactions.

    hashed  the partition of an asset that is new
    """
    return int(db.execute(_LOCK_OF, {"asset": asset, "hashed": hashed}).scalar_one())
