"""The service's loops under seeded schedules (`schedules.py`), and what these find where one of the cures is taken out.

GEAR_TWIN_TEST_SCHEDULES says how many are tried, or which: `515:516` is the one of seed 515.
"""

from __future__ import annotations

import os
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

import pytest
from schedules import Schedule, World

from service.results import sql_store
from service.results.asset_table import AssetTable
from service.results.database import Database
from service.results.jobs import Jobs
from service.results.sql_store import SqlStore
from service.results.window_jobs import WindowJobs
from service.runtime import commits, receiver
from service.runtime.spool import Spool
from service.runtime.work import Work

PARTS = 8
MEMORY = Path("/dev/shm")  # a file system without a disk, where there is one: no schedule cuts the power
pytestmark = [pytest.mark.slow, pytest.mark.timeout(3600)]


@pytest.fixture(scope="module")
def world():
    with TemporaryDirectory(dir=MEMORY if os.access(MEMORY, os.W_OK) else None) as folder:
        yield World(Path(folder))


def seeds():
    """Those to be tried: so many, or from one to another."""
    first, _, last = os.environ.get("GEAR_TWIN_TEST_SCHEDULES", "2000").rpartition(":")
    return range(int(first or 0), int(last))


def try_out(world, seed):
    """One schedule; what happened, in its order."""
    schedule = Schedule(world, seed)
    try:
        schedule.run()
        schedule.check()
    except Exception as error:
        raise AssertionError(f"seed {seed}: {schedule.faults.happened}: {error}") from error
    finally:
        schedule.close()
    return schedule.did, schedule.faults.happened, schedule.faults.statements


@pytest.mark.parametrize("part", range(PARTS))
def test_whatever_fails_everything_is_kept_once_in_order_and_shown(part, world):
    with world.entered():
        for seed in seeds()[part::PARTS]:
            try_out(world, seed)


def test_a_seed_does_the_same_again(world):
    with world.entered():
        for seed in range(5):
            assert try_out(world, seed) == try_out(world, seed)


def hold(store, asset, before, now, worker=None):
    """Whoever carries a job out commits it, also where somebody else has done so since."""
    with store.database.transaction() as db:
        db.execute(sql_store._RENEW, {"of": asset, "now": now})
        store.database.update_due(db, asset)
    return True


def place(work, asset, mark):
    """A state at hand is gone on from, whatever has been committed since."""
    _, known = work._places.get(asset, (None, None))
    known = known or work._read(asset)
    work._at_hand(known, mark)
    return known


def kept(spool, asset, start_ns, written):
    """An attempt before, of which nobody knows whether it was committed, is not looked for."""
    return spool._windows.add_waiting(asset, written, spool._assemblies.get(asset, {}))


def keep_all(spool, asset):
    """A window that cannot be kept now is dropped."""
    for closed in spool._pending.pop(asset):
        spool._storage.attempt(lambda closed=closed: spool._keep(closed))
        spool._held -= closed.segment.nbytes


def get(table, asset, real=AssetTable.get):
    """What this process knows of an asset is taken for what is there."""
    made = table._made.get(asset)
    return real(table, asset) if made is None else table._shown(asset, made)


def unswept(windows, database, folder, *, sweeps=True, real=WindowJobs.__init__):
    """A start deletes nothing."""
    folder.mkdir(exist_ok=True)
    real(windows, database, folder, sweeps=False)


FOUND_WITHIN = 400  # seeds: the rarest cure is needed in about one of 40
CURES = {
    "the fence": (commits, "_demand", lambda waits, asset: None, SqlStore, "hold", hold),
    "the mark of a state at hand": (Work, "_place", place),
    "the look for an attempt without an answer": (Spool, "_kept", kept),
    "windows wait for the storage": (Spool, "_keep_all", keep_all),
    "streams go on where they were": (receiver, "restore", lambda *given: None),
    "a look back at each new connection": (Database, "_look_back", lambda *given: None),
    "files without a row are deleted": (WindowJobs, "__init__", unswept),
    "what was not noticed is looked for": (AssetTable, "look", lambda table: ()),
    "a snapshot is compared with its row": (AssetTable, "get", get),
    "a job ends with what it led to": (Jobs, "end", lambda *given: True),
}


@pytest.mark.parametrize("cure", CURES)
def test_schedules_find_what_a_cure_is_for(cure, world):
    taken, found = [*CURES[cure]], pytest.raises(Exception)
    with ExitStack() as stack, found:
        while taken:
            stack.enter_context(patch.object(*taken[:3]))
            del taken[:3]
        stack.enter_context(world.entered())
        for seed in range(FOUND_WITHIN):
            try_out(world, seed)
