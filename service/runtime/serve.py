"""The service: one process from frames to answers.

Zenoh's callbacks fill the inbox; one worker thread takes the frames through the pipeline to store, board and
Zenoh; HTTP is served in the main thread. A termination signal ends all of it within seconds: what is
committed stays, and what was in progress is taken up from the store by the next start.
"""

from __future__ import annotations

import fcntl
import logging
import signal
import socket
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import uvicorn
import zenoh

from service.api import create_app
from service.errors import FAULT, DeliveryError, InputError
from service.files.rig import checked_rig, load_mapping
from service.results.board import Board
from service.results.decision_queue import DecisionQueue
from service.results.store import Store
from service.runtime.live import Guard, LiveState, OfferedRigs
from service.runtime.pipeline import assembly_settings
from service.runtime.pump import pump
from service.runtime.served import Ended, ServedPipeline
from service.settings import Settings
from service.stream.inbox import Inbox
from service.stream.sources.zenoh import ZenohSource, open_session
from twin.baseline.learned import Baseline
from twin.errors import TwinError
from twin.levels.relation import Relation
from twin.rig import Rig

log = logging.getLogger(__name__)

DATABASE = "gear-twin.sqlite"
CONNECT_WAIT = 2.0  # how long one attempt to reach an external router takes [s]
STOP_WAIT = 5.0  # how long a window in the twin is waited for at the end [s]
HTTP_WAIT = 2  # how long open requests are waited for at the end [s]

Twin = tuple[Any, ...]
"""`step`, the class of its state with `to_dict` and `from_dict`, and `decide` where it takes decisions on effects."""


def run(
    settings: Settings,
    *,
    twin: Twin | None = None,
    announce: Callable[[str], None] = lambda address: print(f"gear-twin serves {address}", flush=True),
    stop: threading.Event | None = None,
) -> int:
    """Serves until a signal, or `stop`, ends it; the exit status.

    twin      its step and its state's class; None for the twin itself
    announce  called once with the page's address, when HTTP is served
    """
    rig = load_mapping(settings.rig) if settings.rig else None
    if rig is not None:
        checked_rig(rig, str(settings.rig))
    baseline = None
    if settings.baseline is not None:
        from service.files.baseline import read_baseline

        baseline = read_baseline(settings.baseline)
    relation = None
    if settings.relation is not None:
        from service.files.relation import read_relation

        relation = read_relation(settings.relation)
    with ExitStack() as stack:
        stack.enter_context(_only_service_of(settings.data))
        store = stack.enter_context(Store(settings.data / DATABASE))
        board = Board.from_store(store)
        listening = stack.enter_context(_listen(settings.http_host, settings.http_port))
        desk = DecisionQueue(store)
        worker = Worker(settings, store, board, desk, rig, twin or _twin(), baseline, relation)
        app = create_app(board, store, desk, not_ready=worker.not_ready, gauges=worker.gauges)
        server = _Server(app, board, worker, lambda: announce(_address(listening)), stop)
        worker.on_end = server.end
        worker.start()
        try:
            server.run(sockets=[listening])
        finally:
            worker.end()
    if worker.failure is not None:
        raise worker.failure
    return 0


