"""An answer as text: its summary in sentences, its windows as a table that fits the terminal."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from service.cli import modulation
from service.cli.diagnosis import verdict
from service.cli.encoder_pair import sentences
from service.cli.indicators import indicator_lines
from service.cli.show import number, reason, spread
from service.contract.base import spoken_time

PIPED = 170  # columns where the output is no terminal
MOST_NOTES = 6


class Column(NamedTuple):
    """One column of the window table."""

    title: str
    key: str
    rank: int  # the higher, the sooner it is left out where the terminal is narrow


WINDOW_COLUMNS = (
    Column("#", "index", 0),
    Column("kind", "kind", 3),
    Column("revolutions", "revolutions", 0),
    Column("speed Hz", "speed_hz", 5),
    Column("torque N·m", "torque_nm", 5),
    Column("RMS meas.", "rms_measured", 0),
    Column("RMS pred.", "rms_predicted", 1),
    Column("error %", "error_percent", 2),
    Column("RMS after", "rms_after", 6),
    Column("K 1/N", "k_wear_per_n", 6),
    Column("depth µm", "wear_depth_um", 0),
    Column("updated", "updated", 4),
    Column("data", "quality", 1),
)


def window_rows(records: Iterable[Mapping[str, Any]], columns: Sequence[Column] = WINDOW_COLUMNS) -> list[list[str]]:
    """The cells of the window table."""
    return [[_cell(record.get(column.key), column.key) for column in columns] for record in records]


def _cell(value: Any, key: str) -> str:
    if key == "updated":
        return "yes" if value else ""
    if key == "revolutions" and isinstance(value, (int, float)):
        return f"{value:.0f}"
    return number(value)


def window_table(records: Sequence[Mapping[str, Any]], width: int = PIPED) -> list[str]:
    """The window table in lines of at most `width` characters; columns that hold nothing are left out."""
    columns = [c for c in WINDOW_COLUMNS if any(_cell(r.get(c.key), c.key) not in ("", "–") for r in records)]
    while True:
        rows = [[c.title for c in columns], *window_rows(records, columns)]
        widths = [max(len(row[i]) for row in rows) for i in range(len(columns))]
        if sum(widths) + 2 * (len(columns) - 1) <= width or not any(c.rank for c in columns):
            break
        columns.remove(max(columns, key=lambda c: c.rank))
    return ["  ".join(cell.rjust(w) for cell, w in zip(row, widths, strict=True)) for row in rows]


def summary_lines(answer: Mapping[str, Any]) -> list[str]:
    """The answer in a few sentences, the most important first."""
    counts = answer["data_quality"]["windows"]
    listed = ", ".join(f"{count} {grade}" for grade, count in counts.items() if count)
    return [
        *status_lines(answer.get("status"), answer.get("data")),
        *_wear(answer["wear"], (answer.get("rig") or {}).get("mesh_stiffness")),
        *_life(answer),
        *verdict(answer),
        *could_be_found(answer.get("detectable")),
        *modulation.sentences(answer.get("modulation")),
        f"Windows: {listed or 'none'}",
        *_notes(answer["windows"], answer["wear"].get("reason")),
    ]


def status_lines(status: Any, data: Any = None) -> list[str]:
    """The machine's health with its reasons, what to do, and apart from it whether the data are usable."""
    if not isinstance(status, Mapping) or not status.get("level"):
        return []
    reasons = list(status.get("reasons") or ())
    first = status.get("summary") or " ".join(reasons[:1])
    lines = [f"Status: {status['level'].replace('_', ' ')}. {first}".rstrip()]
    if status.get("action"):
        lines.append(f"Action: {status['action']}")
    lines += [f"  {reason}" for reason in reasons if reason != first]
    verdict = status.get("verdict") or {}
    if verdict.get("window") is not None:
        age = f", {spoken_time(verdict['age_s'])} before the latest window" if verdict.get("age_s") else ""
        lines.append(f"  of window {verdict['window']}, {verdict['start_time'][:16].replace('T', ' ')} UTC{age}")
    if isinstance(data, Mapping) and data.get("level"):
        lines.append(f"Data: {data['level']}; {data.get('reason')}")
    return lines


def _wear(wear: Mapping[str, Any], mesh_stiffness: str | None) -> list[str]:
    depth = wear.get("max_depth_um")
    if not isinstance(depth, Mapping):
        return [f"Wear depth: {reason(wear)}"]
    lines = [
        f"Largest wear depth, both flanks: {spread(depth.get('combined'), 'µm')}",
        f"  pinion {spread(depth.get('pinion'), 'µm')}; gear {spread(depth.get('gear'), 'µm')}",
    ]
    growth = wear.get("growth")
    if growth:
        grown, since = spread(growth["max_depth_um"], "µm"), f"{growth['since_revolutions']:,.0f} revolutions"
        lines.append(f"  grown since the first window that measured it ({since}): {grown}")
    lines += _preliminary(wear.get("preliminary"))
    if wear.get("reason"):
        lines.append(f"  {wear['reason']}")
    if (wear.get("relation") or {}).get("note"):
        lines.append(f"  {wear['relation']['note']}")
    lines += _validity(wear.get("validity"))
    if wear.get("k_wear_per_n") is not None:
        rate = number(wear.get("specific_wear_rate_m2_per_n"))
        lines.append(f"Wear coefficient K = {number(wear['k_wear_per_n'])} 1/N; specific wear rate k = {rate} m²/N")
        if mesh_stiffness:
            lines.append(f"  mesh stiffness: {mesh_stiffness}")
    return lines


