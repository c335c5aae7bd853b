"""Twins that worker processes can make by name; what they do is said by the rig file's name."""

from __future__ import annotations

import logging
import os
import signal
import time
import warnings
from dataclasses import replace
from pathlib import Path

import fake_twin

from twin.observed import TRACING, part

log = logging.getLogger(__name__)


def sleeps(rig):
    """`slow 20 PATH`: takes 20 s, and marks that it has begun."""
    seconds, *marks = rig.name.split()[1:]
    for mark in marks:
        Path(mark).touch()
    time.sleep(float(seconds))


def searches(rig):
    """`searches PATH`: every window leads to a search, which marks in which process it was made."""
    with part(TRACING), Path(rig.name.partition(" ")[2]).open("a", encoding="utf-8") as file:
        file.write(f"{os.getpid()}\n")


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


def make(options):
    """A twin, for a worker process."""
    return replace(fake_twin.TWIN, step=step, options=options, make=make)


if __name__ == "__main__":
    import worker_twins
    from one_partition import serve

    serve(worker_twins.make(None), fake_twin.JOINED)
