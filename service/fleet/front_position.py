"""How far a stream is stored, as a front end can say it: by what the worker of its partition has committed.

What the worker has received since is not known here and counts as not stored, so that nobody who keeps frames forgets
one too early by this answer; nor is it known whether a frame reaches beyond the newest window, of whose rest the next
one is made. The worker's own answer, on Zenoh, is newer.
"""

from __future__ import annotations

import sqlalchemy as sa

from service.contract.position import ChannelPositionModel, PositionModel, why_retired, why_unknown
from service.fleet.front_kept import FleetNames
from service.fleet.front_store import FleetStore
from service.fleet.heartbeat import SILENT
from service.fleet.layout import PARTITIONS, SERVER_NOW
from service.results.jobs import WINDOW
from service.results.schema import JOBS
from service.runtime.positions import LONGEST_FRAME_NS
from service.stream.frames import NS

_PARTITION = sa.select(
    PARTITIONS.c.token, PARTITIONS.c.figures, (SERVER_NOW - PARTITIONS.c.seen_ns).label("age_ns")
).where(PARTITIONS.c.number == sa.bindparam("number"))
_WAITING = sa.select(sa.func.count()).where(JOBS.c.asset == sa.bindparam("of"), JOBS.c.kind == WINDOW)


class FleetPositions:
    """The positions of all streams."""

    def __init__(self, store: FleetStore) -> None:
        self._store = store

    def of(self, stream: str) -> PositionModel:
        """The position of one stream. Raises StorageUnavailable where the database cannot be read now."""
        store = self._store
        asset = FleetNames(store).asset_of(stream)
        partition = store.places.partition_of(asset)
        stored = store.stores.at(partition).shown_asset(asset)
        assembly = stored.assembly or {}
        (worker,) = store.database.rows(_PARTITION, {"number": partition})
        ((waiting,),) = store.fleet.partition(partition).rows(_WAITING, {"of": asset})
        reason = self._refusal(partition, worker)
        if FleetNames(store).is_free(stream):
            reason = why_unknown(stream)
        elif stored.retired is not None:
            reason = why_retired(stream)
        until = int(assembly.get("closed_until_ns", 0))
        return PositionModel(
            asset=stream,
            instance=f"partition {partition}, worker {worker.token}",
            accepting=reason is None,
            reason=reason,
            unsettled_from_ns=max(until - LONGEST_FRAME_NS, 0),
            settled_until_ns=until or None,
            channels={
                label: ChannelPositionModel(sequence=last["sequence"], start_time_ns=last["start_ns"])
                for label, last in sorted(assembly.get("last_frames", {}).items())
            },
            left_out=assembly.get("left_out", {}),
            backlog=waiting,
        )

    @staticmethod
    def _refusal(partition: int, worker: sa.Row) -> str | None:
        """Why a partition takes no frames now, or None."""
        if worker.age_ns is None or worker.age_ns > SILENT * NS:
            return f"partition {partition} is not served now"
        reason: str | None = (worker.figures or {}).get("not_ready")
        return reason
