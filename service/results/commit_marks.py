"""Whether a transaction was committed whose commit the server did not answer.

Each transaction that writes leaves its number in the row of whoever writes. The server's own
number of the transaction says whether it is still under way, and no more than that: after a crash PostgreSQL gives the
numbers of transactions that it had not written yet to others, and a status asked for then is that of the other one.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from functools import cache
from typing import Any, NamedTuple

import sqlalchemy as sa
from sqlalchemy import Connection, Engine
from sqlalchemy.exc import DBAPIError, SQLAlchemyError

from service.errors import StorageUnavailable
from service.results.schema import COMMITS

OUTCOME_WAIT = 10.0  # how long a server is asked for the outcome of a commit that it did not answer [s]
AGAIN = 0.2  # between two questions [s]
KEPT_NS = 7 * 86_400 * 10**9  # how long the row of somebody who writes no more is kept
NEVER_GIVEN = "22023"  # SQLSTATE of a question about a number that the server has not given out
UNDER_WAY = "in progress"

_OLD = sa.select(COMMITS.c.writer).where(COMMITS.c.written_ns < sa.bindparam("before"))
_DELETE_OLD = sa.delete(COMMITS).where(COMMITS.c.writer.in_(_OLD.with_for_update(skip_locked=True)))
_STATUS = sa.text("SELECT pg_xact_status(CAST(:number AS xid8))")


class Mark(NamedTuple):
    """One transaction of one writer.

    transaction  the server's own number
    """

    writer: str
    number: int
    transaction: str


def marked(
    db: Connection, writer: str, number: int, held: sa.Select | None = None, given: Mapping[str, Any] | None = None
) -> Mark | None:
    """Leaves a mark within a transaction.

    held   a query without whose row no mark is left, and None answered: both are one statement
    given  its parameters
    """
    now = time.time_ns()
    own = {"writer": writer, "number": number, "written_ns": now}
    transaction = db.execute(_mark(held), {**own, **(given or {})}).scalar()
    if transaction is None:
        return None
    if number == 1:
        db.execute(_DELETE_OLD, {"before": now - KEPT_NS})
    return Mark(writer, number, str(transaction))


def is_there(connection: Any, mark: Mark) -> bool:
    """Whether a server has what it had confirmed; by a new connection of its driver."""
    with connection.cursor() as cursor:
        cursor.execute("SELECT number FROM commits WHERE writer = %s", (mark.writer,))
        found = cursor.fetchone()
    connection.commit()
    return found is not None and found[0] >= mark.number


@cache
def _mark(held: sa.Select | None = None) -> Any:
    """Writes the row of whoever writes; answers the server's number of the transaction.

    held  a query without whose row nothing is written
    """
    from sqlalchemy.dialects import postgresql  # services with SQLite do not load it

    row = postgresql.insert(COMMITS)
    if held is not None:
        own = (sa.cast(sa.bindparam(c.name, type_=c.type), c.type) for c in COMMITS.columns)
        row = row.from_select(
            [c.name for c in COMMITS.columns], sa.select(*own).where(sa.exists().select_from(held.cte("held")))
        )
    new = {"number": row.excluded.number, "written_ns": row.excluded.written_ns}
    transaction = sa.cast(sa.func.pg_current_xact_id(), sa.Text)
    return row.on_conflict_do_update(index_elements=[COMMITS.c.writer], set_=new).returning(transaction)


def was_committed(engine: Engine, mark: Mark, name: str) -> bool:
    """The outcome of a commit that was not answered; StorageUnavailable where nobody says in time.

    name  of the database, as a person knows it
    """
    found = sa.select(COMMITS.c.number).where(COMMITS.c.writer == mark.writer)
    end = time.monotonic() + OUTCOME_WAIT
    while time.monotonic() < end:
        try:
            if _status(engine, mark) != UNDER_WAY:
                with engine.connect() as db:
                    return db.execute(found).scalar() == mark.number
        except SQLAlchemyError:
            pass
        time.sleep(AGAIN)
    raise StorageUnavailable(
        f"{name} cannot be used now (connection lost): it did not answer a commit, whose outcome is not known",
        reason="connection lost",
        unknown=True,
    )


def _status(engine: Engine, mark: Mark) -> str | None:
    try:
        with engine.connect() as db:
            status: str | None = db.execute(_STATUS, {"number": mark.transaction}).scalar()
            return status
    except DBAPIError as error:
        if getattr(error.orig, "sqlstate", None) == NEVER_GIVEN:  # it was given before a crash
            return None
        raise
