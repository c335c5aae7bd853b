"""Which streams belong to a partition: those of its assets, and of new ones those whose name hashes to it."""

from __future__ import annotations

from functools import lru_cache

import sqlalchemy as sa

from service.fleet.layout import Layout
from service.results.commit_watch import Noticed
from service.results.schema import ASSETS, NAMES
from service.results.store import Tables

_ALL = sa.select(NAMES.c.name, ASSETS.c.share).join(ASSETS, ASSETS.c.asset == NAMES.c.asset)


class PartitionStreams:
    """Which streams belong to one partition, as whoever receives its frames knows them; for any thread."""

    def __init__(self, layout: Layout, partition: int) -> None:
        self._layout, self._partition = layout, partition
        self._hashed = lru_cache(4096)(layout.partition_of)
        self._elsewhere: dict[str, int] = {}

    def read(self, database: Tables) -> None:
        """Reads what is not in the partition of its hash."""
        of = self._layout.partition_of
        self._elsewhere = {name: share for name, share in database.rows(_ALL) if of(name) != share}

    def committed(self, database: Tables, noticed: Noticed) -> None:
        """Reads it again where something may have changed it. StoreError where that is not possible now."""
        if noticed.named:
            self.read(database)

    def refusal(self, stream: str) -> str | None:
        """Why frames of a stream are not used here: it belongs to another partition. None where it belongs here."""
        there = self._elsewhere.get(stream)
        if there is None:
            there = self._hashed(stream)
        if there == self._partition:
            return None
        return (
            f"asset {stream} is in partition {there}: publish it under {self._layout.prefix_of(there)}, "
            f"which gear-twin fleet key {stream} prints"
        )


def is_hashed_to(layout: Layout, partition: int, stream: str) -> bool:
    """Whether a stream that nobody knows would be of a partition."""
    return layout.partition_of(stream) == partition
