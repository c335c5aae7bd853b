"""The engine as `gear-twin fleet up` asks it: in a process of its own.

What is asked of Ray waits for its head, and Ray ends the whole process where that has not been reached for a minute.
That process is this one: it is ended as soon as the head is known to be gone, and `fleet up` starts everything anew.
"""

from __future__ import annotations

import multiprocessing
import signal
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from service.errors import DeliveryError
from service.fleet.engine_nodes import EngineNode
from service.fleet.joining import joined
from service.fleet.layout import Layout
from service.logs import logging_by
from service.settings import Settings

if TYPE_CHECKING:  # loads Ray, which is to be loaded in the other process only
    from service.fleet.engine import Engine

LOOK_EVERY = 0.2  # at whether the engine is gone, while an answer is awaited [s]
ANSWER_WAIT = 600.0  # for any answer: all partitions of a node may have to be moved [s]
END_WAIT = 5.0  # for the end of the process [s]


class EngineLost(DeliveryError):
    """The engine does not answer any more: it is to be joined again, or started."""


class EngineProcess:
    """An `Engine` in another process, for one thread.

    begin     called in that process: joins the engine
    settings  what it logs by
    lost      whether the engine that it has joined is known to be gone

    Each call raises EngineLost where the engine is lost meanwhile, and DeliveryError where Ray refuses.
    """

    def __init__(self, begin: Callable[[], Engine], settings: Settings, lost: Callable[[], bool]) -> None:
        context = multiprocessing.get_context("spawn")
        self._lost = lost
        self._connection, there = context.Pipe()
        self._process = context.Process(target=_serve, args=(there, begin, settings), name="engine", daemon=True)
        self._process.start()
        there.close()
        try:
            self._answer()
        except BaseException:
            self.close()
            raise

    @classmethod
    def joined(
        cls, settings: Settings, layout: Layout, twin_from: str | None, address: str, *, alone: bool,
        lost: Callable[[], bool],
    ) -> EngineProcess:  # fmt: skip
        """The engine at an address; `alone` as for `joining.joined`. DeliveryError where it is not reached."""
        return cls(partial(_joined, settings, layout, twin_from, address, alone), settings, lost)

    @property
    def is_alive(self) -> bool:
        """Whether the process is there, and may be asked."""
        return not self._connection.closed

    def place(self) -> None:
        """See `Engine.place`, as for all that follow."""
        self._ask("place")

    def nodes(self) -> list[EngineNode]:
        found: list[EngineNode] = self._ask("nodes")
        return found

    def room(self) -> int:
        return int(self._ask("room"))

    def spread(self, served: Mapping[int, str]) -> list[tuple[int, str]]:
        found: list[tuple[int, str]] = self._ask("spread", dict(served))
        return found

    def move(self, partition: int, to: str | None = None) -> None:
        self._ask("move", partition, to)

    def drain(self, node: EngineNode, served: Mapping[int, str], address: str) -> list[int]:
        found: list[int] = self._ask("drain", node, dict(served), address)
        return found

    def end(self) -> None:
        self._ask("end")

    def close(self) -> None:
        """Ends the process, in good order where it is idle."""
        self._connection.close()  # which an idle process takes as its end
        self._process.join(0.0 if self._lost() else END_WAIT)
        self._process.kill()
        self._process.join()

    def _ask(self, name: str, *given: Any) -> Any:
        if not self.is_alive:
            raise EngineLost("the engine has not been joined again yet")
        with suppress(OSError):  # the process has ended: the answer says so
            self._connection.send((name, given))
        return self._answer()

    def _answer(self) -> Any:
        end = time.monotonic() + ANSWER_WAIT
        while not self._connection.poll(LOOK_EVERY):
            if self._lost() or time.monotonic() > end:
                self.close()
                raise EngineLost("the engine does not answer")
        try:
            failed, found = self._connection.recv()
        except (EOFError, OSError):
            self.close()
            raise EngineLost("the process that asks the engine has ended") from None
        if failed:
            raise found
        return found


def _joined(settings: Settings, layout: Layout, twin_from: str | None, address: str, alone: bool) -> Engine:
    folder: Path = settings.data
    return joined(folder, address, alone=alone)(settings, layout, twin_from)


def _serve(connection: Connection, begin: Callable[[], Engine], settings: Settings) -> None:
    """Carries out what is asked, until the other side has ended."""
    for number in (signal.SIGINT, signal.SIGTERM):  # from a terminal or supervisor: `fleet up` ends this process
        signal.signal(number, signal.SIG_IGN)
    with logging_by(settings):
        failed, engine = _done(begin)
        with suppress(EOFError, OSError):
            connection.send((failed, engine if failed else None))
            while not failed:
                name, given = connection.recv()
                connection.send(_done(partial(getattr(engine, name), *given)))
        if not failed:
            engine.leave()


def _done(call: Callable[[], Any]) -> tuple[bool, Any]:
    """Whether a call has failed, and what it has answered or raised; what is Ray's own is made a DeliveryError."""
    try:
        return False, call()
    except Exception as error:
        if type(error).__module__.partition(".")[0] == "ray":
            return True, DeliveryError(f"the engine: {str(error).strip().splitlines()[0]}")
        return True, error