def could_be_found(found: Mapping[str, Any] | None) -> list[str]:
    """What the windows would have shown where nothing was found, and the false alarms of a year."""
    return [f"{'  ' if i else ''}{line}" for i, line in enumerate((found or {}).get("said") or ())]


def _validity(validity: Any) -> list[str]:
    """A warning where the depth lies beyond what the model can compute."""
    if not isinstance(validity, Mapping) or validity.get("valid") is not False:
        return []
    why, loss = validity.get("reason"), validity.get("contact_loss_from_um")
    if not why:
        why = "the depth lies beyond the last computed steady state, the wear rate is extrapolated"
        if loss is not None:
            why += f"; the teeth lose contact for part of the mesh cycle from {number(loss)} µm on"
    return [f"  Warning: outside the validity of the model: {why}"]


def _life(answer: Mapping[str, Any]) -> list[str]:
    """Remaining life; what is said of the wear depth, too, is not repeated."""
    life, wear = answer["rul"], answer["wear"]
    return [*_life_itself(life, wear), *_preliminary(life.get("preliminary"), wear.get("preliminary"))]


def _life_name(life: Mapping[str, Any]) -> str:
    return "Remaining life of wear alone, without the damage found" if life.get("of_wear_alone") else "Remaining life"


def _life_itself(life: Mapping[str, Any], wear: Mapping[str, Any]) -> list[str]:
    if isinstance(life.get("hours"), Mapping) and life["hours"].get("median") is None and life.get("reason"):
        hours, revolutions = (number((life.get(key) or {}).get("p05")) for key in ("hours", "revolutions"))
        return [
            f"{_life_name(life)}: at least {hours} h, {revolutions} revolutions (95 % confidence); {life['reason']}"
        ]
    if isinstance(life.get("hours"), Mapping):
        revolutions = spread(life.get("revolutions"), "revolutions")
        return [f"{_life_name(life)}: {spread(life['hours'], 'h')}; {revolutions}"]
    if life.get("reason") and life.get("reason") == wear.get("reason"):
        return ["Remaining life: not available, for the same reason"]
    return [f"Remaining life: {reason(life)}"]


def _preliminary(own: Mapping[str, Any] | None, said: Mapping[str, Any] | None = None) -> list[str]:
    """Why a figure is not established, and what would settle it, without what has been said of another figure."""
    if not own:
        return []
    known = said or {"reasons": [], "remedies": []}
    reasons = [sentence for sentence in own["reasons"] if sentence not in known["reasons"]]
    remedies = [remedy for remedy in own["remedies"] if remedy not in known["remedies"]]
    lines = [f"  Preliminary: {sentence}" for sentence in reasons] or ["  Preliminary, for the same reasons"]
    return [*lines, *([f"  To settle it: {'; '.join(remedies)}"] if remedies else [])]


def _notes(records: Sequence[Mapping[str, Any]], known: str | None) -> list[str]:
    """The notes of windows, each once, without the one that is the reason given already."""
    noted: dict[str, list[str]] = {}
    for record in records:
        for note in record.get("notes") or ():
            if note != known:
                noted.setdefault(str(note), []).append(str(record.get("index")))
    lines = [f"Note on window {_listed(at)}: {note}" for note, at in noted.items()]
    more = len(lines) - MOST_NOTES
    return lines if more <= 0 else [*lines[:MOST_NOTES], f"and {more} more notes (see windows[].notes in the JSON)"]


def _listed(indices: Sequence[str]) -> str:
    return (
        ", ".join(indices) if len(indices) <= MOST_NOTES else f"{indices[0]} to {indices[-1]} ({len(indices)} windows)"
    )


def answer_text(answer: Mapping[str, Any], width: int = PIPED) -> str:
    """Summary, what two encoders show of the pair, the window table and the latest condition indicators."""
    lines = [f"Asset {answer['asset']}", "", *summary_lines(answer), *sentences(answer.get("pair"))]
    if answer["windows"]:
        lines += ["", *window_table(answer["windows"], width)]
    indicators = indicator_lines(answer["windows"])
    if indicators:
        lines += ["", *indicators]
    return "\n".join(lines)


def print_answer(answer: Mapping[str, Any]) -> None:
    """The answer on standard output, as wide as the terminal."""
    print(answer_text(answer, shutil.get_terminal_size().columns if sys.stdout.isatty() else PIPED))
