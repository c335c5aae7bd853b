"""`gear-twin ready`: whether a service accepts frames; what a health check of containers and of systemd asks."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from service.cli.config import ConfigFile
from service.cli.rest import call

ANY = {"0.0.0.0": "127.0.0.1", "::": "::1"}  # addresses that listen on every interface, and that of this computer


def ready(
    url: Annotated[
        str | None,
        typer.Option("--url", help="Address of the service; default: that of the settings.", envvar="GEAR_TWIN_URL"),
    ] = None,
    config: ConfigFile = None,
) -> None:
    """Say whether the service accepts frames; the exit status is 0 where it does."""
    print(call(url or own_address(config), "/readyz")["status"])


def own_address(config: Path | None) -> str:
    """The address at which a service with the settings of this environment answers on this computer."""
    from service.configuration.load import load

    settings = load(config=config)
    host = ANY.get(settings.http_host, settings.http_host)
    return f"http://{f'[{host}]' if ':' in host else host}:{settings.http_port}"
