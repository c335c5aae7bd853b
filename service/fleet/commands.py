"""`gear-twin fleet`: many machines, served by partitions on an engine, over one PostgreSQL database."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import Annotated, Any

import typer

from service.cli.config import ConfigFile
from service.fleet.cli import fleet_app as assessing

app = typer.Typer(no_args_is_help=True, help="Serve hundreds of machines and more, by partitions over PostgreSQL.")
app.registered_commands += assessing.registered_commands

Database = Annotated[str | None, typer.Option(help="URL of the fleet's PostgreSQL database.", envvar=None)]
Data = Annotated[Path | None, typer.Option(help="Folder that all nodes reach; default: .gear-twin.")]
Address = Annotated[str | None, typer.Option(help="HOST:PORT of the cluster of Ray; default: that of fleet up.")]
JsonFile = Annotated[
    Path | None, typer.Option("--json", help="Write the answer as JSON to this file; - is standard output.")
]
DOWN_WITHIN = 60.0  # the end of a fleet [s]
WAIT_SERVED = 120.0  # for partitions that are moved [s]


def _settings(**given: Any) -> Any:
    from service.cli.assessing import settings_of

    return settings_of(**given)


@app.command()
def up(
    database: Database = None,
    workers: Annotated[
        int | None, typer.Option(min=1, max=64, help="Nodes on this machine, where it joins no cluster; default: 1.")
    ] = None,
    partitions: Annotated[
        int | None, typer.Option(min=1, max=1000, help="Partitions of a new fleet, fixed from then on; default: 8.")
    ] = None,
    address: Annotated[str | None, typer.Option(help="HOST:PORT of a cluster of Ray to join.")] = None,
    http: Annotated[str | None, typer.Option(help="HOST:PORT of REST and the page; default: 127.0.0.1:8080.")] = None,
    rig: Annotated[Path | None, typer.Option(help="Rig file of all assets that no other names.")] = None,
    no_front: Annotated[
        bool, typer.Option("--no-front", help="Serve no HTTP here: front ends run elsewhere (gear-twin fleet front).")
    ] = False,
    data: Data = None,
    config: ConfigFile = None,
) -> None:
    """Start the fleet, or join its engine, and look after it until Ctrl-C. All settings: `gear-twin config`."""
    from service.cli.show import progress_bar
    from service.fleet.up import prepared
    from service.fleet.up import up as run
    from service.logs import logging_by

    settings = _settings(
        database=database, fleet_workers=workers, fleet_partitions=partitions, fleet_address=address, http=http,
        rig=rig, data=data, config=config,
    )  # fmt: skip
    with logging_by(settings):
        with progress_bar("tables") as bar:
            layout = prepared(settings, lambda done, of: bar(done / of, f"{done} of {of} partitions"))
        run(settings, layout, front=not no_front, announce=lambda line: print(line, flush=True))


@app.command()
def front(
    database: Database = None,
    http: Annotated[str | None, typer.Option(help="HOST:PORT of REST and the page; default: 127.0.0.1:8080.")] = None,
    data: Data = None,
    config: ConfigFile = None,
) -> int:
    """Serve REST and the page of the fleet from its database: one of any number of front ends."""
    from service.fleet.front import serve_front
    from service.logs import logging_by

    settings = _settings(database=database, http=http, data=data, config=config)
    with logging_by(settings):
        return serve_front(settings)


@app.command()
def router(
    listen: Annotated[
        list[str] | None, typer.Option(help="Endpoint, such as tcp/0.0.0.0:7447; default: tcp/127.0.0.1:7447.")
    ] = None,
    config: ConfigFile = None,
) -> None:
    """Route the frames of the fleet until Ctrl-C: between publishers and the workers of all machines."""
    from service.fleet.router import route
    from service.logs import logging_by

    settings = _settings(listen=listen, config=config)
    with logging_by(settings):
        route(settings, announce=lambda line: print(line, flush=True))


@app.command()
def status(database: Database = None, config: ConfigFile = None, json: JsonFile = None) -> int:
    """Print which partitions are served, by which node, with how many assets; the exit status is 1 where one is not."""
    from service.fleet.show import print_status
    from service.json_text import wrote_json

    found = _census(_settings(database=database, config=config))
    if not wrote_json(found.to_dict(), json):
        print_status(found)
    return 1 if found.silent else 0


@app.command()
def key(
    asset: Annotated[str, typer.Argument(metavar="ASSET", help="Name of the asset.")],
    database: Database = None,
    config: ConfigFile = None,
) -> None:
    """Print the first part of the keys under which an asset publishes: what `replay --prefix` takes."""
    from service.errors import InputError
    from service.fleet.lookup import partition_in_use
    from service.stream.wire.topics import NAME

    if not NAME.fullmatch(asset):
        raise InputError(f"ASSET = {asset!r} must be 1 to 64 letters, digits, '_', '-' or '.'")
    settings = _settings(database=database, config=config)
    tables, layout = _tables(settings)
    print(layout.prefix_of(partition_in_use(tables, layout, asset), settings.prefix))


@app.command()
def drain(
    node: Annotated[str, typer.Argument(metavar="NODE", help="Name, host or number of the node: see fleet status.")],
    database: Database = None,
    address: Address = None,
    data: Data = None,
    config: ConfigFile = None,
) -> None:
    """Move a node's partitions to others, and place nothing there any more: before its machine is stopped."""
    from contextlib import ExitStack

    from service.fleet.cluster import node_here
    from service.fleet.engine_nodes import find_node
    from service.fleet.joining import joined
    from service.fleet.up import running

    settings = _settings(database=database, data=data, config=config)
    tables, layout = _tables(settings)
    where = address or settings.fleet_address
    alone = False
    if where is None:
        found = running(settings.data)
        where, alone = found["address"], found["workers"] is not None
    with ExitStack() as stack:
        if not alone:
            stack.enter_context(node_here(settings.data, where))
        engine = joined(settings.data, where, alone=alone)(settings, layout)
        chosen = find_node(engine.nodes(), node)
        moved = engine.drain(chosen, _census(settings).nodes, where)
        _await_served(settings, moved)
        engine.leave()
    tables.dispose()
    numbers = ", ".join(map(str, moved)) or "none"
    print(f"{chosen.name} serves no partition any more; moved: {numbers}")


