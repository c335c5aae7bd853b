"""`gear-twin fleet up`: the fleet's tables, and its hosts: this machine, or the nodes of a cluster of Ray.

On this machine alone it is a host with the network's router and a front end as roles beside its own, and all of it
ends with this process, whatever ends it. On a cluster the hosts go on without this process, which may end and be
started again.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

import sqlalchemy as sa

from service.errors import InputError
from service.fleet.databases import database_of, engine_of, reached
from service.fleet.engine import Engine
from service.fleet.front import answered
from service.fleet.host import Host, demand_router
from service.fleet.layout import Layout, create
from service.fleet.ray_session import ray_session
from service.results.data_folder import only_service_of
from service.results.roles import ANSWER
from service.runtime import SERVES
from service.runtime.admission import demand_protected_links
from service.runtime.answer import Answering
from service.runtime.role_process import Context
from service.runtime.supervisor import Role
from service.runtime.twin_port import Twin
from service.settings import Settings
from service.termination import until_told
from service.transport.zenoh_session import open_session

RUNNING = "fleet.pid"  # in the fleet's folder, as long as it runs on this machine alone
LOOK_EVERY = 1.0  # [s]


def prefix_set(settings: Settings) -> str | None:
    """The prefix where somebody has set one; the fleet has its own."""
    return settings.prefix if "prefix" in settings.model_fields_set else None


def prepared(settings: Settings) -> Layout:
    """The layout of the fleet, whose tables are made where they are not there."""
    database = database_of(settings)
    for bridge in ("mqtt", "opcua"):
        if getattr(settings, bridge) is not None:
            raise InputError(f"setting {bridge}: a fleet has no bridges to other networks; gear-twin serve has them")
    with reached(database):
        return create(engine_of(database, poolclass=sa.NullPool), settings.fleet_partitions, prefix_set(settings))


def up(
    settings: Settings,
    layout: Layout,
    *,
    front: bool = True,
    twin: Twin | None = None,
    announce: Callable[[str], None] = print,
) -> None:
    """Has the fleet run until it is told to end.

    front     whether a front end is served from here, too; on a cluster there is none
    twin      its functions; None for the twin itself
    announce  called with a line when the fleet has been started, and one when HTTP is served
    """
    with ExitStack() as stack:
        stack.enter_context(only_service_of(settings.data))
        (settings.data / RUNNING).unlink(missing_ok=True)
        host = Host(settings=settings, layout=layout, name=socket.gethostname(), twin=twin)
        if settings.fleet_address is None:
            stack.enter_context(_noted(settings.data / RUNNING))
            _here(host, front, announce, stack)
        else:
            _on_cluster(host, announce, stack)


def _here(host: Host, front: bool, announce: Callable[[str], None], stack: ExitStack) -> None:
    """Has all of it done by processes of this machine."""
    settings, beside = host.settings, list[Role]()
    if not settings.connect:
        demand_protected_links(settings)
        beside.append(Role(name="router", work=partial(_route, settings), essential=True))
        settings = settings.model_copy(update={"connect": [_reached(e) for e in settings.listen]})
    if front:
        answering = stack.enter_context(Answering.at(settings))
        work = partial(answered, settings, answering, announce=lambda address: announce(f"{SERVES} {address}"))
        beside.append(Role(name=ANSWER, work=work, essential=True))
    stop = stack.enter_context(until_told())
    announce(f"fleet of {host.layout.partitions} partitions on this machine")
    replace(host, settings=settings).serve(stop, beside)


def _on_cluster(host: Host, announce: Callable[[str], None], stack: ExitStack) -> None:
    """Has the nodes of a cluster be hosts."""
    demand_router(host.settings)
    engine = Engine(stack.enter_context(ray_session(host.settings.fleet_address)))
    stop = stack.enter_context(until_told())
    announce(f"fleet of {host.layout.partitions} partitions at {host.settings.fleet_address}")
    while True:
        engine.look(host)
        if stop.wait(LOOK_EVERY):
            return


def _route(settings: Settings, context: Context) -> None:
    """Does the role of the network's router."""
    with open_session(settings.listen, links=settings.zenoh_links):
        while not context.stop.wait(LOOK_EVERY):
            context.beat()


def running(folder: Path) -> int:
    """The process of the `fleet up` that runs on this machine alone; InputError where none does."""
    with suppress(FileNotFoundError, ValueError):
        computer, process, began = (folder / RUNNING).read_text(encoding="utf-8").split()
        if computer != socket.gethostname():
            raise InputError(f"the fleet with the folder {folder} runs on {computer}: it is ended there")
        if _began(process) == began:
            return int(process)
    raise InputError(
        f"no fleet runs with the folder {folder} on this machine alone; one on a cluster is given by --address"
    )


@contextmanager
def _noted(file: Path) -> Iterator[None]:
    """This process in a file while inside: its computer, its number there, and when it began."""
    new = file.with_suffix(".new")
    new.write_text(f"{socket.gethostname()} {os.getpid()} {_began(str(os.getpid()))}\n", encoding="utf-8")
    new.replace(file)
    try:
        yield
    finally:
        file.unlink(missing_ok=True)


def _began(process: str) -> str | None:
    """When a process of this computer has begun, as the kernel counts it; None where there is none of the number."""
    with suppress(OSError):
        return Path("/proc", process, "stat").read_text(encoding="utf-8").rpartition(")")[2].split()[19]
    return None


def _reached(endpoint: str) -> str:
    """How this machine reaches a router that listens at an endpoint."""
    return endpoint.replace("/0.0.0.0:", "/127.0.0.1:").replace("/[::]:", "/[::1]:")
