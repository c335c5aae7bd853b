"""A fleet of one partition in place of `gear-twin serve`, in one process: router, worker of the partition, front end.

With GEAR_TWIN_TEST_FLEET=1 every `Service` of the tests is such a fleet, over a database of PostgreSQL of its own. It
belongs to the data folder as a file of SQLite would: who starts a service there again finds what is stored.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from typing import Any, NoReturn

from postgresql_server import PostgresqlServer

INSTEAD = "FLEET_OF_ONE"  # in the environment of a service: it is a fleet


class Fleets:
    """The databases of fleets, by the data folders of the services that they are in place of."""

    def __init__(self, server: PostgresqlServer, stack: ExitStack) -> None:
        self._server, self._stack = server, stack
        self._made: str | None = None  # a database with a fleet of one partition, to be copied
        self._databases: dict[str, str] = {}

    def database(self, given: Mapping[str, str]) -> str | None:
        """The URL of the database of the fleet in place of a service; None for one whose settings name a database."""
        if "DATABASE" in given:
            return None
        data = os.path.realpath(given["DATA"])
        if data not in self._databases:
            self._databases[data] = self._stack.enter_context(self._server.new_database(template=self._template()))
        return self._databases[data]

    def environment(self, given: Mapping[str, str]) -> dict[str, str]:
        """What makes a service with these settings a fleet."""
        database = self.database(given)
        return {} if database is None else {INSTEAD: "1", "GEAR_TWIN_DATABASE": database}

    def _template(self) -> str:
        if self._made is None:
            from service.fleet.databases import engine_of
            from service.fleet.layout import create

            url = self._stack.enter_context(self._server.new_database())
            engine = engine_of(url)
            create(engine, 1)
            engine.dispose()
            self._made = url.rpartition("/")[2]
        return self._made


@contextmanager
def fleets(server: PostgresqlServer) -> Iterator[Fleets]:
    """Databases of fleets at a server, as long as it is asked for."""
    with ExitStack() as stack:
        yield Fleets(server, stack)


def takes_frames(database: str) -> bool:
    """Whether the worker of a fleet's one partition says that it takes frames."""
    from service.fleet.census import partitions
    from service.fleet.databases import front_tables
    from service.fleet.layout import Layout
    from service.results.roles import Roles
    from service.results.sql_store import SqlStore

    with SqlStore(front_tables(database, Layout(1))) as store:
        (found,) = partitions(Roles(store.database))
    return found.served and found.not_ready is None


def serve(twin: Any, joined: float) -> NoReturn:
    """Serves by the environment with a twin until a signal ends it, and leaves.

    joined  how long channels that nobody knows of are awaited [s]
    """
    from service.__main__ import leave
    from service.runtime import pump
    from service.runtime.serve import run
    from service.settings import Settings

    pump.JOINED = joined
    if not os.environ.get(INSTEAD):
        leave(run(Settings(), twin=twin))
    from service.termination import until_told

    with until_told() as stop:
        leave(served_as_a_fleet(Settings(), twin=twin, stop=stop))


def served_as_a_fleet(
    settings: Any, *, twin: Any, stop: threading.Event, open_transport: Any = None, announce: Any = None
) -> int:
    """`gear-twin fleet up` without its engine, until `stop` is set; the exit status. Arguments as `serve.run` has."""
    from service.fleet.front import serve_front
    from service.fleet.layout import Layout
    from service.fleet.partition import PartitionRoles
    from service.results.roles import INGEST
    from service.runtime.role_process import Context, Others
    from service.transport.zenoh_session import open_session

    failed: list[BaseException] = []
    at_work = threading.Event()

    class AtWork(Context):
        def say(self, what: Any) -> None:
            if what.begun:
                at_work.set()

    with ExitStack() as stack:
        if open_transport is None and not settings.connect:
            stack.enter_context(open_session(settings.listen, links=settings.zenoh_links))
            settings = settings.model_copy(update={"connect": settings.listen})

        def work() -> None:
            try:
                roles = PartitionRoles(settings=settings, partition=0, layout=Layout(1), twin=twin)
                roles.ingest(AtWork(INGEST, stop, Others()), open_transport=open_transport)
            except BaseException as error:
                failed.append(error)
            finally:
                stop.set()
                at_work.set()

        worker = threading.Thread(target=work, name="partition", daemon=True)
        worker.start()
        at_work.wait()
        try:
            if not stop.is_set():
                serve_front(settings, stop=stop, **({} if announce is None else {"announce": announce}))
        finally:
            stop.set()
            worker.join(20)
    if failed:
        raise failed[0]
    return 0
