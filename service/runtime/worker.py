"""The thread that owns the network's connection: it receives frames, and commits and publishes what windows led to."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, replace

from service.alarms.keeper import AlarmKeeper
from service.errors import NotReachable, StoreError
from service.results.asset_life import AssetLife
from service.results.baseline_store import BaselineStore
from service.results.board import Board
from service.results.change_queue import ChangeQueue
from service.results.decision_queue import DecisionQueue
from service.results.signal_store import SignalStore
from service.results.store import ResultStore
from service.runtime.asset_twins import AssetTwins
from service.runtime.changes import ChangeWorker
from service.runtime.computing_threads import Threads
from service.runtime.decisions import DecisionWorker
from service.runtime.intake import Intake
from service.runtime.lanes import Lanes
from service.runtime.outcomes import Checkpoint, ClosedWindow
from service.runtime.pump import pump
from service.runtime.reception import Reception, assembly_settings
from service.runtime.rig_questions import RigQuestions
from service.runtime.rigs import OfferedRigs, Rigs
from service.runtime.service_sink import ServiceSink
from service.runtime.signal_writer import SignalWriter
from service.runtime.spool import Spool
from service.runtime.staleness import WINDOWS_MISSED, StalenessLimits, StalenessWatch
from service.runtime.state_publication import StatePublication
from service.runtime.streams import Streams
from service.runtime.twin_port import Twin, guarded
from service.runtime.waiting_windows import WaitingWindows
from service.settings import Settings
from service.stream.inbox import Inbox
from service.stream.repeats import Repeats
from service.transport.protocol import OpenTransport, Transport
from twin.errors import TwinError

STOP_WAIT = 5.0  # how long a window in the twin is waited for at the end [s]


@dataclass(frozen=True, slots=True, kw_only=True)
class Kept:
    """Where results are kept and shown, and what waits to be carried out."""

    store: ResultStore
    board: Board
    decisions: DecisionQueue
    life: AssetLife
    changes: ChangeQueue
    baselines: BaselineStore
    signals: SignalStore | None = None
    alarms: AlarmKeeper | None = None

    def close(self) -> None:
        """Releases everyone who waits for a decision or a change."""
        self.decisions.close()
        self.changes.close()


class Ended(Exception):
    """The service ends before there is a connection."""


class Worker(threading.Thread):
    """From the connection to the results, until stopped.

    on_end   called when the thread ends, for whatever reason
    failure  the exception that ended it; None where it was stopped
    """

    def __init__(
        self,
        settings: Settings,
        kept: Kept,
        rigs: Rigs,
        twin: Twin,
        open_transport: OpenTransport,
        signals: SignalWriter | None = None,
    ) -> None:
        self._signals = signals
        super().__init__(name="twin", daemon=True)
        self._settings, self._kept = settings, kept
        self._rigs, self._twin, self._open_transport = rigs, guarded(twin, self._count_fault), open_transport
        self._inbox = Inbox(
            frames=settings.queue_frames,
            max_bytes=settings.queue_bytes,
            wait=settings.queue_wait,
            prefix=settings.prefix,
        )
        self._stopping = threading.Event()
        self._reason: str | None = "not yet subscribed to the stream"
        self._transport: Transport | None = None
        self._faults = 0
        self.on_end: Callable[[], None] = lambda: None
        self.failure: Exception | None = None

    def run(self) -> None:
        """Works until stopped."""
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

    def not_ready(self) -> str | None:
        """Why no frames are accepted, or None."""
        return self._reason

    def gauges(self) -> dict[str, float]:
        """Figures of the process for /metrics."""
        network = self._transport.counters() if self._transport else {}
        return {
            "queue_frames": self._inbox.depth,
            "received_frames": self._inbox.received,
            "dropped_frames": self._inbox.dropped_frames,
            "missed_frames": network.get("missed_frames", 0),
            "callback_errors": self._inbox.errors + network.get("callback_errors", 0),
            "program_faults": self._faults,
            **(self._signals.gauges() if self._signals else {}),
        }

    @contextmanager
    def _connection(self) -> Iterator[Transport]:
        """An open connection; one that is not reachable yet is tried again as long as it takes."""
        with ExitStack() as stack:
            while True:
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
        publication = StatePublication(transport, kept.board)
        computing = Threads(self._twin.at_once, self._inbox.wake)
        with (
            OfferedRigs(transport).watching() as offered,
            transport.answer_states(publication),
            closing(computing),
        ):
            self._run(transport, publication, offered, computing)

    def _run(
        self, transport: Transport, publication: StatePublication, offered: OfferedRigs, computing: Threads
    ) -> None:
        kept = self._kept
        store, board, life = kept.store, kept.board, kept.life
        spool = Spool(life, store)

        def close(closed: ClosedWindow) -> None:
            spool.add(closed, reception, lanes)

        def noticed(asset: str, repeats: Repeats) -> None:
            lanes.look_for_repeats(asset, repeats)

        reception = Reception(
            lambda asset: self._rigs.of(asset, offered),
            close,
            noticed=noticed,
            assembly=replace(assembly_settings(self._settings), clocked=True),
            host_clock=time.time_ns,
        )
        lanes = Lanes(
            reception,
            ServiceSink(store, board, publication, life, signals=self._signals, alarms=kept.alarms),
            computing,
            twin_of=AssetTwins(self._twin, kept.baselines).of,
            new_state=self._twin.new_state,
            waiting=WaitingWindows(store, life, board, publication),
        )
        restore(lanes, store, self._twin, spool)
        watch = StalenessWatch(store, board, publication, staleness_limits(self._settings), alarms=kept.alarms)
        intake = Intake(reception, lambda asset: self._show_quality(reception, asset), heard=watch.heard)
        streams = Streams(life, intake, self._is_retired)
        decisions = DecisionWorker(kept.decisions, reception, lanes, store, board, publication, kept.alarms)
        changes = ChangeWorker(
            kept.changes, reception, lanes, store, life, board, publication,
            streams=streams, intake=intake, signals=kept.signals, alarms=kept.alarms, baselines=kept.baselines,
        )  # fmt: skip
        questions = RigQuestions(reception, lanes, store, life, rigs=self._rigs, streams=streams, offered=offered)
        questions.start()

        def between() -> None:
            computing.collect()
            questions()
            decisions()
            changes()
            watch()
            for asset in kept.alarms.changed_by_people() if kept.alarms else ():
                publication.publish(asset)

        with transport.subscribe(self._inbox):
            self._reason = None
            lanes.go()
            pump(
                self._inbox, streams, self._stopping, self._settings.idle_timeout, between,
                channel_wait=self._settings.channel_wait,
            )  # fmt: skip

    def _is_retired(self, asset: str) -> bool:
        snapshot = self._kept.board.get(asset)
        return snapshot is not None and snapshot.retired is not None

    def _show_quality(self, reception: Reception, asset: str) -> None:
        last_frame_ns = reception.freshness(asset).last_arrival_ns
        self._kept.board.update(asset, quality=reception.quality(asset), last_frame_ns=last_frame_ns)

    def _count_fault(self) -> None:
        self._faults += 1


def staleness_limits(settings: Settings) -> StalenessLimits:
    """How long an asset may be without a whole window, by the service's settings."""
    fruitless = max(settings.fruitless_after, WINDOWS_MISSED * settings.window_length)
    return StalenessLimits(silent=settings.stale_after, fruitless=fruitless)


def restore(lanes: Lanes, store: ResultStore, twin: Twin, spool: Spool | None = None) -> None:
    """Goes on where the store's assets ended; StoreError where a state cannot be read."""
    for asset in store.assets():
        stored = store.asset(asset)
        entries = [] if spool is None else spool.waiting(asset)
        if stored.assembly is None or stored.quality is None:
            lanes.leave(asset, entries)
            continue
        try:
            state = twin.new_state() if stored.state is None else twin.load_state(stored.state)
        except (TwinError, LookupError, TypeError, ValueError) as error:
            raise StoreError(
                f"the stored state of {asset} cannot be read ({type(error).__name__}: {error}): it was written by "
                "another version of gear-twin; use that version, or another --data directory"
            ) from error
        checkpoint = Checkpoint(
            index=store.next_index(asset) - 1,
            state=state,
            report=stored.report,
            assembly=stored.assembly,
            quality=stored.quality,
            question=stored.question,
        )
        lanes.restore(asset, checkpoint, entries)
