"""One search for effects as a task of the engine: what a process of the engine does with it."""

from __future__ import annotations

from functools import cache

from service.runtime.worker_task import Reply, Task, perform, prepare


def search(task: Task, log_level: int, cache_bytes: int) -> Reply:
    """Carries a call out, with everything that it leads to.

    cache_bytes  wear curves that this process keeps for the next search [bytes]
    """
    _prepared(log_level, cache_bytes)
    return perform(task)


@cache
def _prepared(log_level: int, cache_bytes: int) -> None:
    """Once in a process."""
    prepare(log_level, cache_bytes)
