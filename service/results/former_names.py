"""Names that assets had before they were renamed."""

from __future__ import annotations

from sqlalchemy import exists, select

from service.results.json_columns import salvage
from service.results.schema import ASSETS, CHANGES, ROUTES
from service.results.store import Tables

_RENAMED = select(CHANGES.c.id, CHANGES.c.asset, CHANGES.c.effect).where(
    CHANGES.c.kind == "renamed", CHANGES.c.effect.is_not(None)
)
_ROUTED = select(ROUTES.c.stream, ROUTES.c.asset).where(~exists().where(ASSETS.c.asset == ROUTES.c.stream))


def former_names(database: Tables) -> dict[str, str]:
    """Names that are no asset's any longer, each with the asset that had it.

    The stream of such a name is its asset's, unless it was found to be another machine's: the rename knows better then.
    """
    former = {stream: asset for stream, asset in database.rows(_ROUTED)}
    for number, asset, kept in database.rows(_RENAMED):
        effect = salvage(kept, f"the effect of change {number} of {asset}")
        if effect is not None:
            former[effect["was"]] = asset
    return former
