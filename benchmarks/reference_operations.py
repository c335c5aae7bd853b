"""The tables of docs/reference/operations.md, each from the single place in the code that it describes."""

from __future__ import annotations

import re

Group = tuple[str, tuple[str, ...], list[tuple[str, ...]]]
"""Title, heads and rows of a table."""


def metrics() -> list[Group]:
    """Every metric, in groups."""
    from service.operation.metric_catalogue import GROUPS

    found: list[Group] = []
    for title, entries in GROUPS.items():
        rows: list[tuple[str, ...]] = [
            (
                f"`{e.shown}`",
                ", ".join(f"`{label}`" for label in e.labels),
                e.type,
                e.unit,
                e.meaning + (f"; {e.only}" if e.only else ""),
                e.action,
            )
            for e in entries
        ]
        found.append((title, ("metric", "labels", "type", "unit", "meaning", "what to do"), rows))
    return found


def states() -> list[Group]:
    """Every status, grade, fault and cause."""
    from service.operation import state_catalogue as states

    tables = {
        "Status of an asset": ("`status.level`", states.STATUSES),
        "Data of an asset": ("`data.level`", states.DATA),
        "Grades of windows": ("`quality`", states.GRADES),
        "Kinds of faults": ("`kind`", states.FAULTS),
        "States of alarms": ("`state`", states.ALARMS),
        "Questions": ("`question.kind`", states.QUESTIONS),
        "Causes of storage that cannot be used": ("cause", states.STORAGE),
    }
    return [
        (
            title,
            (head, "meaning", "what to do"),
            [(f"`{name}`", *entry) for name, entry in table.items()],
        )
        for title, (head, table) in tables.items()
    ]


def log_lines() -> list[Group]:
    """Every log line, by the part of the program that writes it."""
    from benchmarks.log_calls import log_calls
    from service.operation.log_catalogue import LINES

    levels = {(call.place, call.text): call.level for call in log_calls()}
    rows: list[tuple[str, ...]] = [
        (f"`{_readable(line.text)}`", levels[line.place, line.text], f"`{line.place}`", line.meaning, line.action)
        for line in LINES
    ]
    return [("", ("line", "level", "logger", "meaning", "what to do"), rows)]


def _readable(text: str) -> str:
    """A line with … for what is filled in."""
    return re.sub(r"%[-+#0-9.]*[a-zA-Z]", "…", text)
