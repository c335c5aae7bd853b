"""Decisions on effects: kept when they are taken in, carried out once by the thread that owns the twin.

    desk.submit(asset, name, verb) → id        in the store when it returns, whatever happens then
    desk.wait(id, seconds) → StoredDecision    once it has been carried out or refused; None while it waits

The worker asks `desk.asked` between frames. A decision and what it changes are one transaction, so one that was taken
in before a crash is carried out by the next start, and none twice.
"""

from __future__ import annotations

import threading
import time

from service.results.store import ResultStore, StoredDecision


class DecisionQueue:
    """Where decisions are handed in, and waited for."""

    def __init__(self, store: ResultStore) -> None:
        self._store = store
        self._changed = threading.Condition()
        self._closed = False
        self.asked = threading.Event()
        if store.pending_decisions():
            self.asked.set()

    def submit(self, asset: str, name: str, verb: str) -> int:
        """Keeps a decision; its id."""
        number = self._store.add_decision(asset, name, verb)
        self.asked.set()
        return number

    def wait(self, number: int, seconds: float) -> StoredDecision | None:
        """The decision once it is done; None after so many seconds, or where the service ends before."""
        deadline = time.monotonic() + seconds
        with self._changed:
            while True:
                decision = self._store.decision(number)
                if decision.done:
                    return decision
                left = deadline - time.monotonic()
                if left <= 0 or self._closed:
                    return None
                self._changed.wait(min(left, 0.5))

    def pending(self) -> tuple[StoredDecision, ...]:
        """What waits, oldest first; the worker's."""
        self.asked.clear()
        return self._store.pending_decisions()

    def done(self) -> None:
        """Wakes who waits."""
        with self._changed:
            self._changed.notify_all()

    def close(self) -> None:
        """Lets go who waits: the service ends, and what is kept is left to its next start."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
