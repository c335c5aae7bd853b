"""What people have asked for is handed over in the order in which it was received, whatever its kind."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from heapq import merge
from typing import NamedTuple, Protocol

from service.errors import StoreError


class Pending(NamedTuple):
    """Something that waits: when it was received [ns], and what hands it to the lane of its asset, once."""

    received_ns: int
    begin: Callable[[], None]


class RequestWorker(Protocol):
    """Carries out what waits in queues of its own.

    asked  set while something may wait that has not been handed over
    """

    @property
    def asked(self) -> threading.Event: ...

    def pending(self) -> Sequence[Sequence[Pending]]:
        """What waits in each queue, oldest first; `asked` is cleared."""


class InOrder:
    """Hands what waits for several workers to the lanes, oldest first."""

    def __init__(self, *workers: RequestWorker) -> None:
        self._workers = workers

    def __call__(self) -> None:
        """Hands over what waits, where something new does."""
        if not any(worker.asked.is_set() for worker in self._workers):
            return
        try:
            queues = [queue for worker in self._workers for queue in worker.pending()]
            for request in merge(*queues, key=lambda request: request.received_ns):  # each queue keeps its order
                request.begin()
        except StoreError:
            for worker in self._workers:
                worker.asked.set()  # some still wait
            raise
