"""The tables of docs/reference/operations.md, each from the single place in the code that it describes."""

from __future__ import annotations

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
