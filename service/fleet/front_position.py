"""How far a stream is stored, as a front end can say it: by what the worker of its partition has committed.

What the worker has received since is not known here and counts as not stored, so that nobody who keeps frames forgets
one too early by this answer; nor is it known whether a frame reaches beyond the newest window, of whose rest the next
one is made. The worker's own answer, on Zenoh, is newer.
"""

from __future__ import annotations

import sqlalchemy as sa

from service.contract.position import ChannelPositionModel, PositionModel, why_retired, why_unknown
from service.fleet.census import partitions
from service.fleet.layout import Layout, share_of
from service.results.jobs import WINDOW
from service.results.names import Names
from service.results.schema import JOBS
from service.results.sql_store import SqlStore
from service.runtime.positions import LONGEST_FRAME_NS

_WAITING = sa.select(sa.func.count()).where(JOBS.c.asset == sa.bindparam("of"), JOBS.c.kind == WINDOW)


def position_of(store: SqlStore, layout: Layout, stream: str) -> PositionModel:
    """The position of one stream. Raises StorageUnavailable where the database cannot be read now."""
    database, names = store.database, Names(store.database)
    asset = names.asset_of(stream)
    partition = share_of(database, stream, layout)
    stored = store.shown_asset(asset)
    assembly = stored.assembly or {}
    worker = partitions(database)[partition]
    ((waiting,),) = database.rows(_WAITING, {"of": asset})
    reason = worker.not_ready if worker.served else f"partition {partition} is not served now"
    if names.is_free(stream):
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
