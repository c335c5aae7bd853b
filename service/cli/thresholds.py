"""`gear-twin thresholds`: every number that decides a verdict, with its unit, meaning and source."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from service.files.rig import load_rig
from service.stream.clock import ClockThresholds
from service.stream.samples import RangeThresholds
from twin.scales import Scales
from twin.threshold_register import SETS, RegisterRow, register

COLUMNS = ("set", "name", "value", "unit", "share of", "on this rig", "meaning", "source")
SERVICE_SETS = (ClockThresholds, RangeThresholds)  # numbers that the service decides by
WIDTH = 230  # characters, where the output is no terminal
NARROW = 160  # characters; a terminal with fewer shows a list


def rows(rig: Path | None) -> list[RegisterRow]:
    """The whole register; with sizes on one machine where its rig file is given."""
    scales = None if rig is None else Scales.of(load_rig(rig))
    return list(register(scales, (*SETS, *SERVICE_SETS)))


def described(found: Sequence[RegisterRow]) -> list[dict[str, Any]]:
    """The register as plain data."""
    return [
        {
            "module": item.module,
            "set": item.row.group,
            "name": item.row.name,
            "value": item.row.value,
            "unit": item.row.about.unit,
            "share_of": item.row.about.of,
            "on_this_rig": item.scaled,
            "on_this_rig_unit": item.scaled_unit,
            "meaning": item.row.about.meaning,
            "source": item.row.about.source,
        }
        for item in found
    ]


def print_table(found: Sequence[RegisterRow], with_rig: bool) -> None:
    """The register as a table, one section for each set; as a list where the terminal is too narrow for a table."""
    from rich.console import Console

    console = Console()
    console = console if console.is_terminal else Console(width=WIDTH)
    if console.width < NARROW:
        _print_list(console, found, with_rig)
    else:
        _print_table(console, found, with_rig)


def _print_list(console: Any, found: Sequence[RegisterRow], with_rig: bool) -> None:
    """Every number with its meaning and source below it, indented."""
    from rich.markup import escape
    from rich.padding import Padding

    last = ""
    for item in found:
        group = f"{item.module}: {item.row.group}"
        if group != last:
            console.print(f"\n[bold]{escape(group)}[/]", highlight=False)
        about = item.row.about
        size = " ".join(part for part in (number(item.row.value), about.unit) if part)
        of = f", share of {about.of}" if about.of else ""
        here = "" if not with_rig or item.scaled is None else f"; on this rig {_scaled(item)}"
        console.print(Padding(escape(f"{item.row.name} = {size}{of}{here}"), (0, 0, 0, 2)), highlight=False)
        console.print(Padding(escape(f"{about.meaning}. Source: {about.source}"), (0, 0, 0, 6)), highlight=False)
        last = group


def _print_table(console: Any, found: Sequence[RegisterRow], with_rig: bool) -> None:
    from rich.markup import escape
    from rich.table import Table

    columns = [name for name in COLUMNS if with_rig or name != "on this rig"]
    table = Table(*columns, title="Numbers that decide a verdict")
    last = ""
    for item in found:
        group = f"{item.module}: {item.row.group}"
        if last and group != last:
            table.add_section()
        cells = [group if group != last else "", item.row.name, number(item.row.value), item.row.about.unit]
        cells.append(item.row.about.of)
        if with_rig:
            cells.append("" if item.scaled is None else _scaled(item))
        cells += [item.row.about.meaning, item.row.about.source]
        table.add_row(*(escape(cell) for cell in cells))
        last = group
    console.print(table)


def _scaled(item: RegisterRow) -> str:
    return f"{number(item.scaled)} {item.scaled_unit}".rstrip()


def number(value: Any) -> str:
    """A number, or several, as short as it can be said."""
    if isinstance(value, tuple):
        return ", ".join(number(v) for v in value)
    return f"{value:.4g}" if isinstance(value, float) else str(value)
