"""`gear-twin assets`: the machines of a running service, and what people change on them."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any
from urllib.parse import quote, urlencode

import typer

from service.cli.config import configured
from service.cli.rest import LOCAL, JsonFile, Url, asking, call

app = typer.Typer(no_args_is_help=True, help="List the machines of a running service; create, change, rename, retire.")

AssetName = Annotated[str, typer.Argument(metavar="ASSET", help="The asset.")]
NewName = Annotated[str, typer.Argument(metavar="NAME", help="Its new name: letters, digits, '_', '-', '.'.")]
By = Annotated[str | None, typer.Option(help="Your name.", envvar="GEAR_TWIN_NAME", show_default=False)]
Note = Annotated[str | None, typer.Option(help="What was done, and why.")]
DONE, QUEUED = "done", "queued; applied after the current window"


class Kind(StrEnum):
    """What people enter for a machine."""

    gears_replaced = "gears_replaced"
    sensor_moved = "sensor_moved"
    oil_changed = "oil_changed"
    counter_reset = "counter_reset"
    reassembled = "reassembled"
    other_machine = "other_machine"
    ignore = "ignore"


@app.command(name="list")
@asking
def list_(url: Url = LOCAL, json: JsonFile = None) -> None:
    """Show every asset with its status, and the question that waits for an answer."""
    from service.json_text import wrote_json

    found = call(url, "/v1/assets")
    if wrote_json(found, json):
        return
    asked = {a["asset"]: call(url, _path(a["asset"]))["question"] for a in found}
    print("\n".join(asset_lines(found, asked, shutil.get_terminal_size().columns)))


@app.command()
@asking
def create(
    asset: AssetName,
    rig: Annotated[Path | None, typer.Option(help="Rig file of the machine.")] = None,
    by: By = None,
    note: Note = None,
    url: Url = LOCAL,
    json: JsonFile = None,
) -> None:
    """Create an asset before its first frame, with its rig file."""
    from service.files.rig import load_mapping
    from service.json_text import wrote_json

    given: dict[str, Any] = {"asset": asset, "rig": None if rig is None else load_mapping(rig), "by": by, "note": note}
    answer = call(url, "/v1/assets", {name: value for name, value in given.items() if value is not None})
    if not wrote_json(answer, json):
        print(f"{asset} created: publish its frames under this name")


@app.command()
@asking
def unknown(url: Url = LOCAL, json: JsonFile = None) -> None:
    """Show the assets that send frames and are not known: they are left out until somebody adopts them."""
    from service.json_text import wrote_json

    found = call(url, "/v1/unknown-assets")
    if not wrote_json(found, json):
        print("\n".join(unknown_lines(found)))


@app.command()
@asking
def adopt(
    asset: AssetName,
    rig: Annotated[
        str | None, typer.Option(metavar="DIGEST", help="Use the rig file that is offered for it, by its digest.")
    ] = None,
    by: By = None,
    note: Note = None,
    url: Url = LOCAL,
    json: JsonFile = None,
) -> None:
    """Make an unknown asset one of the service's: its frames are used from now on. Needs the role administer."""
    _decide(url, asset, "adopt", "adopted: its frames are used from now on", {"by": by, "note": note, "rig": rig}, json)


@app.command()
@asking
def dismiss(asset: AssetName, by: By = None, note: Note = None, url: Url = LOCAL, json: JsonFile = None) -> None:
    """Take an unknown asset off the list; its frames stay unused. Needs the role administer."""
    _decide(url, asset, "dismiss", "dismissed: its frames stay unused", {"by": by, "note": note}, json)


@app.command()
@asking
def rig(
    asset: Annotated[str | None, typer.Argument(metavar="[ASSET]", help="The asset; default: all.")] = None,
    accept: Annotated[str | None, typer.Option(metavar="DIGEST", help="Use this proposed rig file.")] = None,
    reject: Annotated[str | None, typer.Option(metavar="DIGEST", help="Keep the present one.")] = None,
    by: By = None,
    note: Note = None,
    url: Url = LOCAL,
    json: JsonFile = None,
) -> None:
    """Show rig files that came on the stream, with what differs; accept or reject one (role administer)."""
    from service.errors import InputError
    from service.json_text import wrote_json

    if accept is None and reject is None:
        found = [p for p in call(url, "/v1/rig-proposals") if asset in (None, p["asset"])]
        if not wrote_json(found, json):
            print("\n".join(proposal_lines(found)))
        return
    if asset is None or (accept is not None and reject is not None):
        raise InputError("give the asset, and one of --accept and --reject")
    decision = "accept" if accept is not None else "reject"
    given = {"decision": decision, "digest": accept or reject, "by": by, "note": note}
    body = {name: value for name, value in given.items() if value is not None}
    answer = call(url, f"{_path(asset)}/rig-proposal", body)
    if wrote_json(answer, json):
        return
    asked = (answer["effect"] or {}).get("question")
    then = "; it is of other gears: answer the open question (gear-twin assets list)" if asked else ""
    print(f"rig file {decision}ed for {asset}: {DONE if answer['done'] else QUEUED}{then}")


