"""`gear-twin fleet`: many machines, served by any number of hosts over one PostgreSQL database."""

from __future__ import annotations

import os
import signal
import time
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any

import typer

from service.cli.config import ConfigFile
from service.fleet.cli import fleet_app as assessing

app = typer.Typer(no_args_is_help=True, help="Serve hundreds of machines and more, by partitions over PostgreSQL.")
app.registered_commands += assessing.registered_commands

Database = Annotated[str | None, typer.Option(help="URL of the fleet's PostgreSQL database.", envvar=None)]
Data = Annotated[Path | None, typer.Option(help="Folder that all nodes reach; default: .gear-twin.")]
Address = Annotated[
    str | None,
    typer.Option(help="HOST:PORT of a cluster of Ray, whose nodes are the hosts; default: this machine alone."),
]
JsonFile = Annotated[
    Path | None, typer.Option("--json", help="Write the answer as JSON to this file; - is standard output.")
]
DOWN_WITHIN = 60.0  # the end of a fleet [s]


def _settings(**given: Any) -> Any:
    from service.cli.assessing import settings_of

    return settings_of(**given)


@app.command()
def up(
    database: Database = None,
    partitions: Annotated[
        int | None, typer.Option(min=1, max=1000, help="Partitions of a new fleet, fixed from then on; default: 8.")
    ] = None,
    address: Address = None,
    http: Annotated[str | None, typer.Option(help="HOST:PORT of REST and the page; default: 127.0.0.1:8080.")] = None,
    rig: Annotated[Path | None, typer.Option(help="Rig file of all assets that no other names.")] = None,
    no_front: Annotated[
        bool,
        typer.Option(
            "--no-front", help="Serve no HTTP on this machine: front ends run elsewhere (gear-twin fleet front)."
        ),
    ] = False,
    data: Data = None,
    config: ConfigFile = None,
) -> None:
    """Run the fleet, on this machine or on a cluster of Ray, until Ctrl-C. All settings: `gear-twin config`."""
    from service.fleet.up import prepared
    from service.fleet.up import up as run
    from service.logs import logging_by

    settings = _settings(
        database=database, fleet_partitions=partitions, fleet_address=address, http=http, rig=rig, data=data,
        config=config,
    )  # fmt: skip
    with logging_by(settings):
        run(settings, prepared(settings), front=not no_front, announce=lambda line: print(line, flush=True))


@app.command()
def host(
    name: Annotated[
        str | None,
        typer.Option(help="Name by which it leases partitions, which no other host has; default: this computer's."),
    ] = None,
    database: Database = None,
    data: Data = None,
    config: ConfigFile = None,
) -> None:
    """Be one of any number of hosts of the fleet until Ctrl-C: compute, and receive the frames of leased partitions."""
    import socket

    from service.fleet.host import Host
    from service.fleet.up import prepared
    from service.logs import logging_by
    from service.termination import until_told

    settings = _settings(database=database, data=data, config=config)
    with logging_by(settings), until_told() as stop:
        Host(settings=settings, layout=prepared(settings), name=name or socket.gethostname()).serve(stop)


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
    """Route the frames of the fleet until Ctrl-C: between publishers and all hosts."""
    from service.fleet.router import route
    from service.logs import logging_by

    settings = _settings(listen=listen, config=config)
    with logging_by(settings):
        route(settings, announce=lambda line: print(line, flush=True))


@app.command()
def status(database: Database = None, config: ConfigFile = None, json: JsonFile = None) -> int:
    """Print which host serves which partition, with how many assets; the exit status is 1 where one takes no frames."""
    from service.fleet.census import census
    from service.fleet.front import opened
    from service.fleet.show import print_status
    from service.json_text import wrote_json
    from service.results.roles import Roles

    with opened(_settings(database=database, config=config)) as store:
        roles = Roles(store.database)
        roles.settle()
        found = census(roles)
    if not wrote_json(found.to_dict(), json):
        print_status(found)
    return 0 if found.receiving else 1


@app.command()
def key(
    asset: Annotated[str, typer.Argument(metavar="ASSET", help="Name of the asset.")],
    database: Database = None,
    config: ConfigFile = None,
) -> None:
    """Print the first part of the keys under which an asset publishes: what `replay --prefix` takes."""
    from service.errors import InputError
    from service.fleet.databases import database_of, layout_at
    from service.fleet.front import opened
    from service.fleet.layout import share_of
    from service.fleet.up import prefix_set
    from service.stream.wire.topics import NAME

    if not NAME.fullmatch(asset):
        raise InputError(f"ASSET = {asset!r} must be 1 to 64 letters, digits, '_', '-' or '.'")
    settings = _settings(database=database, config=config)
    layout = layout_at(database_of(settings)).demand(None, prefix_set(settings))
    with opened(settings) as store:
        print(layout.prefix_of(share_of(store.database, asset, layout)))


@app.command()
def down(database: Database = None, address: Address = None, data: Data = None, config: ConfigFile = None) -> None:
    """End the fleet that `fleet up` runs here or on a cluster, in good order; hosts begun with `fleet host` go on."""
    from service.errors import DeliveryError
    from service.fleet.databases import database_of, layout_at
    from service.fleet.engine import Engine
    from service.fleet.ray_session import ray_session
    from service.fleet.up import RUNNING, running

    settings = _settings(database=database, fleet_address=address, data=data, config=config)
    if settings.fleet_address is None:
        process = running(settings.data)
        with suppress(ProcessLookupError):  # it has just ended
            os.kill(process, signal.SIGTERM)
        end = time.monotonic() + DOWN_WITHIN
        while (settings.data / RUNNING).exists():
            if time.monotonic() > end:
                raise DeliveryError(f"fleet up, process {process}, has not ended within {DOWN_WITHIN:g} s")
            time.sleep(0.1)
    else:
        layout_at(database_of(settings))
        with ray_session(settings.fleet_address) as ray:
            Engine(ray).end()
    print("all that fleet up has started has ended; hosts that were started with fleet host go on")
