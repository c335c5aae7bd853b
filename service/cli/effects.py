"""`gear-twin effects`: the effects that a running service has found, and an engineer's decisions on them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated
from urllib.parse import quote

import typer

from service.cli.rest import LOCAL, JsonFile, Url, call

app = typer.Typer(no_args_is_help=True, help="List the effects that a running service has found, and decide on them.")

Names = Annotated[
    list[str],
    typer.Argument(
        metavar="[ASSET] NAME",
        help="The effect, such as misalignment; before it the asset, if the service has several.",
    ),
]


@app.command(name="list")
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
def accept(names: Names, url: Url = LOCAL, json: JsonFile = None) -> None:
    """Confirm an effect: it stays, its size may still be refined."""
    _decide(url, names, "accept", json)


@app.command()
def reject(names: Names, url: Url = LOCAL, json: JsonFile = None) -> None:
    """Remove an effect from the model; it is not added again until released."""
    _decide(url, names, "reject", json)


@app.command()
def pin(names: Names, url: Url = LOCAL, json: JsonFile = None) -> None:
    """Keep an effect with exactly these numbers, whatever later windows show."""
    _decide(url, names, "pin", json)


@app.command()
def release(names: Names, url: Url = LOCAL, json: JsonFile = None) -> None:
    """Let the data decide on an effect again."""
    _decide(url, names, "release", json)


def _decide(url: str, names: list[str], verb: str, json: Path | None) -> None:
    from service.errors import InputError
    from service.json_text import wrote_json

    *before, name = names
    if len(before) > 1:
        raise InputError(f"{' '.join(names)}: one effect at a time, after its asset's name")
    asset = before[0] if before else _only_asset(url)
    answer = call(url, f"/v1/assets/{quote(asset, safe='')}/effects/{quote(name, safe='')}", {"decision": verb})
    if not wrote_json(answer, json):
        when = "done" if answer["done"] else "queued; applied after the current window"
        print(f"{verb} {name} of {asset}: {when}")


def _only_asset(url: str) -> str:
    """The service's asset, where it has one alone."""
    from service.errors import InputError

    known = [a["asset"] for a in call(url, "/v1/assets")]
    if len(known) != 1:
        what = f"name one of its assets: {', '.join(known)}" if known else "no asset has sent a frame yet"
        raise InputError(f"{url}: {what}")
    return known[0]
