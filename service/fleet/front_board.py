"""The assets of a fleet as a front end answers them: the assets' tables of all partitions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from sqlalchemy import Select, Table

from service.alarms.keeper import AlarmKeeper
from service.fleet.front_store import FleetStore
from service.results.asset_table import AssetTable
from service.results.schema import ASSETS
from service.results.sql_store import SqlStore


class FleetBoard(AssetTable):
    """The assets of all partitions, and who waits for them to change."""

    def __init__(self, store: FleetStore, alarms: AlarmKeeper) -> None:
        super().__init__(store, alarms)
        self._fleet_store = store

    def _store_of(self, asset: str) -> SqlStore:
        return self._fleet_store.stores.of(asset)

    def _rows(self, query: Callable[[Table], Select], order: Sequence[str] = (), limit: int | None = None) -> list[Any]:
        return self._fleet_store.fleet.rows_of_all(ASSETS, query, order=order, first=limit)
