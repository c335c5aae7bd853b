"""The thread that owns the network's connection: it makes windows of frames, and shows what they lead to."""

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
from service.operation.journey import Arrived, nobody
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
from service.runtime.backlog_watch import BacklogWatch
from service.runtime.backlogs import Backlogs
from service.runtime.carried_out import CarriedOut
from service.runtime.commits import Commits
from service.runtime.computing_here import ComputingOf, computing_here
from service.runtime.first_frames import FirstFrames
from service.runtime.intake import Intake
from service.runtime.offer_writer import OfferWriter
from service.runtime.outcomes import ClosedWindow, Outcome
from service.runtime.positions import ClosedWindows, Positions
from service.runtime.pump import pump
from service.runtime.raw_recorder import RawRecorder
from service.runtime.reception import Reception, assembly_settings
from service.runtime.rigs import OfferedRigs, Rigs
from service.runtime.spool import BacklogLimits, Spool
from service.runtime.staleness import WINDOWS_MISSED, StalenessLimits, StalenessWatch
from service.runtime.state_publication import StatePublication
from service.runtime.storage_status import StorageStatus
from service.runtime.storage_watch import StorageWatch
from service.runtime.stream_changes import StreamChanges
from service.runtime.stream_questions import StreamQuestions
from service.runtime.streams import Streams
from service.runtime.turns import Turns
from service.runtime.twin_port import Twin, guarded
from service.runtime.work import Work
from service.runtime.worker_figures import shed_of, storage_figures, stream_figures, waiting_figures
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
        self._here = Work(
            kept.store, kept.table, self._twin,
            windows=kept.windows, names=kept.names, baselines=kept.baselines, signals=kept.signals, alarms=kept.alarms,
        )  # fmt: skip
        self._computing = computing_of(settings, self._twin, self._here.turn, self._inbox.wake)
        self._turns: Turns | None = None
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
        self._here.ended.set()
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
            **waiting_figures(self._kept.table, self._turns, self._backlogs, self._reception),
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
            self._go_on()
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
        store, table, windows, storage = kept.store, kept.table, kept.windows, self._storage
        commits = Commits(store, table, windows, alarms=kept.alarms)
        backlogs = self._backlogs = Backlogs(windows)

        def close(closed: ClosedWindow) -> None:
            closed.journey.received_ns = reception.last_arrival_ns(closed.asset) or 0
            spool.add(closed)

        def settled(asset: str) -> None:
            self._show_quality(reception, asset)
            positions.moved(*streams.streams_of(asset))
            turns.wake(asset)

        def keep(outcome: Outcome) -> None:
            commits.commit(outcome)
            publication.publish(outcome.asset)
            turns.wake(outcome.asset)

        reception = self._reception = self._receiving(offered, close)
        turns = self._turns = Turns(computing, storage, lambda turned: carried_out(turned), self.timed)
        spool = self._spool = Spool(
            windows, store, reception, backlogs, storage, backlog_limits(self._settings),
            settled=settled, at_work=turns.at_work,
        )  # fmt: skip
        restore(reception, spool, store, kept.known)
        watch = StalenessWatch(table, keep, staleness_limits(self._settings))
        intake = self._intake = Intake(
            reception, lambda asset: self._show_quality(reception, asset), heard=watch.heard, storage=storage
        )
        streams = self._streams = Streams(kept.names, intake, self._is_retired, lambda: storage.unusable, kept.unknown)
        offer_writer = OfferWriter(Offers(store.database), kept.queue.jobs, kept.unknown, self._rigs)
        kept.unknown.begin(
            lambda stream: table.latest(streams.asset_of(stream)) is not None, (*table.known(), *streams.routed)
        )
        positions = self._positions = Positions(
            self._inbox, transport, streams, unknown=kept.unknown,
            pending=lambda stream: self._closed_windows(spool, streams.asset_of(stream)),
        )  # fmt: skip
        streams.moved = positions.moved
        first_frames = FirstFrames(reception, transport, self._inbox.ask, asset_of=streams.asset_of)
        streams.fed, streams.holds = first_frames.fed, first_frames.holds
        followed = StreamChanges(
            reception, store, table, publication,
            streams=streams, intake=intake, spool=spool, turns=turns,
        )  # fmt: skip
        questions = self._questions = StreamQuestions(
            reception, table, store, kept.queue.jobs, keep, rigs=self._rigs, streams=streams, offered=offered
        )
        questions.start()
        intake.begins = questions.first_frame
        backlog = BacklogWatch(backlogs, computing, table, publication)
        storage_status = StorageStatus(storage, table, publication)
        carried_out = CarriedOut(
            table, kept.queue, publication, backlogs, spool, storage,
            streams=streams, positions=positions, followed=followed, arrived=self.arrived, alarms=kept.alarms,
        )  # fmt: skip

        def between() -> None:
            self._look_at_link(transport)
            storage.attempt(carried_out.follow)  # what could not be followed at once: before a turn is begun again
            self._look_after(spool, turns, storage_status, publication)
            for part in (self._look_at_jobs, backlogs):
                storage.attempt(part)
            positions()
            first_frames()
            backlog()
            for part in (questions, watch, offer_writer):
                storage.attempt(part)
            if storage.reason is None:  # else what waits is kept first
                storage.attempt(table.write_noted)
            carried_out.tell()
            for asset in kept.alarms.changed_by_people() if kept.alarms else ():
                publication.publish(asset)

        return positions, streams, between

    def _go_on(self) -> None:
        """Goes on with what an earlier run has left."""
        assert self._turns is not None and self._backlogs is not None
        self._kept.queue.asked.set()
        if self._storage.attempt(self._backlogs)[0]:
            self._turns.wake(*self._backlogs.all)

    def _look_at_jobs(self) -> None:
        """What people have asked since is carried out."""
        if self._kept.queue.asked.is_set() and self._turns is not None:
            self._turns.wake(*self._kept.queue.assets())

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
        questions = self._questions
        if questions is not None:
            self._storage.attempt(lambda: questions.look_for_repeats(asset, repeats))

    def _look_at_link(self, transport: Transport) -> None:
        """From time to time: whether publishers can be heard."""
        now = time.monotonic()
        if now >= self._link_at:
            self._link_at, self._cut_off = now + TICK, transport.interrupted()

    def _look_after(
        self, spool: Spool, turns: Turns, storage_status: StorageStatus, publication: StatePublication
    ) -> None:
        """Takes what has been carried out, and tries the storage again where that is due."""
        self._beat()
        self._computing.collect()
        self._supervised()
        if self._storage.reason is not None and not self._storage.pausing:
            self._try_again(self._storage, spool, turns)
        elif time.monotonic() >= self._look_at:  # nothing has to be kept while machines stand still
            self._look_at = time.monotonic() + LOOK
            self._storage.attempt(self._kept.windows.probe)
        if self._storage.lasts:
            self._kept.queue.release()
        storage_status()
        while turns.stopped:
            asset, reason = turns.stopped.pop()
            self._kept.table.note(asset, damaged=Stale(since_ns=later_time_ns(), reason=reason))
            publication.publish(asset)

    def _keep_raw(self, frame: Frame) -> None:
        if self._raw is not None:
            self._raw.offer(frame)

    def _try_again(self, storage: StorageWatch, spool: Spool, turns: Turns) -> None:
        """Keeps what has waited for the storage; a window's file is the last thing to fit on a disk that was full."""
        if spool.retry() and turns.retry() and storage.attempt(self._kept.windows.probe)[0]:
            storage.worked()

    def _closed_windows(self, spool: Spool, asset: str) -> ClosedWindows:
        assert self._backlogs is not None
        return ClosedWindows(
            unstored_from_ns=spool.unstored_from_ns(asset),
            waiting=self._backlogs.of(asset).windows,
            shed=shed_of(self._kept.table, asset),
            unassessed=self._computing.unusable(),
        )

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


def backlog_limits(settings: Settings) -> BacklogLimits:
    """How much may wait to be processed, by the service's settings."""
    return BacklogLimits(
        windows=settings.backlog_windows,
        bytes=settings.backlog_bytes,
        total_windows=settings.backlog_total_windows,
        total_bytes=settings.backlog_total_bytes,
        memory_bytes=settings.backlog_memory_bytes,
    )


def restore(reception: Reception, spool: Spool, store: SqlStore, known: dict[str, StoredAsset]) -> None:
    """Goes on where the streams of the store's assets ended.

    known  all assets of the store, as they have been read; empty afterwards
    """
    for stored in [*known.values()] or store.all_assets():
        if stored.assembly:
            reception.resume(stored.asset, stored.assembly, stored.quality or {})
            spool.goes_on(stored.asset, stored.assembly)
    known.clear()
