"""Results of all partitions: each call goes to the partition of its asset."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import chain
from typing import Any

from service.fleet.front_database import FleetDatabase
from service.fleet.layout import Layout
from service.fleet.places import Divided, Places
from service.results.sql_store import SqlStore
from service.results.store import Event, StoredAsset, StoredWindow


class FleetStore(SqlStore):
    """The results of a fleet, for one front end. What it adds is announced to the worker of the partition."""

    def __init__(self, database: str, layout: Layout) -> None:
        self.fleet = FleetDatabase(database, layout.partitions)
        self.database = self.fleet.shared
        self.places = Places(self.fleet, layout)
        self.stores: Divided[SqlStore] = Divided(self.fleet, self.places, lambda _, tables: SqlStore(tables))

    def __enter__(self) -> FleetStore:
        return self

    def __exit__(self, *_: object) -> None:
        self.fleet.close()

    # -- writing -------------------------------------------------------------------------------------

    def commit(self, asset: str, start_ns: int, **given: Any) -> StoredWindow | None:
        return self.stores.of(asset).commit(asset, start_ns, **given)

    def note(self, asset: str, events: Iterable[tuple[str, Mapping[str, Any]]], window_ns: int | None = None) -> None:
        """Takes in what happened; an asset that is new is announced."""
        self.stores.of(asset).note(asset, events, window_ns)

    def keep_rig(self, asset: str, rig: Mapping[str, Any]) -> None:
        self.stores.of(asset).keep_rig(asset, rig)

    def keep(self, asset: str, **parts: Any) -> None:
        self.stores.of(asset).keep(asset, **parts)

    # -- reading -------------------------------------------------------------------------------------

    def assets(self) -> tuple[str, ...]:
        return tuple(sorted(chain(*(s.assets() for s in self.stores.all()))))

    def asset(self, asset: str) -> StoredAsset:
        return self.stores.of(asset).asset(asset)

    def windows(
        self, asset: str, after: int = -1, limit: int = 1000, every: int = 1, epoch: int | None = None
    ) -> tuple[StoredWindow, ...]:
        return self.stores.of(asset).windows(asset, after, limit, every, epoch)

    def before(self, asset: str, start_ns: int) -> Mapping[str, Any]:
        return self.stores.of(asset).before(asset, start_ns)

    def outline(self, asset: str, most: int, after: int = -1, epoch: int | None = None) -> tuple[StoredWindow, ...]:
        return self.stores.of(asset).outline(asset, most, after, epoch)

    def all_assets(self) -> tuple[StoredAsset, ...]:
        return tuple(sorted(chain(*(s.all_assets() for s in self.stores.all())), key=lambda stored: stored.asset))

    def next_indices(self) -> dict[str, int]:
        return dict(chain(*(s.next_indices().items() for s in self.stores.all())))

    def epochs(self, asset: str) -> tuple[Mapping[str, Any], ...]:
        return self.stores.of(asset).epochs(asset)

    def latest_windows(self, asset: str, limit: int) -> tuple[StoredWindow, ...]:
        return self.stores.of(asset).latest_windows(asset, limit)

    def events(self, asset: str, after: int, limit: int = 500) -> tuple[Event, ...]:
        return self.stores.of(asset).events(asset, after, limit)

    def last_event_id(self, asset: str) -> int:
        return self.stores.of(asset).last_event_id(asset)

    def last_event_ids(self) -> dict[str, int]:
        return dict(chain(*(s.last_event_ids().items() for s in self.stores.all())))
