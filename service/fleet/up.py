"""`gear-twin fleet up`: the fleet's tables, and an actor of Ray for each partition.

Without the address of a cluster, Ray, the network's router and the partitions run on this machine, and end with this
process, whatever ends it. On a cluster the partitions go on without this process, which may end and be started again.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import sqlalchemy as sa

from service.errors import InputError
from service.fleet.databases import engine_of, reached
from service.fleet.engine import Engine
from service.fleet.layout import Layout, create, layout_of
from service.fleet.ray_session import ray_session
from service.results.data_folder import only_service_of
from service.runtime.admission import demand_protected_links
from service.settings import Settings
from service.transport.zenoh_session import open_session

RUNNING = "fleet.pid"  # in the fleet's folder, as long as it runs on this machine alone
PARTITIONS = 8  # of a new fleet where nobody says
LOOK_EVERY = 1.0  # [s]
FRONT_WAIT = 10.0  # for the end of the front end [s]


def database_of(settings: Settings) -> str:
    """The URL of the fleet's database; InputError where none is set."""
    if settings.database is None:
        raise InputError(
            "a fleet needs a PostgreSQL database that all its machines reach: --database postgresql://user@host/name"
        )
    return settings.database.get_secret_value()


def prepared(settings: Settings) -> Layout:
    """The layout of the fleet, whose tables are made where they are not there."""
    database = database_of(settings)
    for bridge in ("mqtt", "opcua"):
        if getattr(settings, bridge) is not None:
            raise InputError(f"setting {bridge}: a fleet has no bridges to other networks; gear-twin serve has them")
    with reached(database):
        engine = engine_of(database, poolclass=sa.NullPool)
        known = layout_of(engine)
        return create(engine, settings.fleet_partitions or (known.partitions if known else PARTITIONS))


def up(
    settings: Settings,
    layout: Layout,
    *,
    front: bool = True,
    twin_from: str | None = None,
    announce: Callable[[str], None] = print,
) -> None:
    """Has the fleet run until it is told to end.

    front      whether a front end is served from this process, too
    twin_from  module and name of the twin, `module:name`; None for the twin itself
    announce   called with a line when the fleet has been started, and one when HTTP is served
    """
    address = settings.fleet_address
    with ExitStack() as stack:
        stack.enter_context(only_service_of(settings.data))
        (settings.data / RUNNING).unlink(missing_ok=True)
        if not settings.connect:
            demand_protected_links(settings)
            stack.enter_context(open_session(settings.listen, links=settings.zenoh_links))
            settings = settings.model_copy(update={"connect": [_reached(e) for e in settings.listen]})
        ray = stack.enter_context(ray_session(address, room=layout.partitions))
        stop = stack.enter_context(until_told())
        engine = Engine(ray, settings, layout, twin_from=twin_from)
        if address is None:
            stack.enter_context(_noted(settings.data / RUNNING))
            stack.callback(engine.end)
        engine.create()
        if front:
            stack.enter_context(_front(settings, announce, stop))
        announce(f"fleet of {layout.partitions} partitions {f'at {address}' if address else 'on this machine'}")
        while not stop.wait(LOOK_EVERY):
            engine.look()


def running(folder: Path) -> int:
    """The process of the `fleet up` that runs on this machine alone; InputError where none does."""
    if (folder / RUNNING).exists():
        try:
            with only_service_of(folder):  # left by one that was killed
                (folder / RUNNING).unlink()
        except InputError:
            return int((folder / RUNNING).read_text(encoding="utf-8"))
    raise InputError(
        f"no fleet runs with the folder {folder} on this machine alone; one on a cluster is given by --address"
    )


@contextmanager
def _noted(file: Path) -> Iterator[None]:
    """This process's number in a file while inside."""
    file.write_text(f"{os.getpid()}\n", encoding="utf-8")
    try:
        yield
    finally:
        file.unlink(missing_ok=True)


@contextmanager
def until_told() -> Iterator[threading.Event]:
    """An event that SIGINT and SIGTERM set while inside."""
    stop = threading.Event()
    before = {number: signal.signal(number, lambda *_: stop.set()) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def _front(settings: Settings, announce: Callable[[str], None], stop: threading.Event) -> Iterator[None]:
    """A front end in a thread of its own, until `stop` is set."""
    from service.fleet.front import serve_front
    from service.runtime import SERVES

    failed: list[Exception] = []

    def serve() -> None:
        try:
            serve_front(settings, announce=lambda address: announce(f"{SERVES} {address}"), stop=stop)
        except Exception as error:
            failed.append(error)
        finally:
            stop.set()

    thread = threading.Thread(target=serve, name="front end", daemon=True)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join(FRONT_WAIT)
    if failed:
        raise failed[0]


def _reached(endpoint: str) -> str:
    """How this machine reaches a router that listens at an endpoint."""
    return endpoint.replace("/0.0.0.0:", "/127.0.0.1:").replace("/[::]:", "/[::1]:")
