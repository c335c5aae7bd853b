"""`gear-twin remote alarms`, `effects` and `audit`: what a running service has found, and what people decide on it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from typer import Argument, Option

from service.cli.assessing import Shown
from service.cli.rest import DONE, QUEUED, AssetName, By, Service, asking
from service.errors import InputError
from service.report.words import listed, wrapped

app = typer.Typer(no_args_is_help=True, help="List the alarms of a running service, acknowledge and clear them.")
effects = typer.Typer(
    no_args_is_help=True, help="List the effects that a running service has found, and decide on them."
)

Number = Annotated[int, Argument(metavar="NUMBER", min=1, help="Number of the alarm, as listed.")]
ByName = Annotated[str, Option(help="Your name.", envvar="GEAR_TWIN_NAME", show_default=False)]
Done = Annotated[str, Option(help="What you saw or did.")]
Every = Annotated[str | None, Argument(metavar="ASSET", help="The asset; all where none is given.")]
Only = Annotated[str | None, Argument(metavar="ASSET", help="The asset, if the service has several.")]
Names = Annotated[
    list[str],
    Argument(
        metavar="[ASSET] NAME",
        help="The effect, such as misalignment; before it the asset, if the service has several.",
    ),
]
Why = Annotated[str | None, Option(help="What you saw, or why.")]
VERBS = {
    "accept": "Confirm an effect: it stays, its size may still be refined.",
    "reject": "Remove an effect from the model; it is not added again until released.",
    "pin": "Keep an effect with exactly these numbers, whatever later windows show.",
    "release": "Let the data decide on an effect again.",
}
DECIDED = "received_ns decision name done by note"
AUDITED = "id at name kind role address action asset what outcome note"
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
    service: Service,
    asset: Every = None,
    everything: Annotated[bool, Option("--all", help="Closed alarms, too.")] = False,
) -> Shown:
    """Show the open alarms, the most urgent first."""
    path = ("alarms",) if asset is None else ("assets", asset, "alarms")
    found = service.ask(*path, state="all" if everything else "open")
    return Shown(found, lambda: alarm_lines(found))


@app.command()
@asking
def acknowledge(service: Service, number: Number, by: ByName, note: Done = "") -> Shown:
    """Acknowledge an alarm by name: it stays listed while its quantity is beyond the limit."""
    return _signed(service, number, "acknowledge", by, note)


@app.command()
@asking
def clear(service: Service, number: Number, by: ByName, note: Done = "") -> Shown:
    """Clear an alarm by name, after a repair; it is raised again if its cause lasts."""
    return _signed(service, number, "clear", by, note)


@app.command()
@asking
def rules(
    service: Service,
    asset: AssetName,
    file: Annotated[
        Path | None, Option("--set", help="File of rules (TOML) that the asset is to have from now on.")
    ] = None,
    by: Annotated[str | None, Option(help="Your name; with --set.", envvar="GEAR_TWIN_NAME")] = None,
    note: Done = "",
) -> Shown:
    """Show the alarm rules of an asset with the limits learned so far, or set them from a file."""
    from service.alarms.rules import load_rules

    body = None
    if file is not None:
        if not by:
            raise InputError("--by is missing: rules are changed by name")
        body = {"by": by, "note": note, "rules": [rule.model_dump(exclude_none=True) for rule in load_rules(file)]}
    found = service.ask("assets", asset, "alarm-rules", body=body, method="PUT" if body else "GET")
    return Shown(found, lambda: rule_lines(found))


def _signed(service: Service, number: int, verb: str, by: str, note: str) -> Shown:
    known = {alarm["id"]: alarm["asset"] for alarm in service.ask("alarms")}
    if number not in known:
        numbers = ", ".join(map(str, sorted(known))) or "none"
        raise InputError(f"{service.url}: no alarm {number} is open; open alarms: {numbers}")
    answer = service.ask("assets", known[number], "alarms", number, verb, body={"by": by, "note": note})
    return Shown(answer, lambda: f"alarm {number} of {answer['asset']}: {STATES[answer['state']]}")


# -- effects ---------------------------------------------------------------------------------------------


@effects.command(name="list")
@asking
def list_effects(service: Service, asset: Every = None) -> Shown:
    """Show the effects with their evidence."""
    from service.report.text import effect_lines

    names = [asset] if asset else [a["asset"] for a in service.ask("assets")]
    found = {name: service.ask("assets", name, "effects") for name in names}
    return Shown(found, lambda: [line for name in found for line in effect_lines(name, found[name])])


def _deciding(verb: str, text: str) -> None:
    @asking
    def decide(service: Service, names: Names, by: By = None, note: Why = None) -> Shown:
        *before, name = names
        if len(before) > 1:
            raise InputError(f"{' '.join(names)}: one effect at a time, after its asset's name")
        asset = before[0] if before else service.only_asset()
        answer = service.ask("assets", asset, "effects", name, body={"decision": verb, "by": by, "note": note})
        return Shown(answer, lambda: f"{verb} {name} of {asset}: {DONE if answer['done'] else QUEUED}")

    effects.command(name=verb, help=text)(decide)


for _verb, _text in VERBS.items():
    _deciding(_verb, _text)


@effects.command()
@asking
def decisions(service: Service, asset: Only = None) -> Shown:
    """Show what people have decided on an asset's effects, oldest first."""
    name = asset or service.only_asset()
    found = service.ask("assets", name, "decisions")
    return Shown(found, lambda: listed(found, DECIDED) or f"{name}: no decisions have been entered")


