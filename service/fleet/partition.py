"""One partition at work: the role `ingest` of `gear-twin serve`, and `record` where it is set, over its share of the
tables, which it has taken.

There is no HTTP here: front ends read the tables, and what people decide reaches the partition through the tables, too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

from service.fleet.databases import database_of, fleet_tables, partition_tables
from service.fleet.fence import Fence, leave_at_once
from service.fleet.layout import Layout, folder_of
from service.fleet.naming import PartitionStreams, is_hashed_to
from service.operation.timing import Timing
from service.results.database import Database
from service.results.roles import INGEST, RECORD, ident_of
from service.results.sql_store import SqlStore
from service.results.storage_faults import is_away
from service.runtime.begun import Begun
from service.runtime.by_settings import zenoh_of
from service.runtime.ingest import ingest
from service.runtime.rig_sources import GivenRigs
from service.runtime.role_process import Context
from service.runtime.serve import recorder, recorder_figures, records_raw
from service.runtime.supervisor import Role
from service.runtime.twin_port import Twin
from service.runtime.work_processes import WORK
from service.runtime.workers import workers_here
from service.settings import Settings
from service.transport.protocol import OpenTransport


def settings_of(settings: Settings, partition: int, layout: Layout) -> Settings:
    """The settings of one partition: its keys, and where its recordings are."""
    return settings.model_copy(
        update={
            "prefix": layout.prefix_of(partition),
            "raw_folder": settings.raw_folder and settings.raw_folder / folder_of(partition),
            "new_assets": settings.rule_of_new_assets[0],
        }
    )


@dataclass(kw_only=True)
class PartitionRoles:
    """The roles of one partition.

    settings   of the fleet
    twin       its functions
    node       where this is, for people
    host       that has the partition; None where nobody leases it
    lost       called when another process has taken the partition
    """

    settings: Settings
    partition: int
    layout: Layout
    twin: Twin
    node: str = ""
    host: str | None = None
    lost: Callable[[], None] = leave_at_once

    @cached_property
    def own(self) -> Settings:
        """The settings of the partition."""
        return settings_of(self.settings, self.partition, self.layout)

    @property
    def roles(self) -> list[Role]:
        """Those that a host's supervisor has done."""
        name, record = ident_of(INGEST, self.partition), ident_of(RECORD, self.partition)
        found = [Role(name=name, work=partial(self.ingest, processes=True), hears=(WORK, record))]
        if records_raw(self.own):
            found.append(
                recorder(
                    self.own, Path(), lambda others: self._recorded, name=record, prefix=self.layout.prefix,
                    here=partial(is_hashed_to, self.layout, self.partition),
                )
            )  # fmt: skip
        return found

    def ingest(self, context: Context, *, open_transport: OpenTransport | None = None, processes: bool = False) -> None:
        """Does the role `ingest` of the partition, with workers in threads where there are no other processes."""
        own, timing = self.own, Timing()
        fence = Fence(partition=self.partition, host=self.host, lost=self.lost)
        streams = PartitionStreams(self.layout, self.partition)
        record = ident_of(RECORD, self.partition)

        @contextmanager
        def open_store() -> Iterator[SqlStore]:
            tables = partition_tables(database_of(self.settings), fence, self.layout)
            with SqlStore(Database(tables, claimed=True, took=timing.stored)) as store:
                streams.read(store.database)
                yield store

        given = GivenRigs.read(own.rig, own.asset_rigs)
        ingest(
            context, own, partial(Begun.of, own, given, open_store, streams.refusal), self.twin,
            partial(workers_here, others=context.others if processes else None),
            timing=timing, open_transport=open_transport or zenoh_of(own),
            meant=lambda error: is_away(error) or error.reason == "locked",
            beside=partial(recorder_figures, context.others, record) if processes and records_raw(own) else dict,
            on_commit=lambda begun: partial(streams.committed, begun.store.database),
            node=self.node, says_figures=True,
        )  # fmt: skip

    def _recorded(self) -> Database:
        return fleet_tables(database_of(self.settings), self.layout, "gear-twin records", self.partition)
