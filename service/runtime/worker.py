"""The thread that owns the network's connection: it receives frames, and commits and publishes what windows led to."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, TypeVar

from service.alarms.keeper import AlarmKeeper
from service.contract.position import PositionModel, not_connected
from service.errors import NotReachable, SteppedBack, StorageUnavailable
from service.operation.health import READY, RECEPTION, WORKERS, Health
from service.operation.journey import Arrived, Journey, nobody
from service.results.asset_table import AssetTable
from service.results.baseline_store import BaselineStore
from service.results.job_queue import ALARM, JobQueue
from service.results.kept_signals import KeptSignals
from service.results.names import Names
from service.results.offers import Offers
from service.results.snapshot import Stale
from service.results.sql_store import SqlStore
from service.results.store import StoredAsset
from service.results.unknown_assets import UnknownAssets
from service.results.window_jobs import WindowJobs
from service.runtime.asset_twins import AssetTwins
from service.runtime.backlog_watch import BacklogWatch
from service.runtime.changes import Changes
from service.runtime.commits import Commits
from service.runtime.computing_here import ComputingOf, computing_here
from service.runtime.decisions import Decisions
from service.runtime.first_frames import FirstFrames
from service.runtime.intake import Intake
from service.runtime.job_worker import JobWorker
from service.runtime.lanes import LEFT_OUT, Lanes
from service.runtime.offer_writer import OfferWriter
from service.runtime.outcomes import Checkpoint, ClosedWindow
from service.runtime.packed_state import NEW, StoredState
from service.runtime.positions import ClosedWindows, Positions
from service.runtime.pump import pump
from service.runtime.raw_recorder import RawRecorder
from service.runtime.reception import Reception, assembly_settings
from service.runtime.rig_questions import RigQuestions
from service.runtime.rigs import OfferedRigs, Rigs
from service.runtime.spool import BacklogLimits, Spool, entries_of
from service.runtime.staleness import WINDOWS_MISSED, StalenessLimits, StalenessWatch
from service.runtime.state_publication import StatePublication
from service.runtime.storage_status import StorageStatus
from service.runtime.storage_watch import StorageWatch
from service.runtime.stream_changes import StreamChanges
from service.runtime.streams import Streams
from service.runtime.twin_port import Twin, guarded
from service.runtime.worker_figures import lane_figures, storage_figures, stream_figures
from service.settings import Settings
from service.steady_clock import later_time_ns
from service.stream.frames import Frame
from service.stream.inbox import Inbox
from service.stream.repeats import Repeats
from service.transport.protocol import OpenTransport, Transport

LOOK = 2.0  # between two looks whether the storage can be written [s]
STOP_WAIT = 5.0  # how long a window in the twin is waited for at the end [s]
TICK = 0.1  # between two looks whether the storage may be tried again [s]
AT_START = "the service goes on as soon as it can be read"

T = TypeVar("T")


@dataclass(frozen=True, slots=True, kw_only=True)
class Kept:
    """Where results are kept and shown, and what waits to be carried out."""

    store: SqlStore
    table: AssetTable
    queue: JobQueue
    windows: WindowJobs
    names: Names
    baselines: BaselineStore
    signals: KeptSignals | None = None
    alarms: AlarmKeeper | None = None
    unknown: UnknownAssets = field(default_factory=UnknownAssets)
    known: dict[str, StoredAsset] = field(default_factory=dict)  # all assets as the start has read them, until restored

    def close(self) -> None:
        """Releases everyone who waits for a job."""
        self.queue.close()

    def told(self, what: str, asset: str) -> None:
        """Takes up what people have written of an asset without a job: that it is there, or what became of an alarm."""
        self.table.renewed(asset)
        if what == ALARM:
            assert self.alarms is not None
            self.alarms.changed(asset)
            self.alarms.waiting.set()


class Ended(Exception):
    """The service ends before there is a connection."""


class Worker(threading.Thread):
    """From the connection to the results, until stopped.

    on_end   called when the thread ends, for whatever reason
    arrived  called with each window that has been shown, and its stages in the service
    timed    called with what was asked of a twin and how long its parts took [s]
    failure  the exception that ended it; None where it was stopped
    """

    def __init__(
        self,
        settings: Settings,
        kept: Kept,
        rigs: Rigs,
        twin: Twin,
        open_transport: OpenTransport,
        health: Health | None = None,
        raw: RawRecorder | None = None,
        computing_of: ComputingOf = computing_here,
    ) -> None:
        self._health, self._raw = health or Health(), raw
        super().__init__(name="twin", daemon=True)
        self._settings, self._kept = settings, kept
        self._rigs, self._twin, self._open_transport = rigs, guarded(twin), open_transport
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
        self._computing = computing_of(settings, self._twin, self._inbox.wake)
        self._lanes: Lanes | None = None
        self._spool: Spool | None = None
        self._positions: Positions | None = None
        self._reception: Reception | None = None
        self._intake: Intake | None = None
        self._streams: Streams | None = None
        self._link_at = 0.0  # when the link is looked at next, on the monotonic clock [s]
        self._cut_off = False  # whether the link was lost at the latest look, or just before
        self._storage, self._look_at = StorageWatch(str(settings.data)), 0.0
        self.on_end: Callable[[], None] = lambda: None
        self.arrived: Arrived = nobody
        self.timed: Callable[[str, Mapping[str, float]], object] = lambda verb, parts: None
        self.failure: Exception | None = None

    def run(self) -> None:
        """Works until stopped."""
        self._beat, self._supervised = self._health.loop(RECEPTION), self._health.loop(WORKERS)
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
            self._kept.close()
            self.on_end()

    def stop(self) -> None:
        """Tells the thread to end: windows that wait, and those in the twin, are left to the next start."""
        self._stopping.set()
        self._inbox.close()
        self._kept.close()

    def end(self) -> None:
        """Ends the thread.

        Where that takes longer than a few seconds, its connection is still open, and only ends with the process: see
        `service.__main__.leave`.
        """
        self.stop()
        self.join(STOP_WAIT)

    def offer(self, topic: str, payload: bytes) -> bool:
        """Puts a frame that did not come over the network into the inbox; False where it had to be left out."""
        return self._inbox.offer(topic, payload)

    def look(self) -> None:
        """Looks now at what people have decided: somebody else has kept it."""
        self._inbox.wake()

    def not_ready(self) -> str | None:
        """Why no frames are accepted, or None."""
        late = "; ".join(map(str, self._health.late(READY)))
        return self._reason or self._lost() or self._storage.unusable or self._computing.unusable() or late or None

    def position(self, stream: str) -> PositionModel:
        """How far a stream is stored, as it was published last, and whether its frames are used now."""
        if self._positions is None:
            return not_connected(stream, self._reason)
        return self._positions.latest(stream)

    def _lost(self) -> str | None:
        return None if self._transport is None else self._transport.lost()

    def figures(self) -> dict[str, Any]:
        """Figures of the process for /metrics."""
        network = self._transport.counters() if self._transport else {}
        return {
            **stream_figures(self._inbox, network, self._streams, self._intake),
            "network_connected": float(self._reason is None and self._lost() is None),
            **storage_figures(self._storage, self._settings.data, self._spool),
            **lane_figures(self._lanes, self._reception),
            **self._computing.figures(),
            **(self._raw.figures() if self._raw else {}),
        }

    @contextmanager
    def _connection(self) -> Iterator[Transport]:
        """An open connection; one that is not reachable yet is tried again as long as it takes."""
        with ExitStack() as stack:
            while True:
                self._beat()
                self._supervised()  # nothing is computed yet
                try:
                    transport = stack.enter_context(self._open_transport())
                    break
                except NotReachable as error:
                    self._reason = str(error)
                if self._stopping.is_set():
                    raise Ended
            yield transport

    def _serve(self, transport: Transport) -> None:
        kept = self._kept
        publication = StatePublication(transport, kept.table)
        with (
            OfferedRigs(transport, kept.unknown).watching() as offered,
            transport.answer_states(publication),
            closing(self._computing),
        ):
            self._run(transport, publication, offered)

    def _run(self, transport: Transport, publication: StatePublication, offered: OfferedRigs) -> None:
        positions, streams, between = self._once_stored(partial(self._prepared, transport, publication, offered))
        with positions, transport.subscribe(self._inbox):
            self._reason = None
            assert self._lanes is not None
            self._lanes.go()
            pump(
                self._inbox, streams, self._stopping, self._settings.idle_timeout, between,
                channel_wait=self._settings.channel_wait, holding=self._holds,
                waits=positions.waits, asks=positions.asks, asset_of=streams.asset_of,
            )  # fmt: skip

    def _holds(self) -> bool:
        """Whether publishers are asked to wait or are cut off, so that their silence ends no window."""
        return self._storage.reason is not None or self._cut_off

    def _once_stored(self, prepare: Callable[[], T]) -> T:
        """What is made of stored results, as soon as the storage can be read; it is made anew after a failure."""
        while True:
            self._beat()
            self._supervised()
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
                self._supervised()

    def _prepared(
        self, transport: Transport, publication: StatePublication, offered: OfferedRigs
    ) -> tuple[Positions, Streams, Callable[[], None]]:
        """All that frames go through, as the last run left it: positions, streams, and what is done between frames."""
        kept, computing = self._kept, self._computing
        store, table, windows, storage, known = kept.store, kept.table, kept.windows, self._storage, kept.known

        def close(closed: ClosedWindow) -> None:
            closed.journey.received_ns = reception.last_arrival_ns(closed.asset) or 0
            spool.add(closed)

        reception = self._reception = self._receiving(offered, close)
        sink = Commits(store, table, publication, windows, signals=kept.signals, alarms=kept.alarms)
        lanes = self._lanes = Lanes(
            reception,
            sink,
            computing,
            twin_of=AssetTwins(self._twin, kept.baselines).of,
            new_state=lambda: NEW,
            asks=True,
            storage=storage,
            arrived=self._arrived,
            timed=self.timed,
        )
        lanes.forget = windows.drop_waiting
        spool = self._spool = Spool(windows, store, reception, lanes, storage, backlog_limits(self._settings))
        restore(lanes, store, windows, known)
        watch = StalenessWatch(table, sink, staleness_limits(self._settings))
        intake = self._intake = Intake(
            reception, lambda asset: self._show_quality(reception, asset), heard=watch.heard, storage=storage
        )
        streams = self._streams = Streams(kept.names, intake, self._is_retired, lambda: storage.unusable, kept.unknown)
        jobs, offers = kept.queue.jobs, Offers(store.database)
        offer_writer = OfferWriter(offers, jobs, kept.unknown, self._rigs)
        kept.unknown.begin(
            lambda stream: table.latest(streams.asset_of(stream)) is not None, (*table.known(), *streams.routed)
        )
        positions = self._positions = Positions(
            self._inbox,
            transport,
            streams,
            pending=lambda stream: _closed_windows(spool, lanes, streams.asset_of(stream), computing.unusable()),
            unknown=kept.unknown,
        )
        streams.moved = positions.moved
        first_frames = FirstFrames(reception, transport, self._inbox.ask, asset_of=streams.asset_of)
        streams.fed, streams.holds = first_frames.fed, first_frames.holds

        spool.settled = lambda asset: positions.moved(*streams.streams_of(asset))
        changes = Changes(jobs, windows, store, table, names=kept.names, baselines=kept.baselines, offers=offers)
        followed = StreamChanges(
            reception, lanes, store, table, publication,
            streams=streams, intake=intake, spool=spool,
        )  # fmt: skip
        requests = JobWorker(kept.queue, lanes, {**Decisions(store).kinds, **changes.kinds}, followed)
        questions = RigQuestions(reception, lanes, store, jobs, rigs=self._rigs, streams=streams, offered=offered)
        questions.start()
        intake.begins = questions.first_frame
        storage_status = StorageStatus(storage, table, publication)
        backlog = BacklogWatch(lanes, computing, table, publication)

        def between() -> None:
            self._look_at_link(transport)
            self._look_after(spool, lanes, storage_status, publication)
            positions()
            first_frames()
            backlog()
            for part in (questions, requests, watch, offer_writer):
                storage.attempt(part)
            if storage.reason is None:  # else what waits is kept first
                storage.attempt(table.write_noted)
            requests.tell()
            for asset in kept.alarms.changed_by_people() if kept.alarms else ():
                publication.publish(asset)

        return positions, streams, between

    def _receiving(self, offered: OfferedRigs, close: Callable[[ClosedWindow], None]) -> Reception:
        known = self._kept.known
        return Reception(
            lambda asset: self._rigs.of(asset, offered, known.get(asset)),
            close,
            noticed=self._noticed,
            assembly=replace(assembly_settings(self._settings), clocked=True),
            host_clock=later_time_ns,
            used=self._keep_raw,
        )

    def _noticed(self, asset: str, repeats: Repeats) -> None:
        """Frames of times that have passed have come, or others since."""
        lanes = self._lanes
        if lanes is not None:
            self._storage.attempt(lambda: lanes.look_for_repeats(asset, repeats))

    def _arrived(self, asset: str, index: int, grade: str, journey: Journey) -> None:
        """A window has been shown: one less waits."""
        self.arrived(asset, index, grade, journey)
        if self._positions is not None and self._streams is not None:
            self._positions.moved(*self._streams.streams_of(asset))

    def _look_at_link(self, transport: Transport) -> None:
        """From time to time: whether publishers can be heard."""
        now = time.monotonic()
        if now >= self._link_at:
            self._link_at, self._cut_off = now + TICK, transport.interrupted()

    def _look_after(
        self, spool: Spool, lanes: Lanes, storage_status: StorageStatus, publication: StatePublication
    ) -> None:
        """Takes what the twins have made, and tries the storage again where that is due."""
        self._beat()
        self._computing.collect()
        self._supervised()
        if self._storage.reason is not None and not self._storage.pausing:
            self._try_again(self._storage, spool, lanes)
        elif time.monotonic() >= self._look_at:  # nothing has to be kept while machines stand still
            self._look_at = time.monotonic() + LOOK
            self._storage.attempt(self._kept.windows.probe)
        if self._storage.lasts:
            self._kept.queue.release()
        storage_status()
        while lanes.stopped:
            asset, reason = lanes.stopped.pop()
            self._kept.table.note(asset, damaged=Stale(since_ns=later_time_ns(), reason=reason))
            publication.publish(asset)

    def _keep_raw(self, frame: Frame) -> None:
        if self._raw is not None:
            self._raw.offer(frame)

    def _try_again(self, storage: StorageWatch, spool: Spool, lanes: Lanes) -> None:
        """Keeps what has waited for the storage; a window's file is the last thing to fit on a disk that was full."""
        if spool.retry() and lanes.retry() and storage.attempt(self._kept.windows.probe)[0]:
            storage.worked()

    def _is_retired(self, asset: str) -> bool:
        snapshot = self._kept.table.latest(asset)
        return snapshot is not None and snapshot.retired is not None

    def _show_quality(self, reception: Reception, asset: str) -> None:
        last_frame_ns = reception.last_arrival_ns(asset)
        self._kept.table.note(asset, quality=reception.quality(asset), last_frame_ns=last_frame_ns)


