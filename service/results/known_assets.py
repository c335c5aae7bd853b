"""What a process reads of all assets that only records their frames: their streams and their rig files."""

from __future__ import annotations

from collections.abc import Collection, Iterable

from sqlalchemy import bindparam, select

from service.results.database import Database
from service.results.schema import ASSETS, NAMES

_NAMES = select(NAMES.c.name, NAMES.c.asset, ASSETS.c.retired.is_not(None)).join(
    ASSETS, ASSETS.c.asset == NAMES.c.asset
)
_RIGS = select(ASSETS.c.asset, ASSETS.c.rig).where(ASSETS.c.asset.in_(bindparam("of", expanding=True)))


def streams_of_all(database: Database) -> dict[str, str | None]:
    """The asset of each stream; None for that of a retired one."""
    rows = database.rows(_NAMES.where(database.own(NAMES.c.asset)))
    return {name: None if retired else asset for name, asset, retired in rows}


def kept_rigs(database: Database, assets: Collection[str]) -> Iterable[tuple[str, bytes | None]]:
    """The rig files of some assets, as they are kept."""
    return database.rows(_RIGS, {"of": list(assets)}) if assets else ()
