"""Storage that cannot be used now: said once per cause, tried again with growing pauses, and said to be over once.

Everything that the service's loop keeps goes through here, so that a full disk costs one attempt a pause and not one a
frame, and nothing of it ends the service.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from typing import TypeVar

from service.errors import SteppedBack, StorageUnavailable, StoreError
from service.results.storage_faults import is_away, storage_error

log = logging.getLogger(__name__)

T = TypeVar("T")

WAITING = "windows that have been received wait in memory"
ANSWERED_WITHIN = 2.5  # of what is asked of the storage, in a service that is ready [s]
LASTING = 3.0  # after which it is worth nobody's while to wait until it can be used again [s]
FIRST_PAUSE, LONGEST_PAUSE = 0.5, 10.0  # between two attempts [s]; publishers wait longer than that


class StorageWatch:
    """Whether what the service keeps can be written and read at present.

    where  the storage, as a person knows it
    clock  the monotonic clock [s]
    """

    def __init__(self, where: str, clock: Callable[[], float] = time.monotonic) -> None:
        self._where, self._clock = where, clock
        self._pause = FIRST_PAUSE
        self._next = 0.0
        self._cause: str | None = None
        self._asked: float | None = None  # since when an answer is waited for
        self._since = 0.0  # when it first failed, where it cannot be used
        self.reason: str | None = None
        self.failures = 0

    @property
    def pausing(self) -> bool:
        """Whether the next attempt is not due yet."""
        return self.reason is not None and self._clock() < self._next

    @property
    def lasts(self) -> bool:
        """Whether the storage has failed for more than a moment."""
        return self.reason is not None and self._clock() - self._since > LASTING

    @property
    def unusable(self) -> str | None:
        """Why the storage cannot be used at present, also while an answer of it is waited for; for any thread."""
        waited = 0.0 if (asked := self._asked) is None else self._clock() - asked
        if waited > ANSWERED_WITHIN:
            return f"{self._where} has not answered for {waited:.0f} s: {WAITING}"
        return self.reason

    def attempt(self, action: Callable[[], T]) -> tuple[bool, T | None]:
        """Does what needs the storage, unless it pauses; whether it was done, and what it answered."""
        if self.pausing:
            return False, None
        outer = self._asked
        self._asked = self._clock() if outer is None else outer
        try:
            answer = action()
        except SteppedBack:  # nothing that is remembered holds any more: the process ends, and is started again
            raise
        except (StoreError, OSError) as error:
            self.failed(error)
            return False, None
        finally:
            self._asked = outer
        return True, answer

    def failed(self, error: StoreError | OSError, meanwhile: str = WAITING) -> None:
        """The storage could not be used; what that means for the service meanwhile."""
        meant = error if isinstance(error, StoreError) else storage_error(error, self._where) or error
        cause = meant.reason if isinstance(meant, StorageUnavailable) else str(meant)
        self.failures += 1
        self._since = self._clock() if self.reason is None else self._since
        self._pause = FIRST_PAUSE if self.reason is None else min(2.0 * self._pause, LONGEST_PAUSE)
        self._next = self._clock() + self._pause
        self.reason = f"{meant}: {meanwhile}"
        if cause != self._cause:
            log.error("%s, and it is tried again", self.reason)
        self._cause = cause

    def worked(self) -> None:
        """All that waited for the storage has been kept."""
        if self.reason is not None:
            log.warning("the storage can be used again: what waited has been kept")
        self.reason = self._cause = None


class StoppedWaiting(Exception):
    """The service ends before its database could be used."""


def awaited(
    open_store: Callable[[], T],
    ended: threading.Event,
    meant: Callable[[StorageUnavailable], bool] = is_away,
    longest: float = LONGEST_PAUSE,
) -> T:
    """The store, tried again with growing pauses while it is away; StoppedWaiting once it is ended before.

    meant    whether the store may be there later
    longest  pause [s]
    """
    pause, said = FIRST_PAUSE, False
    while True:
        try:
            found = open_store()
        except StorageUnavailable as error:
            if not meant(error):
                raise
            if not said:
                log.warning("%s: it is waited for", error)
            said = True
        else:
            if said:
                log.warning("the database can be used now")
            return found
        if ended.wait(pause):
            raise StoppedWaiting
        pause = min(2 * pause, longest)