@app.command()
@asking
def change(
    asset: AssetName,
    kind: Annotated[Kind, typer.Argument(metavar="KIND", help="What was changed, or the answer to the open question.")],
    by: By = None,
    note: Note = None,
    at: Annotated[str | None, typer.Option(help="When it was made, ISO 8601; kept as it is given.")] = None,
    sensor: Annotated[str | None, typer.Option(help="sensor_moved: the accelerometer.")] = None,
    revolutions: Annotated[
        float | None,
        typer.Option(help="gears_replaced: the encoder's count then; counter_reset: revolutions since new then."),
    ] = None,
    count: Annotated[float | None, typer.Option(help="counter_reset: what it was set to, in turns.")] = None,
    name: Annotated[str | None, typer.Option(help="other_machine: the new asset's name.")] = None,
    url: Url = LOCAL,
    json: JsonFile = None,
) -> None:
    """Enter a change of the machine, or answer the question about its data."""
    given = {"by": by, "note": note, "at": at, "sensor": sensor, "revolutions": revolutions, "count": count}
    _change(url, asset, kind.value, {**given, "name": name}, json)


@app.command()
@asking
def changes(asset: AssetName, url: Url = LOCAL, json: JsonFile = None) -> None:
    """Show what people have changed on an asset."""
    from service.json_text import wrote_json

    found = call(url, f"{_path(asset)}/changes")
    if not wrote_json(found, json):
        print("\n".join(change_line(c) for c in found) or f"{asset}: no changes have been entered")


@app.command()
@asking
def rename(
    asset: AssetName, name: NewName, by: By = None, note: Note = None, url: Url = LOCAL, json: JsonFile = None
) -> None:
    """Give an asset another name, with its whole history; frames of its old name still reach it."""
    _change(url, asset, "renamed", {"name": name, "by": by, "note": note}, json)


@app.command()
@asking
def retire(asset: AssetName, by: By = None, note: Note = None, url: Url = LOCAL, json: JsonFile = None) -> None:
    """Take an asset out of use: its history stays, its frames are left out."""
    _change(url, asset, "retired", {"by": by, "note": note}, json)


@app.command()
@asking
def reinstate(asset: AssetName, by: By = None, note: Note = None, url: Url = LOCAL, json: JsonFile = None) -> None:
    """Take a retired asset back into use."""
    _change(url, asset, "reinstated", {"by": by, "note": note}, json)


@app.command()
@configured
@asking
def baseline(
    asset: AssetName,
    recordings: Annotated[
        list[Path] | None, typer.Argument(metavar="RECORDING…", help="Recordings of the healthy machine to learn from.")
    ] = None,
    windows: Annotated[
        str | None, typer.Option(help="Learn from windows of the asset whose signals are kept, such as 0-5,8.")
    ] = None,
    add: Annotated[bool, typer.Option("--add", help="With --windows: the recordings so far take part, too.")] = False,
    remove: Annotated[bool, typer.Option("--remove", help="Leave the asset without a baseline of its own.")] = False,
    by: By = None,
    note: Note = None,
    url: Url = LOCAL,
    json: JsonFile = None,
) -> None:
    """Show an asset's own healthy baseline, learn it from recordings or from its windows, or remove it."""
    from service.cli.baseline_report import learned_text
    from service.errors import InputError
    from service.json_text import wrote_json

    if sum((bool(recordings), windows is not None, remove)) > 1:
        raise InputError("give recordings, --windows or --remove, and one of them alone")
    path = f"{_path(asset)}/baseline"
    signed = {name: value for name, value in (("by", by), ("note", note)) if value is not None}
    if recordings:
        answer = call(url, f"{path}?{urlencode(signed)}", _learned_bytes(recordings), "PUT")
    elif windows is not None:
        answer = call(url, f"{path}/learn", {"windows": numbers_of(windows), "add": add, **signed})
    elif remove:
        answer = call(url, f"{path}?{urlencode(signed)}", method="DELETE")
    else:
        answer = call(url, path)
    if wrote_json(answer, json):
        return
    if not answer["own"]:
        print(f"{asset} has no baseline of its own")
        return
    print(learned_text(answer["baseline"]))


def numbers_of(text: str) -> list[int]:
    """Window numbers of a list such as `0-5,8`."""
    from service.errors import InputError

    out: list[int] = []
    for part in text.split(","):
        first, dash, last = part.strip().partition("-")
        try:
            out += range(int(first), int(last if dash else first) + 1)
        except ValueError:
            raise InputError(f"{part.strip()!r} is no window number or range; 0-5,8 is such a list") from None
    return out


