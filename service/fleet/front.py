"""A front end of a fleet: the whole of REST and the page, from the fleet's database. It keeps nothing itself.

Any number of front ends may run at the same time, and each may end at any time. What people decide is written to the
partition of its asset; the worker of the partition carries it out.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import partial

import sqlalchemy as sa
from sqlalchemy.exc import DBAPIError

from service.alarms.keeper import AlarmKeeper
from service.api import create_app
from service.api.incoming import Incoming
from service.errors import StoreError
from service.fleet.databases import engine_of, made
from service.fleet.front_board import FleetBoard
from service.fleet.front_incoming import FleetProposals, FleetUnknown
from service.fleet.front_kept import FleetAlarms, FleetAudit, FleetJobs, FleetNames, FleetSignals, baselines_of
from service.fleet.front_position import FleetPositions
from service.fleet.front_store import FleetStore
from service.fleet.front_watch import FrontWatch
from service.fleet.layout import Layout, layout_of, schema_of
from service.operation.health import FLEET, Health
from service.operation.systemd import READY, STOPPING, notify
from service.results.job_queue import JobQueue
from service.results.storage_faults import storage_error
from service.runtime import SERVES
from service.runtime.admission import access_of, front_of, limits_of
from service.runtime.all_figures import figures_of
from service.runtime.begun import rules_of
from service.runtime.http_server import HttpServer, address_of, listening_at
from service.runtime.serve import turns_of
from service.runtime.storage_wait import StoppedWaiting, opened
from service.settings import Settings

DECIDED_WITHIN = 0.5  # how often who waits for a decision looks whether it is done [s]
NO_FLEET = "the database holds no fleet: gear-twin fleet up makes one"


@dataclass(frozen=True, slots=True, kw_only=True)
class FrontEnd(AbstractContextManager["FrontEnd"]):
    """What a front end answers from; closed when it is left."""

    layout: Layout
    store: FleetStore
    alarms: AlarmKeeper
    board: FleetBoard
    queue: JobQueue
    watch: FrontWatch

    @classmethod
    def of(cls, settings: Settings) -> FrontEnd:
        """Connects to the fleet. StorageUnavailable where its server is away, StoreError where there is no fleet."""
        if settings.database is None:
            raise StoreError("the setting database must name the fleet's database: postgresql://user@host/name")
        database = settings.database.get_secret_value()
        layout = _prepared(database)
        store = FleetStore(database, layout)
        alarms = AlarmKeeper(FleetAlarms(store), rules_of(settings), settings.webhooks)
        board = FleetBoard(store, alarms)
        queue = JobQueue(FleetJobs(store), DECIDED_WITHIN)
        watch = FrontWatch(database, store.fleet, board, queue.done)
        return cls(layout=layout, store=store, alarms=alarms, board=board, queue=queue, watch=watch)

    def end(self) -> None:
        """Ends every wait."""
        self.queue.close()
        self.board.close()

    def __exit__(self, *_: object) -> None:
        self.watch.end()
        self.store.fleet.close()


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
        app = create_app(
            own.board,
            own.store,
            own.queue,
            not_ready=own.watch.not_ready,
            figures=figures_of(own.watch.figures, front.figures),
            signals=FleetSignals(own.store, settings.data),
            alarms=own.alarms,
            names=FleetNames(own.store),
            baselines=baselines_of(own.store, settings.data).of,
            access=access,
            limits=limits_of(settings),
            audit=FleetAudit(own.store.database, settings.audit_entries, own.queue.jobs),
            labelled_assets=None,
            health=health,
            incoming=_incoming_of(settings, own),
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


def _incoming_of(settings: Settings, own: FrontEnd) -> Incoming:
    """What the workers have written of the network's side. What a worker proposes, it proposes itself."""
    asks = settings.rule_of_new_assets[0] == "ask"
    unknown = FleetUnknown(own.store, asks, own.watch.of_workers)
    return Incoming(unknown=unknown, proposals=FleetProposals(own.store), position=FleetPositions(own.store).of)


def _prepared(database: str) -> Layout:
    """The fleet's layout; the tables of partitions that no worker has had yet are made."""
    with _engine(database) as engine:
        layout = layout_of(engine)
        if layout is None:
            raise StoreError(NO_FLEET)
        schemas = set(sa.inspect(engine).get_schema_names())
    for number in layout.all:
        if schema_of(number) not in schemas:
            made(database, number, layout.partitions)
    return layout


@contextmanager
def _engine(database: str) -> Iterator[sa.Engine]:
    """For a look at the layout; failures of the server as errors of the service."""
    engine = engine_of(database, poolclass=sa.NullPool)
    try:
        yield engine
    except DBAPIError as error:
        name = engine.url.render_as_string(hide_password=True)
        raise storage_error(error.orig or error, name, lost=error.connection_invalidated) or error from error
    finally:
        engine.dispose()
