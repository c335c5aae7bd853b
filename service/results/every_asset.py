"""What a start reads of all assets, in one query each: the index is entered once for each asset, never walked along."""

from __future__ import annotations

from typing import Any

from sqlalchemy import ColumnElement, Select, func, select

from service.results.schema import ASSETS, EVENTS, WINDOWS


def _of_each(value: ColumnElement[int], of: ColumnElement[Any]) -> Select:
    """Every asset with one number that is looked up among its rows."""
    return select(ASSETS.c.asset, select(func.coalesce(value, 0)).where(of == ASSETS.c.asset).scalar_subquery())


NEXT_INDICES = _of_each(func.max(WINDOWS.c.number) + 1, WINDOWS.c.asset)
LAST_EVENTS = _of_each(func.max(EVENTS.c.id), EVENTS.c.asset)
