"""The service: one process from frames to answers.

The network's callbacks fill the inbox; one worker thread takes the frames through the pipeline to store, board and
network; HTTP is served in the main thread. A termination signal ends all of it within seconds: what is
committed stays, and what was in progress is taken up from the store by the next start.
"""

from __future__ import annotations

import gc
import logging
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from functools import partial

from service.alarms.keeper import AlarmKeeper
from service.alarms.rules import DEFAULT_RULES, Rule, load_rules
from service.api import create_app
from service.api.collector import Figures
from service.api.incoming import Incoming
from service.errors import StoreError
from service.logs import figures as log_figures
from service.long_lived import long_lived
from service.operation.health import HTTP, RETENTION, WEBHOOKS, Health
from service.operation.health import SIGNALS as RAW_SIGNALS
from service.operation.systemd import READY, STOPPING, Watchdog, notify
from service.operation.telemetry import all_of, sending_traces
from service.operation.timing import Timing
from service.results.alarm_store import AlarmStore
from service.results.asset_life import AssetLife
from service.results.audit_log import AuditLog
from service.results.baseline_store import BaselineStore
from service.results.board import Board
from service.results.change_queue import ChangeQueue
from service.results.data_folder import BASELINES, SIGNALS, WAITING, database_of, only_service_of
from service.results.decision_queue import DecisionQueue
from service.results.rig_proposals import RigProposals
from service.results.signal_store import SignalStore
from service.results.sql_store import SqlStore
from service.results.store import ResultStore, StoredAsset
from service.results.unknown_assets import UnknownAssets
from service.runtime import SERVES
from service.runtime.admission import access_of, front_of, limits_of
from service.runtime.bridging import bridges_of
from service.runtime.http_gate import GatedSocket
from service.runtime.http_server import Front, HttpServer, address_of, listening_at
from service.runtime.raw_recorder import recording_raw
from service.runtime.retention_job import RetentionJob, retention_of
from service.runtime.rigs import GivenRigs, Rigs
from service.runtime.signal_writer import SignalWriter
from service.runtime.storage_wait import StoppedWaiting, opened
from service.runtime.twin_port import Twin, gear_twin
from service.runtime.webhooks import WebhookSender
from service.runtime.worker import Kept, Worker
from service.settings import Settings
from service.transport.protocol import OpenTransport

log = logging.getLogger(__name__)

CONNECT_WAIT = 2.0  # how long one attempt to reach an external router takes [s]

OpenStore = Callable[[], AbstractContextManager[ResultStore]]


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
    twin = twin or _twin_of(settings)
    with suppress(StoppedWaiting), ExitStack() as stack:
        access, front = access_of(settings), front_of(settings)
        sent = stack.enter_context(sending_traces(settings.otlp))
        stack.enter_context(only_service_of(settings.data))
        listening = stack.enter_context(listening_at(settings.http_host, settings.http_port, front.gate))
        store = stack.enter_context(_opened(settings, open_store, listening, front, stop))
        timing = Timing()
        store.database.took = timing.stored
        known, board = stack.enter_context(_restored(store))
        signals = SignalStore(settings.data / SIGNALS, settings.signal_bytes)
        kept, alarms = _kept_in(settings, store, board, signals, known)
        rigs = Rigs(store, board, given_rigs, RigProposals(kept.life.rejected_rigs), asks=kept.unknown.asks)
        writer, health = SignalWriter(signals), Health(settings.loop_limit)
        raw = stack.enter_context(recording_raw(settings, board, health))
        worker = Worker(settings, kept, rigs, twin, open_transport or _zenoh_of(settings), writer, health, raw)
        worker.arrived, worker.timed = all_of(timing.arrived, sent), timing.computed
        bridges = bridges_of(settings, board, store, worker.offer, access)
        webhooks = WebhookSender(alarms.store, alarms.waiting)
        retention = RetentionJob(store, retention_of(settings))
        parts = (worker, webhooks, bridges, retention)
        figures = figures_of(*(part.figures for part in (*parts, front, timing)), partial(database_figures, store))
        app = create_app(
            board,
            store,
            kept.decisions,
            not_ready=worker.not_ready,
            figures=figures,
            signals=signals,
            alarms=alarms,
            changes=kept.changes,
            baselines=kept.baselines,
            access=access,
            limits=limits_of(settings),
            audit=AuditLog(store.database, settings.audit_entries),
            incoming=_incoming_of(worker, kept, rigs),
            labelled_assets=settings.metrics_assets,
            health=health,
        )

        def started() -> None:
            announce(address_of(listening, front))
            notify(READY)

        def ending() -> None:
            notify(STOPPING)
            worker.stop()
            board.close()

        server = HttpServer(app, started=started, ending=ending, stop=stop, front=front, tick=turns_of(health))
        worker.on_end = server.end
        for part in parts:
            part.start()
        for name, thread in ((WEBHOOKS, webhooks), (RETENTION, retention), (RAW_SIGNALS, writer.thread)):
            health.thread(name, thread)
        try:
            server.run(sockets=[listening])
        finally:
            for ended in (*parts, writer):
                ended.end()
        if worker.failure is not None:
            raise worker.failure
    return 0


