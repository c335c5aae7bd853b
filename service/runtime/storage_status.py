"""Storage that cannot be used is shown in the status of every asset, until it can be used again."""

from __future__ import annotations

from service.contract.base import iso_time
from service.results.board import Board
from service.runtime.state_publication import StatePublication
from service.runtime.storage_watch import StorageWatch
from service.steady_clock import later_time_ns


class StorageStatus:
    """Called between frames: shows when the storage fails and when it is back."""

    def __init__(self, storage: StorageWatch, board: Board, publication: StatePublication) -> None:
        self._storage, self._board, self._publication = storage, board, publication
        self.unstored: tuple[str, str] | None = None  # why, and since when (ISO 8601)

    def __call__(self) -> None:
        """Publishes all assets where the storage has failed or is back."""
        reason = self._storage.reason
        if (reason is None) is (self.unstored is None):
            return
        self.unstored = None if reason is None else (reason, iso_time(later_time_ns()))
        for asset in self._board.assets():
            self._board.update(asset, unstored=self.unstored)
            self._publication.publish(asset)
