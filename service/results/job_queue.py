"""Jobs on their way to whoever carries them out: kept when they are submitted, carried out once.

queue.submit(asset, kind, given) → id       in the database when it returns, whatever happens then
await queue.wait(id, seconds) → job         once it has been carried out or refused; None while it waits
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from starlette.concurrency import run_in_threadpool

from service.errors import StorageUnavailable
from service.results.change_signal import ChangeSignal
from service.results.jobs import Job, Jobs

LOOK_EVERY = 0.5  # how often who waits looks without having been woken [s]


class JobQueue:
    """Where people's jobs are submitted, and waited for."""

    def __init__(self, jobs: Jobs) -> None:
        self.jobs, self._signal, self._closed, self._released = jobs, ChangeSignal(), False, 0

    def submit(self, asset: str, kind: str, given: Mapping[str, Any]) -> int:
        """Keeps a job; its id."""
        return self.jobs.add(asset, kind, given)

    async def wait(self, number: int, seconds: float) -> Job | None:
        """The job once it is settled; None after so many seconds, or where it is released before.

        No thread is held meanwhile.
        """
        released = self._released
        with self._signal.listening() as changed, suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                while not self._closed and released == self._released:
                    changed.clear()  # before reading: what is done while reading sets it again
                    with suppress(StorageUnavailable):  # it may be read at the next look
                        job = await run_in_threadpool(self.jobs.job, number)
                        if job.settled:
                            return job
                    with suppress(TimeoutError):
                        await asyncio.wait_for(changed.wait(), LOOK_EVERY)
        return None

    def done(self) -> None:
        """Wakes waiting callers: something has been committed."""
        self._signal.wake()

    def release(self) -> None:
        """Releases waiting callers: the storage cannot be used now, and what is kept is carried out once it can."""
        self._released += 1
        self._signal.wake()

    def close(self) -> None:
        """Releases waiting callers, and those who come later: the service ends; its next start goes on."""
        self._closed = True
        self._signal.wake()
