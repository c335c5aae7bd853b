"""The processes that compute, as a service sees them: the role `work`, by what it says as soon as it changes."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

from service.errors import StoreError
from service.runtime.role_process import Others

WORK = "work"
MOST_DEATHS = 10  # of workers in a row, after which the service does not call itself ready
SLOW_START = 10.0  # after which the service says that it waits for the first worker [s]


class WorkProcesses:
    """The role `work` of one service.

    count  of the workers
    """

    def __init__(self, count: int, others: Others) -> None:
        self._count, self._others, self._began = count, others, time.monotonic()
        self._deaths = self._seen = 0  # of workers of processes that have ended; of those of the present one

    def start(self) -> None:
        """Its supervisor has started it."""

    def end(self) -> None:
        """Its supervisor ends it."""

    def unusable(self) -> str | None:
        """Why nothing can be computed: no worker lives, or they end with whatever they are asked."""
        figures, state = self._figures, self._others.state(WORK)
        if figures.get("living") and state.process is not None:
            in_a_row = figures["in_a_row"]
            if in_a_row < MOST_DEATHS:
                return None
            return f"the last {in_a_row} calls to the twin ended their worker processes; is there enough memory?"
        if why := state.unstarted or figures.get("unstarted"):
            return f"no worker process can be started: {why}"
        if time.monotonic() - self._began > SLOW_START:
            return f"no worker process could be started for {SLOW_START:g} s"
        return "the first worker process is being started"

    def stuck(self) -> StoreError | None:
        """Why nothing can be committed; SteppedBack once a worker has met it."""
        why: StoreError | None = self._figures.get("stuck")
        return why

    def at_work(self) -> tuple[str, ...]:
        """The assets that are worked on."""
        at_work: tuple[str, ...] = self._figures.get("at_work", ())
        return at_work

    def figures(self) -> Mapping[str, Any]:
        """Figures for /metrics."""
        figures = self._figures
        since, deaths = figures.get("since"), figures.get("deaths", 0)
        if deaths < self._seen:  # of another process
            self._deaths += self._seen
        self._seen = deaths
        return {
            "workers": self._count,
            "workers_busy": len(self.at_work()),
            "worker_deaths": self._deaths + deaths,
            "worker_servers_replaced": self._others.state(WORK).replaced,
            "twin_call_seconds": 0.0 if since is None else time.monotonic() - since,
        }

    @property
    def _figures(self) -> Mapping[str, Any]:
        said: Mapping[str, Any] = self._others.said(WORK) or {}
        return said
