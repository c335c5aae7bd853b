"""What a service reads at its start: all of it, or nothing where the storage is lost meanwhile."""

from __future__ import annotations

import gc
import logging
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from types import TracebackType

from service.alarms.keeper import AlarmKeeper
from service.alarms.rules import rules_at
from service.long_lived import long_lived
from service.results.alarm_store import AlarmStore
from service.results.asset_rows import put
from service.results.asset_table import AssetTable
from service.results.baseline_store import BaselineStore
from service.results.data_folder import BASELINES, SEGMENTS
from service.results.jobs import Jobs
from service.results.kept_signals import KeptSignals
from service.results.names import Names
from service.results.snapshot import Snapshot
from service.results.sql_store import SqlStore
from service.results.unknown_assets import Elsewhere, UnknownAssets, everything_here
from service.results.window_jobs import WindowJobs
from service.runtime.kept import Kept, Start
from service.runtime.rig_sources import GivenRigs
from service.runtime.rigs import Rigs
from service.settings import Settings

log = logging.getLogger(__name__)

OpenStore = Callable[[], AbstractContextManager[SqlStore]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Begun(AbstractContextManager["Begun"]):
    """The open store, what was read of it, and where results are kept and shown; closed when it is left."""

    store: SqlStore
    table: AssetTable
    kept: Kept
    alarms: AlarmKeeper
    rigs: Rigs
    resources: ExitStack

    @classmethod
    def of(
        cls, settings: Settings, given_rigs: GivenRigs, open_store: OpenStore, elsewhere: Elsewhere = everything_here
    ) -> Begun:
        """Opens the store and reads what the service begins with. StorageUnavailable where it is lost meanwhile.

        elsewhere  why a stream is not used here but by another service, or None; asked once the store is open
        """
        with ExitStack() as stack:
            store = stack.enter_context(open_store())
            segments = settings.data / SEGMENTS
            windows = WindowJobs(store.database, segments)
            windows.step_back()
            names = Names(store.database)
            alarms = AlarmKeeper(AlarmStore(store.database), rules_at(settings.alarm_rules), settings.webhooks)
            declare(settings, store, names, elsewhere)
            jobs = Jobs(store.database)
            table, start = stack.enter_context(_restored(store, alarms, jobs))
            kept = Kept(
                store=store,
                table=table,
                jobs=jobs,
                windows=windows,
                signals=KeptSignals(store.database, segments, settings.signal_bytes),
                unknown=unknown_of(settings, elsewhere),
                baselines=BaselineStore(store.database, settings.data / BASELINES),
                names=names,
                alarms=alarms,
                start=[start],
            )
            rigs = Rigs(
                store,
                table,
                given_rigs,
                asks=kept.unknown.asks,
                names=names,
            )
            resources = stack.pop_all()
        return cls(store=store, table=table, kept=kept, alarms=alarms, rigs=rigs, resources=resources)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.resources.close()


@contextmanager
def _restored(store: SqlStore, alarms: AlarmKeeper, jobs: Jobs) -> Iterator[tuple[AssetTable, Start]]:
    """What is shown of all assets as long as the service runs, and what their streams go on from."""
    with long_lived():
        table = AssetTable(store, alarms, most=None)
        start = Start.read(jobs, table.load)
    try:
        yield table, start
    finally:
        gc.unfreeze()


def declare(settings: Settings, store: SqlStore, names: Names, elsewhere: Elsewhere = everything_here) -> None:
    """Assets that the settings name are there from now on."""
    declared = dict.fromkeys((*settings.assets, *settings.asset_rigs))
    new = [asset for asset in declared if names.is_free(asset) and elsewhere(asset) is None]
    put(store.database, [Snapshot(asset=asset, label=asset).with_whole() for asset in new])


def unknown_of(settings: Settings, elsewhere: Elsewhere = everything_here) -> UnknownAssets:
    """The list of unknown assets, by the settings."""
    rule, why = settings.rule_of_new_assets
    log.info("new assets: %s%s", rule, "" if why is None else f" ({why})")
    return UnknownAssets(
        asks=rule == "ask", most=settings.unknown_assets, expire=settings.unknown_expire, elsewhere=elsewhere
    )
