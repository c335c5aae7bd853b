"""A fleet of one partition in place of `gear-twin serve`, in one process: router, worker of the partition, front end.

With GEAR_TWIN_TEST_FLEET=1 every `Service` of the tests is such a fleet, over a database of PostgreSQL of its own, which
belongs to its data folder as a file of SQLite would: who starts a service there again finds what is stored.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from typing import Any, NoReturn

from postgresql_server import PostgresqlServer

CHOSEN = "GEAR_TWIN_TEST_FLEET"
INSTEAD = "FLEET_OF_ONE"  # in the environment of a service: it is a fleet
FLEET = bool(os.environ.get(CHOSEN))


class Fleets:
    """The databases of fleets, by the data folders of the services that they are in place of."""

    def __init__(self, server: PostgresqlServer, stack: ExitStack) -> None:
        self._server, self._stack = server, stack
        self._made: str | None = None  # a database with a fleet of one partition, to be copied
        self._databases: dict[str, str] = {}

    def environment(self, given: Mapping[str, str]) -> dict[str, str]:
        """What makes a service with these settings a fleet; nothing for one that has a database of its own."""
        if "DATABASE" in given:
            return {}
        data = os.path.realpath(given["DATA"])
        if data not in self._databases:
            self._databases[data] = self._stack.enter_context(self._server.new_database(template=self._template()))
        return {INSTEAD: "1", "GEAR_TWIN_DATABASE": self._databases[data]}

    def _template(self) -> str:
        if self._made is None:
            from service.fleet.databases import engine_of, made
            from service.fleet.layout import create

            url = self._stack.enter_context(self._server.new_database())
            engine = engine_of(url)
            create(engine, 1)
            engine.dispose()
            made(url, 0, 1)
            self._made = url.rpartition("/")[2]
        return self._made


@contextmanager
def fleets(server: PostgresqlServer) -> Iterator[Fleets]:
    """Databases of fleets at a server, as long as it is asked for."""
    with ExitStack() as stack:
        yield Fleets(server, stack)


def serve(twin: Any, joined: float) -> NoReturn:
    """Serves by the environment with a twin until a signal ends it, and leaves.

    joined  how long channels that nobody knows of are awaited [s]
    """
    from service.__main__ import leave
    from service.runtime import pump
    from service.runtime.serve import run
    from service.settings import Settings

    pump.JOINED = joined
    leave(served_as_a_fleet(Settings(), twin) if os.environ.get(INSTEAD) else run(Settings(), twin=twin))


def served_as_a_fleet(settings: Any, twin: Any) -> int:
    """`gear-twin fleet up` without its engine; the exit status."""
    from service.fleet.front import serve_front
    from service.fleet.layout import Layout
    from service.fleet.partition import serve_partition
    from service.fleet.up import until_told
    from service.transport.zenoh_session import open_session

    failed: list[BaseException] = []
    with until_told() as stop, ExitStack() as stack:
        if not settings.connect:
            stack.enter_context(open_session(settings.listen, links=settings.zenoh_links))
            settings = settings.model_copy(update={"connect": settings.listen})
        at_work = threading.Event()

        def work() -> None:
            try:
                serve_partition(settings, 0, Layout(1), stop, twin=twin, at_work=at_work.set)
            except BaseException as error:
                failed.append(error)
            finally:
                stop.set()
                at_work.set()

        worker = threading.Thread(target=work, name="partition", daemon=True)
        worker.start()
        at_work.wait()
        if not stop.is_set():
            serve_front(settings, stop=stop)
        stop.set()
        worker.join(20)
    if failed:
        print(f"{type(failed[0]).__name__}: {failed[0]}", file=sys.stderr)
        return 1
    return 0
