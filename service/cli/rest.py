"""What commands that ask a running service share: its address and the credential, one call, and how it is refused.

A key is given by GEAR_TWIN_KEY, or by --key, where other people of the computer can see it in the list of processes. It
is never printed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from service.cli.assessing import Shown, answering, with_options
from service.cli.config import ConfigFile
from service.errors import InputError

LOCAL = "http://127.0.0.1:8080"
WAIT = 120.0  # [s]; a wear curve under a new condition takes seconds of a core
ANY = {"0.0.0.0": "127.0.0.1", "::": "::1"}  # addresses that listen on every interface, and that of this computer
DONE, QUEUED = "done", "queued; applied after the current window"

AssetName = Annotated[str, Argument(metavar="ASSET", help="The asset.")]
By = Annotated[str | None, Option(help="Your name.", envvar="GEAR_TWIN_NAME", show_default=False)]
Url = Annotated[str, Option("--url", "--service", help="Address of the service.", envvar="GEAR_TWIN_URL")]
CREDENTIALS = {
    "key": "API key or token that the service accepts; better given by the variable GEAR_TWIN_KEY.",
    "ca": "File of certificates (PEM) that the service's is verified by; default: the system's.",
    "certificate": "File of the certificate (PEM) to show the service; default: GEAR_TWIN_CERTIFICATE.",
    "private_key": "File of its private key (PEM); default: GEAR_TWIN_PRIVATE_KEY.",
}
OPTIONS: dict[str, tuple[Any, Any]] = {
    name: (Annotated[str | None, Option(f"--{name.replace('_', '-')}", help=text)], None)
    for name, text in CREDENTIALS.items()
}


class Service:
    """A running service, as a command asks it."""

    def __init__(self, url: str, credentials: Mapping[str, str | None]) -> None:
        self.url, self._credentials = url, credentials

    def at(self, url: str) -> Service:
        """The service at another address, with the same credentials."""
        return Service(url, self._credentials)

    def ask(
        self, *parts: object, path: str | None = None, body: Any = None, method: str | None = None, **query: Any
    ) -> Any:
        """The answer of /v1/PARTS, or of another path; InputError has the service's own words where it refuses.

        body  JSON data, or a file's bytes as they are
        """
        from service.access.http_client import HttpClient, ServiceError, path_of
        from service.printable import all_printable

        try:
            client = HttpClient(self.url, WAIT, **self._credentials)
            return all_printable(client.json(path or path_of(*parts), body, method=method, query=query))
        except ServiceError as error:
            raise InputError(f"{self.url}: {error.detail}") from None
        except OSError as error:
            why = f"{self.url}: no service answers at this address: {str(error).lower()}; --url sets its address"
            raise InputError(why) from None

    def only_asset(self) -> str:
        """The service's asset, where it has one alone."""
        known = [a["asset"] for a in self.ask("assets")]
        if len(known) != 1:
            what = f"name one of its assets: {', '.join(known)}" if known else "no asset has sent a frame yet"
            raise InputError(f"{self.url}: {what}")
        return known[0]


def with_service(command: Callable[..., Any], *, url: bool = True) -> Callable[..., Any]:
    """Gives a command the options of a credential, and `--url` unless it has an address of its own.

    command  its parameter `service` is the Service that the options name
    """

    def run(**given: Any) -> Any:
        credentials = {name: given.pop(name) for name in OPTIONS}
        return command(service=Service(given.pop("url") if url else "", credentials), **given)

    options = {"url": (Url, LOCAL), **OPTIONS} if url else OPTIONS
    return with_options(command, options, run, without=frozenset({"service"}))


def asking(command: Callable[..., Shown]) -> Callable[..., Any]:
    """A command that asks a service and shows what it answers."""
    return answering(with_service(command))


@partial(with_service, url=False)
def ready(
    service: Service,
    url: Annotated[
        str | None,
        Option("--url", help="Address of the service; default: that of the settings.", envvar="GEAR_TWIN_URL"),
    ] = None,
    config: ConfigFile = None,
) -> None:
    """Say whether the service accepts frames; the exit status is 0 where it does."""
    print(service.at(url or own_address(config)).ask(path="/readyz")["status"])


def own_address(config: Path | None) -> str:
    """The address at which a service with the settings of this environment answers on this computer."""
    from service.configuration.load import load

    settings = load(config=config)
    host = ANY.get(settings.http_host, settings.http_host)
    return f"http://{f'[{host}]' if ':' in host else host}:{settings.http_port}"
