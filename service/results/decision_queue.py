"""Decisions on effects: kept when they are submitted, carried out once by the thread that owns the twin.

    queue.submit(asset, name, verb) → id        in the store when it returns, whatever happens then
    await queue.wait(id, seconds) → decision    once it has been carried out or refused; None while it waits

Inspections wait in the same way: `submit_inspection`, `wait_for_inspection`. The worker asks `queue.asked` between
frames. A decision and what it changes are one transaction, so one that was submitted before a crash is carried out by
the next start, and none twice.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import Any

from service.results.change_signal import DoneSignal
from service.results.store import ResultStore, StoredDecision, StoredInspection


class DecisionQueue:
    """Where decisions are submitted, and waited for.

    look_every  how often who waits looks [s], where another process carries them out
    """

    def __init__(self, store: ResultStore, look_every: float | None = None) -> None:
        self._store, self._signal = store, DoneSignal(look_every)
        self.asked = threading.Event()
        if store.pending_decisions() or store.pending_inspections():
            self.asked.set()

    def submit(self, asset: str, name: str, verb: str, by: str | None = None, note: str | None = None) -> int:
        """Keeps a decision, with the person's name and note; its id."""
        try:
            return self._store.add_decision(asset, name, verb, by, note)
        finally:  # also where nobody knows whether it was committed: then it is carried out if it was
            self.asked.set()

    def submit_inspection(self, asset: str, inspection: Mapping[str, Any], answer: Mapping[str, Any]) -> int:
        """Keeps a measured depth with the twin's own figure; its id."""
        try:
            return self._store.add_inspection(asset, inspection, answer)
        finally:
            self.asked.set()

    async def wait(self, number: int, seconds: float) -> StoredDecision | None:
        """The decision once it is done; None after so many seconds, or where the service ends before."""
        return await self._signal.done(self._store.decision, number, seconds)

    async def wait_for_inspection(self, number: int, seconds: float) -> StoredInspection | None:
        """The inspection once it is done; None as in `wait`."""
        return await self._signal.done(self._store.inspection, number, seconds)

    def pending(self) -> tuple[StoredDecision, ...]:
        """What waits, oldest first; for the worker."""
        self.asked.clear()
        return self._store.pending_decisions()

    def pending_inspections(self) -> tuple[StoredInspection, ...]:
        """Inspections that wait, oldest first; for the worker, after `pending`."""
        return self._store.pending_inspections()

    def done(self) -> None:
        """Wakes waiting callers."""
        self._signal.wake()

    def release(self) -> None:
        """Releases waiting callers: the storage cannot be used now, and what is kept is carried out once it can."""
        self._signal.release()

    def close(self) -> None:
        """Releases waiting callers: the service ends, and what is kept is left to its next start."""
        self._signal.close()
