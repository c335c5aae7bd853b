"""A front end of a fleet: the whole of REST and the page, from the fleet's database. It keeps nothing itself.

Any number of front ends may run at the same time, and each may end at any time. What people decide is carried out by
the workers of the hosts.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any

from service.contract.position import PositionModel
from service.errors import NewerTables, StoreError
from service.fleet.census import Partition, partitions
from service.fleet.databases import FleetTables, database_of, front_tables, layout_at
from service.fleet.layout import look, share_of
from service.operation.health import FLEET, Late
from service.results.asset_table import AssetTable
from service.results.job_queue import JobQueue
from service.results.roles import ANSWER, Roles
from service.results.sql_store import SqlStore
from service.runtime import SERVES
from service.runtime.answer import Answering, stored_position
from service.runtime.role_process import Context, Others
from service.settings import Settings

LOOK_EVERY = 2.0  # [s]
STOP_WAIT = 3.0  # [s]


def serve_front(
    settings: Settings,
    *,
    announce: Callable[[str], None] = lambda address: print(f"{SERVES} {address}", flush=True),
    stop: threading.Event | None = None,
) -> int:
    """Serves until a signal, or `stop`, ends it; the exit status. The settings are those of the fleet.

    announce  called once with the page's address, when HTTP is served
    """
    with Answering.at(settings) as answering:
        answered(settings, answering, Context(ANSWER, stop or threading.Event(), Others()), announce)
    return 0


def answered(settings: Settings, answering: Answering, context: Context, announce: Callable[[str], None]) -> None:
    """Does the role of a front end, at an address that is bound already."""
    answering.answer(context, partial(opened, settings), Hosts, announce)


def opened(settings: Settings) -> SqlStore:
    """Connects to the fleet. StorageUnavailable where its server is away, StoreError where there is no fleet."""
    database = database_of(settings)
    return SqlStore(front_tables(database, layout_at(database)))


class Hosts(threading.Thread):
    """What a front end knows of the hosts: it looks from time to time what they serve, until ended, and whether the
    fleet's tables are of this release.
    """

    def __init__(self, store: SqlStore, table: AssetTable, queue: JobQueue) -> None:
        super().__init__(name="fleet", daemon=True)
        self._store, self._table, self._stopping = store, table, threading.Event()
        tables = store.database.backend
        assert isinstance(tables, FleetTables)
        self._layout, self.roles = tables.layout, Roles(store.database)
        self._partitions: list[Partition] = []
        self._reason: str | None = "the fleet's partitions have not been looked at yet"

    def start(self) -> None:
        """Looks once, and goes on in a thread of its own."""
        with suppress(StoreError):  # then it says why, and looks again
            self.look()
        super().start()

    @property
    def watched(self) -> dict[str, threading.Thread]:
        return {FLEET: self}

    def run(self) -> None:
        """Works until ended."""
        while not self._stopping.wait(LOOK_EVERY):
            with suppress(StoreError):
                self.look()

    def end(self) -> None:
        """Ends the thread."""
        self._stopping.set()
        if self.is_alive():
            self.join(STOP_WAIT)

    def not_ready(self) -> str | None:
        """Why the answers of this front end may be out of date, or None."""
        return self._reason

    def unserved(self) -> list[int]:
        """The partitions that nobody serves."""
        return [partition.number for partition in self._partitions if not partition.served]

    def figures(self) -> dict[str, Any]:
        """Figures of the fleet for /metrics."""
        count, levels = len(self._partitions), {}
        with suppress(StoreError):
            levels = self._table.levels()
        return {
            "fleet_partitions": count,
            "fleet_partitions_served": count - len(self.unserved()),
            "fleet_assets": levels,
        }

    def late(self) -> tuple[Late, ...]:
        """The supervisor of each host looks after its loops."""
        return ()

    def log_figures(self) -> dict[str, Any]:
        """Each host keeps its own log."""
        return {}

    def position(self, stream: str) -> PositionModel:
        """How far a stream is stored, by what has been committed of its partition."""
        number = share_of(self._store.database, stream, self._layout)
        found = partitions(self.roles)[number]
        reason = found.not_ready if found.served else f"partition {number} is not served now"
        return stored_position(self._store, stream, f"partition {number}, token {found.token}", reason)

    def look(self) -> None:
        """Reads who serves the partitions. StoreError where that is not possible now."""
        try:
            look(self._store.database)
            self._partitions = partitions(self.roles)
        except StoreError as error:
            why = str(error).strip().splitlines()[0]
            newer = isinstance(error, NewerTables)
            self._reason = why if newer else f"the fleet's database cannot be used now: {why}"
            raise
        self._reason = None
