"""A front end of a fleet: the whole of REST and the page, from the fleet's database. It keeps nothing itself.

Any number of front ends may run at the same time, and each may end at any time. What people decide is carried out by
the worker of the asset's partition.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from service.alarms.keeper import AlarmKeeper
from service.alarms.rules import rules_at
from service.api import create_app
from service.api.incoming import Incoming
from service.errors import StoreError
from service.fleet.databases import front_tables, layout_at
from service.fleet.front_position import position_of
from service.fleet.front_watch import FrontWatch
from service.fleet.layout import Layout, folder_of, share_of
from service.operation.health import FLEET, Health
from service.operation.systemd import READY, STOPPING, notify
from service.results.alarm_store import AlarmStore
from service.results.asset_table import AssetTable
from service.results.audit_log import AuditLog
from service.results.baseline_store import BaselineStore
from service.results.data_folder import BASELINES, SEGMENTS
from service.results.job_queue import JobQueue
from service.results.jobs import Jobs
from service.results.kept_signals import KeptSignals
from service.results.sql_store import SqlStore
from service.runtime import SERVES
from service.runtime.admission import access_of, front_of, limits_of
from service.runtime.all_figures import figures_of
from service.runtime.http_server import HttpServer, address_of, listening_at
from service.runtime.serve import turns_of
from service.runtime.storage_wait import StoppedWaiting, opened
from service.settings import Settings

DECIDED_WITHIN = 0.5  # how often who waits for a decision looks whether it is done [s]
AUDIT_LOCK = 7_219_434  # of whoever adds an entry; other numbers are in `layout`, `claims` and `migrate`


@dataclass(frozen=True, slots=True, kw_only=True)
class FrontEnd(AbstractContextManager["FrontEnd"]):
    """What a front end answers from; closed when it is left."""

    layout: Layout
    store: SqlStore
    alarms: AlarmKeeper
    table: AssetTable
    queue: JobQueue
    watch: FrontWatch

    @classmethod
    def of(cls, settings: Settings) -> FrontEnd:
        """Connects to the fleet. StorageUnavailable where its server is away, StoreError where there is no fleet."""
        if settings.database is None:
            raise StoreError("the setting database must name the fleet's database: postgresql://user@host/name")
        database = settings.database.get_secret_value()
        layout = layout_at(database)
        store = SqlStore(front_tables(database, layout))
        alarms = AlarmKeeper(AlarmStore(store.database), rules_at(settings.alarm_rules), settings.webhooks)
        table = AssetTable(store, alarms)
        queue = JobQueue(Jobs(store.database), DECIDED_WITHIN)
        watch = FrontWatch(database, store.database, table, queue.done)
        return cls(layout=layout, store=store, alarms=alarms, table=table, queue=queue, watch=watch)

    def end(self) -> None:
        """Ends every wait."""
        self.queue.close()
        self.table.close()

    def __exit__(self, *_: object) -> None:
        self.watch.end()
        self.store.close()


def serve_front(
    settings: Settings,
    *,
    announce: Callable[[str], None] = lambda address: print(f"{SERVES} {address}", flush=True),
    stop: threading.Event | None = None,
) -> int:
    """Serves until a signal, or `stop`, ends it; the exit status. The settings are those of the fleet.

    announce  called once with the page's address, when HTTP is served
    """
    with suppress(StoppedWaiting), ExitStack() as stack:
        access, front = access_of(settings), front_of(settings)
        listening = stack.enter_context(listening_at(settings.http_host, settings.http_port, front.gate))
        health = Health(settings.loop_limit)
        waiting = opened(
            partial(FrontEnd.of, settings),
            listening,
            front=front,
            limits=limits_of(settings),
            tick=turns_of(Health(settings.loop_limit)),
            waits=partial(notify, READY),
            stop=stop,
        )
        own = stack.enter_context(waiting)

        def folder(asset: str) -> Path:
            """Where the worker of an asset keeps its files."""
            return settings.data / folder_of(share_of(own.store.database, asset, own.layout))

        app = create_app(
            own.table,
            own.store,
            own.queue,
            not_ready=own.watch.not_ready,
            figures=figures_of(own.watch.figures, front.figures),
            signals=KeptSignals(own.store.database, lambda asset: folder(asset) / SEGMENTS),
            alarms=own.alarms,
            baselines=lambda asset: BaselineStore(own.store.database, folder(asset) / BASELINES, clears=False),
            access=access,
            limits=limits_of(settings),
            audit=FrontAudit(own.store.database, settings.audit_entries),
            labelled_assets=None,
            health=health,
            incoming=Incoming(
                asks=settings.rule_of_new_assets[0] == "ask", position=partial(position_of, own.store, own.layout)
            ),
            unserved=own.watch.unserved,
        )

        def started() -> None:
            announce(address_of(listening, front))
            notify(READY)

        def ending() -> None:
            notify(STOPPING)
            own.end()

        server = HttpServer(app, started=started, ending=ending, stop=stop, front=front, tick=turns_of(health))
        with suppress(StoreError):  # then the watch says why, and looks again
            own.watch.look()
        own.watch.start()
        health.thread(FLEET, own.watch)
        server.run(sockets=[listening])
    return 0


class FrontAudit(AuditLog):
    """The audit log, in which several front ends write."""

    def enter(self, *given: Any, **named: Any) -> int:
        """Adds an entry; the numbers of entries rise in the order in which they are committed."""
        with self.transaction() as db:
            db.exec_driver_sql(f"SELECT pg_advisory_xact_lock({AUDIT_LOCK})")
            return super().enter(*given, **named)
