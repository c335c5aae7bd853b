"""What the service shows: one immutable snapshot an asset, read by REST, events, Zenoh and the page.

Whoever takes in a window publishes its snapshot here, after the store has committed it; readers take the
snapshot that is there and compute nothing.
"""

from __future__ import annotations

import asyncio
import threading
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

from service.records import NO_WINDOW, document
from service.store import Store, StoredWindow

LATEST_FAULTS = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class Quality:
    """What was wrong with the data so far."""

    windows: Mapping[str, int] = field(default_factory=dict)  # by good, repaired, degraded, refused
    faults: Mapping[tuple[str, str, str], tuple[int, int]] = field(default_factory=dict)
    # (kind, channel, action) → (frames, samples or edges concerned; windows concerned)
    latest: tuple[Mapping[str, Any], ...] = ()

    def with_window(self, window: StoredWindow) -> Quality:
        windows = dict(self.windows)
        windows[window.quality] = windows.get(window.quality, 0) + 1
        faults, latest = dict(self.faults), list(self.latest)
        for fault in window.faults:
            key = (fault["kind"], fault["channel"], fault["action"])
            count, concerned = faults.get(key, (0, 0))
            faults[key] = (count + int(fault["count"]), concerned + 1)
            latest.append({"window_start_ns": window.start_ns, **fault})
        return Quality(windows=windows, faults=faults, latest=tuple(latest[-LATEST_FAULTS:]))

    def to_dict(self) -> dict[str, Any]:
        return {
            "windows": dict(self.windows),
            "faults": [
                {"kind": kind, "channel": channel, "action": action, "count": count, "windows": windows}
                for (kind, channel, action), (count, windows) in sorted(self.faults.items())
            ],
            "latest": list(reversed(self.latest)),
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Snapshot:
    """All that is shown of one asset, as of its last committed window."""

    asset: str
    version: int = 0
    status: str = "waiting"  # waiting, ok, degraded
    reason: str = NO_WINDOW
    records: tuple[Mapping[str, Any], ...] = ()
    trend: tuple[Mapping[str, Any], ...] = ()  # one an accepted window: figures with their bands
    report: Mapping[str, Any] | None = None
    rig: Mapping[str, Any] | None = None
    quality: Quality = field(default_factory=Quality)
    counters: Mapping[str, Mapping[str, int]] = field(default_factory=dict)
    inspections: tuple[Mapping[str, Any], ...] = ()
    last_event_id: int = 0
    whole: Mapping[str, Any] = field(default_factory=dict)  # the contract's section 4

    @property
    def updates(self) -> int:
        return sum(1 for record in self.records if record.get("updated"))

    def summary(self) -> dict[str, Any]:
        """The asset in the list of assets."""
        last = self.records[-1] if self.records else {}
        return {
            "asset": self.asset,
            "status": self.status,
            "reason": self.reason,
            "windows": len(self.records),
            "updates": self.updates,
            "revolutions": last.get("revolutions"),
            "last_window": last.get("start_time"),
            "rig": (self.rig or {}).get("name"),
            "last_event_id": self.last_event_id,
        }


class Board:
    """The snapshots of all assets, and who waits for them to change."""

    def __init__(self) -> None:
        self._snapshots: dict[str, Snapshot] = {}
        self._lock = threading.Lock()
        self._waiting: dict[object, Callable[[], None]] = {}
        self._listeners: list[Callable[[Snapshot], None]] = []
        self.closed = False

    @classmethod
    def from_store(cls, store: Store) -> Board:
        """The board as it was when the last window was committed."""
        board = cls()
        for name in store.assets():
            stored = store.asset(name)
            windows = store.windows(name)
            accepted = [w for w in windows if w.record is not None]
            quality = Quality()
            for window in windows:
                quality = quality.with_window(window)
            status, reason = _status(windows[-1]) if windows else ("waiting", NO_WINDOW)
            board._put(
                Snapshot(
                    asset=name,
                    status=status,
                    reason=reason,
                    records=tuple(w.record for w in accepted),
                    trend=tuple(_point(w) for w in accepted),
                    report=stored.report,
                    rig=stored.rig,
                    quality=quality,
                    counters=dict(stored.counters),
                    inspections=store.inspections(name),
                    last_event_id=store.last_event_id(name),
                )
            )
        return board

    # -- reading -------------------------------------------------------------------------------------

    def assets(self) -> tuple[str, ...]:
        return tuple(sorted(self._snapshots))

    def get(self, asset: str) -> Snapshot | None:
        return self._snapshots.get(asset)

    # -- publishing ----------------------------------------------------------------------------------

    def add_window(
        self,
        asset: str,
        window: StoredWindow,
        *,
        report: Mapping[str, Any] | None = None,
        counters: Mapping[str, Mapping[str, int]] | None = None,
        last_event_id: int | None = None,
    ) -> Snapshot:
        """Shows one committed window; a refused one leaves the report as it was."""
        return self._change(
            asset,
            lambda s: replace(
                _with_window(s, window),
                report=s.report if report is None else report,
                counters=s.counters if counters is None else dict(counters),
                last_event_id=s.last_event_id if last_event_id is None else last_event_id,
            ),
        )

    def update(self, asset: str, **changes: Any) -> Snapshot:
        """Shows changed parts of an asset's snapshot: rig, counters, last_event_id."""
        return self._change(asset, lambda s: replace(s, **changes))

    def add_inspection(self, asset: str, inspection: Mapping[str, Any]) -> Snapshot:
        return self._change(asset, lambda s: replace(s, inspections=(*s.inspections, inspection)))

    def listen(self, listener: Callable[[Snapshot], None]) -> None:
        """Calls back with every new snapshot, in the publishing thread."""
        self._listeners.append(listener)

    def close(self) -> None:
        """Ends every wait: the service goes down."""
        self.closed = True
        self._wake()

    @contextmanager
    def changes(self) -> Iterator[asyncio.Event]:
        """An event of the running loop that is set at each change; the reader clears it."""
        loop, changed, key = asyncio.get_running_loop(), asyncio.Event(), object()

        def wake() -> None:
            # A loop that has ended meanwhile has no one waiting.
            if not loop.is_closed():
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
        for listener in self._listeners:
            listener(snapshot)
        return snapshot

    def _put(self, snapshot: Snapshot) -> Snapshot:
        whole = document(snapshot.asset, snapshot.records, snapshot.report)
        snapshot = replace(snapshot, whole=whole, version=snapshot.version + 1)
        self._snapshots[snapshot.asset] = snapshot
        return snapshot

    def _wake(self) -> None:
        with self._lock:
            waiting = list(self._waiting.values())
        for wake in waiting:
            wake()


def _with_window(snapshot: Snapshot, window: StoredWindow) -> Snapshot:
    """The snapshot with one more committed window, its report apart."""
    status, reason = _status(window)
    changed = replace(snapshot, status=status, reason=reason, quality=snapshot.quality.with_window(window))
    if window.record is None:
        return changed
    return replace(changed, records=(*snapshot.records, window.record), trend=(*snapshot.trend, _point(window)))


def _point(window: StoredWindow) -> dict[str, Any]:
    """One accepted window's figures, to be drawn against revolutions."""
    record = window.record or {}
    names = ("index", "kind", "revolutions", "updated")
    return {**{name: record.get(name) for name in names}, **window.figures}


def _status(window: StoredWindow) -> tuple[str, str]:
    if window.quality in ("good", "repaired"):
        return "ok", f"the latest window is {window.quality}"
    faults = Counter(f"{f['kind']} in {f['channel']}" for f in window.faults)
    what = ", ".join(faults) or "see its record"
    return "degraded", f"the latest window is {window.quality}: {what}"
