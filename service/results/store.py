"""What the service remembers, whatever keeps it: the records, and what a store must do.

A store is added by one file in this folder that implements `ResultStore`, and is handed to `service.runtime.serve.run`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
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
    quality: Mapping[str, Any] | None = None
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

    took: Callable[[str, float], object]

    def size(self) -> int: ...

    def transaction(self) -> AbstractContextManager[Any]: ...

    def rows(self, query: Any, values: Mapping[str, Any] | None = None) -> list[Any]: ...

    def insert(self, table: Any) -> Any: ...

    def add(self, db: Any, table: Any, row: Mapping[str, Any]) -> int: ...

    def ensure(self, db: Any, asset: str) -> None: ...

    def named(self, db: Any, asset: str, name: str) -> None: ...

    def shown(self, db: Any, assets: Sequence[str]) -> None: ...


class ResultStore(Protocol):
    """Results of all assets, for several threads of one process."""

    @property
    def database(self) -> Tables:
        """Where stores of other things keep theirs, in transactions that this store takes part in."""
        ...

    # -- writing -------------------------------------------------------------------------------------

    def commit(
        self,
        asset: str,
        start_ns: int,
        *,
        record: Mapping[str, Any],
        state: Mapping[str, Any],
        report: Mapping[str, Any] | None,
        assembly: Mapping[str, Any],
        quality: Mapping[str, Any],
        received_ns: int,
        events: Iterable[tuple[str, Mapping[str, Any]]] = (),
    ) -> StoredWindow | None:
        """Takes in one window, whole; None (and nothing changed) where it is there already.

        A `report` of None, before the twin's first, leaves what is committed. `received_ns` is this machine's Unix time
        [ns]; the record's `index` is the window's number.
        """
        ...

    def note(self, asset: str, events: Iterable[tuple[str, Mapping[str, Any]]], window_ns: int | None = None) -> None:
        """Takes in what happened outside a window.

        window_ns  start of the committed window that was the cause: it stays when its history is thinned
        """
        ...

    def keep_rig(self, asset: str, rig: Mapping[str, Any]) -> None:
        """Keeps the rig file's mapping for the asset, in place of an earlier one."""
        ...

    def keep(self, asset: str, **parts: Any) -> None:
        """Keeps parts of what is known of an asset outside a window: fields of `StoredAsset` by name.

        A `question` or `retired` of None ends it; a greater `epoch` begins one without windows.
        """
        ...

    # -- reading -------------------------------------------------------------------------------------

    def assets(self) -> tuple[str, ...]: ...

    def asset(self, asset: str) -> StoredAsset:
        """What is committed of the asset; empty where it has never been seen."""
        ...

    def windows(
        self, asset: str, after: int = -1, limit: int = 1000, every: int = 1, epoch: int | None = None
    ) -> tuple[StoredWindow, ...]:
        """At most `limit` windows with an index above `after`, oldest first; of the present epoch where None is given.

        Of each `every` indices the first that is kept, and the newest in any case.
        """
        ...

    def outline(self, asset: str, most: int, after: int = -1, epoch: int | None = None) -> tuple[StoredWindow, ...]:
        """About `most` windows of one epoch with an index above `after`, oldest first; all where there are no more.

        Of each part of the history the first, those with the lowest and the highest measured RMS, and that with the
        highest kurtosis of any sensor; and the newest.
        """
        ...

    def all_assets(self) -> tuple[StoredAsset, ...]:
        """What is committed of every asset, by name; what their twins remember is checked and left unread."""
        ...

    def next_indices(self) -> Mapping[str, int]:
        """Index of every asset's next window: it goes on through all epochs."""
        ...

    def epochs(self, asset: str) -> tuple[Mapping[str, Any], ...]:
        """The epochs that have windows: `epoch`, `windows`, `first` and `last` index, and the first's `since`."""
        ...

    def latest_windows(self, asset: str, limit: int) -> tuple[StoredWindow, ...]:
        """The newest windows of the present epoch, oldest first."""
        ...

    def events(self, asset: str, after: int, limit: int = 500) -> tuple[Event, ...]:
        """The asset's events with an id above `after`, oldest first."""
        ...

    def last_event_id(self, asset: str) -> int: ...

    def last_event_ids(self) -> Mapping[str, int]: ...
