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
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import uvicorn
import zenoh

from service.api import create_app
from service.board import Board
from service.errors import DeliveryError, InputError
from service.frames import Frame
from service.inbox import Inbox, pump
from service.jsontext import plain
from service.live import LiveState, OfferedRigs
from service.pipeline import Checkpoint, Outcome, Pipeline, assembly_settings
from service.rigfile import checked_rig, load_mapping
from service.settings import Settings
from service.sources.zenoh import ZenohSource, open_session
from service.store import Store
from service.wire.topics import Channel
from twin.errors import TwinError
from twin.rig import Rig

log = logging.getLogger(__name__)

DATABASE = "gear-twin.sqlite"
CONNECT_WAIT = 2.0  # how long one attempt to reach an external router takes [s]
LEARN_WAIT = 0.5  # how long a new asset's channels are awaited before its first window [s]
LEARN_BYTES = 64 * 2**20  # frames of a new asset held meanwhile, at most [bytes]
QUALITY_EVERY = 1.0  # how often counters are shown while frames come [s]
STOP_WAIT = 5.0  # how long a window in the twin is waited for at the end [s]
HTTP_WAIT = 2  # how long open requests are waited for at the end [s]

Twin = tuple[Callable[..., tuple[Any, Any]], Any]
"""`step`, and the class of its state with `to_dict` and `from_dict`."""


class _Ended(Exception):
    """The service ends: the windows that are whole but not taken in yet are left to the next start."""


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
    with ExitStack() as stack:
        stack.enter_context(_only_service_of(settings.data))
        store = stack.enter_context(Store(settings.data / DATABASE))
        board = Board.from_store(store)
        listening = stack.enter_context(_listen(settings.http_host, settings.http_port))
        worker = Worker(settings, store, board, rig, twin or _twin())
        app = create_app(board, store, not_ready=worker.not_ready, gauges=worker.gauges)
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
        self, settings: Settings, store: Store, board: Board, rig: Mapping[str, Any] | None, twin: Twin
    ) -> None:
        super().__init__(name="twin", daemon=True)
        self._settings, self._store, self._board, self._rig = settings, store, board, rig
        self._step, self._new_state = twin
        self._inbox = Inbox(frames=settings.queue_frames, wait=settings.queue_wait, prefix=settings.prefix)
        self._stopping = threading.Event()
        self._reason: str | None = "not yet subscribed to the stream"
        self._source: ZenohSource | None = None
        self._faults = 0
        self.on_end: Callable[[], None] = lambda: None
        self.failure: Exception | None = None

    def run(self) -> None:
        try:
            with self._session() as session:
                self._serve(session)
        except _Ended:
            pass
        except Exception as error:
            self.failure = error
        finally:
            self._reason = "the stream's subscription has ended"
            self.on_end()

    def stop(self) -> None:
        """Tells the thread to end after the window in work."""
        self._stopping.set()
        self._inbox.close()

    def end(self) -> None:
        """Ends the thread, at the latest after a few seconds."""
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
            "callback_errors": self._inbox.errors,
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
                    raise _Ended
            yield session

    def _serve(self, session: zenoh.Session) -> None:
        from twin.step import Options

        prefix = self._settings.prefix
        options = Options(update=self._settings.update, error_threshold=self._settings.error_threshold)
        with OfferedRigs(session, prefix) as offered, LiveState(session, self._board, prefix) as live:
            pipeline = ServedPipeline(
                self._store,
                self._board,
                live,
                self._stopping,
                lambda asset: self._rig_of(asset, offered),
                options,
                assembly=assembly_settings(self._settings),
                step=self._guarded_step,
                new_state=self._new_state,
            )
            pipeline.restore_all(self._new_state.from_dict)
            self._source = ZenohSource(session, prefix)
            with self._source.subscribe(self._inbox):
                self._reason = None
                pump(self._inbox, pipeline, self._stopping, self._settings.idle_timeout)

    def _guarded_step(self, *given: Any) -> tuple[Any, Any]:
        """The twin's step; a fault of the program costs the window it was in and ends nothing else."""
        try:
            return self._step(*given)
        except TwinError:
            raise
        except Exception as error:
            self._faults += 1
            log.exception("a window was refused for a fault of the program")
            raise TwinError(f"a fault of the program: {type(error).__name__}: {error}") from error

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


