"""What commands that talk to a running service share: its address, the credential, and one call with its errors.

A key is given by GEAR_TWIN_KEY, or by --key, where other people of the computer can see it in the list of processes. It
is never printed, and never sent on where the service answers with another address.
"""

from __future__ import annotations

import inspect
import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any
from urllib.error import HTTPError, URLError
from urllib.request import HTTPRedirectHandler, HTTPSHandler, ProxyHandler, Request, build_opener

import typer

Url = Annotated[str, typer.Option("--url", "--service", help="Address of the service.", envvar="GEAR_TWIN_URL")]
JsonFile = Annotated[
    Path | None, typer.Option("--json", help="Write the answer as JSON to this file; - is standard output.")
]
LOCAL = "http://127.0.0.1:8080"
WAIT = 120.0  # [s]; a wear curve under a new condition takes seconds of a core
KEY, CA = "GEAR_TWIN_KEY", "GEAR_TWIN_CA"
CERTIFICATE, PRIVATE_KEY = "GEAR_TWIN_CERTIFICATE", "GEAR_TWIN_PRIVATE_KEY"


_given: dict[str, str] = {}  # by the options of the command that is running


Key = Annotated[
    str | None,
    typer.Option("--key", help=f"API key or token that the service accepts; better given by the variable {KEY}."),
]
Authorities = Annotated[
    str | None,
    typer.Option("--ca", help="File of certificates (PEM) that the service's is verified by; default: the system's."),
]

Certificate = Annotated[
    str | None,
    typer.Option("--certificate", help=f"File of the certificate (PEM) to show the service; default: {CERTIFICATE}."),
]
PrivateKey = Annotated[
    str | None,
    typer.Option("--private-key", help=f"File of its private key (PEM); default: {PRIVATE_KEY}."),
]
OPTIONS = {  # of every command that asks a service, with the variable that does the same
    "key": (Key, KEY),
    "ca": (Authorities, CA),
    "certificate": (Certificate, CERTIFICATE),
    "private_key": (PrivateKey, PRIVATE_KEY),
}


def asking(command: Callable[..., Any]) -> Callable[..., Any]:
    """Gives a command that talks to a service the options of credentials, which `call` uses."""
    signature = inspect.signature(command, eval_str=True)
    added = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, annotation=kind, default=None)
        for name, (kind, _) in OPTIONS.items()
    ]

    def asked(**given: Any) -> Any:
        for name, (_, variable) in OPTIONS.items():
            if value := given.pop(name, None):
                _given[variable] = value
        try:
            return command(**given)
        finally:
            _given.clear()

    asked.__name__, asked.__doc__ = command.__name__, command.__doc__
    parameters = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in (*signature.parameters.values(), *added)]
    asked.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    asked.__annotations__ = {p.name: p.annotation for p in parameters}
    return asked


def _known(variable: str) -> str | None:
    return _given.get(variable) or os.environ.get(variable) or None


class _NoRedirects(HTTPRedirectHandler):
    """A credential is not taken to another address."""

    def redirect_request(self, *_: Any, **__: Any) -> None:
        return None


def call(url: str, path: str, body: Mapping[str, Any] | bytes | None = None, method: str | None = None) -> Any:
    """The service's answer, asked for directly, whatever proxy the environment names.

    InputError has the service's own words where it refuses, or says that nothing answers.

    body  JSON data, or a file as it is
    """
    from service.access.client_tls import client_context
    from service.errors import InputError
    from service.printable import all_printable

    data = body if body is None or isinstance(body, bytes) else json.dumps(body).encode()
    headers = {"Content-Type": "application/octet-stream" if isinstance(body, bytes) else "application/json"}
    if key := _known(KEY):
        headers["Authorization"] = f"Bearer {key}"
    try:
        context = client_context(*map(_known, (CA, CERTIFICATE, PRIVATE_KEY)))
        opener = build_opener(ProxyHandler({}), _NoRedirects, HTTPSHandler(context=context))
        request = Request(url.rstrip("/") + path, data, headers, method=method)
        with opener.open(request, timeout=WAIT) as response:
            return all_printable(json.load(response))
    except HTTPError as error:
        try:
            with error:
                detail = json.load(error)["detail"]
        except (ValueError, KeyError, TypeError):
            detail = f"status {error.code}"
        raise InputError(f"{url}: {detail}") from None
    except (URLError, OSError, ValueError) as error:
        why = getattr(error, "reason", error)
        raise InputError(
            f"{url}: no service answers at this address: {str(why).lower()}; --url sets its address"
        ) from None