def _learned_bytes(recordings: Sequence[Path]) -> bytes:
    """The file of a baseline learned from recordings."""
    from tempfile import TemporaryDirectory

    from service.cli.assessing import prefix_of, windowing
    from service.files.baseline import learned, save

    with TemporaryDirectory() as folder:
        path = Path(folder) / "learned.baseline"
        save(learned(recordings, None, windowing(), prefix_of(None)), path)
        return path.read_bytes()


# -- text ------------------------------------------------------------------------------------------------


def asset_lines(found: Sequence[Mapping[str, Any]], asked: Mapping[str, Any], width: int) -> list[str]:
    """A line for each asset, and one for its question."""
    if not found:
        return ["no asset has sent a frame yet"]
    longest = max(len(a["asset"]) for a in found)
    lines = []
    for a in found:
        level = "retired" if a["retired"] else a["status"]["level"].replace("_", " ")
        turns = "" if a["revolutions"] is None else f"{a['revolutions']:,.0f} revolutions"
        lines.append(f"{a['asset']:<{longest}}  {level:<11}  {a['windows']:>6} windows  {turns}".rstrip()[:width])
        question = asked.get(a["asset"])
        if question is not None:
            answers = ", ".join(question["answers"])
            lines.append(f"  {question['text']} {question['detail']}")
            lines.append(f"  {question['waiting']} windows wait. Answer: gear-twin assets change {a['asset']} ANSWER")
            lines.append(f"  with one of {answers}")
    return lines


def unknown_lines(found: Mapping[str, Any]) -> list[str]:
    """A line for each unknown asset, and what can be done."""
    if not found["asks"]:
        return ["every asset is adopted with its first frame (setting new_assets)"]
    listed = found["assets"]
    if not listed:
        return ["no unknown asset sends frames"]
    longest = max(len(a["asset"]) for a in listed)
    lines = []
    for a in listed:
        channels = ", ".join(a["channels"]) or "no channel"
        seen = f"{a['first_seen'][:16]} to {a['last_seen'][:16]}".replace("T", " ")
        rig = f"; offers the rig file {a['rig_digest']} ({a['rig_name'] or 'without a name'})" if a["rig"] else ""
        lines.append(f"{a['asset']:<{longest}}  {a['frames']:>8} frames  {seen}  {channels}{rig}")
    return [*lines, "gear-twin assets adopt NAME makes one known; gear-twin assets dismiss NAME takes it off this list"]


def proposal_lines(found: Sequence[Mapping[str, Any]]) -> list[str]:
    """The proposed rig files, each with a line for every value that differs."""
    if not found:
        return ["no rig file waits for a decision"]
    lines = []
    for p in found:
        named = f' "{p["name"]}"' if p["name"] else ""
        lines.append(f"{p['asset']}: rig file {p['digest']}{named}, received {p['received'][:16].replace('T', ' ')}")
        longest = max((len(d["key"]) for d in p["differences"]), default=0)
        for d in p["differences"]:
            present, proposed = (_absent(d[name]) for name in ("present", "proposed"))
            lines.append(f"  {d['key']:<{longest}}  {present} -> {proposed}")
    return [*lines, "gear-twin assets rig ASSET --accept DIGEST uses one; --reject DIGEST keeps the present one"]


def _absent(value: str | None) -> str:
    return "absent" if value is None else value


def change_line(change: Mapping[str, Any]) -> str:
    """One change in one line."""
    named = ("by", "at", "sensor", "revolutions", "count", "name", "note")
    said = [f"{name} {change[name]}" for name in named if change.get(name) is not None]
    done = "" if change["done"] else f" ({QUEUED})"
    kind = change["kind"].replace("_", " ")
    return f"{change['received'][:16].replace('T', ' ')}  {kind}{done}  {'; '.join(said)}".rstrip()


# -- within ----------------------------------------------------------------------------------------------


def _path(asset: str) -> str:
    return f"/v1/assets/{quote(asset, safe='')}"


def _decide(url: str, asset: str, action: str, done: str, given: Mapping[str, str | None], json: Path | None) -> None:
    from service.json_text import wrote_json

    body = {name: value for name, value in given.items() if value is not None}
    answer = call(url, f"/v1/unknown-assets/{quote(asset, safe='')}/{action}", body)
    if not wrote_json(answer, json):
        print(f"{asset} {done}")


def _change(url: str, asset: str, kind: str, given: Mapping[str, Any], json: Path | None) -> None:
    from service.json_text import wrote_json

    body = {"kind": kind} | {name: value for name, value in given.items() if value is not None}
    answer = call(url, f"{_path(asset)}/changes", body)
    if not wrote_json(answer, json):
        print(f"{kind} of {asset}: {DONE if answer['done'] else QUEUED}")
