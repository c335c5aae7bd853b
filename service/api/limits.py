"""What one client may ask of the service: under which name, how often, how much at once. Checked before anything else.

- The Host header names the service: an address, `localhost`, this computer's name, or one of the settings. A page that
  had its own name resolved to this service's address (DNS rebinding) is refused.
- Requests are limited by client and minute, and so are those in progress and event streams. Clients of this computer
  are not limited: proxies are there, which name the true client.
- Compressed bodies are refused: nothing is unpacked for a client.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fnmatch import fnmatch
from ipaddress import ip_address
from socket import gethostname
from typing import Any

from fastapi import Request
from limits import RateLimitItemPerMinute
from limits.storage import MemoryStorage
from limits.strategies import FixedWindowRateLimiter
from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.access.addresses import is_loopback, network
from service.api.problems import MEDIA_TYPE, problem

BODY = 64 * 1024  # of a request, where its route does not say otherwise [bytes]
LONGEST_TARGET = 4096  # of path and query [characters]
LARGEST_HEADERS = 16 * 1024  # of a request [bytes]
RETRY = 5  # after so long a refused request may be sent again [s]


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Limits of one service.

    hosts               names besides addresses and this computer's own; None: the Host header is not checked
    per_minute          requests of a client in a minute
    in_progress         requests of a client at once
    streams             event streams together
    streams_per_client  event streams of a client
    """

    hosts: tuple[str, ...] | None = None
    per_minute: int = 3000
    in_progress: int = 20
    streams: int = 256
    streams_per_client: int = 32


class Bounds:
    """The middleware; counts what it refuses."""

    def __init__(self, app: ASGIApp, limits: Limits, counts: Counter[str]) -> None:
        self._app, self._limits, self._counts = app, limits, counts
        self._rate = RateLimitItemPerMinute(limits.per_minute)
        self._limiter = FixedWindowRateLimiter(MemoryStorage())
        self._running: Counter[str] = Counter()
        self._streams: Counter[str] = Counter()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        refusal = self._refusal(scope, headers) or self._too_many(scope)
        if refusal is not None:
            status, detail = refusal
            self._counts[str(status)] += 1
            retry = {"Retry-After": str(RETRY)} if status in (429, 503) else {}
            await problem(Request(scope), status, detail, {"Connection": "close", **retry})(scope, receive, send)
            return
        with self._counted(scope):
            await self._app(scope, receive, _with_problem(scope, receive, send))

    def _refusal(self, scope: Scope, headers: Headers) -> tuple[int, str] | None:
        if len(scope["path"]) + len(scope["query_string"]) > LONGEST_TARGET:
            scope["path"] = "/"  # it is not repeated in the answer
            return 414, f"the address is longer than {LONGEST_TARGET} characters"
        if sum(len(name) + len(value) for name, value in scope["headers"]) > LARGEST_HEADERS:
            return 431, f"the headers are larger than {LARGEST_HEADERS} bytes"
        if self._limits.hosts is not None and not _is_ours(headers.get("host", ""), self._limits.hosts):
            host = headers.get("host", "")[:100]
            return 421, f"this service is not called {host!r}; [http] hosts lists the names that it answers to"
        if headers.get("content-encoding", "identity").lower() != "identity":
            return 415, "a compressed body is not accepted; send it as it is"
        return None

    def _too_many(self, scope: Scope) -> tuple[int, str] | None:
        client = _client(scope)
        if client is None:
            return None
        limits = self._limits
        if not self._limiter.hit(self._rate, client):
            return 429, f"more than {limits.per_minute} requests in a minute from one address"
        if _is_stream(scope):
            if sum(self._streams.values()) >= limits.streams:
                return 503, f"{limits.streams} event streams are open already"
            if self._streams[client] >= limits.streams_per_client:
                return 429, f"{limits.streams_per_client} event streams are open from this address already"
        elif self._running[client] >= limits.in_progress:
            return 429, f"{limits.in_progress} requests from this address are in progress already"
        return None

    @contextmanager
    def _counted(self, scope: Scope) -> Iterator[None]:
        client = _client(scope)
        if client is None:
            yield
            return
        running = self._streams if _is_stream(scope) else self._running
        running[client] += 1
        try:
            yield
        finally:
            running[client] -= 1
            if running[client] <= 0:
                del running[client]


def _with_problem(scope: Scope, receive: Receive, send: Send) -> Send:
    """Passes messages on, and a plain refusal of a large body as a problem."""
    refused = False

    async def passed(message: Message) -> None:
        nonlocal refused
        if message["type"] == "http.response.start" and message["status"] == 413:
            refused = not Headers(raw=message["headers"]).get("content-type", "").startswith(MEDIA_TYPE)
            if refused:
                detail = "the body is larger than this call accepts"
                await problem(Request(scope), 413, detail, {"Connection": "close"})(scope, receive, send)
        if not refused:
            await send(message)

    return passed


def _client(scope: Scope) -> str | None:
    """Whom requests are counted for; None for clients of this computer."""
    client: Any = scope.get("client")
    return None if client is None or is_loopback(client[0]) else network(client[0])


def _is_stream(scope: Scope) -> bool:
    return str(scope["path"]).endswith("/events")


def _is_ours(host: str, names: tuple[str, ...]) -> bool:
    name = (host[: host.index("]") + 1] if host.startswith("[") and "]" in host else host.partition(":")[0]).lower()
    try:
        ip_address(name.strip("[]"))
        return True  # an address is nobody's name
    except ValueError:
        own = ("localhost", gethostname().lower(), *(known.lower() for known in names))
        return bool(name) and any(fnmatch(name.rstrip("."), known) for known in own)