@dataclass(slots=True)
class _Held:
    """A new asset's frames while its channels are learned."""

    since: float
    frames: list[Frame] = field(default_factory=list)
    bytes: int = 0


class ServedPipeline(Pipeline):
    """The pipeline over store, board and Zenoh, with counters shown between windows."""

    def __init__(
        self,
        store: Store,
        board: Board,
        live: LiveState,
        ending: threading.Event,
        rig_lookup: Callable[[str], Rig],
        options: Any,
        **given: Any,
    ) -> None:
        super().__init__(rig_lookup, options, self._keep, self._show, **given)
        self._store, self._board, self._live, self._ending = store, board, live, ending
        self._shown: dict[str, float] = {}
        self._held: dict[str, _Held] = {}

    def restore_all(self, state_of: Callable[[Mapping[str, Any]], Any]) -> None:
        """Goes on where the store's assets ended."""
        for asset in self._store.assets():
            stored = self._store.asset(asset)
            if stored.state is None or stored.assembly is None or stored.quality is None:
                continue
            last = self._store.windows(asset)[-1].record
            self.restore(
                asset,
                Checkpoint(
                    index=last["index"],
                    state=state_of(stored.state),
                    report=stored.report,
                    assembly=stored.assembly,
                    quality=stored.quality,
                ),
            )

    def feed(self, frame: Frame) -> None:
        asset = frame.channel.asset
        if asset not in self._lines:
            self._line(asset)  # asks for the rig file now: who offers it may be gone later
            self._held[asset] = _Held(time.monotonic())
        if asset not in self._held:
            super().feed(frame)
        elif not self._hold(frame):
            return
        if time.monotonic() - self._shown.get(asset, 0.0) > QUALITY_EVERY:
            self._show_quality(asset)

    def reject(self, channel: Channel, error: Any) -> None:
        super().reject(channel, error)
        self._show_quality(channel.asset)

    def flush(self, asset: str | None = None) -> None:
        for name in list(self._held) if asset is None else [asset]:
            if name in self._held:
                self._release(name)
        super().flush(asset)

    def waiting(self, asset: str) -> bool:
        if asset in self._held:
            return True
        # Asked when a stream is silent: the last frames' counters are due.
        if asset in self._shown and self._shown[asset] > 0 and not super().waiting(asset):
            self._show_quality(asset)
            self._shown[asset] = 0.0
        return super().waiting(asset)

    def _hold(self, frame: Frame) -> bool:
        """Holds a new asset's frame, since keys start at different times; whether all held are let go."""
        asset = frame.channel.asset
        held = self._held[asset]
        held.frames.append(frame)
        held.bytes += frame.nbytes
        if time.monotonic() - held.since < LEARN_WAIT and held.bytes < LEARN_BYTES:
            return False
        self._release(asset)
        return True

    def _release(self, asset: str) -> None:
        """Takes in the frames held for a new asset, whose channels are known now."""
        held = self._held.pop(asset)
        self._line(asset).assembler.expect({frame.channel.label for frame in held.frames})
        for frame in held.frames:
            super().feed(frame)

    def _take(self, *given: Any) -> None:
        if self._ending.is_set():
            raise _Ended
        super()._take(*given)

    def _keep(self, outcome: Outcome) -> None:
        self._committed = self._store.commit(
            outcome.asset,
            outcome.window.start_time_ns,
            record=outcome.record,
            state=outcome.state.to_dict(),
            report=outcome.report,
            assembly=outcome.assembly,
            quality=outcome.quality,
            events=outcome.events,
        )

    def _show(self, outcome: Outcome) -> None:
        if self._committed is None:
            log.error("%s: window %s was committed before", outcome.asset, outcome.record["start_time"])
            return
        self._board.add_window(
            outcome.asset,
            self._committed,
            report=None if outcome.report is None else plain(outcome.report),
            quality=outcome.quality,
            last_event_id=self._store.last_event_id(outcome.asset),
        )
        self._live.publish(outcome.asset)

    def _show_quality(self, asset: str) -> None:
        self._shown[asset] = time.monotonic()
        self._board.update(asset, quality=self.quality(asset))


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
    from twin.step import State, step

    return step, State


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
