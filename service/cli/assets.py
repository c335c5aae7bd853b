"""`gear-twin remote assets`: the machines of a running service, and what people change on them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from typer import Argument, Option

from service.cli.assessing import Shown
from service.cli.config import configured
from service.cli.rest import DONE, QUEUED, AssetName, By, Service, asking
from service.errors import InputError
from service.report.words import listed, moment, table

app = typer.Typer(no_args_is_help=True, help="List the machines of a running service; create, change, rename, retire.")

Kind = Literal[
    "gears_replaced", "sensor_moved", "oil_changed", "counter_reset", "reassembled", "other_machine", "ignore"
]  # what people enter for a machine
NewName = Annotated[str, Argument(metavar="NAME", help="Its new name: letters, digits, '_', '-', '.'.")]
Note = Annotated[str | None, Option(help="What was done, and why.")]
CHANGED = "received kind done by at sensor revolutions count name note"  # what is told of a change


@app.command(name="list")
@asking
def list_(service: Service) -> Shown:
    """Show every asset with its status, and the question that waits for an answer."""
    found = service.ask("assets")
    return Shown(found, lambda: asset_lines(found, [service.ask("assets", a["asset"])["question"] for a in found]))


@app.command()
@asking
def create(
    service: Service,
    asset: AssetName,
    rig: Annotated[Path | None, Option(help="Rig file of the machine.")] = None,
    by: By = None,
    note: Note = None,
) -> Shown:
    """Create an asset before its first frame, with its rig file."""
    from service.files.rig import load_mapping

    known = None if rig is None else load_mapping(rig)
    answer = service.ask("assets", body={"asset": asset, "rig": known, "by": by, "note": note})
    return Shown(answer, lambda: f"{asset} created: publish its frames under this name")


@app.command()
@asking
def unknown(service: Service) -> Shown:
    """Show the assets that send frames and are not known: they are left out until somebody adopts them."""
    found = service.ask("unknown-assets")
    return Shown(found, lambda: unknown_lines(found))


@app.command()
@asking
def adopt(
    service: Service,
    asset: AssetName,
    rig: Annotated[
        str | None, Option(metavar="DIGEST", help="Use the rig file that is offered for it, by its digest.")
    ] = None,
    by: By = None,
    note: Note = None,
) -> Shown:
    """Make an unknown asset one of the service's: its frames are used from now on. Needs the role administer."""
    answer = service.ask("unknown-assets", asset, "adopt", body={"by": by, "note": note, "rig": rig})
    return Shown(answer, lambda: f"{asset} adopted: its frames are used from now on")


@app.command()
@asking
def dismiss(service: Service, asset: AssetName, by: By = None, note: Note = None) -> Shown:
    """Take an unknown asset off the list; its frames stay unused. Needs the role administer."""
    answer = service.ask("unknown-assets", asset, "dismiss", body={"by": by, "note": note})
    return Shown(answer, lambda: f"{asset} dismissed: its frames stay unused")


@app.command()
@asking
def rig(
    service: Service,
    asset: Annotated[str | None, Argument(metavar="[ASSET]", help="The asset; default: all.")] = None,
    accept: Annotated[str | None, Option(metavar="DIGEST", help="Use this proposed rig file.")] = None,
    reject: Annotated[str | None, Option(metavar="DIGEST", help="Keep the present one.")] = None,
    by: By = None,
    note: Note = None,
) -> Shown:
    """Show rig files that came on the stream, with what differs; accept or reject one (role administer)."""
    if accept is None and reject is None:
        found = [p for p in service.ask("rig-proposals") if asset in (None, p["asset"])]
        return Shown(found, lambda: proposal_lines(found))
    if asset is None or (accept is not None and reject is not None):
        raise InputError("give the asset, and one of --accept and --reject")
    decision = "accept" if accept is not None else "reject"
    body = {"decision": decision, "digest": accept or reject, "by": by, "note": note}
    answer = service.ask("assets", asset, "rig-proposal", body=body)
    asked = (answer["effect"] or {}).get("question")
    then = "; it is of other gears: answer the open question (gear-twin remote assets list)" if asked else ""
    return Shown(answer, lambda: f"rig file {decision}ed for {asset}: {DONE if answer['done'] else QUEUED}{then}")


@app.command()
@asking
def change(
    service: Service,
    asset: AssetName,
    kind: Annotated[Kind, Argument(metavar="KIND", help="What was changed, or the answer to the open question.")],
    by: By = None,
    note: Note = None,
    at: Annotated[str | None, Option(help="When it was made, ISO 8601; kept as it is given.")] = None,
    sensor: Annotated[str | None, Option(help="sensor_moved: the accelerometer.")] = None,
    revolutions: Annotated[
        float | None,
        Option(help="gears_replaced: the encoder's count then; counter_reset: revolutions since new then."),
    ] = None,
    count: Annotated[float | None, Option(help="counter_reset: what it was set to, in turns.")] = None,
    name: Annotated[str | None, Option(help="other_machine: the new asset's name.")] = None,
) -> Shown:
    """Enter a change of the machine, or answer the question about its data."""
    given: dict[str, Any] = {"by": by, "note": note, "at": at, "sensor": sensor, "revolutions": revolutions}
    return _changed(service, asset, kind, **given, count=count, name=name)


