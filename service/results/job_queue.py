"""Jobs on their way to whoever carries them out: kept when they are submitted, carried out once.

queue.submit(asset, kind, given) → id       in the database when it returns, whatever happens then
await queue.wait(id, seconds) → job         once it has been carried out or refused; None while it waits
"""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import Any

from service.errors import StoreError
from service.results.change_signal import DoneSignal
from service.results.jobs import Job, Jobs

ALARM, ASSET = "alarm", "asset"
"""What people write that is no job and is to be taken up: an alarm was signed, an asset was created."""


class JobQueue:
    """Where people's jobs are submitted, and waited for.

    look_every  how often who waits looks [s], where another process carries them out
    """

    def __init__(self, jobs: Jobs, look_every: float | None = None) -> None:
        self.jobs, self._signal = jobs, DoneSignal(look_every)
        self.asked = threading.Event()
        if jobs.pending():
            self.asked.set()

    def submit(self, asset: str, kind: str, given: Mapping[str, Any]) -> int:
        """Keeps a job; its id."""
        try:
            return self.jobs.add(asset, kind, given)
        finally:  # also where nobody knows whether it was committed: then it is carried out if it was
            self.asked.set()

    async def wait(self, number: int, seconds: float) -> Job | None:
        """The job once it is done; None after so many seconds, or where the service ends before."""
        return await self._signal.done(self.jobs.job, number, seconds)

    def assets(self) -> tuple[str, ...]:
        """The assets of which something waits; for whoever has it carried out."""
        self.asked.clear()
        try:
            return self.jobs.asked()
        except StoreError:
            self.asked.set()  # something may still wait
            raise

    def done(self) -> None:
        """Wakes waiting callers."""
        self._signal.wake()

    def release(self) -> None:
        """Releases waiting callers: the storage cannot be used now, and what is kept is carried out once it can."""
        self._signal.release()

    def close(self) -> None:
        """Releases waiting callers: the service ends, and what is kept is left to its next start."""
        self._signal.close()
