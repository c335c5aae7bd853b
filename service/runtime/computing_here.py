"""Where the turns of a service's assets are carried out: by worker processes, or by threads of its own."""

from __future__ import annotations

from collections.abc import Callable

from service.runtime.computing import Computing, Turn, Turned
from service.runtime.computing_threads import Threads
from service.runtime.curves import CurvePlace, Curves
from service.runtime.twin_port import Twin
from service.runtime.usable_cores import usable_cores
from service.runtime.work import Workplace
from service.runtime.worker_processes import Processes
from service.settings import Settings

Here = Callable[[Turn], Turned]
ComputingOf = Callable[[Settings, Twin, Here, Callable[[], None]], Computing]
"""By the settings, for a twin; with what carries a turn out in this process, and what is called when one has been."""
LEAST = 2  # worker processes: one has no search under way, whatever the others do


def computing_here(
    settings: Settings,
    twin: Twin,
    here: Here,
    wake: Callable[[], None],
    *,
    place: Workplace | None = None,
    curves: CurvePlace | None = None,
    keep: Callable[[str, Curves], object] = lambda asset, curves: None,
) -> Computing:
    """Where turns are carried out; `place`, `curves` and `keep` are those of `Processes`."""
    if settings.workers == 0 or twin.make is None or place is None:
        return Threads(twin.at_once, here, wake)
    return Processes(
        max(usable_cores() - 1, LEAST) if settings.workers is None else settings.workers,
        place,
        task_limit=settings.task_limit,
        cache_bytes=settings.worker_cache_bytes,
        wake=wake,
        curves=curves,
        keep=keep,
    )
