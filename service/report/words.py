"""Numbers, bands, sizes and tables as text: alike in every command, report and page."""

from __future__ import annotations

import re
import shutil
import sys
import textwrap
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from math import degrees
from typing import Any

PIPED = 170  # columns where the output is no terminal
GAP = "  "  # between columns
NARROWEST = 24  # characters that the last column is wrapped to
UNITS = {"m": (1e6, "µm"), "kg·m": (1e6, "g·mm"), "rad": (degrees(1.0), "°"), "turn": (1.0, "of a turn")}
MOMENT = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d")
COUNTED = 1e-3  # of a value: a spread that is smaller belongs to a count, such as the number of a tooth


def number(value: Any, digits: int = 3) -> str:
    """A number to so many digits, without an exponent where it can be read without; a dash where there is none."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return "–" if value is None else str(value)
    if value == 0 or 1e-3 <= abs(value) < 10**digits - 0.5:
        return f"{value:.{digits}g}"
    return f"{value:,.0f}" if 1 <= abs(value) < 1e9 else f"{value:.{digits}g}"


def band(value: Mapping[str, Any], unit: str) -> str:
    """The 5–95 % band, or the one bound that is known."""
    low, high = value.get("p05"), value.get("p95")
    if low is not None and high is not None and value.get("median") is not None:
        return f"5–95 %: {number(low)} to {number(high)} {unit}"
    if low or high is None:
        return "no band" if low is None else f"at least {number(low)} {unit} (95 % confidence)"
    return f"below {number(high)} {unit} (95 % confidence)"


def spread(value: Any, unit: str) -> str:
    """A median with its band, the bound that is known, or why there is none."""
    if not isinstance(value, Mapping) or not {"median", "p05"} & value.keys():
        return reason(value)
    if value.get("median") is None:
        return reason(None) if value.get("p05") is None and value.get("p95") is None else band(value, unit)
    return f"{number(value['median'])} {unit} ({band(value, unit)})"


def reason(value: Any) -> str:
    """Why a quantity is not there."""
    if isinstance(value, Mapping) and value.get("reason"):
        from service.contract.finding import cause

        return f"not available: {cause(value['reason'])}"
    return "not available"


def available(part: Any) -> bool:
    """Whether a part of the answer holds figures."""
    return bool(part) and not (isinstance(part, Mapping) and part.get("status") == "not available")


def size(figure: Mapping[str, Any], name: str = "") -> str:
    """A parameter with its standard deviation, in the unit that workshops use."""
    if figure["value"] is None:
        return "–"
    share = not figure["unit"] and name.endswith(("_share", "_loss"))
    factor, unit = (100.0, "%") if share else UNITS.get(figure["unit"], (1.0, figure["unit"]))
    known = figure["std"] is not None and figure["std"] > COUNTED * abs(figure["value"])
    about = f" ± {number(figure['std'] * factor, 2)}" if known else ""
    return f"{number(figure['value'] * factor)}{about}{'' if unit in ('', '°') else ' '}{unit}"


def sizes(parameters: Mapping[str, Mapping[str, Any]]) -> str:
    """All parameters of an effect."""
    return ", ".join(f"{name.replace('_', ' ')} {size(value, name)}" for name, value in parameters.items())


def label(name: str) -> str:
    """What people call an effect; the name in words where the table has none of this name."""
    from twin.effects.channel_faults import label_of

    return label_of(name) or name.replace("_", " ")


def moment(text: Any) -> str:
    """A time of the JSON as people read it: date and minute."""
    return f"{text[:10]} {text[11:16]} UTC" if isinstance(text, str) and len(text) > 15 else "time not recorded"


def capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def sentence(text: str) -> str:
    """A text that begins and ends as a sentence does."""
    text = capital(text)
    return text if not text or text.endswith(".") else f"{text}."


# -- lines -----------------------------------------------------------------------------------------------


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
        first, *rest = textwrap.wrap(row[-1], room) or [""]
        aligned = [c.rjust(w) if i in right else c.ljust(w) for i, (c, w) in enumerate(zip(row, widths, strict=False))]
        lines.append(GAP.join([*aligned, first]).rstrip())
        lines += [" " * before + line for line in rest]
    return lines


def listed(found: Sequence[Mapping[str, Any]], keys: str) -> list[str]:
    """A list of the JSON as a table of these keys; columns that hold nothing are left out."""
    columns = [(key, [_cell(key, entry.get(key)) for entry in found]) for key in keys.split()]
    used = [(key, cells) for key, cells in columns if any(cells)]
    heads = [key.removesuffix("_ns").replace("_", " ") for key, _ in used]
    return table(list(zip(*(cells for _, cells in used), strict=True)), heads) if found else []


def _cell(key: str, value: Any) -> str:
    if key.endswith("_ns"):
        value = datetime.fromtimestamp(value / 1e9, UTC).isoformat()
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {item}" for name, item in value.items() if item not in (None, "", [], {}))
    if isinstance(value, list):
        return ", ".join(map(str, value))
    if isinstance(value, str):
        return moment(value) if MOMENT.match(value) else value
    return "" if value is None else number(value, 9)
