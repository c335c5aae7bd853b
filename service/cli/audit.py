"""`gear-twin audit`: who changed what on a running service, when and why."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

import typer

from service.cli.rest import LOCAL, JsonFile, Url, call


def audit(
    after: Annotated[
        int | None, typer.Option(min=0, help="Only entries behind this number, oldest first; default: the newest.")
    ] = None,
    limit: Annotated[int, typer.Option(min=1, max=10_000, help="At most so many entries.")] = 100,
    url: Url = LOCAL,
    json: JsonFile = None,
) -> None:
    """Show the audit log of a running service: who changed what, when and why. Needs the role administer."""
    from service.json_text import wrote_json

    cursor = "" if after is None else f"&after={after}"
    found = call(url, f"/v1/audit?limit={limit}{cursor}")
    if not wrote_json(found, json):
        print("\n".join(entry_line(entry) for entry in found) or "no entries")


def entry_line(entry: Mapping[str, Any]) -> str:
    """One entry in one line."""
    when = entry["at"][:19].replace("T", " ")
    who = entry["name"] or {"local": "this computer"}.get(entry["kind"], entry["kind"])
    role = f" ({entry['role']})" if entry["role"] else ""
    where = f" from {entry['address']}" if entry["address"] else ""
    asset = f" {entry['asset']}" if entry["asset"] else ""
    what = ", ".join(f"{key} {value}" for key, value in entry["what"].items() if value not in (None, "", [], {}))
    note = f"; {entry['note']}" if entry["note"] else ""
    return (
        f"{entry['id']:>6}  {when} UTC  {who}{role}{where}: {entry['action']}{asset}: {what}{note}: {entry['outcome']}"
    )
