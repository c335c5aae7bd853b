"""Storage that cannot be used is shown in the status of every asset, until it can be used again."""

from __future__ import annotations

from service.contract.base import iso_time
from service.results.asset_table import AssetTable
from service.runtime.storage_watch import StorageWatch
from service.steady_clock import later_time_ns


class StorageStatus:
    """Called between frames: shows when the storage fails and when it is back."""

    def __init__(self, storage: StorageWatch, table: AssetTable) -> None:
        self._storage, self._table = storage, table

    def __call__(self) -> None:
        """Shows all assets anew where the storage has failed or is back."""
        reason = self._storage.reason
        if (reason is None) is (self._table.unstored is None):
            return
        self._table.note_unstored(None if reason is None else (reason, iso_time(later_time_ns())))
