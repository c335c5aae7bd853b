"""The service's loop from closed windows to committed results, turned by hand."""

from __future__ import annotations

from types import SimpleNamespace

import fake_twin

from service.alarms.keeper import AlarmKeeper
from service.results.alarm_store import AlarmStore
from service.results.asset_table import AssetTable
from service.results.baseline_store import BaselineStore
from service.results.jobs import Jobs
from service.results.names import Names
from service.results.window_jobs import WindowJobs
from service.runtime.backlogs import Backlogs
from service.runtime.outcomes import ClosedWindow
from service.runtime.reception import Reception
from service.runtime.spool import BacklogLimits, Spool
from service.runtime.storage_watch import StorageWatch
from service.runtime.work import Work
from service.runtime.work_loop import WorkLoop
from service.stream.assembly import Assembler
from twin.rig import Rig

ROOMY = BacklogLimits(windows=100, bytes=10**9, total_windows=1000, total_bytes=10**9, memory_bytes=10**9)


def work_of(store, folder, twin=fake_twin.TWIN, table=None, alarms=None, signals=None):
    """What carries turns out over a store."""
    alarms = alarms or AlarmKeeper(AlarmStore(store.database))
    return Work(
        store, table or AssetTable(store, alarms), twin,
        windows=WindowJobs(store.database, folder / "segments", sweeps=False), names=Names(store.database),
        baselines=BaselineStore(store.database, folder / "baselines"), alarms=alarms, signals=signals,
    )  # fmt: skip


def loop_of(store, folder, twin=fake_twin.TWIN, **limits):
    """All of the loop, by name; `add` takes a segment to be a window of an asset, `carry_out` does what waits."""
    clock = [0.0]
    alarms = AlarmKeeper(AlarmStore(store.database))
    table = AssetTable(store, alarms)
    windows, storage, done = WindowJobs(store.database, folder / "segments"), StorageWatch("data", lambda: clock[0]), []
    reception = Reception(lambda asset: Rig.from_mapping({}), lambda closed: spool.add(closed))
    backlogs = Backlogs(windows)
    work = work_of(store, folder, twin, table, alarms)
    loop = WorkLoop(work, Jobs(store.database), store.database.at_work(), "here")
    given = BacklogLimits(**{name: limits.get(name, getattr(ROOMY, name)) for name in BacklogLimits.__slots__})
    spool = Spool(windows, store, reception, backlogs, storage, given, settled=lambda asset: None)

    def carry_out(most=1000):
        """Carries out what waits, and what that leads to."""
        turn, work.turn = work.turn, lambda asset, **given: done.append(turn(asset, **given)) or done[-1]
        try:
            while most and loop.turn():
                most -= 1
        finally:
            work.turn = turn
            backlogs.changed()

    def add(asset, segment):
        spool.add(ClosedWindow(asset=asset, segment=segment, assembly=Assembler().to_dict()))

    return SimpleNamespace(**locals())
