"""`gear-twin effects`: the effects that a running service has found, and an engineer's decisions on them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any
from urllib.parse import quote

import typer

from service.cli.rest import LOCAL, JsonFile, Url, asking, call

app = typer.Typer(no_args_is_help=True, help="List the effects that a running service has found, and decide on them.")

Names = Annotated[
    list[str],
    typer.Argument(
        metavar="[ASSET] NAME",
        help="The effect, such as misalignment; before it the asset, if the service has several.",
    ),
]
By = Annotated[str | None, typer.Option(help="Your name.", envvar="GEAR_TWIN_NAME", show_default=False)]
Note = Annotated[str | None, typer.Option(help="What you saw, or why.")]
QUEUED = "queued; applied after the current window"


@app.command(name="list")
@asking
def list_(
    asset: Annotated[str | None, typer.Argument(metavar="ASSET", help="The asset; all where none is given.")] = None,
    url: Url = LOCAL,
    json: JsonFile = None,
) -> None:
    """Show the effects with their evidence."""
    from rich.console import Console

    from service.cli.diagnosis import effect_table
    from service.json_text import wrote_json

    names = [asset] if asset else [a["asset"] for a in call(url, "/v1/assets")]
    found = {name: call(url, f"/v1/assets/{quote(name, safe='')}/effects") for name in names}
    if wrote_json(found, json):
        return
    console = Console()
    console = console if console.is_terminal else Console(width=170)
    for name, effects in found.items():
        if not effects:
            console.print(f"{name}: no effect besides wear")
        else:
            console.print(effect_table(effects, title=f"Effects in the twin of {name}"))


@app.command()
@asking
def accept(names: Names, by: By = None, note: Note = None, url: Url = LOCAL, json: JsonFile = None) -> None:
    """Confirm an effect: it stays, its size may still be refined."""
    _decide(url, names, "accept", {"by": by, "note": note}, json)


@app.command()
@asking
def reject(names: Names, by: By = None, note: Note = None, url: Url = LOCAL, json: JsonFile = None) -> None:
    """Remove an effect from the model; it is not added again until released."""
    _decide(url, names, "reject", {"by": by, "note": note}, json)


@app.command()
@asking
def pin(names: Names, by: By = None, note: Note = None, url: Url = LOCAL, json: JsonFile = None) -> None:
    """Keep an effect with exactly these numbers, whatever later windows show."""
    _decide(url, names, "pin", {"by": by, "note": note}, json)


@app.command()
@asking
def release(names: Names, by: By = None, note: Note = None, url: Url = LOCAL, json: JsonFile = None) -> None:
    """Let the data decide on an effect again."""
    _decide(url, names, "release", {"by": by, "note": note}, json)


@app.command()
@asking
def decisions(
    asset: Annotated[str | None, typer.Argument(metavar="ASSET", help="The asset, if the service has several.")] = None,
    url: Url = LOCAL,
    json: JsonFile = None,
) -> None:
    """Show what people have decided on an asset's effects, oldest first."""
    from service.json_text import wrote_json

    asset = asset or _only_asset(url)
    found = call(url, f"/v1/assets/{quote(asset, safe='')}/decisions")
    if not wrote_json(found, json):
        print("\n".join(decision_line(d) for d in found) or f"{asset}: no decisions have been entered")


def decision_line(decision: Mapping[str, Any]) -> str:
    """One decision in one line."""
    from service.contract.base import iso_time

    when = iso_time(decision["received_ns"])[:16].replace("T", " ")
    queued = "" if decision["done"] else f" ({QUEUED})"
    by = f"  by {decision['by']}" if decision.get("by") else ""
    note = f": {decision['note']}" if decision.get("note") else ""
    return f"{when}  {decision['decision']} {decision['name']}{queued}{by}{note}"


def _decide(url: str, names: list[str], verb: str, signed: Mapping[str, str | None], json: Path | None) -> None:
    from service.errors import InputError
    from service.json_text import wrote_json

    *before, name = names
    if len(before) > 1:
        raise InputError(f"{' '.join(names)}: one effect at a time, after its asset's name")
    asset = before[0] if before else _only_asset(url)
    body = {"decision": verb} | {key: text for key, text in signed.items() if text is not None}
    answer = call(url, f"/v1/assets/{quote(asset, safe='')}/effects/{quote(name, safe='')}", body)
    if not wrote_json(answer, json):
        when = "done" if answer["done"] else QUEUED
        print(f"{verb} {name} of {asset}: {when}")


def _only_asset(url: str) -> str:
    """The service's asset, where it has one alone."""
    from service.errors import InputError

    known = [a["asset"] for a in call(url, "/v1/assets")]
    if len(known) != 1:
        what = f"name one of its assets: {', '.join(known)}" if known else "no asset has sent a frame yet"
        raise InputError(f"{url}: {what}")
    return known[0]