@app.command()
def scale(
    workers: Annotated[int, typer.Argument(metavar="N", min=1, max=64, help="Nodes on the machine of fleet up.")],
    database: Database = None,
    data: Data = None,
    config: ConfigFile = None,
) -> None:
    """Have N nodes on the machine of `fleet up`, which starts or empties them. A cluster is scaled by its own means."""
    from service.errors import InputError
    from service.fleet.up import running, want_workers

    settings = _settings(database=database, data=data, config=config)
    tables, _ = _tables(settings)
    if running(settings.data)["workers"] is None:
        raise InputError(
            f"scale = {workers}: this fleet has joined the cluster at {running(settings.data)['address']}, which is "
            "scaled by its own means (ray start, or the operator for Kubernetes)"
        )
    want_workers(tables, workers)
    print(f"the fleet is going to have {workers} nodes on its machine: see gear-twin fleet status")


@app.command()
def down(data: Data = None, config: ConfigFile = None) -> None:
    """End the fleet of this folder in good order: what is committed stays, and what waits is left to the next start."""
    from service.errors import DeliveryError
    from service.fleet.up import RUNNING, running

    settings = _settings(data=data, config=config)
    process = running(settings.data)["pid"]
    try:
        os.kill(process, signal.SIGTERM)
    except ProcessLookupError:
        (settings.data / RUNNING).unlink(missing_ok=True)
        raise DeliveryError(f"fleet up, process {process}, has ended before; nothing is left of it") from None
    end = time.monotonic() + DOWN_WITHIN
    while (settings.data / RUNNING).exists():
        if time.monotonic() > end:
            raise DeliveryError(f"fleet up, process {process}, has not ended within {DOWN_WITHIN:g} s")
        time.sleep(0.1)
    print("the fleet has ended")


def _tables(settings: Any) -> tuple[Any, Any]:
    """Connections to what all partitions share, and the layout; InputError where there is no fleet."""
    import sqlalchemy as sa

    from service.errors import InputError
    from service.fleet.databases import engine_of, reached
    from service.fleet.layout import layout_of
    from service.fleet.up import database_of

    database = database_of(settings)
    tables = engine_of(database, poolclass=sa.NullPool)
    with reached(database):
        layout = layout_of(tables)
    if layout is None:
        raise InputError("the database holds no fleet: gear-twin fleet up makes one")
    return tables, layout


def _census(settings: Any) -> Any:
    from service.fleet.census import census
    from service.fleet.databases import reached
    from service.fleet.up import database_of

    with reached(database_of(settings)):
        return census(*_tables(settings))


def _await_served(settings: Any, partitions: list[int]) -> None:
    """Waits until all of these partitions are served again."""
    from service.errors import DeliveryError

    end = time.monotonic() + WAIT_SERVED
    while missing := sorted(set(partitions) & set(_census(settings).silent)):
        if time.monotonic() > end:
            raise DeliveryError(f"partitions {missing} are not served after {WAIT_SERVED:g} s: see fleet status")
        time.sleep(0.2)
