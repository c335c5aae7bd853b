"""What the service shows: one immutable snapshot an asset, read by REST, events, Zenoh and the page.

Whoever takes in a window publishes its snapshot here, after the store has committed it; readers take the
snapshot that is there and compute nothing.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

from service.contract.answer import assemble
from service.results.store import ResultStore, StoredWindow

Totals = Mapping[tuple[str, str, str], tuple[int, int]]
"""(kind, channel, action) → (frames, samples or edges concerned; windows concerned)."""

REFUSED = "refused"
NO_WINDOW = "no whole measurement window has been received yet"


@dataclass(frozen=True, slots=True, kw_only=True)
class Snapshot:
    """All that is shown of one asset, as of its last committed window."""

    asset: str
    status: str = "waiting"  # waiting, ok, degraded
    reason: str = NO_WINDOW
    records: tuple[Mapping[str, Any], ...] = ()
    trend: tuple[Mapping[str, Any], ...] = ()  # one a window that was not refused: figures with their bands
    report: Mapping[str, Any] | None = None
    rig: Mapping[str, Any] | None = None
    quality: Mapping[str, Any] = field(default_factory=dict)
    fault_totals: Totals = field(default_factory=dict)
    updates: int = 0
    inspections: tuple[Mapping[str, Any], ...] = ()
    last_event_id: int = 0
    whole: Mapping[str, Any] = field(default_factory=dict)  # the contract's section 4

    def with_windows(self, windows: Iterable[StoredWindow]) -> Snapshot:
        """The snapshot with more committed windows, their report apart."""
        windows = tuple(windows)
        if not windows:
            return self
        status, reason = _status(windows[-1].record)
        return replace(
            self,
            status=status,
            reason=reason,
            records=self.records + tuple(w.record for w in windows),
            trend=self.trend + tuple(_point(w) for w in windows if w.record.get("quality") != REFUSED),
            fault_totals=_totals(self.fault_totals, windows),
            updates=self.updates + sum(1 for w in windows if w.record.get("updated")),
        )

    def summary(self) -> dict[str, Any]:
        """The asset in the list of assets."""
        last = self.trend[-1] if self.trend else {}
        return {
            "asset": self.asset,
            "status": self.status,
            "reason": self.reason,
            "windows": len(self.records),
            "updates": self.updates,
            "revolutions": last.get("revolutions"),
            "last_window": self.records[-1].get("start_time") if self.records else None,
            "rig": (self.rig or {}).get("name"),
            "last_event_id": self.last_event_id,
        }

    def data_quality(self) -> dict[str, Any]:
        """The section `data_quality` of the state, with the faults of all windows added up."""
        totals = [
            {"kind": kind, "channel": channel, "action": action, "count": count, "windows": windows}
            for (kind, channel, action), (count, windows) in sorted(self.fault_totals.items())
        ]
        return {**self.quality, "totals": totals}


class Board:
    """The snapshots of all assets, and who waits for them to change."""

    def __init__(self) -> None:
        self._snapshots: dict[str, Snapshot] = {}
        self._lock = threading.Lock()
        self._waiting: dict[object, Callable[[], None]] = {}
        self.closed = False

    @classmethod
    def from_store(cls, store: ResultStore) -> Board:
        """The board as it was when the last window was committed."""
        board = cls()
        for name in store.assets():
            stored = store.asset(name)
            snapshot = Snapshot(
                asset=name,
                report=stored.report,
                rig=stored.rig,
                quality=stored.quality or {},
                inspections=store.inspections(name),
                last_event_id=store.last_event_id(name),
            )
            board._put(snapshot.with_windows(store.windows(name)))
        return board

    # -- reading -------------------------------------------------------------------------------------

    def assets(self) -> tuple[str, ...]:
        return tuple(sorted(self._snapshots))

    def get(self, asset: str) -> Snapshot | None:
        return self._snapshots.get(asset)

    # -- publishing ----------------------------------------------------------------------------------

    def add_window(self, asset: str, window: StoredWindow, **changes: Any) -> Snapshot:
        """Shows one committed window, and changed parts of the snapshot beside it."""
        return self._change(asset, lambda s: replace(s.with_windows([window]), **changes))

    def update(self, asset: str, **changes: Any) -> Snapshot:
        """Shows changed parts of an asset's snapshot: rig, quality, last_event_id."""
        return self._change(asset, lambda s: replace(s, **changes))

    def add_inspection(self, asset: str, inspection: Mapping[str, Any]) -> Snapshot:
        return self._change(asset, lambda s: replace(s, inspections=(*s.inspections, inspection)))

    def close(self) -> None:
        """Ends every wait: the service goes down."""
        self.closed = True
        self._wake()

    @contextmanager
    def changes(self) -> Iterator[asyncio.Event]:
        """An event of the running loop that is set at each change; the reader clears it."""
        loop, changed, key = asyncio.get_running_loop(), asyncio.Event(), object()

        def wake() -> None:
            if not loop.is_closed():  # a loop that has ended meanwhile has no one waiting
                loop.call_soon_threadsafe(changed.set)

        with self._lock:
            self._waiting[key] = wake
        try:
            yield changed
        finally:
            with self._lock:
                del self._waiting[key]

    # -- within --------------------------------------------------------------------------------------

    def _change(self, asset: str, change: Callable[[Snapshot], Snapshot]) -> Snapshot:
        with self._lock:
            snapshot = self._put(change(self._snapshots.get(asset) or Snapshot(asset=asset)))
        self._wake()
        return snapshot

    def _put(self, snapshot: Snapshot) -> Snapshot:
        whole = assemble(snapshot.asset, snapshot.records, snapshot.report, snapshot.quality)
        snapshot = replace(snapshot, whole=whole)
        self._snapshots[snapshot.asset] = snapshot
        return snapshot

    def _wake(self) -> None:
        with self._lock:
            waiting = list(self._waiting.values())
        for wake in waiting:
            wake()


def _point(window: StoredWindow) -> dict[str, Any]:
    """One window's figures, to be drawn against revolutions."""
    names = ("index", "kind", "revolutions", "updated")
    return {**{name: window.record.get(name) for name in names}, **window.figures}


def _totals(totals: Totals, windows: Iterable[StoredWindow]) -> Totals:
    out = dict(totals)
    for window in windows:
        for fault in window.record.get("faults", ()):
            key = (fault["kind"], fault["channel"], fault["action"])
            count, concerned = out.get(key, (0, 0))
            out[key] = (count + fault["count"], concerned + 1)
    return out


def _status(record: Mapping[str, Any]) -> tuple[str, str]:
    """The asset's status and its reason, by its latest window."""
    grade = record.get("quality", "good")
    if grade in ("good", "repaired"):
        return "ok", f"the latest window is {grade}"
    found = dict.fromkeys(f"{f['kind']} in {f['channel']}" for f in record.get("faults", ()))
    return "degraded", f"the latest window is {grade}: {record.get('reason') or ', '.join(found)}"
