"""Which partitions are served, by whom, and how they are: as whoever receives their frames says it in the tables."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa

from service.contract.base import iso_time
from service.fleet.layout import ASSETS_A_PARTITION, PARTITIONS
from service.results.roles import INGEST, Role, Roles
from service.results.schema import ASSETS

_ALL = sa.select(PARTITIONS.c.number, PARTITIONS.c.token).order_by(PARTITIONS.c.number)
_COUNTS = sa.select(ASSETS.c.share, ASSETS.c.level, sa.func.count()).group_by(ASSETS.c.share, ASSETS.c.level)


@dataclass(frozen=True, slots=True, kw_only=True)
class Partition:
    """One partition.

    token   of whoever may commit
    ingest  what whoever receives its frames says of itself; None where nobody has said anything since it was taken
    """

    number: int
    token: int
    ingest: Role | None

    @property
    def served(self) -> bool:
        return self.ingest is not None and self.ingest.lives

    @property
    def not_ready(self) -> str | None:
        """Why no frames are taken, or None."""
        return None if self.ingest is None else self.ingest.not_ready


def partitions(roles: Roles) -> list[Partition]:
    """All partitions, by number."""
    known = {role.share: role for role in roles.look() if role.role == INGEST}
    found = roles.database.rows(_ALL)
    return [Partition(number=number, token=token, ingest=known.get(number)) for number, token in found]


@dataclass(frozen=True, slots=True, kw_only=True)
class Census:
    """All partitions at one moment, as `fleet status --json` gives them.

    assets  their number by level of the status
    """

    partitions: tuple[Mapping[str, Any], ...]
    assets: Mapping[str, int]

    @property
    def not_served(self) -> list[int]:
        """Partitions whose frames nobody receives."""
        return [row["partition"] for row in self.partitions if not row["served"]]

    @property
    def receiving(self) -> bool:
        """Whether all partitions are served, and take frames."""
        return all(row["served"] and row["not_ready"] is None for row in self.partitions)

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


def census(roles: Roles) -> Census:
    """What the tables say now."""
    counts, levels = Counter[int](), Counter[str]()
    for number, level, count in roles.database.rows(_COUNTS):
        counts[number] += count
        levels[level] += count
    rows = tuple(
        {
            "partition": found.number,
            "served": found.served,
            "node": ingest and ingest.node,
            "worker": ingest and ingest.host,
            "since": ingest and iso_time(ingest.began_ns),
            "assets": counts.get(found.number, 0),
            "waiting": int(ingest.figures.get("backlog_windows", 0)) if ingest else 0,
            "not_ready": found.not_ready,
            "token": found.token,
        }
        for found in partitions(roles)
        for ingest in (found.ingest,)
    )
    return Census(partitions=rows, assets=levels)
