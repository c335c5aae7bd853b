"""The role `answer`: REST, page and events from what is stored, in `serve` and in the front ends of a fleet alike.

with Answering.at(settings) as answering:
    answering.answer(context, open_store, receivers_of, announce)      # until `context.stop` is set, or by a signal
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from functools import partial
from typing import Any, Protocol

from service.access.access import Access
from service.alarms.keeper import AlarmKeeper
from service.alarms.rules import rules_at
from service.api import create_app
from service.api.incoming import Incoming
from service.contract.position import ChannelPositionModel, PositionModel, why_retired, why_unknown
from service.logs import figures as log_figures
from service.operation.health import FEED, HTTP, Health, Late
from service.operation.systemd import READY, STOPPING, Watchdog
from service.results.alarm_store import AlarmStore
from service.results.asset_table import AssetTable
from service.results.audit_log import AuditLog
from service.results.baseline_store import BaselineStore
from service.results.data_folder import BASELINES, SEGMENTS
from service.results.job_queue import JobQueue
from service.results.jobs import Jobs
from service.results.kept_signals import KeptSignals
from service.results.names import Names
from service.results.roles import INGEST, Roles
from service.results.sql_store import SqlStore
from service.runtime.admission import access_of, front_of, limits_of
from service.runtime.all_figures import database_figures
from service.runtime.feed import Feed
from service.runtime.http_gate import GatedSocket
from service.runtime.http_server import Front, HttpServer, address_of, listening_at
from service.runtime.ingested import FiguresAsked, ingested
from service.runtime.positions import LONGEST_FRAME_NS
from service.runtime.role_process import Context
from service.runtime.storage_wait import opened
from service.runtime.storage_watch import StoppedWaiting
from service.runtime.supervisor import SUPERVISOR
from service.settings import Settings

STARTED = "the process that receives frames is being started"
LOOK_EVERY = 1.0  # [s]
FIGURES_WAIT = 2.0  # for the figures of another process [s]


class Receivers(Protocol):
    """What is known of the processes that receive frames, from `start` to `end`."""

    @property
    def roles(self) -> Roles:
        """The rows of all processes of the service."""
        ...

    @property
    def watched(self) -> Mapping[str, threading.Thread]:
        """Its threads, by what health calls them."""
        ...

    @property
    def unserved(self) -> Callable[[], Sequence[int]] | None:
        """The partitions of a fleet that nobody serves; None where this is no fleet."""
        ...

    def start(self) -> object: ...

    def end(self) -> object: ...

    def not_ready(self) -> str | None:
        """Why no frames are taken, or why that is not known; None where they are."""
        ...

    def late(self) -> Sequence[Late]:
        """Their loops that hang or have ended."""
        ...

    def position(self, stream: str) -> PositionModel:
        """How far a stream is stored."""
        ...

    def figures(self) -> Mapping[str, Any]:
        """What is known of them, for /metrics."""
        ...

    def log_figures(self) -> Mapping[str, Any]:
        """Those of the log of whoever looks after them."""
        ...


ReceiversOf = Callable[[SqlStore, AssetTable, JobQueue], Receivers]


class IngestSeen(threading.Thread):
    """The process of the role `ingest`, by what it says: whoever waits for a job, and the table, follow it."""

    unserved = None

    def __init__(self, context: Context, store: SqlStore, table: AssetTable, queue: JobQueue) -> None:
        super().__init__(name="ingest", daemon=True)
        self._context, self._others = context, context.others
        self._store, self._table, self._queue = store, table, queue
        self._ended = threading.Event()
        self.roles = Roles(store.database)
        self.watched: dict[str, threading.Thread] = {}

    def run(self) -> None:
        """Follows until ended."""
        while not self._ended.is_set():
            said = ingested(self._others)
            if said.unstored != self._table.unstored:
                self._table.note_unstored(said.unstored)
            if said.lasts:
                self._queue.release()
            self._others.wait(LOOK_EVERY)

    def end(self) -> None:
        self._ended.set()

    def not_ready(self) -> str | None:
        return ingested(self._others).not_ready if self._others.state(INGEST).lives else STARTED

    def late(self) -> Sequence[Late]:
        return ingested(self._others).late

    def position(self, stream: str) -> PositionModel:
        return stored_position(self._store, stream, ingested(self._others).instance, self.not_ready())

    def figures(self) -> Mapping[str, Any]:
        asked = FiguresAsked(time.monotonic_ns())
        self._context.say(asked)
        self._others.wait_for(lambda: ingested(self._others).asked_ns >= asked.at_ns, FIGURES_WAIT)
        return ingested(self._others).figures

    def log_figures(self) -> Mapping[str, Any]:
        return self._others.said(SUPERVISOR) or {}


class Answering:
    """Who answers at an address that is bound already.

    access  whom it lets in
    """

    def __init__(self, settings: Settings, access: Access, front: Front, listening: GatedSocket) -> None:
        self._settings, self.access, self._front, self._listening = settings, access, front, listening
        self._health = Health(settings.loop_limit)

    @classmethod
    @contextmanager
    def at(cls, settings: Settings) -> Iterator[Answering]:
        """Binds the address of the settings. InputError where that, or whom they let in, cannot be so."""
        access, front = access_of(settings), front_of(settings)
        with listening_at(settings.http_host, settings.http_port, front.gate) as listening:
            yield cls(settings, access, front, listening)

    def answer(
        self,
        context: Context,
        open_store: Callable[[], AbstractContextManager[SqlStore]],
        receivers_of: ReceiversOf,
        announce: Callable[[str], None],
    ) -> None:
        """Answers until a signal, or `context.stop`, ends it; as long as the store cannot be opened, that it waits.

        announce  called once with the page's address, when HTTP is served
        """
        with (
            suppress(StoppedWaiting),
            opened(
                open_store, self._listening, front=self._front, limits=limits_of(self._settings),
                tick=self._turns(context, Health(self._settings.loop_limit)), waits=partial(context.notify, READY),
                stop=context.stop,
            ) as store,
        ):  # fmt: skip
            self._run(context, store, receivers_of, announce)

    def _run(
        self, context: Context, store: SqlStore, receivers_of: ReceiversOf, announce: Callable[[str], None]
    ) -> None:
        settings, database = self._settings, store.database
        alarms = AlarmKeeper(AlarmStore(database), rules_at(settings.alarm_rules), settings.webhooks)
        table, queue = AssetTable(store, alarms), JobQueue(Jobs(database))
        receivers, feed = receivers_of(store, table, queue), Feed(store, table, lambda assets: queue.done())
        app = create_app(
            table,
            store,
            queue,
            not_ready=receivers.not_ready,
            figures=partial(
                receivers.roles.figures, receivers.figures, receivers.log_figures, self._front.figures, log_figures,
                partial(database_figures, store),
            ),
            signals=KeptSignals(database, settings.data / SEGMENTS),
            alarms=alarms,
            baselines=BaselineStore(database, settings.data / BASELINES, clears=False),
            access=self.access,
            limits=limits_of(settings),
            audit=AuditLog(database, settings.audit_entries),
            incoming=Incoming(asks=settings.rule_of_new_assets[0] == "ask", position=receivers.position),
            labelled_assets=settings.metrics_assets if receivers.unserved is None else None,
            health=self._health,
            unserved=receivers.unserved,
        )  # fmt: skip

        def started() -> None:
            announce(address_of(self._listening, self._front))
            context.notify(READY)

        def ending() -> None:
            context.notify(STOPPING)
            queue.close()
            table.close()

        self._health.includes(receivers.late)
        server = HttpServer(
            app, started=started, ending=ending, stop=context.stop, front=self._front,
            tick=self._turns(context, self._health),
        )  # fmt: skip
        parts = (receivers, feed)
        for part in parts:
            part.start()
        for name, thread in {FEED: feed, **receivers.watched}.items():
            self._health.thread(name, thread)
        try:
            server.run(sockets=[self._listening])
        finally:
            for part in parts:
                part.end()

    def _turns(self, context: Context, health: Health) -> Callable[[], None]:
        """What the loop of HTTP does with each turn: it says that it is alive, and to systemd that all loops are."""
        beat, watchdog = health.loop(HTTP), Watchdog(health, context.notify)

        def turn() -> None:
            context.beat()
            beat()
            watchdog()

        return turn


def stored_position(store: SqlStore, stream: str, instance: str, reason: str | None) -> PositionModel:
    """How far a stream is stored, by what has been committed. StorageUnavailable where that cannot be read now.

    What has been received since is not known here and counts as not stored, so that nobody who keeps frames forgets one
    too early by this answer; nor is it known whether a frame reaches beyond the newest window, of whose rest the next
    one is made. The answer of who receives frames, on Zenoh, is newer.

    instance  of who receives its frames
    reason    why that takes none, or None
    """
    names = Names(store.database)
    asset = names.asset_of(stream)
    stored = store.shown_asset(asset)
    if names.is_free(stream):
        reason = why_unknown(stream)
    elif stored.retired is not None:
        reason = why_retired(stream)
    assembly = stored.assembly or {}
    until = int(assembly.get("closed_until_ns", 0))
    return PositionModel(
        asset=stream,
        instance=instance,
        accepting=reason is None,
        reason=reason,
        unsettled_from_ns=max(until - LONGEST_FRAME_NS, 0),
        settled_until_ns=until or None,
        channels={
            label: ChannelPositionModel(sequence=last["sequence"], start_time_ns=last["start_ns"])
            for label, last in sorted(assembly.get("last_frames", {}).items())
        },
        left_out=assembly.get("left_out", {}),
        backlog=Jobs(store.database).windows(asset),
    )
