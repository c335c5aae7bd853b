"""Which partition a name belongs to: that of its hash, unless an asset of another partition has or had it.

An asset that is renamed stays where its tables are, and that of the answer `other_machine` begins beside the earlier
one. A name that hashes elsewhere is then in `layout.NAMES`, as is every name that an asset had before: it is not given
away again.
Both are written in the transaction that gives the name, and so is the row among all assets, of which there is one a
name: of two partitions that give the same name at the same time one is refused.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import sqlalchemy as sa
from sqlalchemy import Connection, bindparam
from sqlalchemy.dialects import postgresql

from service.errors import InputError
from service.fleet.layout import ASSETS, CURVES, NAMES, Layout
from service.fleet.notices import NAMED, announce
from service.fleet.rows import row_of, say
from service.results.asset_list import area_of, words_of
from service.results.board import Snapshot
from service.results.store import Tables

_IS, _NAMED = ASSETS.c.asset == bindparam("of"), NAMES.c.name == bindparam("of")
PLACE = sa.select(NAMES.c.partition).where(_NAMED).union(sa.select(ASSETS.c.partition).where(_IS))
"""The partition of the name `of`; nothing where no asset has or had it."""

_BEGIN = postgresql.insert(ASSETS).on_conflict_do_nothing()
_PLACE = postgresql.insert(NAMES).on_conflict_do_nothing()
_ROW = sa.select(ASSETS).where(_IS)
_GONE = sa.delete(ASSETS).where(_IS, ASSETS.c.partition == bindparam("own"))
_KEEP_CURVES = sa.update(CURVES).where(CURVES.c.asset == bindparam("of")).values(asset=bindparam("to"))
_ALL = sa.select(NAMES.c.name, NAMES.c.partition)


def claim(db: Connection, name: str, partition: int, layout: Layout, row: Mapping[str, Any] | None = None) -> bool:
    """Has a name for an asset of a partition, within the transaction that makes the asset; False where it has it.

    Raises InputError where an asset of another partition has or had the name.

    row  of the asset among all; None for that of a new asset
    """
    first = db.execute(_BEGIN, row or row_of(Snapshot(asset=name).with_whole(), partition)).rowcount
    if any(found != partition for (found,) in db.execute(PLACE, {"of": name})):  # those who waited see it, too
        raise InputError(f"there is an asset {name!r} already, or one that was called so: give another name")
    hashed = layout.partition_of(name)
    if hashed != partition and db.execute(_PLACE, {"name": name, "partition": partition}).rowcount:
        for each in (partition, hashed):
            announce(db, each, NAMED, name)
    return bool(first)


def renamed(db: Connection, asset: str, name: str, partition: int, layout: Layout) -> None:
    """An asset of a partition has another name, within the transaction that gives it. InputError as with `claim`."""
    kept = db.execute(_ROW, {"of": asset}).mappings().first()
    claim(db, name, partition, layout, None if kept is None else _row_under(dict(kept), name))
    db.execute(_GONE, {"of": asset, "own": partition})
    db.execute(_PLACE, {"name": asset, "partition": partition})
    db.execute(_KEEP_CURVES, {"of": asset, "to": name})
    say(db, [asset, name])


def _row_under(kept: Mapping[str, Any], name: str) -> dict[str, Any]:
    """The row of an asset under another name."""
    summary = {**kept["summary"], "asset": name}
    own = {"asset": name, "area": area_of(name), "summary": summary, "words": words_of(summary)}
    return {**kept, **own, "version": kept["version"] + 1, "changed_ns": time.time_ns()}


class Names:
    """The names that belong to one partition, as its worker knows them; safe to use from several threads.

    prefix  of the settings
    """

    def __init__(self, layout: Layout, partition: int, prefix: str) -> None:
        self._layout, self._partition, self._prefix = layout, partition, prefix
        self._hashed = lru_cache(4096)(layout.partition_of)
        self._given: dict[str, int] = {}

    def read(self, database: Tables) -> None:
        """Reads what is not in the partition of its hash."""
        self._given = {name: partition for name, partition in database.rows(_ALL)}

    def refusal(self, stream: str) -> str | None:
        """Why frames of a stream are not used here: it belongs to another partition. None where it belongs here."""
        there = self._given.get(stream)
        if there is None:
            there = self._hashed(stream)
        if there == self._partition:
            return None
        return (
            f"asset {stream} is in partition {there}: publish it under {self._layout.prefix_of(there, self._prefix)}, "
            f"which gear-twin fleet key {stream} prints"
        )
