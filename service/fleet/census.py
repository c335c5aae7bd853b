"""Which partitions are served, by whom, and how they are: as their workers say it in the tables."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import sqlalchemy as sa

from service.contract.base import iso_time
from service.fleet.front_database import tables_of
from service.fleet.heartbeat import SILENT
from service.fleet.layout import ASSETS_A_PARTITION, PARTITIONS, SERVER_NOW, Layout, schema_of
from service.results.schema import ASSETS

NS = 1_000_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Census:
    """All partitions at one moment."""

    nodes: Mapping[int, str] = field(default_factory=dict)  # of partitions that are served: the node's number
    silent: Mapping[int, float] = field(default_factory=dict)  # time without a worker [s]; infinite: never had one
    rows: tuple[Mapping[str, Any], ...] = ()
    assets: Mapping[str, int] = field(default_factory=dict)  # number by level of the status

    @property
    def crowded(self) -> list[int]:
        """Partitions with more assets than Zenoh recovers in time."""
        return [row["partition"] for row in self.rows if row["assets"] > ASSETS_A_PARTITION]

    def to_dict(self) -> dict[str, Any]:
        """As `fleet status --json` gives it."""
        return {
            "partitions": [dict(row) for row in self.rows],
            "not_served": sorted(self.silent),
            "crowded": self.crowded,
            "assets": dict(self.assets),
        }


def census(tables: sa.Engine, layout: Layout) -> Census:
    """What the tables say now."""
    age = (SERVER_NOW - PARTITIONS.c.seen_ns).label("age_ns")
    with tables.connect() as db:
        partitions = db.execute(sa.select(PARTITIONS, age).order_by(PARTITIONS.c.number)).mappings().all()
        counts, levels = Counter[int](), Counter[str]()
        made = set(sa.inspect(db).get_schema_names())
        for number in (number for number in layout.all if schema_of(number) in made):
            table = tables_of(number)[ASSETS.name]
            for level, count in db.execute(sa.select(table.c.level, sa.func.count()).group_by(table.c.level)):
                counts[number] += count
                levels[level] += count
    nodes, silent, rows = {}, {}, []
    for row in partitions:
        seconds = float("inf") if row["age_ns"] is None else row["age_ns"] / NS
        served = seconds <= SILENT
        if served:
            nodes[row["number"]] = row["node"] or ""
        else:
            silent[row["number"]] = seconds
        figures = row["figures"] or {}
        rows.append(
            {
                "partition": row["number"],
                "served": served,
                "node": row["node"],
                "worker": row["worker"],
                "since": None if row["taken_ns"] is None else iso_time(row["taken_ns"]),
                "assets": counts.get(row["number"], 0),
                "waiting": int(figures.get("backlog_windows", 0)),
                "not_ready": figures.get("not_ready"),
                "token": row["token"],
            }
        )
    assert len(rows) == layout.partitions
    return Census(nodes=nodes, silent=silent, rows=tuple(rows), assets=levels)
