"""What waits for people and is in a worker's memory alone, written for front ends: unknown assets, proposed rig files.

The rows follow the worker's lists every few seconds: nothing is kept in them that a worker would read again.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any

import sqlalchemy as sa
from sqlalchemy.dialects import postgresql

from service.fleet.layout import REPORTED, Layout, share_of
from service.fleet.notices import DISMISSED, announce
from service.results.jobs import Jobs
from service.results.json_columns import dump, load
from service.results.rig_proposals import ACCEPTED, REJECTED, Proposal, RigProposals
from service.results.schema import NAMES
from service.results.store import Tables
from service.results.unknown_assets import Unknown, UnknownAssets

UNKNOWN, OFFERED, PROPOSAL = "unknown", "offered", "proposal"  # kinds; a rig file is offered for an unknown asset

_ROW = postgresql.insert(REPORTED)
_PUT = _ROW.on_conflict_do_update(index_elements=list(REPORTED.primary_key), set_={"data": _ROW.excluded.data})
_ROWS = sa.select(REPORTED.c.kind, REPORTED.c.asset, REPORTED.c.data).order_by(REPORTED.c.asset)
_STILL_UNKNOWN = ~sa.exists().where(NAMES.c.name == REPORTED.c.asset)  # not adopted since the worker wrote it


class Reports:
    """What the worker of a partition knows of it."""

    def __init__(self, database: Tables, unknown: UnknownAssets, proposals: RigProposals) -> None:
        self._database, self._unknown, self._proposals = database, unknown, proposals
        self._written: dict[tuple[str, str], bytes | None] | None = None  # None before the first

    def write(self) -> None:
        """Writes what has changed since the last time."""
        present = self._present()
        before = {} if self._written is None else self._written
        changed = {key: data for key, data in present.items() if before.get(key) != data}
        gone = set(before) - set(present)
        if self._written is not None and not changed and not gone:
            return
        own = REPORTED.c.partition == self._database.share
        with self._database.transaction() as db:
            if self._written is None:
                db.execute(sa.delete(REPORTED).where(own))
            for kind, asset in gone:
                db.execute(sa.delete(REPORTED).where(own, REPORTED.c.kind == kind, REPORTED.c.asset == asset))
            if changed:
                rows = [
                    {"partition": self._database.share, "kind": kind, "asset": asset, "data": data}
                    for (kind, asset), data in changed.items()
                ]
                db.execute(_PUT, rows)
        self._written = present

    def _present(self) -> dict[tuple[str, str], bytes | None]:
        found: dict[tuple[str, str], bytes | None] = {}
        for unknown in self._unknown.listed():
            about = {"first_ns": unknown.first_ns, "last_ns": unknown.last_ns, "frames": unknown.frames}
            found[UNKNOWN, unknown.asset] = dump({**about, "channels": sorted(unknown.channels)})
            if unknown.rig is not None:
                found[OFFERED, unknown.asset] = dump(unknown.rig)
        for proposal in self._proposals.all():
            found[PROPOSAL, proposal.asset] = dump(asdict(proposal))
        return found


class FleetUnknown:
    """The unknown assets of all partitions.

    asks     whether an unknown asset waits for a person
    figures  of the workers together
    """

    def __init__(self, database: Tables, layout: Layout, asks: bool, figures: Callable[[], Mapping[str, Any]]) -> None:
        self._database, self._layout, self.asks, self._figures = database, layout, asks, figures

    @property
    def frames(self) -> int:
        """Frames that the present workers have left out."""
        return int(self._figures().get("unknown_asset_frames", 0))

    @property
    def forgotten(self) -> int:
        """Assets that have left the workers' lists for want of room."""
        return int(self._figures().get("unknown_assets_forgotten", 0))

    def listed(self) -> list[Unknown]:
        """The unknown assets, the busiest first."""
        return sorted(self._read(_ROWS), key=lambda each: (-each.frames, each.asset))

    def find(self, asset: str) -> Unknown | None:
        """An unknown asset of the list."""
        return next(iter(self._read(_ROWS.where(REPORTED.c.asset == asset))), None)

    def dismiss(self, asset: str) -> None:
        """Takes an asset off the list; the worker of its partition does not list it again."""
        with self._database.transaction() as db:
            kinds = REPORTED.c.kind.in_((UNKNOWN, OFFERED))
            db.execute(sa.delete(REPORTED).where(REPORTED.c.asset == asset, kinds))
            announce(db, share_of(self._database, asset, self._layout), DISMISSED, asset)

    def _read(self, query: sa.Select) -> list[Unknown]:
        rows = self._database.rows(query.where(REPORTED.c.kind.in_((UNKNOWN, OFFERED)), _STILL_UNKNOWN))
        offered = {asset: data for kind, asset, data in rows if kind == OFFERED}
        return [unknown_of(asset, data, offered.get(asset)) for kind, asset, data in rows if kind == UNKNOWN]


class FleetProposals:
    """The proposed rig files of all partitions, without those that were decided on since their worker wrote them."""

    def __init__(self, database: Tables) -> None:
        self._database, self._jobs = database, Jobs(database)

    def all(self) -> list[Proposal]:
        """The proposals of all assets."""
        return self._read(_ROWS)

    def find(self, asset: str) -> Proposal | None:
        """The proposal of an asset."""
        return next(iter(self._read(_ROWS.where(REPORTED.c.asset == asset))), None)

    def _read(self, query: sa.Select) -> list[Proposal]:
        rows = self._database.rows(query.where(REPORTED.c.kind == PROPOSAL))
        return [proposal for proposal in (proposal_of(data) for _, _, data in rows) if not self._decided(proposal)]

    def _decided(self, proposal: Proposal) -> bool:
        return any(
            job.done and job.refused is None and job.received_ns >= proposal.received_ns
            for kind in (ACCEPTED, REJECTED)
            for job in self._jobs.of(proposal.asset, kind)
            if job.given["digest"] == proposal.digest
        )


def unknown_of(asset: str, data: bytes, rig: bytes | None) -> Unknown:
    """An unknown asset as its rows say."""
    about: Mapping[str, Any] = load(data)
    return Unknown(asset=asset, **{**about, "channels": set(about["channels"])}, rig=load(rig))


def proposal_of(data: bytes) -> Proposal:
    """A proposal as its row says."""
    return Proposal(**load(data))
