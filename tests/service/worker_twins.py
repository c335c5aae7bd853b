"""Twins that worker processes can make by name; what they do is said by the rig file's name."""

from __future__ import annotations

import logging
import os
import signal
import time
import warnings
from dataclasses import replace
from functools import partial
from pathlib import Path

import fake_twin

from service.errors import StorageUnavailable
from service.results.asset_table import AssetTable
from service.results.schema import WINDOW
from service.results.sql_store import SqlStore
from service.runtime import role_process
from service.runtime.commits import Commits
from twin.observed import TRACING, part

log = logging.getLogger(__name__)


def sleeps(rig):
    """`slow 20 PATH`: takes 20 s, and marks that it has begun."""
    seconds, *marks = rig.name.split()[1:]
    for mark in marks:
        Path(mark).touch()
    time.sleep(float(seconds))


def searches(rig):
    """`searches PATH 20`: every window leads to a search of 20 s, which marks that it has begun."""
    path, seconds = rig.name.split()[1:]
    with part(TRACING):
        Path(path).touch()
        time.sleep(float(seconds))


def dies(rig):
    """Ends its process, as a fault in compiled code or too little memory does."""
    os.kill(os.getpid(), signal.SIGKILL)


def dies_once(rig):
    """`once PATH`: ends its process, and marks that it has."""
    mark = Path(rig.name.partition(" ")[2])
    if not mark.exists():
        mark.touch()
        dies(rig)


def starves_once(rig):
    """`starved PATH`: there is no memory for it, and marks that there was none."""
    mark = Path(rig.name.partition(" ")[2])
    if not mark.exists():
        mark.touch()
        raise MemoryError


def complains(rig):
    log.warning("the twin of %s complains", rig.name)
    log.info("nothing that a warning level shows")
    warnings.warn("a warning of a library", stacklevel=1)


def fails(rig):
    raise ZeroDivisionError("a defect")


BEHAVIOURS = {
    "slow": sleeps,
    "searches": searches,
    "dies": dies,
    "once": dies_once,
    "starved": starves_once,
    "complains": complains,
    "fails": fails,
}


def step(rig, state, window, options):
    BEHAVIOURS.get(rig.name.split()[0], lambda rig: None)(rig)
    state, estimate = fake_twin.step(rig, state, window, options)
    estimate.record["pid"] = os.getpid()
    return state, estimate


def struck(where, kind, number, mark):
    """Has the first transaction of a job of a kind send its worker a signal, `within` it or `after` it; or fail: 0."""
    commit, write, kinds = Commits.commit, AssetTable.write, []

    def strike(here):
        if (here, kinds[-1]) == (where, kind) and not Path(mark).exists():
            written = Path(f"{mark}.new")
            written.write_text(str(os.getpid()))
            written.rename(mark)
            if not int(number):
                raise StorageUnavailable("the disk is full", reason="no space")
            os.kill(os.getpid(), int(number))

    def committed(self, outcome, job=None, marks=None):
        kinds.append(WINDOW if job is None else job.kind)
        is_new = commit(self, outcome, job, marks)
        strike("after")
        return is_new

    def written(self, snapshot):
        version = write(self, snapshot)
        strike("within")
        return version

    Commits.commit, AssetTable.write = committed, written


def dies_thrice(marks):
    """Ends the first three workers that come here, before they do anything."""
    with marks.open("a") as file:
        file.write("x")
    if marks.stat().st_size <= 3:
        dies(None)


def opened(file, mark):
    """A store that cannot be opened the first time."""
    if not mark.exists():
        mark.touch()
        raise StorageUnavailable("the server does not answer", reason="connection lost")
    return SqlStore(file, shared=True)


def make(options, strike=None):
    """A twin; for a worker process, `strike` is what `struck` takes, as text."""
    if strike is not None and role_process._channel is not None:
        struck(*strike.split()) if " " in strike else dies_thrice(Path(strike))
    return replace(fake_twin.TWIN, step=step, options=options, make=partial(make, strike=strike))


TWIN = make(None)


if __name__ == "__main__":
    import worker_twins
    from one_partition import serve

    serve(worker_twins.make(None, os.environ.get("STRUCK")), fake_twin.JOINED)
