"""Decisions on effects: kept when they are submitted, carried out once by the thread that owns the twin.

    queue.submit(asset, name, verb) → id        in the store when it returns, whatever happens then
    await queue.wait(id, seconds) → decision    once it has been carried out or refused; None while it waits

The worker asks `queue.asked` between frames. A decision and what it changes are one transaction, so one that was
submitted before a crash is carried out by the next start, and none twice.
"""

from __future__ import annotations

import asyncio
import threading

from starlette.concurrency import run_in_threadpool

from service.results.change_signal import ChangeSignal
from service.results.store import ResultStore, StoredDecision


class DecisionQueue:
    """Where decisions are submitted, and waited for."""

    def __init__(self, store: ResultStore) -> None:
        self._store = store
        self._signal = ChangeSignal()
        self._closed = False
        self.asked = threading.Event()
        if store.pending_decisions():
            self.asked.set()

    def submit(self, asset: str, name: str, verb: str) -> int:
        """Keeps a decision; its id."""
        number = self._store.add_decision(asset, name, verb)
        self.asked.set()
        return number

    async def wait(self, number: int, seconds: float) -> StoredDecision | None:
        """The decision once it is done; None after so many seconds, or where the service ends before.

        No thread is held meanwhile.
        """
        with self._signal.listening() as changed:
            try:
                async with asyncio.timeout(seconds):
                    while not self._closed:
                        changed.clear()  # before reading: what is done while reading sets it again
                        decision = await run_in_threadpool(self._store.decision, number)
                        if decision.done:
                            return decision
                        await changed.wait()
            except TimeoutError:
                pass
        return None

    def pending(self) -> tuple[StoredDecision, ...]:
        """What waits, oldest first; for the worker."""
        self.asked.clear()
        return self._store.pending_decisions()

    def done(self) -> None:
        """Wakes waiting callers."""
        self._signal.wake()

    def close(self) -> None:
        """Releases waiting callers: the service ends, and what is kept is left to its next start."""
        self._closed = True
        self._signal.wake()
