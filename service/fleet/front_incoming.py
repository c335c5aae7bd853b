"""What waits for people at a front end: unknown assets and proposed rig files, as the workers have written them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import sqlalchemy as sa

from service.fleet.front_kept import FleetJobs
from service.fleet.front_store import FleetStore
from service.fleet.layout import NAMES, REPORTED
from service.fleet.notices import DISMISSED, announce
from service.fleet.reported import OFFERED, PROPOSAL, UNKNOWN, proposal_of, unknown_of
from service.results.rig_proposals import ACCEPTED, REJECTED, Proposal
from service.results.unknown_assets import Unknown

_ROWS = sa.select(REPORTED.c.kind, REPORTED.c.asset, REPORTED.c.data).order_by(REPORTED.c.asset)
_STILL_UNKNOWN = ~sa.exists().where(NAMES.c.name == REPORTED.c.asset)  # not adopted since the worker wrote it


class FleetUnknown:
    """The unknown assets of all partitions.

    asks     whether an unknown asset waits for a person
    figures  of the workers together
    """

    def __init__(self, store: FleetStore, asks: bool, figures: Callable[[], Mapping[str, Any]]) -> None:
        self._store, self.asks, self._figures = store, asks, figures

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
        with self._store.database.transaction() as db:
            kinds = REPORTED.c.kind.in_((UNKNOWN, OFFERED))
            db.execute(sa.delete(REPORTED).where(REPORTED.c.asset == asset, kinds))
            announce(db, self._store.places.partition_of(asset), DISMISSED, asset)

    def _read(self, query: sa.Select) -> list[Unknown]:
        rows = self._store.database.rows(query.where(REPORTED.c.kind.in_((UNKNOWN, OFFERED)), _STILL_UNKNOWN))
        offered = {asset: data for kind, asset, data in rows if kind == OFFERED}
        return [unknown_of(asset, data, offered.get(asset)) for kind, asset, data in rows if kind == UNKNOWN]


class FleetProposals:
    """The proposed rig files of all partitions, without those that were decided on since their worker wrote them."""

    def __init__(self, store: FleetStore) -> None:
        self._store, self._jobs = store, FleetJobs(store)

    def all(self) -> list[Proposal]:
        """The proposals of all assets."""
        return self._read(_ROWS)

    def find(self, asset: str) -> Proposal | None:
        """The proposal of an asset."""
        return next(iter(self._read(_ROWS.where(REPORTED.c.asset == asset))), None)

    def _read(self, query: sa.Select) -> list[Proposal]:
        rows = self._store.database.rows(query.where(REPORTED.c.kind == PROPOSAL))
        return [proposal for proposal in (proposal_of(data) for _, _, data in rows) if not self._decided(proposal)]

    def _decided(self, proposal: Proposal) -> bool:
        return any(
            job.done and job.refused is None and job.received_ns >= proposal.received_ns
            for kind in (ACCEPTED, REJECTED)
            for job in self._jobs.of(proposal.asset, kind)
            if job.given["digest"] == proposal.digest
        )