def unknown_of(settings: Settings, board: Board, life: AssetLife) -> UnknownAssets:
    """The list of unknown assets, by the settings; assets that are declared are shown from now on."""
    renamed = life.routes()
    for asset in (*settings.assets, *settings.asset_rigs):
        if board.get(asset) is None and asset not in renamed:
            board.update(asset)
    rule, why = settings.rule_of_new_assets
    log.info("new assets: %s%s", rule, "" if why is None else f" ({why})")
    return UnknownAssets(asks=rule == "ask", most=settings.unknown_assets, expire=settings.unknown_expire)


def turns_of(health: Health) -> Callable[[], None]:
    """What the loop of HTTP does with each turn: it says that it is alive, and to systemd that all loops are."""
    beat, watchdog = health.loop(HTTP), Watchdog(health)

    def turn() -> None:
        beat()
        watchdog()

    return turn


def _kept_in(
    settings: Settings, store: ResultStore, board: Board, signals: SignalStore, known: dict[str, StoredAsset]
) -> tuple[Kept, AlarmKeeper]:
    """Where results are kept and shown, with the alarms that are open."""
    life = AssetLife(store.database, settings.data / WAITING)
    alarms = AlarmKeeper(AlarmStore(store.database), rules_of(settings), settings.webhooks)
    are_open = alarms.store.open()
    for asset in {alarm["asset"] for alarm in are_open}:
        board.update(asset, alarms=tuple(alarm for alarm in are_open if alarm["asset"] == asset))
    kept = Kept(
        store=store,
        board=board,
        decisions=DecisionQueue(store),
        life=life,
        changes=ChangeQueue(life),
        unknown=unknown_of(settings, board, life),
        baselines=BaselineStore(store.database, settings.data / BASELINES),
        signals=signals,
        alarms=alarms,
        known=known,
    )
    return kept, alarms


def _incoming_of(worker: Worker, kept: Kept, rigs: Rigs) -> Incoming:
    """What REST answers of the network's side."""
    return Incoming(unknown=kept.unknown, proposals=rigs.proposals, position=worker.position, propose=rigs.propose)


def figures_of(*parts: Callable[[], Figures]) -> Callable[[], Figures]:
    """The figures of some parts and of the log together, for /metrics."""
    return lambda: {key: value for figures in (*parts, log_figures) for key, value in figures().items()}


def database_figures(store: ResultStore) -> dict[str, float]:
    """Figures of the database for /metrics; none while it cannot be used."""
    try:
        return {"store_bytes": store.database.size()}
    except (StoreError, OSError):
        return {}


def _opened(
    settings: Settings,
    open_store: OpenStore | None,
    listening: GatedSocket,
    front: Front,
    stop: threading.Event | None,
) -> AbstractContextManager[ResultStore]:
    """The store, which no other service writes to; waited for where its server is away."""
    own = partial(SqlStore, database_of(settings.data, settings.database), claimed=True)
    return opened(
        open_store or own,
        listening,
        front=front,
        limits=limits_of(settings),
        tick=turns_of(Health(settings.loop_limit)),
        waits=partial(notify, READY),
        stop=stop,
    )


@contextmanager
def _restored(store: ResultStore) -> Iterator[tuple[dict[str, StoredAsset], Board]]:
    """All assets of the store, and what is shown of them as long as the service runs."""
    with long_lived():
        known = {stored.asset: stored for stored in store.all_assets()}
        board = Board.from_store(store, known.values())
    try:
        yield known, board
    finally:
        gc.unfreeze()


def rules_of(settings: Settings) -> tuple[Rule, ...]:
    """The alarm rules of assets that have none of their own."""
    return DEFAULT_RULES if settings.alarm_rules is None else load_rules(settings.alarm_rules)


def _twin_of(settings: Settings) -> Twin:
    """The twin itself with the options of the settings."""
    from twin.options import Options

    baseline = relation = None
    if settings.baseline is not None:
        from service.files.baseline import read_baseline

        baseline = read_baseline(settings.baseline)
    if settings.relation is not None:
        from service.files.relation import read_relation

        relation = read_relation(settings.relation)
    return gear_twin(
        Options(
            update=settings.update,
            error_threshold=settings.error_threshold,
            trace=settings.trace,
            baseline=baseline,
            relation=relation,
            status_limits=settings.status_limits,
        )
    )


def _zenoh_of(settings: Settings) -> OpenTransport:
    from service.transport.zenoh import open_zenoh

    links = settings.zenoh_links
    return partial(open_zenoh, settings.listen, settings.connect, settings.prefix, CONNECT_WAIT, links)
