"""Assets that have changed, for a thread that shows them elsewhere: the latest state counts, and nothing is queued."""

from __future__ import annotations

import threading


class AssetChanges:
    """Names of the assets that have changed since they were last taken.

    It holds each name once, however often the asset changes: whoever takes a name finds the latest state on the
    table. Noting a change never waits.
    """

    def __init__(self) -> None:
        self._changed: dict[str, None] = {}  # in the order of their first change
        self._condition = threading.Condition()

    def note(self, *assets: str) -> None:
        """These assets have changed, or are there no longer."""
        with self._condition:
            self._changed.update(dict.fromkeys(assets))
            self._condition.notify_all()

    def take(self, timeout: float) -> tuple[str, ...]:
        """The assets that have changed; none where nothing changes within the time [s]."""
        with self._condition:
            if not self._changed and timeout:
                self._condition.wait(timeout)
            taken, self._changed = tuple(self._changed), {}
        return taken
