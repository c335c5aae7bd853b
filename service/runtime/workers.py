"""Those who compute for a service: threads of its own process, or the processes of the role `work`."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from typing import Any, Protocol

from service.errors import StoreError
from service.results.commit_watch import SharedWatch
from service.results.jobs import Jobs
from service.results.sql_store import SqlStore
from service.runtime.role_process import Others
from service.runtime.twin_port import Twin, guarded
from service.runtime.usable_cores import usable_cores
from service.runtime.work import Work, Workplace
from service.runtime.work_loop import LOOK_EVERY, WorkLoop
from service.runtime.work_processes import WorkProcesses
from service.runtime.work_role import WorkGiven
from service.settings import Settings

NAME = "twin"  # how the names of the threads begin
LEAST = 2  # worker processes: one has no search under way, whatever the others do
NONE = {"workers": 0, "workers_busy": 0, "worker_deaths": 0, "worker_servers_replaced": 0, "twin_call_seconds": 0.0}


WorkOf = Callable[[Twin], Work]
"""What carries jobs out in this process, with a twin."""


class Workers(Protocol):
    """Those who compute, from `start` to `end`."""

    def start(self) -> None: ...

    def end(self) -> None:
        """Ends them at once: what they compute is computed again by the next start."""
        ...

    def unusable(self) -> str | None:
        """Why nothing can be computed, or None."""
        ...

    def stuck(self) -> StoreError | None:
        """Why nothing that has been made can be committed, or None; SteppedBack where one of them has met it."""
        ...

    def at_work(self) -> tuple[str, ...]:
        """The assets that are worked on."""
        ...

    def figures(self) -> Mapping[str, Any]:
        """Figures for /metrics."""
        ...


WorkersOf = Callable[[Settings, Twin, WorkOf, SqlStore], Workers]
"""Those who compute, by the settings, for a twin and a database."""


class WorkThreads:
    """Threads of this process, as many as a twin allows."""

    def __init__(self, store: SqlStore, work: Work, count: int) -> None:
        self._store, self._work = store, work
        jobs, claims = Jobs(store.database), store.database.at_work()
        self._commits, self._ended = SharedWatch(), threading.Event()
        self._why: dict[int, StoreError] = {}  # by loop: why it can commit nothing
        self._began: dict[int, tuple[float, str]] = {}  # by loop: since when, monotonic [s], and the asset
        self._loops = [
            WorkLoop(work, jobs, claims, f"thread {number}", at=self._at_of(number), stuck=self._stuck_of(number))
            for number in range(count)
        ]

    def start(self) -> None:
        threading.Thread(target=self._listen, name="watch", daemon=True).start()
        for loop in self._loops:
            threading.Thread(target=loop.run, args=(self._commits,), name=NAME, daemon=True).start()

    def end(self) -> None:
        self._work.ended.set()
        self._ended.set()
        for loop in self._loops:
            loop.ended.set()
        self._commits.note()

    def unusable(self) -> str | None:
        return None

    def stuck(self) -> StoreError | None:
        return next(iter(self._why.copy().values()), None)

    def at_work(self) -> tuple[str, ...]:
        return tuple(asset for _, asset in self._began.copy().values())

    def figures(self) -> Mapping[str, Any]:
        began = [since for since, _ in self._began.copy().values()]
        return NONE | {"twin_call_seconds": max((time.monotonic() - since for since in began), default=0.0)}

    def _listen(self) -> None:
        with self._store.database.watching() as watch:
            while not self._ended.is_set():
                if watch.wait(LOOK_EVERY) is not None:
                    self._commits.note()

    def _stuck_of(self, number: int) -> Callable[[StoreError | None], None]:
        def stuck(why: StoreError | None) -> None:
            if why is None:
                self._why.pop(number, None)
            else:
                self._why[number] = why

        return stuck

    def _at_of(self, number: int) -> Callable[[str | None], None]:
        def at(asset: str | None) -> None:
            if asset is None:
                self._began.pop(number, None)
            else:
                self._began[number] = time.monotonic(), asset

        return at


def workers_here(
    settings: Settings, twin: Twin, here: WorkOf, store: SqlStore, *, others: Others | None = None
) -> Workers:
    """Those who compute by the settings: the processes of another role, where there is one, or threads."""
    if others is None or not in_processes(settings, twin):
        return WorkThreads(store, here(guarded(twin)), twin.at_once)
    return WorkProcesses(workers_of(settings), others)


def in_processes(settings: Settings, twin: Twin) -> bool:
    """Whether a twin can compute in processes of its own, and is to."""
    return settings.workers != 0 and twin.make is not None


def workers_of(settings: Settings) -> int:
    """How many worker processes there are."""
    return max(usable_cores() - 1, LEAST) if settings.workers is None else settings.workers


def work_given(settings: Settings, place: Workplace, **given: Any) -> WorkGiven:
    """What worker processes are given by the settings; `given` as `WorkGiven` has it."""
    return WorkGiven(place=place, count=workers_of(settings), **given)
