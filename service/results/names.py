"""Names: an asset is a row, and what people and machines call it points to that row.

An asset's id is the name under which it began, and it never changes. Its label is the name that it has now. Every name
that was ever given is a row for good: whose frames come under it, and whose label it is or was, so that no name is
given twice.

| | `asset`, whose frames | `labelled`, whose label it is or was |
| --- | --- | --- |
| `press` begins | press | press |
| it is renamed `press-7` | `press` and `press-7`: press | `press` and `press-7`: press |
| its data are another machine's, `mill` | `press`, `press-7`, `mill`: mill | `mill`: mill |
"""

from __future__ import annotations

from sqlalchemy import bindparam, insert, select, update
from sqlalchemy.exc import IntegrityError

from service.errors import NameTaken
from service.results.schema import ASSETS, NAMES
from service.results.store import Tables

_LABEL = select(ASSETS.c.label).where(ASSETS.c.asset == bindparam("of"))
_IS = NAMES.c.name == bindparam("of")
_NOT_ITS_NAME = select(NAMES.c.name, NAMES.c.asset).where(NAMES.c.name != NAMES.c.asset)


def taken(name: str) -> NameTaken:
    """A name has been given before."""
    return NameTaken(f"there is an asset {name!r} already, or one that was called so: give another name")


class Names:
    """The names of all assets, in the results' database."""

    def __init__(self, database: Tables) -> None:
        self.database = database

    # -- reading -------------------------------------------------------------------------------------

    def label(self, asset: str) -> str:
        """What an asset is called now; its id where nothing is kept of it yet."""
        return next((label for (label,) in self.database.rows(_LABEL, {"of": asset})), asset)

    def labels(self) -> dict[str, str]:
        """What each asset is called now, by its id."""
        return {asset: label for asset, label in self.database.rows(select(ASSETS.c.asset, ASSETS.c.label))}

    def labelled(self, name: str) -> str | None:
        """The asset that has or had a name as its label; None where none had."""
        rows = self.database.rows(select(NAMES.c.labelled).where(_IS), {"of": name})
        return rows[0][0] if rows else None

    def asset_of(self, stream: str) -> str:
        """The asset whose frames come under a name; that name's own where it was never given."""
        return next(
            (asset for (asset,) in self.database.rows(select(NAMES.c.asset).where(_IS), {"of": stream})), stream
        )

    def routes(self) -> dict[str, str]:
        """The names under which another asset's frames come than that whose id it is, each with that asset."""
        return {
            name: asset for name, asset in self.database.rows(_NOT_ITS_NAME.where(self.database.own(NAMES.c.asset)))
        }

    def is_free(self, name: str) -> bool:
        """Whether a name has never been given."""
        return not self.database.rows(select(NAMES.c.name).where(_IS), {"of": name})

    # -- writing -------------------------------------------------------------------------------------

    def begin(self, name: str, beside: str) -> None:
        """Has a new asset, of the share of another. InputError where its name has been given before."""
        with self.database.transaction() as db:
            self.demand_free(name)
            self.database.ensure(db, name, beside)

    def demand_free(self, name: str) -> None:
        """InputError where a name has been given before."""
        if not self.is_free(name):
            raise taken(name)

    def rename(self, asset: str, name: str) -> None:
        """Gives an asset another label: a new name, or one that it had before. InputError where others have or had it.

        Frames that come under the new name are the asset's, too.
        """
        with self.database.transaction() as db:
            self.database.ensure(db, asset)
            new = self.labelled(name) != asset or self.label(asset) == name
            if new:
                self.demand_free(name)
            try:  # of several that give a name at the same time, one waits for the other, and is refused
                with db.begin_nested():
                    db.execute(update(ASSETS).where(ASSETS.c.asset == asset).values(label=name))
                    if new:
                        db.execute(insert(NAMES), {"name": name, "asset": asset, "labelled": asset})
            except IntegrityError:
                raise taken(name) from None
            self.database.named(db, asset, name)

    def give_streams(self, asset: str, other: str) -> None:
        """From now on all frames that were an asset's are another one's."""
        with self.database.transaction() as db:
            self.database.ensure(db, other)
            db.execute(update(NAMES).where(NAMES.c.asset == asset).values(asset=other))