@asking
def audit(
    service: Service,
    after: Annotated[
        int | None, Option(min=0, help="Only entries behind this number, oldest first; default: the newest.")
    ] = None,
    limit: Annotated[int, Option(min=1, max=10_000, help="At most so many entries.")] = 100,
) -> Shown:
    """Show the audit log of a running service: who changed what, when and why. Needs the role administer."""
    found = service.ask("audit", limit=limit, after=after)
    return Shown(found, lambda: listed(found, AUDITED) or "no entries")


# -- text ------------------------------------------------------------------------------------------------


def alarm_lines(alarms: Sequence[Mapping[str, Any]]) -> list[str]:
    """Alarms as text, one block each."""
    lines: list[str] = []
    for alarm in alarms:
        head = f"{alarm['id']:>4}  {alarm['level'].upper():5}  {alarm['asset']}  {alarm['quantity'].replace('_', ' ')}"
        place = f" ({alarm['place']})" if alarm["place"] else ""
        lines.append(f"{head}{place}, {STATES[alarm['state']]}, since {_second(alarm['raised_at'])}")
        said = [alarm["reason"], alarm["action"]]
        for word, signed in (("Acknowledged", alarm.get("acknowledgement")), ("Cleared", alarm.get("clearance"))):
            if signed:
                note = f": {signed['note']}" if signed["note"] else ""
                said.append(f"{word} by {signed['by']} at {_second(signed['at'])}{note}")
        lines += [line for text in said for line in wrapped(text, 6)]
    return lines or ["no open alarm"]


def rule_lines(found: Mapping[str, Any]) -> list[str]:
    """The rules of an asset as text, each with what it has learned."""
    signed = f"set by {found['by']} at {_second(found['at'])}" if found["own"] else "those of the service"
    lines = [f"Alarm rules: {signed}"]
    for rule in found["rules"]:
        lines.append(f"  {rule['name']}: {_rule(rule)}")
        lines += [f"    {_learned(point)}" for point in found["learning"] if point["rule"] == rule["name"]]
    return lines


def _rule(rule: Mapping[str, Any]) -> str:
    limits = ", ".join(f"{name} {rule[name]:g}" for name in ("watch", "alarm") if rule.get(name) is not None)
    place = "" if rule["place"] == "*" else f" of {rule['place']}"
    often = "at once" if rule["windows"] == 1 else f"{rule['windows']} windows in a row"
    off = "" if rule["enabled"] else "; switched off"
    depth = "; only without a known wear depth" if rule["without_depth"] else ""
    return f"{rule['quantity'].replace('_', ' ')}{place}: {limits or BASES[rule['basis']]}; {often}{depth}{off}"


def _learned(point: Mapping[str, Any]) -> str:
    known = [(point[key], unit) for key, unit in (("speed_hz", "Hz"), ("torque_nm", "N·m"))]
    at = [f"{value:.3g} {unit}" for value, unit in known if value is not None]
    where = " at ".join(part for part in (point["place"], ", ".join(at)) if part)
    limits = "" if point.get("watch") is None else f" (watch {point['watch']:.4g}, alarm {point['alarm']:.4g})"
    return f"{where}: {point['text']}{limits}"


def _second(text: str | None) -> str:
    return f"{(text or '')[:19].replace('T', ' ')} UTC"
