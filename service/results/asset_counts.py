"""The numbers that are kept of an asset, and the seal by which damage to them is found."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from service.results.json_columns import seal

COUNTS = ("windows", "updates", "received_ns", "epoch")  # which the seal is made of


def sealed(counts: Mapping[str, Any]) -> dict[str, Any]:
    """The numbers of an asset with their seal."""
    return {**counts, "seal": seal(*(counts[name] for name in COUNTS))}


def is_sealed(row: Any) -> bool:
    """Whether the numbers of an asset are those that were written; a new asset has no seal and nothing to count."""
    if row["seal"] is None:
        return not any(row[name] for name in COUNTS)
    return row["seal"] == sealed({name: row[name] for name in COUNTS})["seal"]
