"""`gear-twin import`: a data file into a recording, by a mapping file or by a guess of what its columns are."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from service.cli.assessing import JsonFile, Prefix, asked, prefix_of, tell
from service.cli.config import configured
from service.cli.show import progress_bar
from service.errors import InputError
from service.json_text import write_text, wrote_json

_guessing = partial(Option, rich_help_panel="With --guess")
Started = Annotated[
    str | None,
    Option(help="When the file begins, such as 2026-03-12T08:14:00+01:00; default: as mapping or file states."),
]
Zone = Annotated[
    str | None, Option(help="Zone of a date that is a local time: Europe/Berlin, +01:00, UTC.", show_default=False)
]


@configured
def import_(
    mapping: Annotated[
        Path,
        Argument(
            metavar="MAPPING", help="Mapping file (TOML): which column is which channel; a data file with --guess."
        ),
    ],
    out: Annotated[Path | None, Option(help="MCAP file to write.", show_default=False)] = None,
    source: Annotated[Path | None, Option(help="Data file instead of the one that the mapping names.")] = None,
    age: Annotated[
        str | None,
        Option(
            help="Age of the gears when the file begins: new, 5000 rev (revolutions), 1200 h (hours run), or unknown; "
            "default: the mapping's, of its own file.",
            show_default=False,
        ),
    ] = None,
    started: Started = None,
    zone: Zone = None,
    prefix: Prefix = None,
    json: JsonFile = None,
    guess: Annotated[bool, _guessing("--guess", help="Propose a mapping for a data file and write it.")] = False,
    yes: Annotated[bool, _guessing("--yes", help="Import at once, into NAME.mcap without --out.")] = False,
    teeth: Annotated[str | None, _guessing(help="Tooth counts of pinion and gear, such as 23/57.")] = None,
    speed: Annotated[str | None, _guessing(help="Pinion speed, in Hz or as 1752rpm.")] = None,
    rig: Annotated[Path | None, _guessing(help="Rig file, in place of --teeth and --speed.")] = None,
    rate: Annotated[
        float | None, _guessing(help="Sample rate in Hz, of a file without a time column.", min=0.0)
    ] = None,
    tachometer: Annotated[str | None, _guessing(help="Shaft of the tachometer: pinion or gear.")] = None,
    pulses_per_rev: Annotated[int, _guessing(help="Pulses per turn, or counts of a counter.", min=1)] = 1,
    asset: Annotated[str | None, _guessing(help="Name of the machine; default: the file's name.")] = None,
    write: Annotated[Path | None, _guessing(help="Mapping file to write; default: NAME.toml.")] = None,
    force: Annotated[bool, _guessing("--force", help="Replace a mapping file that is there.")] = False,
) -> None:
    """Convert a data file (CSV, MAT, WAV, TDMS, HDF5, …) into a recording."""
    said: dict[str, Any] = {}
    if guess:
        age = age or _asked_age(yes)
        given = {
            "teeth": _teeth(teeth), "speed": _speed(speed), "rig": rig, "rate": rate, "shaft": tachometer,
            "asset": asset, "age": age, "zone": zone, "ask": None if yes or started else _zone_asked(),
        }  # fmt: skip
        path, said = _proposed(mapping, write, force, pulses_per_rev, given, quiet=str(json) == "-")
        if out is None and yes:
            out = Path(f"{_stem(mapping)}.mcap")
        mapping = path
    elif out is None:
        raise InputError("--out must name the MCAP file to write; or --guess: propose a mapping for a data file")
    if out is not None:
        dated: dict[str, Any] = {"started": started, "zone": zone, "ask": None if yes else _zone_asked()}
        said |= _imported(mapping, out, source, prefix_of(prefix), age, dated, quiet=str(json) == "-")
    wrote_json(said, json)


def _asked_age(yes: bool) -> str | None:
    """The age of the gears as a person at a terminal types it; None where nobody is asked."""
    from service.files.rig import age_of

    if yes or not sys.stdin.isatty():
        return None
    question = "Age of the gears when the file begins (new / such as 5000 rev or 1200 h / unknown)"
    return asked(question, "unknown", lambda given: age_of("age", given, speed_hz=1.0))


def _zone_asked() -> Callable[[str], str] | None:
    """Asks a person at a terminal for a zone; None where nobody can be asked."""
    from service.files.dates import zone_of

    if not sys.stdin.isatty():
        return None
    return lambda said: asked(f"{said}. Its zone (such as Europe/Berlin or +01:00)", "UTC", zone_of)


def _zone_of(began: datetime | None, data: Path, ask: Callable[[str], str] | None) -> str | None:
    """The zone of a file's own date, where that is a local time and somebody can be asked."""
    from service.files.dates import without_zone

    if began is None or began.tzinfo is not None or ask is None:
        return None
    return ask(without_zone(str(data), began))


def _stem(path: Path) -> str:
    return path.name.partition(".")[0] or path.stem


