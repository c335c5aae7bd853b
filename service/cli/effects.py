"""`gear-twin effects`: what a running service has added to its twins, and an engineer's decisions."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Annotated, Any
from urllib.error import HTTPError, URLError
from urllib.parse import quote
from urllib.request import Request, urlopen

import typer

app = typer.Typer(no_args_is_help=True, help="Effects in the twins of a running service: list them, decide on them.")

Url = Annotated[str, typer.Option(help="Address of the service.", envvar="GEAR_TWIN_URL")]
AssetName = Annotated[str, typer.Argument(metavar="ASSET", help="The asset.")]
EffectName = Annotated[str, typer.Argument(metavar="NAME", help="The effect, such as misalignment.")]
JsonFlag = Annotated[bool, typer.Option("--json", help="Print the answer as JSON.")]
LOCAL = "http://127.0.0.1:8080"
WAIT = 60.0  # [s]


@app.command(name="list")
def list_(
    asset: Annotated[str | None, typer.Argument(metavar="ASSET", help="The asset; all where none is given.")] = None,
    url: Url = LOCAL,
    json: JsonFlag = False,
) -> None:
    """Show the effects with what speaks for them."""
    from rich.console import Console

    from service.cli.diagnosis import effect_table
    from service.jsontext import json_text

    names = [asset] if asset else [a["asset"] for a in _call(url, "/v1/assets")]
    found = {name: _call(url, f"/v1/assets/{quote(name)}/effects") for name in names}
    if json:
        print(json_text(found))
        return
    console = Console()
    for name, effects in found.items():
        if not effects:
            console.print(f"{name}: no effect beside wear")
        else:
            console.print(effect_table(effects, title=f"Effects in the twin of {name}"))


@app.command()
def accept(asset: AssetName, name: EffectName, url: Url = LOCAL, json: JsonFlag = False) -> None:
    """Confirm an effect: it stays, its numbers may be refined."""
    _decide(url, asset, name, "accept", json)


@app.command()
def reject(asset: AssetName, name: EffectName, url: Url = LOCAL, json: JsonFlag = False) -> None:
    """Take an effect out of the twin; it is not added again until released."""
    _decide(url, asset, name, "reject", json)


@app.command()
def pin(asset: AssetName, name: EffectName, url: Url = LOCAL, json: JsonFlag = False) -> None:
    """Keep an effect with these very numbers, whatever later windows say."""
    _decide(url, asset, name, "pin", json)


@app.command()
def release(asset: AssetName, name: EffectName, url: Url = LOCAL, json: JsonFlag = False) -> None:
    """Let the data decide on an effect again."""
    _decide(url, asset, name, "release", json)


def _decide(url: str, asset: str, name: str, verb: str, as_json: bool) -> None:
    from service.jsontext import json_text

    answer = _call(url, f"/v1/assets/{quote(asset)}/effects/{quote(name)}", {"decision": verb})
    if as_json:
        print(json_text(answer))
    else:
        when = "done" if answer["done"] else "kept; it is carried out after the window in work"
        print(f"{verb} {name} of {asset}: {when}")


def _call(url: str, path: str, body: Mapping[str, Any] | None = None) -> Any:
    """The service's answer; InputError with its own words where it refuses, or where nothing answers."""
    from service.errors import InputError

    data = None if body is None else json.dumps(body).encode()
    try:
        request = Request(url.rstrip("/") + path, data, {"Content-Type": "application/json"})
        with urlopen(request, timeout=WAIT) as response:
            return json.load(response)
    except HTTPError as error:
        try:
            detail = json.load(error)["detail"]
        except (ValueError, KeyError, TypeError):
            detail = f"status {error.code}"
        raise InputError(f"{url}: {detail}") from None
    except (URLError, OSError, ValueError) as error:
        why = getattr(error, "reason", error)
        raise InputError(f"{url}: no service answers there: {str(why).lower()}; --url sets its address") from None
