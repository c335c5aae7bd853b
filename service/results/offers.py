"""Offers: what comes from the network and waits for people, in one table.

| kind | name | what it is |
| --- | --- | --- |
| `asset` | the stream's | an unknown asset: frames come under a name that was never given |
| `rig` | the stream's, or the asset's | a rig file; where there is an asset, a proposal until a person decides on it |
| `left_out` | the share's number | since the start: frames left out, and names that the list had no room for |

Whoever receives writes the rows, once a second at most (`runtime/offer_writer.py`), and takes them away. People's
answers are what others write: that an asset was dismissed, a name that was given, a job that decided on a proposal. A
row reserves no name: one whose name has been given meanwhile is of no unknown asset any more.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa

from service.errors import StoreError
from service.results.json_columns import dump, salvage
from service.results.schema import ASSETS, NAMES, OFFERS
from service.results.store import Tables
from service.results.unknown_assets import Unknown

ASSET, RIG, LEFT_OUT = "asset", "rig", "left_out"

_IS = sa.and_(OFFERS.c.kind == sa.bindparam("of_kind"), OFFERS.c.name == sa.bindparam("of"))
_RIG = OFFERS.alias()
_ASSETS = (
    sa.select(OFFERS, _RIG.c.digest.label("rig_digest"), _RIG.c.data.label("rig"))
    .outerjoin(_RIG, sa.and_(_RIG.c.kind == RIG, _RIG.c.name == OFFERS.c.name))
    .where(OFFERS.c.kind == ASSET)
)
_LISTED = _ASSETS.where(OFFERS.c.dismissed_ns.is_(None), ~sa.exists().where(NAMES.c.name == OFFERS.c.name))
_PROPOSALS = (
    sa.select(OFFERS).join(ASSETS, ASSETS.c.asset == OFFERS.c.name).where(OFFERS.c.kind == RIG).order_by(OFFERS.c.name)
)
_DISMISSED = sa.select(OFFERS.c.name, OFFERS.c.dismissed_ns).where(
    OFFERS.c.share == sa.bindparam("of"), OFFERS.c.dismissed_ns.is_not(None)
)
_DIGESTS = sa.select(OFFERS.c.name, OFFERS.c.digest).where(
    OFFERS.c.kind == RIG, OFFERS.c.name.in_(sa.bindparam("names", expanding=True))
)
_LEFT_OUT = sa.select(OFFERS.c.frames, OFFERS.c.data).where(OFFERS.c.kind == LEFT_OUT)
_END = sa.delete(OFFERS).where(_IS)


@dataclass(frozen=True, slots=True, kw_only=True)
class Proposal:
    """A rig file that came for an asset and is not the one in use."""

    asset: str
    rig: Mapping[str, Any]
    digest: str  # a decision names it
    received_ns: int  # Unix time [ns]


class Offers:
    """The offers of all shares, in the results' database."""

    def __init__(self, database: Tables) -> None:
        self._database, self._share = database, database.share or 0
        put = database.insert(OFFERS)
        others = {c.name: put.excluded[c.name] for c in OFFERS.c if not c.primary_key and c.name != "dismissed_ns"}
        self._put = put.on_conflict_do_update(index_elements=list(OFFERS.primary_key), set_=others)

    # -- for people ----------------------------------------------------------------------------------

    def unknown(self) -> list[Unknown]:
        """The unknown assets, the busiest first."""
        return sorted(self._unknown(_LISTED), key=lambda each: (-each.frames, each.asset))

    def find(self, asset: str) -> Unknown | None:
        """An unknown asset of the list."""
        return next(iter(self._unknown(_LISTED.where(OFFERS.c.name == asset))), None)

    def dismiss(self, asset: str, at_ns: int) -> None:
        """Takes an unknown asset off the list; whoever receives does not list it again for a time."""
        with self._database.transaction() as db:
            db.execute(sa.update(OFFERS).where(_IS).values(dismissed_ns=at_ns), {"of_kind": ASSET, "of": asset})
            self.end(asset)

    def proposals(self, *, own: bool = False) -> list[Proposal]:
        """The proposals of all assets, or of those of the share alone."""
        return self._proposals(_PROPOSALS.where(OFFERS.c.share == self._share) if own else _PROPOSALS)

    def proposal(self, asset: str) -> Proposal | None:
        """The proposal of an asset."""
        return next(iter(self._proposals(_PROPOSALS.where(OFFERS.c.name == asset))), None)

    def end(self, name: str, digest: str | None = None) -> None:
        """Ends the offer of a rig file: whatever it is, or if it is still the one of this digest."""
        ended = _END if digest is None else _END.where(OFFERS.c.digest == digest)
        with self._database.transaction() as db:
            db.execute(ended, {"of_kind": RIG, "of": name})

    def left_out(self, *, own: bool = False) -> tuple[int, int]:
        """Frames that were left out, and unknown assets that had no room in the list; of all, or of the share alone."""
        rows = self._database.rows(_LEFT_OUT.where(OFFERS.c.share == self._share) if own else _LEFT_OUT)
        forgotten = (salvage(data, "how many unknown assets had no room") or 0 for _, data in rows)
        return sum(frames for frames, _ in rows), sum(forgotten)

    def figures(self) -> dict[str, float]:
        """Figures for /metrics; none while the database cannot be used."""
        try:
            listed, proposed = (
                self._database.rows(sa.select(sa.func.count()).select_from(query.subquery()))[0][0]
                for query in (_LISTED.with_only_columns(OFFERS.c.name), _PROPOSALS.with_only_columns(OFFERS.c.name))
            )
            frames, forgotten = self.left_out()
        except StoreError:
            return {}
        return {
            "unknown_assets": listed,
            "unknown_asset_frames": frames,
            "unknown_assets_forgotten": forgotten,
            "rig_proposals": proposed,
        }

    # -- for whoever receives ------------------------------------------------------------------------

    def own(self) -> dict[str, Unknown]:
        """The unknown assets of the share as they were written last, those that were dismissed too."""
        return {each.asset: each for each in self._unknown(_ASSETS.where(OFFERS.c.share == self._share))}

    def dismissed(self) -> dict[str, int]:
        """The unknown assets of the share that were dismissed, and when [Unix time, ns]."""
        return {name: at_ns for name, at_ns in self._database.rows(_DISMISSED, {"of": self._share})}

    def digests(self, names: Collection[str]) -> dict[str, str]:
        """The digests of the rig files that are offered for some names."""
        rows = self._database.rows(_DIGESTS, {"names": sorted(names)}) if names else []
        return {name: digest for name, digest in rows}

    def write(
        self,
        *,
        gone: Collection[tuple[str, str]] = (),
        assets: Collection[Unknown] = (),
        rigs: Collection[Proposal] = (),
        left_out: tuple[int, int] = (0, 0),
    ) -> None:
        """Takes rows away, by kind and name, and writes others, in one transaction."""
        rows = [self._row(LEFT_OUT, str(self._share), left_out[1], frames=left_out[0])]
        for u in assets:
            about = {"channels": sorted(u.channels), "rig_bytes": u.rig_bytes}
            rows.append(self._row(ASSET, u.asset, about, first_ns=u.first_ns, last_ns=u.last_ns, frames=u.frames))
        for p in rigs:
            rows.append(self._row(RIG, p.asset, p.rig, first_ns=p.received_ns, last_ns=p.received_ns, digest=p.digest))
        with self._database.transaction() as db:
            if gone:
                db.execute(_END, [{"of_kind": kind, "of": name} for kind, name in gone])
            db.execute(self._put, rows)

    # -- within --------------------------------------------------------------------------------------

    def _row(self, kind: str, name: str, data: Any, **numbers: Any) -> dict[str, Any]:
        none = {"first_ns": 0, "last_ns": 0, "frames": 0, "dismissed_ns": None, "digest": None}
        return {"kind": kind, "name": name, "share": self._share, "data": dump(data), **none, **numbers}

    def _unknown(self, query: sa.Select) -> list[Unknown]:
        found = []
        for row in self._database.rows(query):
            about = salvage(row.data, f"what is known of {row.name}") or {"channels": (), "rig_bytes": 0}
            rig = _rig(row.rig, row.name)
            entry = Unknown(
                asset=row.name, first_ns=row.first_ns, last_ns=row.last_ns, frames=row.frames,
                channels=frozenset(about["channels"]), dismissed_ns=row.dismissed_ns,
                rig=rig, digest=None if rig is None else row.rig_digest, rig_bytes=about["rig_bytes"],
            )  # fmt: skip
            found.append(entry)
        return found

    def _proposals(self, query: sa.Select) -> list[Proposal]:
        return [
            Proposal(asset=row.name, rig=rig, digest=row.digest, received_ns=row.last_ns)
            for row in self._database.rows(query)
            if (rig := _rig(row.data, row.name)) is not None
        ]


def _rig(data: bytes | None, name: str) -> Mapping[str, Any] | None:
    return salvage(data, f"the rig file that is offered for {name}")
