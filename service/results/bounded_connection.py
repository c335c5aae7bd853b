"""Connections to PostgreSQL that are given up where the server takes longer than it may, however alive its host is.

A process that is suspended keeps its sockets: neither the server's own limit of a statement nor those of TCP end a
wait for it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator
from functools import cache
from typing import Any


@cache
def connecting(seconds: float) -> Callable[..., Any]:
    """What connects, so that no answer is waited for longer than this: a lost connection, where one takes longer."""
    import psycopg  # services with SQLite do not have it

    class Bounded(psycopg.Connection[Any]):
        def wait(self, gen: Any, *given: Any, **named: Any) -> Any:
            return super().wait(self._within(gen), *given, **named)

        def _within(self, gen: Any) -> Generator[Any, Any, Any]:
            """As a generator of the driver, which is told at least ten times a second that nothing has come."""
            end, ready = time.monotonic() + seconds, None
            while True:
                try:
                    wanted = gen.send(ready)
                except StopIteration as ended:
                    return ended.value
                ready = yield wanted
                if time.monotonic() > end:
                    self.close()
                    raise psycopg.OperationalError(f"the server has not answered for {seconds:g} s")

    def connect(dialect: Any, record: Any, given: Any, named: Any) -> Any:
        return Bounded.connect(*given, **named)

    return connect
