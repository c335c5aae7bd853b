"""Wear curves of a fleet's assets, kept with their states: whoever goes on with an asset need not compute them again.

A curve that is lost, or not there yet, is computed again, and one of an asset that another worker has by now is as good
as its own: nothing here is fenced, and what cannot be kept now is left out.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import sqlalchemy as sa
from sqlalchemy.dialects import postgresql
from sqlalchemy.exc import SQLAlchemyError

from service.errors import StoreError
from service.fleet.databases import engine_of
from service.fleet.layout import CURVES, expect_revision
from service.runtime.curves import Curves

log = logging.getLogger(__name__)

AWAY = 10.0  # how long a database that does not answer is not asked again [s]

_ROW = postgresql.insert(CURVES)
_PUT = _ROW.on_conflict_do_update(index_elements=[CURVES.c.asset, CURVES.c.name], set_={"data": _ROW.excluded.data})
_silent_until = 0.0  # until then the database is not asked, on the monotonic clock [s]


@dataclass(frozen=True, slots=True)
class StoredCurves:
    """The curves in a fleet's database, for any process that computes."""

    database: str = field(repr=False)  # may hold a password, and tasks are printed where they fail

    def read(self, asset: str, name: str) -> bytes | None:
        """A curve by its name, compressed; None where there is none, or the database does not answer."""
        wanted = sa.select(CURVES.c.data).where(CURVES.c.asset == asset, CURVES.c.name == name)
        found: bytes | None = self._asked(lambda db: db.execute(wanted).scalar())
        return found

    def keep(self, asset: str, curves: Curves) -> None:
        """Writes an asset's new curves, and deletes those that it no longer uses."""

        def write(db: sa.Connection) -> None:
            expect_revision(db)
            db.execute(sa.delete(CURVES).where(CURVES.c.asset == asset, CURVES.c.name.not_in(curves.names)))
            if curves.new:
                db.execute(_PUT, [{"asset": asset, "name": name, "data": data} for name, data in curves.new])

        self._asked(write)

    def _asked(self, what: Callable[[sa.Connection], Any]) -> Any:
        """What the database answers; None where it does not, after which it is not asked for a while."""
        global _silent_until
        if time.monotonic() < _silent_until:
            return None
        try:
            with _engine(self.database).begin() as db:
                return what(db)
        except (SQLAlchemyError, StoreError) as error:
            log.debug("wear curves are not kept now: %s", error)
            _silent_until = time.monotonic() + AWAY
            return None


@lru_cache(maxsize=1)
def _engine(database: str) -> sa.Engine:
    """This process's one connection."""
    return engine_of(database, name="gear-twin curves", pool_size=1, max_overflow=0)
