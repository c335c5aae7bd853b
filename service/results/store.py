"""What the service remembers: the records, and the database that stores of several things share."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Any, Protocol

FaultTotals = Mapping[tuple[str, str, str], tuple[int, int]]
"""(kind, channel, action) → (frames, samples or edges concerned; windows concerned)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Event:
    """One thing that happened, in the order of `id`."""

    id: int
    asset: str
    kind: str  # window, update, effect, rul, data_fault, status, alarm
    data: Mapping[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredWindow:
    """One window as committed, a refused one too."""

    start_ns: int
    record: Mapping[str, Any]
    figures: Mapping[str, Any]  # depth and remaining life with their bands as of this window


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredAsset:
    """All that is known of one asset, as committed; None where nothing has been committed yet."""

    asset: str
    label: str  # what it is called now
    rig: Mapping[str, Any] | None = None
    state: Mapping[str, Any] | None = None  # of the twin
    report: Mapping[str, Any] | None = None
    assembly: Mapping[str, Any] | None = None  # where the stream's windows end
    making: Mapping[str, Any] | None = None  # what the making of the next window goes on from; counts of windows
    quality: Mapping[str, Any] | None = None  # what is known of its frames
    windows: int = 0  # how many have been committed, refused ones too
    updates: int = 0  # of them, that updated the twin
    fault_totals: FaultTotals = field(default_factory=dict)  # of all windows
    received_ns: int | None = None  # Unix time of this machine when the newest window was committed, or held [ns]
    epoch: int = 0  # number of the present gears: their windows, and no others, are counted above
    question: Mapping[str, Any] | None = None  # that waits for an answer by people
    retired: Mapping[str, Any] | None = None  # since when, by whom; None while the asset is in use
    damaged: str | None = None  # why its windows cannot go on from what is kept; None where they can
    unread_state: bool = False  # whether there is a state, which is read when it is first needed

    @property
    def has_state(self) -> bool:
        """Whether anything is kept of what the twin remembers."""
        return self.state is not None or self.unread_state


def faults_of(record: Mapping[str, Any]) -> dict[tuple[str, str, str], int]:
    """The faults of one window's record added up: (kind, channel, action) → frames, samples or edges concerned."""
    counts: dict[tuple[str, str, str], int] = {}
    for fault in record.get("faults") or ():
        key = (fault["kind"], fault["channel"], fault["action"])
        counts[key] = counts.get(key, 0) + fault["count"]
    return counts


class Tables(Protocol):
    """A database that several stores keep their tables in: service/results/database.py."""

    @property
    def share(self) -> int | None: ...

    def own(self, asset: Any) -> Any: ...

    def size(self) -> int: ...

    def transaction(self) -> AbstractContextManager[Any]: ...

    def rows(self, query: Any, values: Mapping[str, Any] | None = None) -> list[Any]: ...

    def insert(self, table: Any) -> Any: ...

    def add(self, db: Any, table: Any, row: Mapping[str, Any]) -> int: ...

    def ensure(self, db: Any, asset: str, beside: str | None = None) -> None: ...

    def update_due(self, db: Any, *assets: str) -> None: ...

    def show(self, shown: Collection[Any]) -> None: ...

    def named(self, db: Any, asset: str, name: str) -> None: ...
