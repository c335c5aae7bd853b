"""The thread that owns the network's connection: it makes windows of frames, and shows what they lead to."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar

from service.errors import NotReachable, SteppedBack, StorageUnavailable, StoreError
from service.operation.health import FEED, READY, RECEPTION, Health
from service.operation.journey import Arrived, nobody
from service.results.asset_changes import AssetChanges
from service.results.jobs import STALE
from service.results.offers import Offers
from service.results.retention import Retention
from service.results.roles import INGEST, OwnRole
from service.results.store import StoredAsset
from service.runtime.backlog_watch import BacklogWatch
from service.runtime.backlogs import Backlogs
from service.runtime.feed import Feed, OnCommit
from service.runtime.first_frames import FirstFrames
from service.runtime.followed import Followed, Timed
from service.runtime.intake import Intake
from service.runtime.kept import Kept, Start
from service.runtime.offer_writer import OfferWriter
from service.runtime.outcomes import ClosedWindow
from service.runtime.positions import ClosedWindows, Positions
from service.runtime.pump import Pump
from service.runtime.questions import REPEATED
from service.runtime.receiver_figures import shed_of, storage_figures, stream_figures, waiting_figures
from service.runtime.reception import Reception, assembly_settings
from service.runtime.rig_sources import OfferedRigs
from service.runtime.rigs import Rigs
from service.runtime.routes import Routes
from service.runtime.spool import BacklogLimits, Spool
from service.runtime.staleness import StalenessLimits, StalenessWatch
from service.runtime.state_publication import StatePublication
from service.runtime.storage_status import StorageStatus
from service.runtime.storage_watch import StorageWatch
from service.runtime.stream_changes import StreamChanges
from service.runtime.stream_questions import StreamQuestions
from service.runtime.streams import Streams
from service.runtime.twin_port import Twin
from service.runtime.work import Work
from service.runtime.workers import WorkersOf, workers_here
from service.settings import Settings
from service.steady_clock import later_time_ns
from service.stream.inbox import Inbox
from service.stream.repeats import Repeats
from service.transport.protocol import OpenTransport, Transport

log = logging.getLogger(__name__)

LOOK = 2.0  # between two looks whether the storage can be written [s]
STOP_WAIT = 5.0  # how long a window in the twin is waited for at the end [s]
TICK = 0.1  # between two looks whether the storage may be tried again [s]
AT_START = "the service goes on as soon as it can be read"

T = TypeVar("T")


class Ended(Exception):
    """The service ends before there is a connection."""


class Receiver(threading.Thread):
    """From the connection to the results, until stopped.

    on_commit  called with assets of which others have committed something
    on_end     called when the thread ends, for whatever reason
    node       of a cluster, where it is on one
    said       figures of other parts of the process, to be said with its own where another process answers
    arrived    called with each window that has been shown, and its stages in the service
    timed      called with what was asked of a twin and how long its parts took [s]
    failure    the exception that ended it; None where it was stopped
    """

    def __init__(
        self,
        settings: Settings,
        kept: Kept,
        rigs: Rigs,
        twin: Twin,
        open_transport: OpenTransport,
        health: Health | None = None,
        workers_of: WorkersOf = workers_here,
        *,
        on_commit: OnCommit = lambda assets: None,
        on_end: Callable[[], None] = lambda: None,
        node: str | None = None,
        said: Callable[[], Mapping[str, Any]] | None = None,
        arrived: Arrived = nobody,
        timed: Timed = lambda verb, parts: None,
    ) -> None:
        self._health = health or Health()
        super().__init__(name="twin", daemon=True)
        self._settings, self._kept = settings, kept
        self._rigs, self._open_transport = rigs, open_transport
        self._inbox = Inbox(
            frames=settings.queue_frames,
            max_bytes=settings.queue_bytes,
            prefix=settings.prefix,
            admits=kept.unknown.admits,
            known=kept.unknown.is_known,
        )
        self._stopping = threading.Event()
        self._reason: str | None = "not yet subscribed to the stream"
        self._transport: Transport | None = None
        self._workers = workers_of(settings, twin, self._work_of, kept.store)
        self._feed = Feed(kept.store, kept.table, self._committed, on_commit)
        self._followed: Followed | None = None
        self._backlogs: Backlogs | None = None
        self._questions: StreamQuestions | None = None
        self._spool: Spool | None = None
        self._positions: Positions | None = None
        self._reception: Reception | None = None
        self._intake: Intake | None = None
        self._streams: Streams | None = None
        self._link_at = 0.0  # when the link is looked at next, on the monotonic clock [s]
        self._cut_off = False  # whether the link was lost at the latest look, or just before
        self._storage, self._look_at = StorageWatch(str(settings.data)), 0.0
        self._role, self._said = OwnRole(kept.store.database, INGEST, node), said
        self._heard = True  # whether what was said last has been written
        self._on_end, self._arrived, self._timed = on_end, arrived, timed
        self.failure: Exception | None = None

    def run(self) -> None:
        """Works until stopped."""
        self._beat = self._health.loop(RECEPTION)
        try:
            with self._connection() as transport:
                self._transport = transport
                self._serve(transport)
        except Ended:
            pass
        except Exception as error:
            self.failure = error
        finally:
            self._reason = "the subscription to the stream has ended"
            with suppress(StoreError):
                self._role.gone()
            self._on_end()

    def stop(self) -> None:
        """Tells the thread to end: windows that wait, and those in the twin, are left to the next start."""
        self._stopping.set()
        self._workers.end()
        self._inbox.close()

    def end(self) -> None:
        """Ends the thread.

        Where that takes longer than a few seconds, its connection is still open, and only ends with the process: see
        `service.__main__.leave`.
        """
        self.stop()
        self.join(STOP_WAIT)

    def offer(self, topic: str, payload: bytes) -> bool:
        """Puts a frame that did not come over the network into the inbox; False where it had to be left out."""
        if self._transport is not None:
            self._transport.publish_made(topic, payload)
        return self._inbox.offer(topic, payload)

    def not_ready(self) -> str | None:
        """Why no frames are accepted, or None."""
        late = "; ".join(map(str, self._health.late(READY)))
        return self._reason or self._lost() or self._storage.unusable or self._workers.unusable() or late or None

    @property
    def instance(self) -> str:
        """As positions name this process; empty before there are any."""
        return "" if self._positions is None else self._positions.instance

    @property
    def unstored(self) -> tuple[str, str] | None:
        """Why results cannot be stored now, and since when (ISO 8601)."""
        return self._kept.table.unstored

    @property
    def storage_lasts(self) -> bool:
        """Whether the storage has failed for more than a moment."""
        return self._storage.lasts

    def _lost(self) -> str | None:
        return None if self._transport is None else self._transport.lost()

    def figures(self) -> dict[str, Any]:
        """Figures of the process for /metrics."""
        network = self._transport.counters() if self._transport else {}
        return {
            **stream_figures(self._inbox, network, self._streams, self._intake),
            "network_connected": float(self._reason is None and self._lost() is None),
            **storage_figures(self._storage, self._settings.data, self._spool),
            **waiting_figures(self._kept.table, self._followed, self._backlogs, self._reception),
            **self._workers.figures(),
            "twin_calls_waiting": self._waiting_assets(),
        }

    def _waiting_assets(self) -> int:
        """How many assets wait for who computes."""
        waiting = {} if self._backlogs is None else self._backlogs.all
        return len({asset for asset, waits in waiting.items() if waits.windows} - set(self._workers.at_work()))

    @contextmanager
    def _connection(self) -> Iterator[Transport]:
        """An open connection; one that is not reachable yet is tried again as long as it takes."""
        with ExitStack() as stack:
            while True:
                self._beat()
                try:
                    transport = stack.enter_context(self._open_transport())
                    break
                except NotReachable as error:
                    if self._reason != str(error):
                        log.warning("%s; it is tried again all the time", error)
                    self._reason = str(error)
                    self._say_besides()
                if self._stopping.is_set():
                    raise Ended
            yield transport

    def _serve(self, transport: Transport) -> None:
        kept = self._kept
        publication = StatePublication(transport, kept.table)
        with (
            OfferedRigs(transport, kept.unknown).watching() as offered,
            transport.answer_states(publication),
            kept.table.follow(fleeting=False) as changes,
        ):
            self._run(transport, publication, offered, changes)

    def _run(
        self, transport: Transport, publication: StatePublication, offered: OfferedRigs, changes: AssetChanges
    ) -> None:
        prepare = partial(self._prepared, transport, publication, offered, changes)
        positions, streams, between = self._once_stored(prepare)
        with positions, transport.subscribe(self._inbox), self._at_work():
            self._reason = None
            pump = Pump(
                self._inbox, streams, self._settings.idle_timeout, between,
                channel_wait=self._settings.channel_wait, holding=self._holds,
                waits=positions.waits, asks=positions.asks, asset_of=streams.routes.asset_of,
            )  # fmt: skip
            pump.run(self._stopping)

    def _holds(self) -> bool:
        """Whether publishers are asked to wait or are cut off, so that their silence ends no window."""
        return self._storage.reason is not None or self._cut_off

    def _once_stored(self, prepare: Callable[[], T]) -> T:
        """What is made of stored results, as soon as the storage can be read; it is made anew after a failure."""
        while True:
            self._beat()
            try:
                made = prepare()
            except StorageUnavailable as error:
                if error.reason == "damaged" or isinstance(error, SteppedBack):
                    raise
                self._storage.failed(error, AT_START)
            else:
                self._storage.worked()
                return made
            while self._storage.pausing:
                if self._stopping.wait(TICK):
                    raise Ended
                self._beat()

    def _prepared(
        self, transport: Transport, publication: StatePublication, offered: OfferedRigs, changes: AssetChanges
    ) -> tuple[Positions, Streams, Callable[[], None]]:
        """All that frames go through, as the last run left it, with what is done between frames."""
        kept, storage = self._kept, self._storage
        store, table, windows = kept.store, kept.table, kept.windows
        jobs, backlogs = kept.jobs, Backlogs(windows)
        self._backlogs = backlogs
        routes, moved = Routes(kept.names), set[str]()

        def close(closed: ClosedWindow) -> None:
            closed.journey.received_ns = reception.last_arrival_ns(closed.asset) or 0
            watch.closed(closed.asset, closed.segment.start_ns)
            spool.add(closed)

        def settled(asset: str) -> None:
            watch.stored(asset)
            self._show_quality(reception, asset)
            moved.update(routes.streams_of(asset))

        start = kept.start.pop() if kept.start else Start.read(jobs, store.all_assets)
        reception = self._reception = self._receiving(offered, close, start.assets)
        spool = self._spool = Spool(
            windows, store, reception, backlogs, storage, BacklogLimits.of(self._settings), settled=settled
        )
        restore(reception, spool, start.assets)
        for about in (STALE, REPEATED):  # what the last run has seen and nobody has judged: it is seen anew
            jobs.forget(about)
        watch = StalenessWatch(
            table, jobs.notice, StalenessLimits.of(self._settings), waiting=lambda asset: backlogs.now(asset).newest_ns
        )
        questions = self._questions = StreamQuestions(
            reception, table, store, jobs.notice, rigs=self._rigs, routes=routes, offered=offered
        )
        first_frames = FirstFrames(reception, transport, self._inbox.ask, asset_of=routes.asset_of)
        intake = self._intake = Intake(
            reception, lambda asset: self._show_quality(reception, asset),
            heard=watch.heard, begins=self._begin, storage=storage,
        )  # fmt: skip
        streams = self._streams = Streams(
            routes, intake, self._is_retired, lambda: storage.unusable, kept.unknown,
            moved=moved.add, fed=first_frames.fed, holds=first_frames.holds,
        )  # fmt: skip
        offer_writer = OfferWriter(Offers(store.database), jobs, kept.unknown, self._rigs)
        kept.unknown.begin(
            lambda stream: table.latest(routes.asset_of(stream)) is not None, (*table.known(), *routes.routed)
        )
        positions = self._positions = Positions(
            self._inbox, transport, streams, unknown=kept.unknown, moved=moved,
            pending=lambda stream: self._closed_windows(spool, routes.asset_of(stream)),
        )  # fmt: skip
        changed = StreamChanges(reception, store, table, routes=routes, intake=intake, spool=spool, retire=watch.retire)
        questions.start()
        backlog = BacklogWatch(backlogs, self._workers, table)
        storage_status = StorageStatus(storage, table)
        followed = self._followed = Followed(
            changes, store, publication, backlogs, spool, storage,
            routes=routes, positions=positions, carry_on=changed, arrived=self._arrived, timed=self._timed,
            alarms=kept.alarms, ended=start.ended,
        )  # fmt: skip

        def between() -> None:
            self._look_at_link(transport)
            followed()
            self._look_after(spool, storage_status)
            storage.attempt(backlogs)
            positions()
            first_frames()
            backlog()
            storage.attempt(questions)
            storage.attempt(offer_writer)
            if storage.reason is None:  # else what waits is kept first
                spool.retry()
                storage.attempt(watch)
                storage.attempt(table.write_noted)

        return positions, streams, between

    def _committed(self, assets: object) -> None:
        self._inbox.wake()

    def _work_of(self, twin: Twin) -> Work:
        """What carries jobs out in this process."""
        kept = self._kept
        return Work(
            kept.store, kept.table, twin,
            windows=kept.windows, names=kept.names, baselines=kept.baselines, signals=kept.signals, alarms=kept.alarms,
            retention=Retention.of(self._settings),
        )  # fmt: skip

    @contextmanager
    def _at_work(self) -> Iterator[None]:
        """Those who compute are at work, and what they commit is noticed, while inside."""
        self._storage.attempt(self._kept.table.write_noted)  # what the last run has shown is over
        self._feed.start()
        self._workers.start()
        self._health.thread(FEED, self._feed)
        try:
            yield
        finally:
            self._workers.end()
            self._feed.end()

    def _begin(self, asset: str) -> None:
        """The first frame of an asset has come; NameTaken where another one has been given its name meanwhile."""
        with self._kept.windows.transaction() as db:  # from now on no other is given it
            self._kept.store.database.ensure(db, asset)
        assert self._questions is not None
        self._questions.first_frame(asset)

    def _receiving(
        self, offered: OfferedRigs, close: Callable[[ClosedWindow], None], known: Mapping[str, StoredAsset]
    ) -> Reception:
        return Reception(
            lambda asset: self._rigs.of(asset, offered, known.get(asset)),
            close,
            noticed=self._noticed,
            assembly=replace(assembly_settings(self._settings), clocked=True),
            host_clock=later_time_ns,
        )

    def _noticed(self, asset: str, repeats: Repeats) -> None:
        """Frames of times that have passed have come, or others since."""
        questions = self._questions
        if questions is not None:
            self._storage.attempt(lambda: questions.look_for_repeats(asset, repeats))

    def _look_at_link(self, transport: Transport) -> None:
        """From time to time: whether publishers can be heard."""
        now = time.monotonic()
        if now >= self._link_at:
            self._link_at, self._cut_off = now + TICK, transport.interrupted()

    def _look_after(self, spool: Spool, storage_status: StorageStatus) -> None:
        """Tries the storage again where that is due."""
        self._beat()
        stuck = self._workers.stuck()
        if isinstance(stuck, SteppedBack):
            raise stuck
        if self._storage.reason is None and stuck is not None:
            self._storage.failed(stuck)
        if self._storage.reason is not None and not self._storage.pausing:
            self._try_again(self._storage, spool)
        elif self._storage.reason is not None and self._heard:  # a disk is full, and the database can be used
            self._say_besides()
        elif self._storage.reason is None and time.monotonic() >= self._look_at:  # nothing comes that has to be kept
            self._look_at = time.monotonic() + LOOK
            if self._storage.attempt(self._say)[0]:
                self._storage.attempt(self._kept.windows.probe)
        storage_status()

    def _try_again(self, storage: StorageWatch, spool: Spool) -> None:
        """Keeps what has waited for the storage; a window's file is the last thing to fit on a disk that was full."""
        kept = storage.attempt(self._say)[0] and spool.retry() and storage.attempt(self._kept.windows.probe)[0]
        if kept and self._workers.stuck() is None:
            storage.worked()

    def _say_besides(self) -> None:
        """Says now and then how this process is while it does not receive frames, or cannot keep windows."""
        if time.monotonic() >= self._look_at:
            self._look_at = time.monotonic() + LOOK
            try:
                self._say()
            except SteppedBack:
                raise
            except StoreError as error:  # whoever keeps windows says it
                log.debug("how this process is cannot be written now: %s", error)

    def _say(self) -> None:
        """Writes how this process is, as a window is written. StoreError where that is not possible now."""
        self._heard = False
        figures = {} if self._said is None else {**self.figures(), **self._said()}
        self._role.say(figures, self.not_ready())
        self._heard = True

    def _closed_windows(self, spool: Spool, asset: str) -> ClosedWindows:
        assert self._backlogs is not None
        return ClosedWindows(
            unstored_from_ns=spool.unstored_from_ns(asset),
            waiting=self._backlogs.of(asset).windows,
            shed=shed_of(self._kept.table, asset),
            unassessed=self._workers.unusable(),
        )

    def _is_retired(self, asset: str) -> bool:
        snapshot = self._kept.table.latest(asset)
        return snapshot is not None and snapshot.retired is not None

    def _show_quality(self, reception: Reception, asset: str) -> None:
        last_frame_ns = reception.last_arrival_ns(asset)
        self._kept.table.note(asset, quality=reception.quality(asset), last_frame_ns=last_frame_ns)


def restore(reception: Reception, spool: Spool, known: dict[str, StoredAsset]) -> None:
    """Goes on where the streams of the store's assets ended.

    known  all assets of the store, by name; empty afterwards
    """
    for stored in known.values():
        if stored.assembly:
            reception.resume(stored.asset, stored.assembly, stored.quality or {})
            spool.goes_on(stored.asset, stored.assembly)
    known.clear()
