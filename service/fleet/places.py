"""Which partition an asset is in, and what a front end keeps for each partition."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import Generic, TypeVar

from service.fleet.front_database import FleetDatabase, SchemaDatabase
from service.fleet.layout import Layout
from service.fleet.naming import PLACE

T = TypeVar("T")


class Places:
    """The partition of each asset and name, for good: where it was given; else where it hashes to."""

    def __init__(self, database: FleetDatabase, layout: Layout) -> None:
        self._database, self._layout = database, layout
        self._known: dict[str, int] = {}

    def partition_of(self, asset: str) -> int:
        """The partition whose tables have the asset, or will have it."""
        found = self._known.get(asset)
        if found is not None:
            return found
        rows = self._database.shared.rows(PLACE, {"of": asset})
        if not rows:
            return self._layout.partition_of(asset)
        return self._known.setdefault(asset, int(rows[0][0]))

    def elsewhere(self, name: str, asset: str) -> bool:
        """Whether a name has been given in another partition than that of an asset."""
        rows = self._database.shared.rows(PLACE, {"of": name})
        return bool(rows) and rows[0][0] != self.partition_of(asset)

    def partition_of_number(self, number: int) -> int:
        """The partition whose tables have given out a number."""
        return self._layout.partition_of_number(number)


class Divided(Generic[T]):
    """What there is once for each partition, over the partition's tables; made when it is first needed."""

    def __init__(self, database: FleetDatabase, places: Places, make: Callable[[int, SchemaDatabase], T]) -> None:
        self._database, self._places, self._make = database, places, make
        self._made: dict[int, T] = {}
        self._lock = threading.Lock()

    def at(self, partition: int) -> T:
        """That of a partition."""
        with self._lock:
            if partition not in self._made:
                self._made[partition] = self._make(partition, self._database.partition(partition))
            return self._made[partition]

    def of(self, asset: str) -> T:
        """That of the partition of an asset."""
        return self.at(self._places.partition_of(asset))

    def of_number(self, number: int) -> T:
        """That of the partition which has given out a number."""
        return self.at(self._places.partition_of_number(number))

    def all(self) -> Iterator[T]:
        """Those of all partitions."""
        return map(self.at, range(self._database.count))
