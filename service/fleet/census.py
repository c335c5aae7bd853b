"""Which partitions are served, by whom, and how they are: as their workers say it in the tables."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa

from service.contract.base import iso_time
from service.fleet.heartbeat import SILENT
from service.fleet.layout import ASSETS_A_PARTITION, PARTITIONS, SERVER_NOW
from service.results.schema import ASSETS
from service.results.store import Tables

NS = 1_000_000_000
_ALL = sa.select(PARTITIONS, (SERVER_NOW - PARTITIONS.c.seen_ns).label("silent_ns")).order_by(PARTITIONS.c.number)
_COUNTS = sa.select(ASSETS.c.share, ASSETS.c.level, sa.func.count()).group_by(ASSETS.c.share, ASSETS.c.level)


@dataclass(frozen=True, slots=True, kw_only=True)
class Partition:
    """One partition, and what its worker has said last.

    token     of whoever may commit
    taken_ns  since when [Unix time, ns]
    """

    number: int
    token: int
    worker: str | None
    node: str | None
    taken_ns: int | None
    served: bool
    figures: Mapping[str, Any]

    @property
    def not_ready(self) -> str | None:
        """Why the worker takes no frames, or None."""
        return self.figures.get("not_ready")


def partitions(database: Tables) -> list[Partition]:
    """All partitions, by number."""
    return [
        Partition(
            number=row.number, token=row.token, worker=row.worker, node=row.node, taken_ns=row.taken_ns,
            served=row.silent_ns is not None and row.silent_ns <= SILENT * NS, figures=row.figures or {},
        )
        for row in database.rows(_ALL)
    ]  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Census:
    """All partitions at one moment, as `fleet status --json` gives them.

    assets  their number by level of the status
    """

    partitions: tuple[Mapping[str, Any], ...]
    assets: Mapping[str, int]

    @property
    def not_served(self) -> list[int]:
        """Partitions without a worker."""
        return [row["partition"] for row in self.partitions if not row["served"]]

    @property
    def crowded(self) -> list[int]:
        """Partitions with more assets than Zenoh recovers in time."""
        return [row["partition"] for row in self.partitions if row["assets"] > ASSETS_A_PARTITION]

    def to_dict(self) -> dict[str, Any]:
        return {
            "partitions": [dict(row) for row in self.partitions],
            "not_served": self.not_served,
            "crowded": self.crowded,
            "assets": dict(self.assets),
        }


def census(database: Tables) -> Census:
    """What the tables say now."""
    counts, levels = Counter[int](), Counter[str]()
    for number, level, count in database.rows(_COUNTS):
        counts[number] += count
        levels[level] += count
    rows = tuple(
        {
            "partition": found.number,
            "served": found.served,
            "node": found.node,
            "worker": found.worker,
            "since": None if found.taken_ns is None else iso_time(found.taken_ns),
            "assets": counts.get(found.number, 0),
            "waiting": int(found.figures.get("backlog_windows", 0)),
            "not_ready": found.not_ready,
            "token": found.token,
        }
        for found in partitions(database)
    )
    return Census(partitions=rows, assets=levels)
