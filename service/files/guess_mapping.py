"""The mapping file of a proposal, as text with a comment on every guess."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from service.errors import InputError
from service.files.documents import Part
from service.files.guess import LEFT_OUT, TACHO, TIME, Guess, Proposal
from service.files.import_columns import columns_of
from service.files.import_mapping import COUNTS, checked_mapping
from service.files.readers import Table
from service.toml_text import key_text, lines_of

UNKNOWN_EDGES = "# edges_per_rev = 1024  # replace: not in the file"

SPEEDS_AGREE = 0.1  # relative difference of a nominal speed and the measured one: load makes motors slip


@dataclass(frozen=True, slots=True, kw_only=True)
class Known:
    """What a person states besides the file."""

    asset: str
    path: str  # of the data file, as the mapping file names it
    rate: float | None = None  # [Hz]
    teeth: tuple[int, int] | None = None  # of pinion and gear
    speed: float | None = None  # of the pinion [Hz]
    rig: str | None = None  # rig file, as the mapping file names it
    pulses_per_rev: int = 1
    age: str | None = None  # of the gears when the file begins
    zone: str | None = None  # of dates that are local times


def with_reference(proposal: Proposal, reference: str | None) -> Proposal:
    """The first accelerometer under the name of the rig file's reference, where none has that name."""
    sensors = [i for i, guess in enumerate(proposal.guesses) if guess.kind == "accel"]
    if reference is None or not sensors or reference in {proposal.guesses[i].name for i in sensors}:
        return proposal
    guesses = list(proposal.guesses)
    first = guesses[sensors[0]]
    remark = "; ".join(t for t in (first.remark, "assumed to be the rig file's reference accelerometer") if t)
    guesses[sensors[0]] = replace(first, name=reference, remark=remark)
    return replace(proposal, guesses=tuple(guesses))


def speed_of(proposal: Proposal, known: Known) -> float | None:
    """The pinion's speed [Hz]: as stated, else by its tachometer, or by the gear's with the tooth counts."""
    if known.speed is not None:
        return known.speed
    for guess in proposal.guesses:
        if guess.kind == TACHO and guess.speed is not None:
            turns = guess.speed / known.pulses_per_rev
            if guess.name == "pinion":
                return turns
            if known.teeth is not None:
                return turns * known.teeth[1] / known.teeth[0]
    return None


def contradicted_speed(proposal: Proposal, known: Known) -> str | None:
    """What is wrong with a stated speed that the file's own tachometer contradicts; None where nothing is."""
    measured = speed_of(proposal, replace(known, speed=None))
    if known.speed is None or measured is None or abs(known.speed / measured - 1) <= SPEEDS_AGREE:
        return None
    meant = "is it in revolutions a minute? " if abs(known.speed / (60 * measured) - 1) <= SPEEDS_AGREE else ""
    return (
        f"--speed {known.speed:g} Hz is contradicted by the file's tachometer, which gives {measured:.4g} Hz; {meant}"
        "state the pinion's speed in Hz, or leave it out where the tachometer is right"
    )


def mapping_text(proposal: Proposal, known: Known) -> str:
    """The mapping file."""
    head = {"schema": "gear-import/1", "asset": known.asset, "rig": known.rig, "age": known.age, "zone": known.zone}
    lines = lines_of(head, {"age": "of the gears when the file begins", "zone": "of dates that are local times"})
    if known.age is None:
        lines.append('# age = "new"  # of the gears when the file begins: also "5000 rev" or "1200 h"; else not known')
    time = proposal.axes[0].name if len(proposal.axes) == 1 else None
    lines += ["", "[file]", *lines_of({"path": known.path, "sample_rate_hz": known.rate, "time_column": time})]
    if proposal.rate is not None:
        lines.append(f"# {proposal.rate:.9g} samples a second, {proposal.rate_from}")
    for guess in proposal.guesses:
        lines += ["", *_channel(guess, known)]
    if known.rig is None:
        lines += ["", *_rig(proposal, known)]
    return "\n".join(lines)


def check_text(text: str, path: Path, table: Table, proposal: Proposal) -> None:
    """InputError where the reader of mapping files, or the data file, would refuse a proposal's mapping file."""
    if all(guess.kind in (TIME, LEFT_OUT) for guess in proposal.guesses):
        why = "; ".join(f"{', '.join(g.columns)}: {g.why}" for g in proposal.guesses if g.kind == LEFT_OUT)
        raise InputError(f"no column of the file can be a channel: {why}")
    document = tomllib.loads(text)
    Part("--asset", document).asset()
    if UNKNOWN_EDGES not in text.splitlines():  # else it says what a person has to add
        columns_of(checked_mapping(document, path), table, document["file"]["path"])


def _channel(guess: Guess, known: Known) -> Sequence[str]:
    columns = ", ".join(guess.columns)
    if guess.kind in (TIME, LEFT_OUT):
        said = f"{columns}: {guess.kind}, {guess.why}"
        return [f"# {' '.join(said.split())}"]
    group = "" if guess.kind == "accel" else f"{guess.kind}."
    head = f"[channels.{group}{key_text(guess.name)}]"
    values: dict[str, Any] = {"column": columns} if len(guess.columns) == 1 else {"columns": guess.columns}
    if guess.kind == TACHO:
        values |= {"pulses_per_rev": known.pulses_per_rev, "edge": "falling" if guess.falling else None}
    else:
        values |= {"unit": guess.unit, "scale": guess.scale if guess.scale != 1 else None}
    counted = guess.unit == COUNTS and known.pulses_per_rev > 1
    if guess.kind == "encoder" and counted:
        values["edges_per_rev"] = known.pulses_per_rev
    lines = [f"{head}  # {guess.why}{'; ' + guess.remark if guess.remark else ''}", *lines_of(values)]
    return [*lines, UNKNOWN_EDGES] if guess.kind == "encoder" and not counted else lines


def _rig(proposal: Proposal, known: Known) -> list[str]:
    """What is known of the gears; comments where it is not."""
    speed = speed_of(proposal, known)
    if known.teeth is None:
        lines = ["# [rig.gears.pinion]  # give the tooth counts: --teeth 23/57", "# teeth = 23", ""]
        lines += ["# [rig.gears.gear]", "# teeth = 57"]
    else:
        lines = ["[rig.gears.pinion]", f"teeth = {known.teeth[0]}", "", "[rig.gears.gear]", f"teeth = {known.teeth[1]}"]
    if speed is None:
        return [*lines, "", "# [rig.operating]", "# pinion_speed_hz = 24.6  # give the speed: --speed 24.6"]
    measured = "" if known.speed is not None else "  # by the tachometer"
    return [*lines, "", "[rig.operating]", f"pinion_speed_hz = {float(f'{speed:.4g}')}{measured}"]
