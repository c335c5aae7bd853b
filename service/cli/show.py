"""What every command shows alike: progress and notes on standard error, tables on standard output."""

from __future__ import annotations

import shutil
import sys
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from service.printable import printable

PIPED = 170  # columns where the output is no terminal
GAP = "  "  # between columns
NARROWEST = 24  # characters that the last column is wrapped to


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
    print(f"gear-twin: {printable(line)}", file=sys.stderr)


def width() -> int:
    """Columns of the terminal; of a pipe those of a wide one."""
    return shutil.get_terminal_size().columns if sys.stdout.isatty() else PIPED


def wrapped(text: str, indent: int) -> list[str]:
    """A text in lines that fit the terminal, each indented."""
    space = " " * indent
    return textwrap.wrap(text, max(width(), NARROWEST + indent), initial_indent=space, subsequent_indent=space)


def table(rows: Sequence[Sequence[object]], heads: Sequence[str] = (), right: Sequence[int] = ()) -> list[str]:
    """Rows as columns, the last of them wrapped where the terminal is narrow.

    right  columns of figures, which end at one place
    """
    cells = [[str(cell) for cell in row] for row in ([heads] if heads else []) + list(rows)]
    if not cells:
        return []
    widths = [max(len(row[i]) for row in cells) for i in range(len(cells[0]) - 1)]
    before = sum(widths) + len(GAP) * len(widths)
    room = max(width() - before, NARROWEST)
    lines = []
    for row in cells:
        start = GAP.join(
            c.rjust(w) if i in right else c.ljust(w) for i, (c, w) in enumerate(zip(row, widths, strict=False))
        )
        first, *rest = textwrap.wrap(row[-1], room) or [""]
        lines.append(f"{start}{GAP if widths else ''}{first}".rstrip())
        lines += [" " * before + line for line in rest]
    return lines


def number(value: Any, digits: int = 4) -> str:
    """A number to so many digits, or a dash where there is none."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return "–" if value is None else str(value)
    return f"{value:.{digits}g}"


def spread(value: Any, unit: str) -> str:
    """A median with its 5–95 % band, or why there is none."""
    if isinstance(value, Mapping) and value.get("median") is None and (value.get("p05") or value.get("p95")):
        low, high = value.get("p05"), value.get("p95")
        return (
            f"at least {number(low)} {unit} (95 % confidence)"
            if low
            else f"below {number(high)} {unit} (95 % confidence)"
        )
    if not isinstance(value, Mapping) or value.get("median") is None:
        return reason(value)
    return f"{number(value['median'])} {unit} (5–95 %: {number(value.get('p05'))} … {number(value.get('p95'))})"


def reason(value: Any) -> str:
    """Why a quantity is not there."""
    if isinstance(value, Mapping) and value.get("reason"):
        from service.contract.finding import cause

        return f"not available: {cause(value['reason'])}"
    return "not available"
