"""Views as CSV: one line a point, in full resolution; the head names quantity and unit."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence

import numpy as np

from service.signals.view import View

DIGITS = 9


def as_csv(view: View) -> str:
    """All points of a view. Curves over an axis of their own have it in a column before theirs."""
    heads, columns = [named(view.x.label, view.x.unit)], [view.x.values]
    for s in view.series:
        if s.x is not None:
            heads.append(named(f"{s.name}: {view.x.label}", view.x.unit))
            columns.append(s.x)
        heads.append(named(s.name, s.unit))
        columns.append(s.values)
    if all(s.x is not None for s in view.series):
        heads, columns = heads[1:], columns[1:]
    return table(heads, columns)


def named(label: str, unit: str) -> str:
    return f"{label} [{unit}]" if unit else label


def table(heads: Sequence[str], columns: Iterable[np.ndarray]) -> str:
    """Columns of numbers as CSV text; shorter columns and what is not finite leave their cells empty."""
    texts = [[f"{v:.{DIGITS}g}" if np.isfinite(v) else "" for v in column.tolist()] for column in columns]
    rows = max((len(t) for t in texts), default=0)
    texts = [t + [""] * (rows - len(t)) for t in texts]
    head = io.StringIO()
    csv.writer(head, lineterminator="\n").writerow(heads)
    return head.getvalue() + "".join(",".join(row) + "\n" for row in zip(*texts, strict=True))
