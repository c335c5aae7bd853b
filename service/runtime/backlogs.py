"""What waits of all assets, as this process knows it: read again where something may have changed it."""

from __future__ import annotations

from collections.abc import Mapping

from service.results.window_jobs import Backlog, WindowJobs

NOTHING = Backlog()


class Backlogs:
    """The windows that wait, by asset. Read by one thread, and looked at by any."""

    def __init__(self, windows: WindowJobs) -> None:
        self._windows, self._changed = windows, True
        self._known: Mapping[str, Backlog] = {}

    def changed(self) -> None:
        """Something has been added, or carried out."""
        self._changed = True

    def __call__(self) -> None:
        """Reads what waits, where that may have changed."""
        if self._changed:
            self._known, self._changed = self._windows.backlogs(), False

    def now(self, asset: str) -> Backlog:
        """What waits of an asset now."""
        self()
        return self.of(asset)

    def of(self, asset: str) -> Backlog:
        """What waited of an asset when that was last read."""
        return self._known.get(asset, NOTHING)

    @property
    def all(self) -> Mapping[str, Backlog]:
        """What waited, by asset."""
        return self._known

    @property
    def windows(self) -> int:
        """How many windows wait."""
        return sum(backlog.all_windows for backlog in self._known.values())

    @property
    def bytes(self) -> int:
        """What they take on disk."""
        return sum(backlog.bytes for backlog in self._known.values())

    def most_waiting(self) -> str:
        """The asset whose windows take most."""
        return max(self._known, key=lambda asset: (self._known[asset].bytes, self._known[asset].all_windows))
