"""`gear-twin keys`: API keys of a service, made and revoked in its data directory; they hold at once."""

from __future__ import annotations

import re
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import typer

from service.access.roles import Role
from service.cli.assessing import settings_of, tell
from service.cli.config import ConfigFile

app = typer.Typer(no_args_is_help=True, help="Make, list and revoke the API keys of a service.")

Data = Annotated[Path | None, typer.Option(help="Data directory of the service; default: .gear-twin.")]
JsonFile = Annotated[
    Path | None, typer.Option("--json", help="Write the answer as JSON to this file; - is standard output.")
]
Which = Annotated[str, typer.Argument(metavar="KEY", help="Name or identifier of the key, as listed.")]
DAY = 86_400.0  # [s]


@app.command()
def add(
    name: Annotated[str, typer.Option(help="Name of the person or program; it signs what is done with the key.")],
    role: Annotated[Role, typer.Option(help="What may be done with it; each role includes the one before.")],
    expires: Annotated[
        str | None, typer.Option(metavar="DATE|DAYSd", help="When it ends, ISO 8601 or as 90d; default: never.")
    ] = None,
    data: Data = None,
    config: ConfigFile = None,
    json: JsonFile = None,
) -> None:
    """Make a key. It is printed this once and cannot be shown again: only a salted hash of it is kept."""
    from service.json_text import wrote_json

    key = _store(data, config).add(name, role, None if expires is None else _moment(expires))
    if not wrote_json({"name": name, "role": role.value, "key": key}, json):
        print(key)
    tell(f"key of {name} with the role {role}: keep it now, it cannot be shown again")


@app.command(name="list")
def list_(data: Data = None, config: ConfigFile = None, json: JsonFile = None) -> None:
    """List the keys: their names, roles and times, never the keys themselves."""
    from service.json_text import wrote_json

    now = time.time()
    found: list[dict[str, Any]] = [
        {
            "id": key.id,
            "name": key.name,
            "role": key.role.value,
            "state": key.state(now),
            "created": _text(key.created),
            "expires": _text(key.expires),
            "revoked": _text(key.revoked),
        }
        for key in _store(data, config).all()
    ]
    if wrote_json(found, json):
        return
    for key in found:
        until = f", expires {key['expires']}" if key["expires"] else ""
        print(f"{key['id']}  {key['state']:8}{key['role']:12}{key['name']}, made {key['created']}{until}")
    if not found:
        print("no keys: only clients of this computer are let in")


@app.command()
def revoke(which: Which, data: Data = None, config: ConfigFile = None) -> None:
    """Revoke a key: it is refused from now on."""
    key = _store(data, config).revoke(which)
    print(f"revoked: {key.name} ({key.id})")


@app.command()
def remove(which: Which, data: Data = None, config: ConfigFile = None) -> None:
    """Remove a revoked or expired key from the list."""
    key = _store(data, config).remove(which)
    print(f"removed: {key.name} ({key.id})")


def _store(data: Path | None, config: Path | None) -> Any:
    from service.access.keys import KeyStore

    return KeyStore(settings_of(data=data, config=config).data)


def _moment(text: str) -> float:
    """Unix time [s] of a date, or of a number of days from now."""
    from service.errors import InputError

    days = re.fullmatch(r"(\d{1,5})d", text)
    if days:
        return time.time() + int(days[1]) * DAY
    try:
        found = datetime.fromisoformat(text)
    except ValueError:
        raise InputError(f"--expires {text!r} must be a date such as 2027-01-31, or days such as 90d") from None
    moment = (found if found.tzinfo else found.replace(tzinfo=UTC)).timestamp()
    if moment <= time.time():
        raise InputError(f"--expires {text!r} is in the past")
    return moment


def _text(moment: float | None) -> str | None:
    return None if moment is None else datetime.fromtimestamp(moment, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
