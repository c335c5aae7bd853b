"""HTTP/1.1 that waits for no slow client: headers, body and the reading of answers have their time.

headers  from the connection, or the end of the answer before
body     a fixed time, and more for a body that is announced to be large
answer   how long a client may read nothing of what it was sent
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from typing import Any, ClassVar

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

from service.runtime.http_tls import subject_of


@dataclass(frozen=True, slots=True, kw_only=True)
class Times:
    """How long a client may take [s]."""

    headers: float = 10.0
    body: float = 30.0
    body_rate: float = 100_000.0  # of a large body, at least [bytes/s]
    answer: float = 60.0
    linger: float = 2.0  # to read an answer that was given before the body had come


class BoundedProtocol(H11Protocol):
    """Uvicorn's protocol with a time for each part of a request."""

    times: ClassVar[Times] = Times()
    slow: ClassVar[int] = 0  # connections that were closed for being slow

    def __init__(self, *arguments: Any, **given: Any) -> None:
        super().__init__(*arguments, **given)
        self._part: tuple[str, int, bool] | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._stall: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """A connection begins."""
        super().connection_made(transport)
        subject = subject_of(transport.get_extra_info("peercert"))
        if subject is not None:
            self.app_state = {**self.app_state, "certificate": subject}
        self._watch()

    def data_received(self, data: bytes) -> None:
        """Part of a request."""
        super().data_received(data)
        self._watch()

    def on_response_complete(self) -> None:
        """An answer is written."""
        super().on_response_complete()
        self._watch()

    def connection_lost(self, exc: Exception | None) -> None:
        """The connection is over."""
        self._cancel()
        if self._stall is not None:
            self._stall.cancel()
        super().connection_lost(exc)

    def pause_writing(self) -> None:
        """The client reads more slowly than it is written to."""
        super().pause_writing()
        self._stall = self.loop.call_later(self.times.answer, self._too_slow)

    def resume_writing(self) -> None:
        """The client has read again."""
        super().resume_writing()
        if self._stall is not None:
            self._stall.cancel()
            self._stall = None

    def _watch(self) -> None:
        """Gives the part of the request that is awaited its time."""
        answered = self.cycle is not None and self.cycle.response_complete
        if self.conn.their_state is h11.IDLE:
            part, time = ("headers", id(self.cycle), False), self.times.headers
        elif self.conn.their_state is h11.SEND_BODY:
            part = ("body", id(self.cycle), answered)
            time = self.times.linger if answered else self._body_time()
        else:
            self._cancel()
            return
        if answered and self.conn.their_state is h11.SEND_BODY:
            self.flow.pause_reading()  # the rest of a body that nobody wants
        if part != self._part:
            self._cancel()
            self._part, self._timer = part, self.loop.call_later(time, self._too_slow)

    def _body_time(self) -> float:
        announced = next((value for name, value in self.headers or () if name == b"content-length"), b"0")
        return self.times.body + int(announced) / self.times.body_rate

    def _cancel(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._part = self._timer = None

    def _too_slow(self) -> None:
        type(self).slow += 1
        if self.conn.our_state in (h11.IDLE, h11.SEND_RESPONSE) and not self.transport.is_closing():
            if self.cycle is not None:
                self.cycle.disconnected = True
            headers = [(b"connection", b"close"), (b"content-length", b"0")]
            self.transport.write(self.conn.send(h11.Response(status_code=408, headers=headers)) or b"")
            self.transport.close()
        else:
            self.transport.abort()


def bounded(times: Times) -> type[BoundedProtocol]:
    """The protocol with these times, and a count of its own."""
    return type("Protocol", (BoundedProtocol,), {"times": times, "slow": 0})
