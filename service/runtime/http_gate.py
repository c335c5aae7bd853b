"""Connections of HTTP are bounded where they are accepted, so that they never use up descriptors that Zenoh needs.

A connection beyond the bounds is closed at once, before TLS, request or thread. Where descriptors run out all the same,
accepting pauses for a second at a time.
"""

from __future__ import annotations

import asyncio
import errno
import logging
import resource
import socket
import time
from collections import Counter
from collections.abc import Callable
from typing import Any

from limits import parse
from limits.storage import MemoryStorage
from limits.strategies import FixedWindowRateLimiter

from service.access.addresses import is_loopback, network

HANDSHAKE = 10.0  # how long a TLS handshake may take [s]
_PAUSE = 0.9  # after descriptors ran out; the event loop itself looks again after a second [s]
_AT_ONCE = 100  # connections that are refused in one turn of the event loop
_EXHAUSTED = frozenset({errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM})
_LINES = parse("6/minute")  # of one kind in the log
log = logging.getLogger(__name__)


class Gate:
    """Counts connections, together and by client. Clients of this computer share the whole alone: proxies are there."""

    def __init__(self, most: int, most_per_client: int) -> None:
        self.most, self.most_per_client = most, most_per_client
        self.open = 0
        self.refused = 0
        self._by_client: Counter[str] = Counter()
        self._quiet = Quiet(log)

    def enter(self, address: str) -> Callable[[], None] | None:
        """Admits a connection; answers what must be called at its end, or None where it is one too many."""
        client = network(address)
        if self.open >= self.most:
            self._refuse(address, f"{self.most} are open")
            return None
        if self._by_client[client] >= self.most_per_client and not is_loopback(address):
            self._refuse(address, f"it has {self.most_per_client}")
            return None
        self.open += 1
        self._by_client[client] += 1

        def leave() -> None:
            self.open -= 1
            self._by_client[client] -= 1
            if self._by_client[client] <= 0:
                del self._by_client[client]

        return leave

    def _refuse(self, address: str, why: str) -> None:
        self.refused += 1
        if not self._by_client[network(address)]:
            del self._by_client[network(address)]
        self._quiet.warning("connections", "a connection from %s was refused: %s", address, why)


class Quiet:
    """Writes at most a few lines a minute of each kind to the log."""

    def __init__(self, to: logging.Logger) -> None:
        self._to, self._limiter = to, FixedWindowRateLimiter(MemoryStorage())

    def warning(self, kind: str, message: str, *values: object) -> None:
        if self.allows(kind):
            self._to.warning(message, *values)

    def allows(self, kind: str) -> bool:
        return self._limiter.hit(_LINES, kind)


class _Connection(socket.socket):
    """An accepted connection that says when it is closed."""

    leave: Callable[[], None] | None = None

    def close(self) -> None:
        super().close()
        if self.leave is not None:
            leave, self.leave = self.leave, None
            leave()


class GatedSocket(socket.socket):
    """A listening socket whose connections pass a gate; None for no gate."""

    gate: Gate | None = None
    _paused_until = 0.0

    def accept(self) -> tuple[socket.socket, Any]:
        """The next connection that is admitted; BlockingIOError where there is none now."""
        if time.monotonic() < self._paused_until:
            raise BlockingIOError
        for _ in range(_AT_ONCE):
            try:
                accepted, address = super().accept()
            except OSError as error:
                if error.errno in _EXHAUSTED:  # the event loop is given this once, and pauses
                    self._paused_until = time.monotonic() + _PAUSE
                raise
            connection = _Connection(self.family, self.type, self.proto, fileno=accepted.detach())
            if self.gate is None:
                return connection, address
            connection.leave = self.gate.enter(address[0])
            if connection.leave is not None:
                return connection, address
            connection.close()
        raise BlockingIOError


class Loop(asyncio.SelectorEventLoop):
    """An event loop whose TLS handshakes end soon, and which logs errors of accepting a few times a minute only."""

    def __init__(self) -> None:
        super().__init__()
        quiet = Quiet(logging.getLogger("asyncio"))

        def handle(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
            if context.get("message", "").startswith("socket.accept()"):
                quiet.warning("accept", "no connection can be accepted: %s", context.get("exception"))
            elif quiet.allows(str(context.get("message"))):
                loop.default_exception_handler(context)

        self.set_exception_handler(handle)

    async def create_server(self, *arguments: Any, **given: Any) -> asyncio.Server:  # type: ignore[override]
        """Listens; TLS handshakes are given up after a few seconds."""
        if given.get("ssl") is not None:
            given.setdefault("ssl_handshake_timeout", HANDSHAKE)
        return await super().create_server(*arguments, **given)


def raise_descriptor_limit() -> int:
    """Raises this process's limit of descriptors as far as it may; answers the limit."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = min(hard, 65536) if hard != resource.RLIM_INFINITY else 65536
    if soft < most:
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))
        return most
    return soft


def connections_within(wanted: int, descriptors: int) -> int:
    """How many connections HTTP may have: at most half of the descriptors, the others are Zenoh's and the store's."""
    return max(8, min(wanted, descriptors // 2))
