"""Which partition a name belongs to: that of its hash, unless it was given to an asset of another partition.

Every name that was ever given is in `layout.NAMES`, and is not given away again. It is written in the transaction that
gives the name: of two partitions that give the same name at the same time one is refused.
"""

from __future__ import annotations

from functools import lru_cache

import sqlalchemy as sa
from sqlalchemy import Connection, bindparam
from sqlalchemy.dialects import postgresql

from service.errors import InputError
from service.fleet.layout import NAMES, Layout
from service.fleet.notices import NAMED, announce, say
from service.results.store import Tables

PLACE = sa.select(NAMES.c.partition).where(NAMES.c.name == bindparam("of"))
"""The partition of the name `of`; nothing where it was never given."""

_GIVE = postgresql.insert(NAMES).on_conflict_do_nothing()
_ELSEWHERE = sa.select(NAMES.c.name, NAMES.c.partition).where(NAMES.c.elsewhere)


def named(db: Connection, asset: str, name: str, partition: int, layout: Layout) -> None:
    """An asset of a partition has a name, within the transaction that gives it.

    Raises InputError where an asset of another partition has or had the name.
    """
    elsewhere = layout.partition_of(name) != partition
    given = {"name": name, "partition": partition, "elsewhere": elsewhere}
    new = db.execute(_GIVE, given).rowcount  # who waits for another transaction sees what that has given
    if db.execute(PLACE, {"of": name}).scalar_one() != partition:
        raise InputError(f"there is an asset {name!r} already, or one that was called so: give another name")
    if new and elsewhere:
        for each in (partition, layout.partition_of(name)):
            announce(db, each, NAMED, name)
    say(db, [asset])


class PartitionStreams:
    """Which streams belong to one partition, as its worker knows them; safe to use from several threads.

    prefix  of the settings
    """

    def __init__(self, layout: Layout, partition: int, prefix: str) -> None:
        self._layout, self._partition, self._prefix = layout, partition, prefix
        self._hashed = lru_cache(4096)(layout.partition_of)
        self._elsewhere: dict[str, int] = {}

    def read(self, database: Tables) -> None:
        """Reads what is not in the partition of its hash."""
        self._elsewhere = {name: partition for name, partition in database.rows(_ELSEWHERE)}

    def refusal(self, stream: str) -> str | None:
        """Why frames of a stream are not used here: it belongs to another partition. None where it belongs here."""
        there = self._elsewhere.get(stream)
        if there is None:
            there = self._hashed(stream)
        if there == self._partition:
            return None
        return (
            f"asset {stream} is in partition {there}: publish it under {self._layout.prefix_of(there, self._prefix)}, "
            f"which gear-twin fleet key {stream} prints"
        )
