"""Figures of several parts of a process, for /metrics."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from service.errors import StoreError
from service.logs import figures as log_figures
from service.results.sql_store import SqlStore

if TYPE_CHECKING:  # a process without HTTP does not load what answers it
    from service.api.collector import Figures


def figures_of(*parts: Callable[[], Figures]) -> Callable[[], Figures]:
    """The figures of some parts and of the log together, for /metrics."""
    return lambda: {key: value for figures in (*parts, log_figures) for key, value in figures().items()}


def database_figures(store: SqlStore) -> dict[str, float]:
    """Figures of the database for /metrics; none while it cannot be used."""
    try:
        return {"store_bytes": store.database.size()}
    except (StoreError, OSError):
        return {}
