"""Where results are kept and shown, and what the streams go on from at a start."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from service.alarms.keeper import AlarmKeeper
from service.results.asset_table import AssetTable
from service.results.baseline_store import BaselineStore
from service.results.jobs import Job, Jobs
from service.results.kept_signals import KeptSignals
from service.results.names import Names
from service.results.sql_store import SqlStore
from service.results.store import StoredAsset
from service.results.unknown_assets import UnknownAssets
from service.results.window_jobs import WindowJobs


@dataclass(frozen=True, slots=True)
class Start:
    """What the streams go on from, as a start reads it.

    ended   jobs of which it tells; those that end later are followed. They are read first
    assets  all of the store, by name, until streams go on from them
    """

    ended: tuple[Job, ...]
    assets: dict[str, StoredAsset]

    @classmethod
    def read(cls, jobs: Jobs, read: Callable[[], Iterable[StoredAsset]]) -> Start:
        """Reads it; `read` answers all assets."""
        ended = jobs.ended()
        return cls(ended, {stored.asset: stored for stored in read()})


@dataclass(frozen=True, slots=True, kw_only=True)
class Kept:
    """Where results are kept and shown, and what waits to be carried out.

    start  what has been read of it, until streams go on from that
    """

    store: SqlStore
    table: AssetTable
    jobs: Jobs
    windows: WindowJobs
    names: Names
    baselines: BaselineStore
    signals: KeptSignals | None = None
    alarms: AlarmKeeper | None = None
    unknown: UnknownAssets = field(default_factory=UnknownAssets)
    start: list[Start] = field(default_factory=list)
