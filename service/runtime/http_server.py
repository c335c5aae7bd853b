"""HTTP in the main thread: a bound socket, and a server that ends on a signal with open event streams."""

from __future__ import annotations

import asyncio
import logging
import signal
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import uvicorn

from service.errors import InputError
from service.runtime.http_gate import Gate, GatedSocket
from service.runtime.http_protocol import Times, bounded
from service.runtime.http_tls import Tls, context_of, load_certificate

TICK = 0.25  # how often the server looks whether it should end [s]
HTTP_WAIT = 2  # how long open requests are waited for at the end [s]
log = logging.getLogger(__name__)


class Front:
    """How HTTP is served: its gate, the time that clients have, and TLS; None for none.

    Raises InputError where certificate or key cannot be used.
    """

    def __init__(self, gate: Gate | None = None, times: Times | None = None, tls: Tls | None = None) -> None:
        self.gate, self.protocol, self.tls = gate, bounded(times or Times()), tls
        self.context = None if tls is None else context_of(tls)

    def renew(self) -> None:
        """Reads certificate and key again; the present ones stay where the new ones cannot be used."""
        if self.tls is None or self.context is None:
            return
        try:
            context_of(self.tls)
            load_certificate(self.context, self.tls)
        except InputError as error:
            log.error("the certificate stays as it was: %s", error)
        else:
            log.warning("certificate and key were read again: %s", self.tls.certificate)

    def figures(self) -> dict[str, float]:
        """Figures for the metrics."""
        gate = self.gate
        counted = {} if gate is None else {"http_connections": gate.open, "http_connections_refused": gate.refused}
        return {**counted, "http_slow_clients": self.protocol.slow}


class HttpServer(uvicorn.Server):
    """Uvicorn that ends on SIGINT and SIGTERM without raising them again, open event streams included.

    started  called once the server accepts requests
    ending   called at the end, before open requests are waited for
    stop     ends the server when set; None where only signals end it
    front    how HTTP is served
    tick     called every TICK seconds
    """

    def __init__(
        self,
        app: Any,
        *,
        started: Callable[[], object],
        ending: Callable[[], None],
        stop: threading.Event | None = None,
        front: Front | None = None,
        tick: Callable[[], None] = lambda: None,
    ) -> None:
        self.front, self._tick = front or Front(), tick
        config = uvicorn.Config(
            app,
            log_level="warning",
            log_config=None,
            access_log=False,
            timeout_graceful_shutdown=HTTP_WAIT,
            lifespan="off",
            http=self.front.protocol,
            ws="none",
            loop="service.runtime.http_gate:Loop",
            server_header=False,
        )
        config.load()
        config.ssl = self.front.context
        super().__init__(config)
        self._started, self._ending, self._stop = started, ending, stop

    def end(self) -> None:
        """Ends the server, from any thread."""
        self.should_exit = True

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Starts to accept requests."""
        await super().startup(sockets)
        if not self.should_exit:
            self._started()

    async def main_loop(self) -> None:
        """Looks from time to time whether the server should end."""
        while True:
            self._tick()
            if self._stop is not None and self._stop.is_set():
                self.should_exit = True
            if await self.on_tick(0):  # 0: the date of its answers is that of the turn
                return
            await asyncio.sleep(TICK)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Ends event streams, then waits for open requests."""
        self._ending()
        await super().shutdown(sockets)

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Ends the server on SIGINT and SIGTERM while inside."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        before = {s: signal.signal(s, self.handle_exit) for s in (signal.SIGINT, signal.SIGTERM)}
        before[signal.SIGHUP] = signal.signal(signal.SIGHUP, lambda *_: self.front.renew())
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)


@contextmanager
def listening_at(host: str, port: int, gate: Gate | None = None) -> Iterator[GatedSocket]:
    """A bound socket; InputError where the address cannot be had. Port 0 takes any that is free."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listening = GatedSocket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)  # asyncio sends at once where it says so
    listening.gate = gate
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind((host, port))
    except (OSError, OverflowError) as error:
        listening.close()
        what = (getattr(error, "strerror", None) or str(error)).lower()
        raise InputError(f"HTTP cannot be served at {host}:{port}: {what}") from None
    with listening:
        yield listening


def address_of(listening: socket.socket, front: Front | None = None) -> str:
    """The page's address at a bound socket."""
    host, port = listening.getsockname()[:2]
    scheme = "http" if front is None or front.tls is None else "https"
    return f"{scheme}://[{host}]:{port}/" if ":" in host else f"{scheme}://{host}:{port}/"
