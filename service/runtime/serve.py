"""The service: one process from frames to answers.

The network's callbacks fill the inbox; one worker thread takes the frames through the pipeline to store, table and
network; HTTP is served in the main thread. A termination signal ends all of it within seconds: what is
committed stays, and what was in progress is taken up from the store by the next start.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack, suppress
from functools import partial

from service.api import create_app
from service.api.incoming import Incoming
from service.operation.health import HTTP, RETENTION, WEBHOOKS, Health
from service.operation.systemd import READY, STOPPING, Watchdog, notify
from service.operation.telemetry import all_of, sending_traces
from service.operation.timing import Timing
from service.results.audit_log import AuditLog
from service.results.data_folder import SEGMENTS, database_of, only_service_of
from service.results.sql_store import SqlStore
from service.runtime import SERVES
from service.runtime.admission import access_of, front_of, limits_of
from service.runtime.all_figures import database_figures, figures_of
from service.runtime.begun import Begun, OpenStore
from service.runtime.bridging import bridges_of
from service.runtime.by_settings import twin_of, zenoh_of
from service.runtime.computing_here import computing_here
from service.runtime.http_gate import GatedSocket
from service.runtime.http_server import Front, HttpServer, address_of, listening_at
from service.runtime.raw_recorder import recording_raw
from service.runtime.retention_job import RetentionJob, retention_of
from service.runtime.rigs import GivenRigs
from service.runtime.storage_wait import StoppedWaiting, opened
from service.runtime.twin_port import Twin
from service.runtime.webhooks import WebhookSender
from service.runtime.work import Workplace
from service.runtime.worker import Worker
from service.settings import Settings
from service.transport.protocol import OpenTransport


def run(
    settings: Settings,
    *,
    twin: Twin | None = None,
    open_transport: OpenTransport | None = None,
    open_store: OpenStore | None = None,
    announce: Callable[[str], None] = lambda address: print(f"{SERVES} {address}", flush=True),
    stop: threading.Event | None = None,
) -> int:
    """Serves until a signal, or `stop`, ends it; the exit status.

    twin            its functions; None for the twin itself
    open_transport  the network; None for Zenoh at the endpoints of the settings
    open_store      where results are kept; None for the database of the settings
    announce        called once with the page's address, when HTTP is served
    """
    given_rigs = GivenRigs.read(settings.rig, settings.asset_rigs)
    twin = twin or twin_of(settings)
    with suppress(StoppedWaiting), ExitStack() as stack:
        access, front = access_of(settings), front_of(settings)
        sent = stack.enter_context(sending_traces(settings.otlp))
        stack.enter_context(only_service_of(settings.data))
        listening = stack.enter_context(listening_at(settings.http_host, settings.http_port, front.gate))
        begun = stack.enter_context(_opened(settings, given_rigs, open_store, listening, front, stop))
        store, table, kept, alarms, rigs = begun.store, begun.table, begun.kept, begun.alarms, begun.rigs
        timing = Timing()
        store.database.took = timing.stored
        health = Health(settings.loop_limit)
        raw = stack.enter_context(recording_raw(settings, table, health))
        computing_of = partial(computing_here, place=place_of(settings, twin, open_store))
        worker = Worker(settings, kept, rigs, twin, open_transport or zenoh_of(settings), health, raw, computing_of)
        worker.arrived, worker.timed = all_of(timing.arrived, sent), timing.computed
        bridges = bridges_of(settings, table, store, worker.offer, access)
        webhooks = WebhookSender(alarms.store, alarms.waiting)
        retention = RetentionJob(store, retention_of(settings), settings.data / SEGMENTS)
        parts = (worker, webhooks, bridges, retention)
        figures = figures_of(*(part.figures for part in (*parts, front, timing)), partial(database_figures, store))
        app = create_app(
            table,
            store,
            kept.queue,
            not_ready=worker.not_ready,
            figures=figures,
            signals=kept.signals,
            alarms=alarms,
            baselines=kept.baselines,
            access=access,
            limits=limits_of(settings),
            audit=AuditLog(store.database, settings.audit_entries),
            incoming=Incoming(asks=kept.unknown.asks, position=worker.position),
            labelled_assets=settings.metrics_assets,
            health=health,
            told=kept.told,
        )

        def started() -> None:
            announce(address_of(listening, front))
            notify(READY)

        def ending() -> None:
            notify(STOPPING)
            worker.stop()
            table.close()

        server = HttpServer(app, started=started, ending=ending, stop=stop, front=front, tick=turns_of(health))
        worker.on_end = server.end
        for part in parts:
            part.start()
        for name, thread in ((WEBHOOKS, webhooks), (RETENTION, retention)):
            health.thread(name, thread)
        try:
            server.run(sockets=[listening])
        finally:
            for ended in parts:
                ended.end()
        if worker.failure is not None:
            raise worker.failure
    return 0


def place_of(settings: Settings, twin: Twin, open_store: OpenStore | None) -> Workplace | None:
    """Where worker processes find the results; None where no other process can open them, or make the twin."""
    if open_store is not None or twin.make is None:
        return None
    own = partial(SqlStore, database_of(settings.data, settings.database), shared=True)
    return Workplace(settings=settings, open=own, make=twin.make, options=twin.options)


def turns_of(health: Health) -> Callable[[], None]:
    """What the loop of HTTP does with each turn: it says that it is alive, and to systemd that all loops are."""
    beat, watchdog = health.loop(HTTP), Watchdog(health)

    def turn() -> None:
        beat()
        watchdog()

    return turn


def _opened(
    settings: Settings,
    given_rigs: GivenRigs,
    open_store: OpenStore | None,
    listening: GatedSocket,
    front: Front,
    stop: threading.Event | None,
) -> AbstractContextManager[Begun]:
    """The store, which no other service writes to, and what is read of it; waited for where its server is away."""
    own = partial(SqlStore, database_of(settings.data, settings.database), claimed=True)
    return opened(
        partial(Begun.of, settings, given_rigs, open_store or own),
        listening,
        front=front,
        limits=limits_of(settings),
        tick=turns_of(Health(settings.loop_limit)),
        waits=partial(notify, READY),
        stop=stop,
    )
