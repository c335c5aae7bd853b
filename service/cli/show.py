"""What the commands show: progress on standard error, answers as tables on standard output."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any


@contextmanager
def progress_bar(title: str) -> Iterator[Callable[[float, str], None]]:
    """A bar on standard error; call it with the share done and a note."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TextColumn("{task.fields[note]}"),
        TimeElapsedColumn(),
    )
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not sys.stderr.isatty()) as bar:
        task = bar.add_task(title, total=1.0, note="")
        yield lambda share, note: bar.update(task, completed=share, note=note)


def say(line: str) -> None:
    """One line on standard error."""
    print(f"gear-twin: {line}", file=sys.stderr)


def number(value: Any, digits: int = 4) -> str:
    """A number to so many digits, or a dash where there is none."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return "–" if value is None else str(value)
    return f"{value:.{digits}g}"


def spread(value: Any, unit: str) -> str:
    """A median with its 5–95 % band, or why there is none."""
    if not isinstance(value, Mapping) or value.get("median") is None:
        return reason(value)
    return f"{number(value['median'])} {unit} (5–95 %: {number(value.get('p05'))} … {number(value.get('p95'))})"


def reason(value: Any) -> str:
    """Why a quantity is not there."""
    if isinstance(value, Mapping) and value.get("reason"):
        return f"not available: {value['reason']}"
    return "not available"


WINDOW_COLUMNS = (
    ("#", "index"),
    ("kind", "kind"),
    ("revolutions", "revolutions"),
    ("speed Hz", "speed_hz"),
    ("torque N·m", "torque_nm"),
    ("RMS meas.", "rms_measured"),
    ("RMS pred.", "rms_predicted"),
    ("error %", "error_percent"),
    ("RMS after", "rms_after"),
    ("K 1/N", "k_wear_per_n"),
    ("depth µm", "wear_depth_um"),
    ("updated", "updated"),
    ("data", "quality"),
)


def window_rows(records: Iterable[Mapping[str, Any]]) -> list[list[str]]:
    """The cells of the window table."""
    rows = []
    for record in records:
        cells = []
        for _, key in WINDOW_COLUMNS:
            value = record.get(key)
            if key == "updated":
                cells.append("yes" if value else "")
            elif key == "revolutions" and isinstance(value, (int, float)):
                cells.append(f"{value:.0f}")
            else:
                cells.append(number(value))
        rows.append(cells)
    return rows


def summary_lines(answer: Mapping[str, Any]) -> list[str]:
    """The answer in a few sentences."""
    wear, rul, quality = answer["wear"], answer["rul"], answer["data_quality"]
    depth = wear.get("max_depth_um")
    lines = []
    if isinstance(depth, Mapping):
        lines.append(f"Largest wear depth, both flanks: {spread(depth.get('combined'), 'µm')}")
        lines.append(f"  pinion {spread(depth.get('pinion'), 'µm')}; gear {spread(depth.get('gear'), 'µm')}")
        if wear.get("reason"):
            lines.append(f"  {wear['reason']}")
        if (wear.get("relation") or {}).get("note"):
            lines.append(f"  {wear['relation']['note']}")
    else:
        lines.append(f"Wear depth: {reason(wear)}")
    validity = wear.get("validity")
    if isinstance(validity, Mapping) and validity.get("reason"):
        lines.append(f"  not valid: {validity['reason']}")
    if wear.get("k_wear_per_n") is not None:
        rate = number(wear.get("specific_wear_rate_m2_per_n"))
        lines.append(f"Wear coefficient K = {number(wear['k_wear_per_n'])} 1/N; specific wear rate k = {rate} m²/N")
        lines.append(f"  mesh stiffness: {answer['rig']['mesh_stiffness']}")
    if isinstance(rul.get("hours"), Mapping):
        revolutions = spread(rul.get("revolutions"), "revolutions")
        lines.append(f"Remaining life: {spread(rul['hours'], 'h')}; {revolutions}")
    else:
        lines.append(f"Remaining life: {reason(rul)}")
    names = [effect.get("name", "?") for effect in answer["effects"]]
    lines.append(f"Effects added: {', '.join(names) if names else 'none'}")
    counts = ", ".join(f"{count} {grade}" for grade, count in quality["windows"].items() if count)
    lines.append(f"Windows: {counts or 'none'}")
    return lines


def print_answer(answer: Mapping[str, Any]) -> None:
    """The window table, the summary, and what two encoders tell of the pair."""
    from rich.console import Console
    from rich.table import Table

    from service.cli.encoder_pair import sentences

    console = Console()
    console = console if console.is_terminal else Console(width=170)
    table = Table(title=f"Asset {answer['asset']}")
    for title, _ in WINDOW_COLUMNS:
        table.add_column(title, justify="left" if title in ("kind", "data", "updated") else "right")
    for row in window_rows(answer["windows"]):
        table.add_row(*row)
    console.print(table)
    for line in (*summary_lines(answer), *sentences(answer.get("pair"))):
        console.print(line, markup=False, highlight=False)
