"""Wear curves of a fleet's assets, kept with their states: whoever goes on with an asset need not compute them again.

A curve that is lost, or not there yet, is computed again, and one of an asset that another worker has by now is as good
as its own: nothing here is fenced or waited for.
Processes that compute read curves themselves, by name.
"""

from __future__ import annotations

import logging
import threading
import time
from dataclasses import dataclass, field
from functools import lru_cache

import sqlalchemy as sa
from sqlalchemy.dialects import postgresql
from sqlalchemy.exc import SQLAlchemyError

from service.errors import StoreError
from service.fleet.databases import engine_of
from service.fleet.layout import CURVES, expect_revision
from service.runtime.curves import Curves

log = logging.getLogger(__name__)

AWAY = 10.0  # how long a database that does not answer is not asked again [s]
MOST_WAITING = 128 * 2**20  # bytes of curves that wait to be written; of more, the oldest are left out
LOOK_EVERY = 0.5  # whether the thread is to end [s]
PAUSE = 2.0  # after a failure [s]
STOP_WAIT = 3.0  # [s]

_ROW = postgresql.insert(CURVES)
_PUT = _ROW.on_conflict_do_update(index_elements=[CURVES.c.asset, CURVES.c.name], set_={"data": _ROW.excluded.data})
_silent_until = 0.0  # until then the database is not asked, on the monotonic clock [s]


@dataclass(frozen=True, slots=True)
class StoredCurves:
    """The curves in a fleet's database, for any process."""

    database: str = field(repr=False)  # may hold a password, and tasks are printed where they fail

    def read(self, asset: str, name: str) -> bytes | None:
        """A curve by its name, compressed; None where there is none, or the database does not answer."""
        global _silent_until
        if time.monotonic() < _silent_until:
            return None
        wanted = sa.select(CURVES.c.data).where(CURVES.c.asset == asset, CURVES.c.name == name)
        try:
            with _reader(self.database).connect() as db:
                found: bytes | None = db.execute(wanted).scalar()
        except SQLAlchemyError as error:
            log.debug("wear curves cannot be read now: %s", error)
            _silent_until = time.monotonic() + AWAY
            return None
        return found


@lru_cache(maxsize=1)
def _reader(database: str) -> sa.Engine:
    """This process's one connection."""
    return engine_of(database, name="gear-twin curves", pool_size=1, max_overflow=0).execution_options(
        isolation_level="AUTOCOMMIT"
    )


class CurveWriter(threading.Thread):
    """Writes the newest curves of one partition's assets, until ended."""

    def __init__(self, database: str) -> None:
        super().__init__(name="curves", daemon=True)
        self._engine = engine_of(database, name="gear-twin curves", pool_size=1, max_overflow=0)
        self._stopping = threading.Event()
        self._changed = threading.Condition()
        self._waiting: dict[str, Curves] = {}

    def keep(self, asset: str, curves: Curves) -> None:
        """Has an asset's new curves written, and those that it no longer uses deleted."""
        with self._changed:
            before = self._waiting.pop(asset, None)
            new = {} if before is None else {name: data for name, data in before.new if name in curves.names}
            self._waiting[asset] = Curves(names=curves.names, new=tuple((new | dict(curves.new)).items()))
            while len(self._waiting) > 1 and _bytes(self._waiting) > MOST_WAITING:
                self._waiting.pop(next(iter(self._waiting)))
            self._changed.notify()

    def run(self) -> None:
        """Works until ended."""
        while not self._stopping.is_set():
            with self._changed:
                if not self._waiting:
                    self._changed.wait(LOOK_EVERY)
                    continue
                asset, curves = next(iter(self._waiting.items()))
            try:
                self._write(asset, curves)
            except (SQLAlchemyError, StoreError) as error:
                log.debug("the wear curves of %s wait: %s", asset, error)
                self._stopping.wait(PAUSE)
                continue
            with self._changed:
                if self._waiting.get(asset) is curves:
                    del self._waiting[asset]

    def end(self) -> None:
        """Ends the thread; curves that wait are computed again."""
        self._stopping.set()
        if self.is_alive():
            self.join(STOP_WAIT)
        self._engine.dispose()

    def _write(self, asset: str, curves: Curves) -> None:
        with self._engine.begin() as db:
            expect_revision(db)
            db.execute(sa.delete(CURVES).where(CURVES.c.asset == asset, CURVES.c.name.not_in(curves.names)))
            if curves.new:
                db.execute(_PUT, [{"asset": asset, "name": name, "data": data} for name, data in curves.new])


def _bytes(waiting: dict[str, Curves]) -> int:
    return sum(len(data) for curves in waiting.values() for _, data in curves.new)