@app.command()
@asking
def changes(service: Service, asset: AssetName) -> Shown:
    """Show what people have changed on an asset."""
    found = service.ask("assets", asset, "changes")
    return Shown(found, lambda: listed(found, CHANGED) or f"{asset}: no changes have been entered")


@app.command()
@asking
def rename(service: Service, asset: AssetName, name: NewName, by: By = None, note: Note = None) -> Shown:
    """Give an asset another name, with its whole history; frames of its old name still reach it."""
    return _changed(service, asset, "renamed", name=name, by=by, note=note)


@app.command()
@asking
def retire(service: Service, asset: AssetName, by: By = None, note: Note = None) -> Shown:
    """Take an asset out of use: its history stays, its frames are left out."""
    return _changed(service, asset, "retired", by=by, note=note)


@app.command()
@asking
def reinstate(service: Service, asset: AssetName, by: By = None, note: Note = None) -> Shown:
    """Take a retired asset back into use."""
    return _changed(service, asset, "reinstated", by=by, note=note)


def _changed(service: Service, asset: str, kind: str, **given: Any) -> Shown:
    answer = service.ask("assets", asset, "changes", body={"kind": kind, **given})
    return Shown(answer, lambda: f"{kind} of {asset}: {DONE if answer['done'] else QUEUED}")


@app.command()
@configured
@asking
def baseline(
    service: Service,
    asset: AssetName,
    recordings: Annotated[
        list[Path] | None, Argument(metavar="RECORDING…", help="Recordings of the healthy machine to learn from.")
    ] = None,
    windows: Annotated[
        str | None, Option(help="Learn from windows of the asset whose signals are kept, such as 0-5,8.")
    ] = None,
    add: Annotated[bool, Option("--add", help="With --windows: the recordings so far take part, too.")] = False,
    remove: Annotated[bool, Option("--remove", help="Leave the asset without a baseline of its own.")] = False,
    by: By = None,
    note: Note = None,
) -> Shown:
    """Show an asset's own healthy baseline, learn it from recordings or from its windows, or remove it."""
    from service.report.baseline import learned_text

    if sum((bool(recordings), windows is not None, remove)) > 1:
        raise InputError("give recordings, --windows or --remove, and one of them alone")
    path, signed = ("assets", asset, "baseline"), {"by": by, "note": note}
    if recordings:
        answer = service.ask(*path, body=_learned_bytes(recordings), method="PUT", **signed)
    elif windows is not None:
        answer = service.ask(*path, "learn", body={"windows": numbers_of(windows), "add": add, **signed})
    else:
        answer = service.ask(*path, method="DELETE", **signed) if remove else service.ask(*path)
    none = f"{asset} has no baseline of its own"
    return Shown(answer, lambda: learned_text(answer["baseline"]) if answer["own"] else none)


def numbers_of(text: str) -> list[int]:
    """Window numbers of a list such as `0-5,8`."""
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


def asset_lines(found: Sequence[Mapping[str, Any]], asked: Sequence[Any]) -> list[str]:
    """A line for each asset, and the question that waits for an answer below it."""
    rows = []
    for a in found:
        level = "retired" if a["retired"] else a["status"]["level"].replace("_", " ")
        turns = "" if a["revolutions"] is None else f"{a['revolutions']:,.0f} revolutions"
        rows.append((a["asset"], level, f"{a['windows']} windows", turns))
    lines = []
    for a, line, question in zip(found, table(rows, right=(2,)), asked, strict=True):
        lines.append(line)
        if question is not None:
            lines.append(f"  {question['text']} {question['detail']}")
            lines.append(f"  {question['waiting']} windows wait. Answer: gear-twin remote assets change {a['asset']}")
            lines.append(f"  with one of {', '.join(question['answers'])}")
    return lines or ["no asset has sent a frame yet"]


def unknown_lines(found: Mapping[str, Any]) -> list[str]:
    """A line for each unknown asset, and what can be done."""
    if not found["asks"]:
        return ["every asset is adopted with its first frame (setting new_assets)"]
    rows = []
    for a in found["assets"]:
        rig = f"; offers the rig file {a['rig_digest']} ({a['rig_name'] or 'without a name'})" if a["rig"] else ""
        seen = f"{moment(a['first_seen'])} to {moment(a['last_seen'])}"
        rows.append((a["asset"], f"{a['frames']} frames", seen, (", ".join(a["channels"]) or "no channel") + rig))
    if not rows:
        return ["no unknown asset sends frames"]
    how = "gear-twin remote assets adopt NAME makes one known; dismiss in place of adopt takes it off this list"
    return [*table(rows, right=(1,)), how]


def proposal_lines(found: Sequence[Mapping[str, Any]]) -> list[str]:
    """The proposed rig files, each with a line for every value that differs."""
    if not found:
        return ["no rig file waits for a decision"]
    lines = []
    for p in found:
        named = f' "{p["name"]}"' if p["name"] else ""
        lines.append(f"{p['asset']}: rig file {p['digest']}{named}, received {moment(p['received'])}")
        rows = [
            (d["key"], *("absent" if d[n] is None else d[n] for n in ("present", "proposed"))) for d in p["differences"]
        ]
        lines += [f"  {line}" for line in table([(key, f"{before} -> {after}") for key, before, after in rows])]
    return [*lines, "gear-twin remote assets rig ASSET --accept DIGEST uses one; --reject DIGEST keeps the present one"]
