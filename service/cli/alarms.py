"""`gear-twin alarms`: the alarms of a running service, what people do about them, and the rules that raise them."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any
from urllib.parse import quote

import typer

from service.cli.rest import LOCAL, JsonFile, Url, asking, call

app = typer.Typer(no_args_is_help=True, help="List the alarms of a running service, acknowledge and clear them.")

Number = Annotated[int, typer.Argument(metavar="NUMBER", min=1, help="Number of the alarm, as listed.")]
By = Annotated[str, typer.Option(help="Your name.", envvar="GEAR_TWIN_NAME", show_default=False)]
Note = Annotated[str, typer.Option(help="What you saw or did.")]
AssetName = Annotated[str, typer.Argument(metavar="ASSET", help="The asset.")]
STATES = {
    "active_unacknowledged": "active",
    "active_acknowledged": "active, acknowledged",
    "returned_unacknowledged": "ended, not acknowledged",
    "closed": "closed",
}
BASES = {"criterion": "by the criterion of the status", "learned": "limits learned", "fixed": "limits stated"}


@app.command(name="list")
@asking
def list_(
    asset: Annotated[str | None, typer.Argument(metavar="ASSET", help="The asset; all where none is given.")] = None,
    everything: Annotated[bool, typer.Option("--all", help="Closed alarms, too.")] = False,
    url: Url = LOCAL,
    json: JsonFile = None,
) -> None:
    """Show the open alarms, the most urgent first."""
    from service.json_text import wrote_json

    path = "/v1/alarms" if asset is None else f"/v1/assets/{quote(asset, safe='')}/alarms"
    found = call(url, f"{path}?state={'all' if everything else 'open'}")
    if not wrote_json(found, json):
        print("\n".join(alarm_lines(found, shutil.get_terminal_size().columns)))


@app.command()
@asking
def acknowledge(number: Number, by: By, note: Note = "", url: Url = LOCAL, json: JsonFile = None) -> None:
    """Acknowledge an alarm by name: it stays listed while its quantity is beyond the limit."""
    _sign(url, number, "acknowledge", by, note, json)


@app.command()
@asking
def clear(number: Number, by: By, note: Note = "", url: Url = LOCAL, json: JsonFile = None) -> None:
    """Clear an alarm by name, after a repair; it is raised again if its cause lasts."""
    _sign(url, number, "clear", by, note, json)


@app.command()
@asking
def rules(
    asset: AssetName,
    file: Annotated[
        Path | None, typer.Option("--set", help="File of rules (TOML) that the asset is to have from now on.")
    ] = None,
    by: Annotated[str | None, typer.Option(help="Your name; with --set.", envvar="GEAR_TWIN_NAME")] = None,
    note: Note = "",
    url: Url = LOCAL,
    json: JsonFile = None,
) -> None:
    """Show the alarm rules of an asset with the limits learned so far, or set them from a file."""
    from service.alarms.rules import load_rules
    from service.errors import InputError
    from service.json_text import wrote_json

    path = f"/v1/assets/{quote(asset, safe='')}/alarm-rules"
    if file is None:
        found = call(url, path)
    else:
        if not by:
            raise InputError("--by is missing: rules are changed by name")
        given = [rule.model_dump(exclude_none=True) for rule in load_rules(file)]
        found = call(url, path, {"by": by, "note": note, "rules": given}, method="PUT")
    if not wrote_json(found, json):
        print("\n".join(rule_lines(found)))


def alarm_lines(alarms: Sequence[Mapping[str, Any]], width: int) -> list[str]:
    """Alarms as text: one block each, in lines of at most `width` characters."""
    import textwrap

    if not alarms:
        return ["no open alarm"]
    lines: list[str] = []
    for alarm in alarms:
        head = f"{alarm['id']:>4}  {alarm['level'].upper():5}  {alarm['asset']}  {alarm['quantity'].replace('_', ' ')}"
        place = f" ({alarm['place']})" if alarm["place"] else ""
        lines.append(f"{head}{place}, {STATES[alarm['state']]}, since {alarm['raised_at'][:19].replace('T', ' ')} UTC")
        said = [alarm["reason"], alarm["action"]] + [
            f"{word} by {signed['by']} at {signed['at'][:19].replace('T', ' ')} UTC"
            + (f": {signed['note']}" if signed["note"] else "")
            for word, signed in (("Acknowledged", alarm.get("acknowledgement")), ("Cleared", alarm.get("clearance")))
            if signed
        ]
        for text in filter(None, said):
            indent = " " * 6
            lines += textwrap.wrap(text, max(width, 40), initial_indent=indent, subsequent_indent=indent)
    return lines


def rule_lines(found: Mapping[str, Any]) -> list[str]:
    """The rules of an asset as text, each with what it has learned."""
    at = f"{(found['at'] or '')[:19].replace('T', ' ')} UTC"
    signed = f"set by {found['by']} at {at}" if found["own"] else "those of the service"
    lines = [f"Alarm rules: {signed}"]
    for rule in found["rules"]:
        lines.append(f"  {rule['name']}: {_rule(rule)}")
        for point in found["learning"]:
            if point["rule"] == rule["name"]:
                lines.append(f"    {_learned(point)}")
    return lines


def _rule(rule: Mapping[str, Any]) -> str:
    limits = ", ".join(f"{name} {rule[name]:g}" for name in ("watch", "alarm") if rule.get(name) is not None)
    basis = limits or BASES[rule["basis"]]
    place = "" if rule["place"] == "*" else f" of {rule['place']}"
    often = "at once" if rule["windows"] == 1 else f"{rule['windows']} windows in a row"
    off = "" if rule["enabled"] else "; switched off"
    depth = "; only without a known wear depth" if rule["without_depth"] else ""
    return f"{rule['quantity'].replace('_', ' ')}{place}: {basis}; {often}{depth}{off}"


def _learned(point: Mapping[str, Any]) -> str:
    known = [(point[key], unit) for key, unit in (("speed_hz", "Hz"), ("torque_nm", "N·m"))]
    at = [f"{value:.3g} {unit}" for value, unit in known if value is not None]
    where = " at ".join(part for part in (point["place"], ", ".join(at)) if part)
    limits = "" if point.get("watch") is None else f" (watch {point['watch']:.4g}, alarm {point['alarm']:.4g})"
    return f"{where}: {point['text']}{limits}"


def _sign(url: str, number: int, verb: str, by: str, note: str, json: Path | None) -> None:
    from service.errors import InputError
    from service.json_text import wrote_json

    known = {alarm["id"]: alarm["asset"] for alarm in call(url, "/v1/alarms")}
    if number not in known:
        numbers = ", ".join(map(str, sorted(known))) or "none"
        raise InputError(f"{url}: no alarm {number} is open; open alarms: {numbers}")
    path = f"/v1/assets/{quote(known[number], safe='')}/alarms/{number}/{verb}"
    answer = call(url, path, {"by": by, "note": note})
    if not wrote_json(answer, json):
        print(f"alarm {number} of {answer['asset']}: {STATES[answer['state']]}")
