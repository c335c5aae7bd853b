"""What commands that talk to a running service share: its address, and one call with its errors in one line."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any
from urllib.error import HTTPError, URLError
from urllib.request import Request, urlopen

import typer

Url = Annotated[str, typer.Option("--url", "--service", help="Address of the service.", envvar="GEAR_TWIN_URL")]
JsonFile = Annotated[
    Path | None, typer.Option("--json", help="Write the answer as JSON to this file; - is standard output.")
]
LOCAL = "http://127.0.0.1:8080"
WAIT = 120.0  # [s]; a wear curve under a new condition takes seconds of a core


def call(url: str, path: str, body: Mapping[str, Any] | bytes | None = None, method: str | None = None) -> Any:
    """The service's answer; InputError with its own words where it refuses, or where nothing answers.

    body  JSON data, or a file as it is
    """
    from service.errors import InputError

    data = body if body is None or isinstance(body, bytes) else json.dumps(body).encode()
    kind = "application/octet-stream" if isinstance(body, bytes) else "application/json"
    try:
        request = Request(url.rstrip("/") + path, data, {"Content-Type": kind}, method=method)
        with urlopen(request, timeout=WAIT) as response:
            return json.load(response)
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
