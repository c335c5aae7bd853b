"""Figures of several parts of a process, and of the database, for /metrics."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from service.errors import StoreError
from service.results.retention import deleted_of
from service.results.sql_store import SqlStore

if TYPE_CHECKING:  # a process without HTTP does not load what answers it
    from service.api.collector import Figures


def figures_of(*parts: Callable[[], Figures]) -> Callable[[], Figures]:
    """The figures of some parts of a process together."""
    return lambda: {key: value for figures in parts for key, value in figures().items()}


def database_figures(store: SqlStore) -> dict[str, float]:
    """Figures of the database for /metrics; none while it cannot be used."""
    try:
        return {"store_bytes": store.database.size(), "old_rows_deleted": deleted_of(store.database)}
    except (StoreError, OSError):
        return {}