def _teeth(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    found = re.fullmatch(r"\s*(\d+)\s*[/:,x]\s*(\d+)\s*", text)
    if not found or min(int(found[1]), int(found[2])) < 5:
        raise InputError(f"--teeth {text} must be the tooth counts of pinion and gear, such as 23/57")
    return int(found[1]), int(found[2])


def _speed(text: str | None) -> float | None:
    """A speed in turns a second, from a number in Hz or with its unit."""
    from service.files.guess import SPEEDS

    if text is None:
        return None
    found = re.fullmatch(r"\s*(\d+(?:[.,]\d+)?)\s*(Hz|rpm|1/min|/min|min-1|u/min|rev/min|1/s)?\s*", text, re.IGNORECASE)
    turns = float(found[1].replace(",", ".")) / (60.0 if "m" in (found[2] or "").lower() else 1.0) if found else 0.0
    if not SPEEDS[0] <= turns <= SPEEDS[1]:
        raise InputError(
            f"--speed {text} must be from {SPEEDS[0]:g} to {SPEEDS[1]:g} turns a second, such as 29.2 (Hz) or 1752rpm"
        )
    return turns


def _proposed(
    data: Path, write: Path | None, force: bool, pulses_per_rev: int, given: dict[str, Any], *, quiet: bool
) -> tuple[Path, dict[str, Any]]:
    """The mapping file that was written for a data file, and what is in it."""
    from service.files.guess import plain_name, proposal_of
    from service.files.guess_mapping import Known, check_text, contradicted_speed, mapping_text, with_reference
    from service.files.readers import read_table
    from service.files.rig import load_rig
    from service.stream.channels import SHAFTS

    if given["shaft"] not in (None, *SHAFTS):
        raise InputError(f"--tachometer {given['shaft']} must be {' or '.join(SHAFTS)}")
    if data.suffix == ".toml":
        raise InputError(f"{data} is a mapping file: --guess takes the data file itself")
    if not data.is_file():
        raise InputError(f"{data} does not exist")
    table = read_table(data)
    rig = given["rig"]
    reference = None if rig is None else load_rig(rig).accelerometer
    proposal = with_reference(proposal_of(table, data.name, given["rate"], given["shaft"]), reference)
    path = write or Path(f"{_stem(data)}.toml")
    known = Known(
        asset=given["asset"] or plain_name(_stem(data)),
        path=os.path.relpath(data, path.parent),
        rate=given["rate"],
        teeth=given["teeth"],
        speed=given["speed"],
        rig=None if rig is None else os.path.relpath(rig, path.parent),
        pulses_per_rev=pulses_per_rev,
        age=given["age"],
        zone=given["zone"] or _zone_of(table.started, data, given["ask"]),
    )
    if mistake := contradicted_speed(proposal, known):
        raise InputError(mistake)
    text = mapping_text(proposal, known)
    if not quiet:
        _print_proposal(table, proposal)
    check_text(text, path, table, proposal)
    if path.exists() and not force and path.read_text(encoding="utf-8") != text + "\n":
        raise InputError(f"{path} is there already, with other content; --force replaces it, --write names another")
    write_text(path, text)
    if not quiet:
        print(f"mapping file: {path}")
        if known.teeth is None and rig is None:
            print("Tooth counts are not known: without them there are levels, but no mesh lines (--teeth 23/57).")
    channels = [
        {"columns": list(g.columns), "becomes": g.becomes, "unit": g.unit, "because": g.why, "remark": g.remark}
        for g in proposal.guesses
    ]
    return path, {"mapping": str(path), "format": table.format, "sample_rate_hz": proposal.rate, "proposal": channels}


def _print_proposal(data: Any, proposal: Any) -> None:
    from service.report.words import table

    length = "" if proposal.duration is None else f", {proposal.duration:.6g} s"
    rate = "different rates" if proposal.rate is None else f"{proposal.rate:.9g} Hz ({proposal.rate_from})"
    print(f"{data.format} file, {rate}{length}")
    rows = [
        (
            ", ".join(g.columns),
            g.becomes,
            g.unit if g.scale == 1 else f"{g.scale:g} {g.unit}",
            g.why + (f"; {g.remark}" if g.remark else ""),
        )
        for g in proposal.guesses
    ]
    print("\n".join(table(rows, ("column", "becomes", "unit", "because"))))
    for note in data.notes:
        print(f"note: {note}")


def _imported(
    mapping: Path, out: Path, source: Path | None, prefix: str, age: str | None, dated: dict[str, Any], *, quiet: bool
) -> dict[str, Any]:
    from service.files.import_recording import UNKNOWN_AGE, import_recording

    with progress_bar("importing") as bar:
        found = import_recording(
            mapping,
            out,
            lambda done, whole: bar(done / max(whole, 1e-9), f"{done:.0f} s of {whole:.0f}"),
            source,
            prefix,
            age,
            **dated,
        )
    if not quiet:
        print(f"{found['frames']} frames of {found['duration']:g} s imported: {out}")
    if found["notes"].get("age") == UNKNOWN_AGE:
        tell(UNKNOWN_AGE)
    for label, counts in found["encoders"].items():
        if any(counts.get(fault) for fault in ("illegal_transitions", "reversals", "missed", "doubled")):
            tell(f"{label}: {found['notes'][label]}")
    if undated := found["notes"].get("started"):
        tell(f"started: {undated}")
    for note in found["told"]:
        tell(f"note: {note}")
    for mistake in found["mistakes"]:
        tell(f"likely mistake: {mistake}")
    return found
