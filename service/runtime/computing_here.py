"""Where the twins of a service are computed: by worker processes, or by threads of its own."""

from __future__ import annotations

from collections.abc import Callable

from service.runtime.computing import Computing
from service.runtime.computing_threads import Threads
from service.runtime.curves import CurvePlace, Curves
from service.runtime.twin_port import Twin
from service.runtime.usable_cores import usable_cores
from service.runtime.worker_processes import Processes
from service.settings import Settings

ComputingOf = Callable[[Settings, Twin, Callable[[], None]], Computing]
"""By the settings, for a twin; with what is called when something is ready to be collected."""


def computing_here(
    settings: Settings,
    twin: Twin,
    wake: Callable[[], None],
    *,
    curves: CurvePlace | None = None,
    keep: Callable[[str, Curves], object] = lambda asset, curves: None,
) -> Computing:
    """Where the twin's calls are carried out; `curves` and `keep` are those of `Processes`."""
    if settings.workers == 0 or twin.make is None:
        return Threads(twin.at_once, wake)
    return Processes(
        usable_cores() - 1 or 1 if settings.workers is None else settings.workers,
        task_limit=settings.task_limit,
        cache_bytes=settings.worker_cache_bytes,
        wake=wake,
        curves=curves,
        keep=keep,
    )
