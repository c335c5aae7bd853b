"""What waits for people and is in a worker's memory alone, written for front ends: unknown assets, proposed rig files.

The rows follow the worker's lists every few seconds: nothing is kept in them that a worker would read again.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import sqlalchemy as sa
from sqlalchemy.dialects import postgresql

from service.errors import StoreError
from service.fleet.fence import Fenced
from service.fleet.layout import REPORTED
from service.results.json_columns import dump, load
from service.results.rig_proposals import Proposal, RigProposals
from service.results.store import Tables
from service.results.unknown_assets import Unknown, UnknownAssets

log = logging.getLogger(__name__)

EVERY = 2.0  # [s]
STOP_WAIT = 3.0  # [s]
UNKNOWN, OFFERED, PROPOSAL = "unknown", "offered", "proposal"  # kinds; a rig file is offered for an unknown asset

_ROW = postgresql.insert(REPORTED)
_PUT = _ROW.on_conflict_do_update(index_elements=list(REPORTED.primary_key), set_={"data": _ROW.excluded.data})


class ReportWriter(threading.Thread):
    """Writes what the worker of a partition knows of it, until ended."""

    def __init__(self, database: Tables, partition: int, unknown: UnknownAssets, proposals: RigProposals) -> None:
        super().__init__(name="reports", daemon=True)
        self._database, self._partition = database, partition
        self._unknown, self._proposals = unknown, proposals
        self._stopping = threading.Event()
        self._written: dict[tuple[str, str], bytes | None] | None = None  # None before the first

    def run(self) -> None:
        """Works until ended."""
        while not self._stopping.wait(EVERY):
            try:
                self.write()
            except Fenced:
                return
            except StoreError as error:  # whoever keeps windows says it
                log.debug("what waits for people in partition %d is written later: %s", self._partition, error)

    def end(self) -> None:
        """Ends the thread."""
        self._stopping.set()
        if self.is_alive():
            self.join(STOP_WAIT)

    def write(self) -> None:
        """Writes what has changed since the last time."""
        present = self._present()
        before = {} if self._written is None else self._written
        changed = {key: data for key, data in present.items() if before.get(key) != data}
        gone = set(before) - set(present)
        if self._written is not None and not changed and not gone:
            return
        own = REPORTED.c.partition == self._partition
        with self._database.transaction() as db:
            if self._written is None:
                db.execute(sa.delete(REPORTED).where(own))
            for kind, asset in gone:
                db.execute(sa.delete(REPORTED).where(own, REPORTED.c.kind == kind, REPORTED.c.asset == asset))
            if changed:
                rows = [
                    {"partition": self._partition, "kind": kind, "asset": asset, "data": data}
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


def unknown_of(asset: str, data: bytes, rig: bytes | None) -> Unknown:
    """An unknown asset as its rows say."""
    about: Mapping[str, Any] = load(data)
    return Unknown(asset=asset, **{**about, "channels": set(about["channels"])}, rig=load(rig))


def proposal_of(data: bytes) -> Proposal:
    """A proposal as its row says."""
    return Proposal(**load(data))