class Worker(threading.Thread):
    """The thread that owns the Zenoh session and the pipeline."""

    def __init__(
        self,
        settings: Settings,
        store: Store,
        board: Board,
        desk: DecisionQueue,
        rig: Mapping[str, Any] | None,
        twin: Twin,
        baseline: Baseline | None = None,
        relation: Relation | None = None,
    ) -> None:
        super().__init__(name="twin", daemon=True)
        self._baseline, self._relation = baseline, relation
        self._settings, self._store, self._board, self._rig = settings, store, board, rig
        self._desk = desk
        self._step, self._new_state, *more = twin
        self._decide = more[0] if more else None
        self._inbox = Inbox(frames=settings.queue_frames, wait=settings.queue_wait, prefix=settings.prefix)
        self._stopping = threading.Event()
        self._reason: str | None = "not yet subscribed to the stream"
        self._source: ZenohSource | None = None
        self._faults = 0
        self._guard = Guard()
        self.on_end: Callable[[], None] = lambda: None
        self.failure: Exception | None = None

    def run(self) -> None:
        try:
            with self._session() as session:
                self._serve(session)
        except Ended:
            pass
        except Exception as error:
            self.failure = error
        finally:
            self._reason = "the stream's subscription has ended"
            self._desk.close()
            self.on_end()

    def stop(self) -> None:
        """Tells the thread to end after the window in work."""
        self._stopping.set()
        self._inbox.close()
        self._desk.close()

    def end(self) -> None:
        """Ends the thread; a window that takes longer than a few seconds is left to the next start.

        The thread's session is then still open, and only ends with the process: see `service.__main__.leave`.
        """
        self.stop()
        self.join(STOP_WAIT)

    def not_ready(self) -> str | None:
        """Why no frames are taken, or None."""
        return self._reason

    def gauges(self) -> dict[str, float]:
        """Figures of the process for /metrics."""
        return {
            "queue_frames": self._inbox.depth,
            "received_frames": self._inbox.received,
            "dropped_frames": self._inbox.dropped_frames,
            "missed_frames": self._source.missed if self._source else 0,
            "callback_errors": self._inbox.errors + self._guard.errors,
            "program_faults": self._faults,
        }

    @contextmanager
    def _session(self) -> Iterator[zenoh.Session]:
        """An open session; an external router is waited for as long as it takes."""
        listen, connect = self._settings.listen, self._settings.connect
        with ExitStack() as stack:
            while True:
                try:
                    session = stack.enter_context(open_session(listen, connect, CONNECT_WAIT))
                    break
                except DeliveryError as error:
                    if not connect:
                        raise
                    self._reason = str(error)
                if self._stopping.is_set():
                    raise Ended
            yield session

    def _serve(self, session: zenoh.Session) -> None:
        from twin.step import Options

        prefix = self._settings.prefix
        options = Options(
            update=self._settings.update,
            error_threshold=self._settings.error_threshold,
            trace=self._settings.trace,
            baseline=self._baseline,
            relation=self._relation,
        )
        with (
            OfferedRigs(session, prefix, self._guard) as offered,
            LiveState(session, self._board, prefix, self._guard) as live,
        ):
            pipeline = ServedPipeline(
                self._store,
                self._board,
                live,
                self._stopping,
                self._desk,
                lambda asset: self._rig_of(asset, offered),
                options,
                assembly=assembly_settings(self._settings),
                step=lambda *given: self._guarded(self._step, given),
                new_state=self._new_state,
                decide=None if self._decide is None else lambda *given: self._guarded(self._decide, given),
            )
            pipeline.restore_all(self._new_state.from_dict)
            self._source = ZenohSource(session, prefix)
            with self._source.subscribe(self._inbox):
                self._reason = None
                pump(self._inbox, pipeline, self._stopping, self._settings.idle_timeout)

    def _guarded(self, call: Callable[..., tuple[Any, Any]], given: tuple[Any, ...]) -> tuple[Any, Any]:
        """A call of the twin; a fault of the program costs the window or decision it was in and ends nothing else."""
        try:
            return call(*given)
        except TwinError:
            raise
        except Exception as error:
            self._faults += 1
            log.exception("a window or decision was refused for a fault of the program")
            raise TwinError(f"{FAULT}: {type(error).__name__}: {error}") from error

    def _rig_of(self, asset: str, offered: OfferedRigs) -> Rig:
        """The rig of an asset: as set, as stored, as offered on Zenoh, else one of which nothing is known."""
        stored = self._store.asset(asset).rig
        rig = self._rig or stored or offered.find(asset)
        if rig is None:
            log.warning("no rig file is known for %s: only what needs none will be available", asset)
            return Rig.from_mapping({})
        checked = checked_rig(rig, f"rig of {asset}")
        if rig != stored:
            self._store.keep_rig(asset, rig)
        self._board.update(asset, rig=rig)
        return checked


class _Server(uvicorn.Server):
    """Uvicorn that ends on SIGINT and SIGTERM without raising them again, open event streams included."""

    def __init__(
        self,
        app: Any,
        board: Board,
        worker: Worker,
        started: Callable[[], None],
        stop: threading.Event | None,
    ) -> None:
        config = uvicorn.Config(
            app, log_level="warning", access_log=False, timeout_graceful_shutdown=HTTP_WAIT, lifespan="off"
        )
        super().__init__(config)
        self._board, self._worker, self._announce, self._stop = board, worker, started, stop

    def end(self) -> None:
        self.should_exit = True

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        if not self.should_exit:
            self._announce()

    async def on_tick(self, counter: int) -> bool:
        if self._stop is not None and self._stop.is_set():
            self.should_exit = True
        return await super().on_tick(counter)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        self._worker.stop()
        self._board.close()
        await super().shutdown(sockets)

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        before = {s: signal.signal(s, self.handle_exit) for s in (signal.SIGINT, signal.SIGTERM)}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)


def _twin() -> Twin:
    """The twin itself, imported where it is first needed."""
    from twin.step import State, decide, step

    return step, State, decide


@contextmanager
def _only_service_of(data: Path) -> Iterator[None]:
    """Holds the data directory; InputError where another service has it."""
    try:
        data.mkdir(parents=True, exist_ok=True)
        held = (data / "service.lock").open("w")
    except OSError as error:
        raise InputError(f"{data}: cannot be the data directory: {error.strerror}") from None
    with held:
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InputError(f"{data}: another service has this data directory; give another") from None
        yield


@contextmanager
def _listen(host: str, port: int) -> Iterator[socket.socket]:
    """A bound socket; InputError where the address cannot be had. Port 0 takes any that is free."""
    listening = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_STREAM)
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind((host, port))
    except (OSError, OverflowError) as error:
        listening.close()
        what = (getattr(error, "strerror", None) or str(error)).lower()
        raise InputError(f"HTTP cannot be served at {host}:{port}: {what}") from None
    with listening:
        yield listening


def _address(listening: socket.socket) -> str:
    host, port = listening.getsockname()[:2]
    return f"http://[{host}]:{port}/" if ":" in host else f"http://{host}:{port}/"