def staleness_limits(settings: Settings) -> StalenessLimits:
    """How long an asset may be without a whole window, by the service's settings."""
    fruitless = max(settings.fruitless_after, WINDOWS_MISSED * settings.window_length)
    return StalenessLimits(silent=settings.stale_after, fruitless=fruitless)


def _closed_windows(spool: Spool, lanes: Lanes, asset: str, unassessed: str | None) -> ClosedWindows:
    lane = lanes.find(asset)
    return ClosedWindows(
        unstored_from_ns=spool.unstored_from_ns(asset),
        waiting=lanes.unprocessed(asset),
        shed=0 if lane is None else lane.shed,
        unassessed=unassessed,
    )


def backlog_limits(settings: Settings) -> BacklogLimits:
    """How much may wait to be processed, by the service's settings."""
    return BacklogLimits(
        windows=settings.backlog_windows,
        bytes=settings.backlog_bytes,
        total_windows=settings.backlog_total_windows,
        total_bytes=settings.backlog_total_bytes,
        memory_bytes=settings.backlog_memory_bytes,
    )


def restore(
    lanes: Lanes, store: SqlStore, windows: WindowJobs | None = None, known: dict[str, StoredAsset] | None = None
) -> None:
    """Goes on where the store's assets ended. What their twins remember is read when it is first needed.

    known  all assets of the store, where they have been read; it is empty afterwards: the table and the lanes go on
    """
    next_indices, waiting = store.next_indices(), {} if windows is None else windows.all_waiting()
    for stored in [*known.values()] if known else store.all_assets():
        asset = stored.asset
        entries = [] if windows is None else entries_of(windows, waiting.get(asset, ()))
        if stored.assembly is None and not stored.has_state:
            lanes.leave(asset, entries)
            continue
        checkpoint = Checkpoint(
            index=next_indices.get(asset, 0) - 1,
            state=NEW if not stored.has_state else StoredState(partial(_state_of, asset, store)),
            report=stored.report,
            assembly=stored.assembly,
            quality=stored.quality,
            making=stored.making or {},
            question=stored.question,
            shed=stored.fault_totals.get((*LEFT_OUT, "refused"), (0, 0))[1],
        )
        lanes.restore(asset, checkpoint, entries)
    if known:
        known.clear()


def _state_of(asset: str, store: SqlStore) -> Mapping[str, Any] | None:
    """What is stored of an asset's twin."""
    return store.asset(asset).state
