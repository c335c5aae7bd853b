"""A start while the server of the database is away: HTTP says so, and the service goes on as soon as it answers."""

from __future__ import annotations

import socket
import threading
from collections import Counter
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import TypeVar

from starlette.requests import Request
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Receive, Scope, Send

from service.api.headers import SafeHeaders
from service.api.limits import Bounds, Limits
from service.api.problems import problem
from service.errors import StorageUnavailable
from service.results.storage_faults import is_away
from service.runtime.http_gate import GatedSocket
from service.runtime.http_server import Front, HttpServer
from service.runtime.storage_watch import awaited

RETRY = {"Retry-After": "10"}
LOOK_EVERY = 1.0  # whether the server answers [s]

T = TypeVar("T")


def opened(
    open_store: Callable[[], AbstractContextManager[T]],
    listening: GatedSocket,
    *,
    front: Front,
    limits: Limits,
    tick: Callable[[], None],
    waits: Callable[[], object],
    stop: threading.Event | None = None,
) -> AbstractContextManager[T]:
    """The store, as soon as its server answers. StoppedWaiting where the service was told to end before.

    listening  where HTTP says meanwhile that the service waits, and why
    tick       called ten times a second while it waits
    waits      called once it answers so
    """
    try:
        return open_store()
    except StorageUnavailable as error:
        if not is_away(error):
            raise
        reason = str(error)
    ended = threading.Event()
    found: list[AbstractContextManager[T] | Exception] = []

    def attempts() -> None:
        try:
            found.append(awaited(open_store, ended, longest=LOOK_EVERY))
        except Exception as error:
            found.append(error)
        server.end()

    server = HttpServer(_saying(reason, limits), started=waits, ending=ended.set, stop=stop, front=front, tick=tick)
    thread = threading.Thread(target=attempts, name="storage", daemon=True)
    thread.start()
    own = GatedSocket(fileno=socket.dup(listening.fileno()))
    own.gate = listening.gate
    server.run(sockets=[own])
    thread.join()
    (outcome,) = found
    if isinstance(outcome, Exception):
        raise outcome
    return outcome


def _saying(reason: str, limits: Limits) -> ASGIApp:
    """An app that answers that the service waits; that the process lives is true all the same."""

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        request = Request(scope)
        alive = request.url.path == "/healthz"
        answer = (
            JSONResponse({"status": "ok"}) if alive else problem(request, 503, f"{reason}: it is waited for", RETRY)
        )
        await answer(scope, receive, send)

    return SafeHeaders(Bounds(app, limits, Counter()))
