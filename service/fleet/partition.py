"""One partition at work: the pipeline of `gear-twin serve` on the keys of its assets, over tables that it has taken.

There is no HTTP here: front ends read the tables. What people decide reaches the partition through the tables, too; a
notification of PostgreSQL says that something is there, and a look now and then finds what a lost one would have said.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial

from service.errors import StorageUnavailable
from service.fleet.databases import joined, worker_tables
from service.fleet.fence import Fence, leave_at_once
from service.fleet.heartbeat import Heartbeat
from service.fleet.kept_curves import CurveWriter, StoredCurves
from service.fleet.layout import Layout, folder_of
from service.fleet.listener import Listener
from service.fleet.naming import PartitionStreams
from service.operation.health import FLEET, Health, Late
from service.operation.telemetry import all_of, sending_traces
from service.operation.timing import Timing
from service.results.data_folder import SEGMENTS
from service.results.sql_store import SqlStore
from service.results.storage_faults import is_away
from service.runtime.all_figures import database_figures, figures_of
from service.runtime.begun import Begun, OpenStore
from service.runtime.by_settings import twin_of, zenoh_of
from service.runtime.computing_here import LEAST, computing_here
from service.runtime.raw_recorder import recording_raw
from service.runtime.retention_job import RetentionJob, retention_of
from service.runtime.rigs import GivenRigs
from service.runtime.twin_port import Twin
from service.runtime.webhooks import WebhookSender
from service.runtime.work import Workplace
from service.runtime.worker import Worker
from service.settings import Settings
from service.transport.protocol import OpenTransport

log = logging.getLogger(__name__)

FIRST_PAUSE, LONGEST_PAUSE = 0.2, 5.0  # between two attempts to reach the database [s]


def settings_of(settings: Settings, partition: int, layout: Layout) -> Settings:
    """The settings of one partition: its keys, its folder, and no more worker processes than are needed."""
    return settings.model_copy(
        update={
            "prefix": layout.prefix_of(partition, settings.prefix),
            "data": settings.data / folder_of(partition),
            "raw_folder": settings.raw_folder and settings.raw_folder / folder_of(partition),
            "new_assets": settings.rule_of_new_assets[0],
            "workers": LEAST if settings.workers is None else settings.workers,
        }
    )


def serve_partition(
    settings: Settings,
    partition: int,
    layout: Layout,
    stop: threading.Event,
    *,
    node: str = "",
    twin: Twin | None = None,
    open_transport: OpenTransport | None = None,
    lost: Callable[[], None] = leave_at_once,
    at_work: Callable[[Callable[[], Sequence[Late]]], object] = lambda late: None,
) -> None:
    """Serves one partition until `stop` is set. The settings are those of the fleet.

    node     where this is, for people
    lost     called when another worker has taken the partition
    at_work  called once the partition has been taken, with what says which of its loops hang
    """
    assert settings.database is not None
    database = settings.database.get_secret_value()
    own = settings_of(settings, partition, layout)
    own.data.mkdir(parents=True, exist_ok=True)
    fence = Fence(partition=partition, node=node, lost=lost)
    streams = PartitionStreams(layout, partition, settings.prefix)

    @contextmanager
    def open_store() -> Iterator[SqlStore]:
        with SqlStore(worker_tables(database, fence, layout), claimed=True) as store:
            streams.read(store.database)
            yield store

    twin = twin or twin_of(own)
    with _begun(own, open_store, stop, streams.refusal) as begun, ExitStack() as stack:
        if begun is None:
            return
        store, kept = begun.store, begun.kept
        timing, health = Timing(), Health(own.loop_limit)
        store.database.took = timing.stored
        raw = stack.enter_context(recording_raw(own, begun.table, health, prefix=settings.prefix))
        curves = CurveWriter(database)
        place = (
            None
            if twin.make is None
            else Workplace(
                settings=own, open=partial(joined, database, fence, layout), make=twin.make, options=twin.options
            )
        )
        computing_of = partial(computing_here, place=place, curves=StoredCurves(database), keep=curves.keep)
        transport = open_transport or zenoh_of(own)
        worker = Worker(own, kept, begun.rigs, twin, transport, health, raw, computing_of)
        sent = stack.enter_context(sending_traces(own.otlp))
        worker.arrived, worker.timed = all_of(timing.arrived, sent), timing.computed
        webhooks = WebhookSender(begun.alarms.store, begun.alarms.waiting)
        retention = RetentionJob(store, retention_of(own), own.data / SEGMENTS)
        figures = figures_of(
            *(p.figures for p in (worker, webhooks, retention, timing)), partial(database_figures, store)
        )
        listener = Listener(database, partition, kept, worker.look, streams)
        parts = (
            curves,
            worker,
            webhooks,
            retention,
            listener,
            Heartbeat(database, fence, figures, worker.not_ready, health.late),
        )
        health.thread(FLEET, listener)
        worker.on_end = stop.set
        for part in parts:
            part.start()
        at_work(health.late)
        try:
            stop.wait()
        finally:
            for ended in parts:
                ended.end()
        if worker.failure is not None:
            raise worker.failure


@contextmanager
def _begun(
    settings: Settings,
    open_store: OpenStore,
    stop: threading.Event,
    elsewhere: Callable[[str], str | None] = lambda asset: None,
) -> Iterator[Begun | None]:
    """What the partition begins with, as soon as the database answers; None where it is stopped before that.

    elsewhere  why an asset is not of this partition, or None
    """
    given = GivenRigs.read(settings.rig, settings.asset_rigs)
    pause = FIRST_PAUSE
    while True:
        try:
            begun = Begun.of(settings, given, open_store, elsewhere)
            break
        except StorageUnavailable as error:
            if not is_away(error) and error.reason != "locked":
                raise
            log.warning("%s: it is waited for", error)
        if stop.wait(pause):
            yield None
            return
        pause = min(2 * pause, LONGEST_PAUSE)
    with begun:
        yield begun
