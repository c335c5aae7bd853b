"""The faults of all windows of an asset added up, in the transaction of each window."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from service.results.schema import FAULT_TOTALS
from service.results.store import FaultTotals, faults_of


def adding(insert: Any) -> Any:
    """The statement that adds a window's faults.

    insert  an insertion into `FAULT_TOTALS` of the database's own kind
    """
    return insert.on_conflict_do_update(
        index_elements=["asset", "kind", "channel", "action"],
        set_={
            "count": FAULT_TOTALS.c.count + insert.excluded["count"],
            "windows": FAULT_TOTALS.c.windows + 1,
        },
    )


def fault_rows(asset: str, record: Mapping[str, Any]) -> list[dict[str, Any]]:
    """What a window's record adds."""
    return [
        {"asset": asset, "kind": kind, "channel": channel, "action": action, "count": count, "windows": 1}
        for (kind, channel, action), count in faults_of(record).items()
    ]


def totals_by_asset(rows: Iterable[Any]) -> dict[str, FaultTotals]:
    """Rows of the table as the totals of each asset."""
    totals: dict[str, dict[tuple[str, str, str], tuple[int, int]]] = {}
    for asset, kind, channel, action, count, windows in rows:
        totals.setdefault(asset, {})[kind, channel, action] = (count, windows)
    return dict(totals)
