"""What is shown of one asset: a snapshot, which is never changed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from service.contract.alarms import added_of, counted
from service.contract.answer import NO_WHOLE_WINDOW, assemble, health_of
from service.contract.base import iso_time
from service.contract.overview import overview
from service.contract.status import Backlog, asked, none_yet, not_stored
from service.results.sparkline import REFUSED, Sparkline
from service.results.sql_store import SqlStore
from service.results.store import FaultTotals, StoredAsset, StoredWindow, faults_of
from service.stream.quality import data_quality

TAIL = 100  # windows that a snapshot carries, the newest
FEW = 8  # windows that are read in place of those


@dataclass(frozen=True, slots=True, kw_only=True)
class Stale:
    """Why an asset's figures no longer say how the machine is now."""

    since_ns: int  # Unix time of this machine [ns]
    reason: str
    notice: int = field(default=0, compare=False)  # by which it is known: a window that came later ends it


@dataclass(frozen=True, slots=True, kw_only=True)
class Waiting:
    """Windows of an asset that wait to be assessed."""

    windows: int
    since_ns: int  # when the oldest of them was complete, Unix time of this machine [ns]
    behind: tuple[str, ...] = ()  # assets that are assessed before; empty where it is this asset's turn
    reason: str | None = None  # why none of any asset can be assessed at present

    def as_backlog(self) -> Backlog:
        """As the contract has it."""
        return Backlog(
            windows=self.windows, since=iso_time(self.since_ns), behind=list(self.behind), reason=self.reason
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Snapshot:
    """All that is shown of one asset, as of its last committed window. Its size does not grow with time."""

    asset: str
    label: str = ""  # what it is called now; empty where that is its id
    records: tuple[Mapping[str, Any], ...] = ()  # of the newest windows, oldest first
    latest: Mapping[str, Any] = field(default_factory=dict)  # the trend's point of the newest window that has one
    windows_total: int = 0
    updates: int = 0
    fault_totals: FaultTotals = field(default_factory=dict)
    report: Mapping[str, Any] | None = None
    alarms: tuple[Mapping[str, Any], ...] = ()  # that are open, most urgent first
    rig: Mapping[str, Any] | None = None
    counts: Mapping[str, Any] = field(default_factory=dict)  # of its windows; `Counts.to_dict`
    quality: Mapping[str, Any] = field(default_factory=dict)  # what is known of its frames; `received_quality`
    last_event_id: int = 0
    received_ns: int | None = None  # when the newest window was committed or held, Unix time of this machine [ns]
    last_frame_ns: int | None = None  # when the newest frame came, Unix time of this machine [ns]
    stale: Stale | None = None
    damaged: Stale | None = None  # why nothing more is processed
    sparkline: Sparkline = field(default_factory=Sparkline)
    waiting: Waiting | None = None  # windows to be assessed; None where none has waited for long
    unstored: tuple[str, str] | None = None  # why results cannot be stored now, and since when (ISO 8601)
    question: Mapping[str, Any] | None = None  # that waits for an answer by people
    epoch: int = 0  # number of the present gears
    retired: Mapping[str, Any] | None = None  # since when, by whom; None while the asset is in use
    whole: Mapping[str, Any] = field(default_factory=dict)  # the contract's section 4

    @classmethod
    def from_store(
        cls, store: SqlStore, stored: StoredAsset, last_event_id: int, before: Snapshot | None = None
    ) -> Snapshot:
        """The snapshot as it was when the last window was committed; reads no more than the newest windows.

        before  an earlier one, from which it goes on where only a few windows have been committed since
        """
        windows = None if before is None else before._followed(store, stored)
        if windows is None:
            windows = cls._of_windows(store, stored.asset)
        return replace(
            windows,
            asset=stored.asset,
            label=stored.label,
            windows_total=stored.windows,
            updates=stored.updates,
            fault_totals=stored.fault_totals,
            report=stored.report,
            rig=stored.rig,
            counts=stored.making or {},
            quality=stored.quality or {},
            last_event_id=last_event_id,
            received_ns=stored.received_ns,
            question=stored.question,
            epoch=stored.epoch,
            retired=stored.retired,
            damaged=None if stored.damaged is None else Stale(since_ns=stored.received_ns or 0, reason=stored.damaged),
        )

    @classmethod
    def _of_windows(cls, store: SqlStore, asset: str) -> Snapshot:
        """What a snapshot has of the newest windows."""
        windows = store.latest_windows(asset, TAIL)
        return cls(
            asset=asset,
            records=tuple(w.record for w in windows),
            latest=next((trend_point(w) for w in reversed(windows) if has_point(w)), {}),
            sparkline=Sparkline.from_store(store, asset, windows[-1].record["index"] if windows else -1),
        )

    def _followed(self, store: SqlStore, stored: StoredAsset) -> Snapshot | None:
        """What a snapshot has of the newest windows, by the few that have been committed since this one; else None."""
        more = stored.windows - self.windows_total
        if stored.epoch != self.epoch or not self.records or not 0 <= more <= FEW:
            return None
        windows = store.windows(self.asset, self.records[-1]["index"], more + 1)
        if len(windows) != more:
            return None
        found = Snapshot(asset=self.asset, records=self.records, latest=self.latest, sparkline=self.sparkline)
        for window in windows:
            found = found.with_window(window)
        return found

    def with_window(self, window: StoredWindow) -> Snapshot:
        """The snapshot with one more committed window, without its report."""
        return replace(
            self,
            records=(*self.records, window.record)[-TAIL:],
            latest=trend_point(window) if has_point(window) else self.latest,
            windows_total=self.windows_total + 1,
            updates=self.updates + bool(window.record.get("updated")),
            fault_totals=_added(self.fault_totals, window.record),
            sparkline=self.sparkline.with_record(window.record),
        )

    def with_whole(self) -> Snapshot:
        """The snapshot with the contract's section 4 made of the rest."""
        whole = assemble(
            self.name,
            self.records,
            self.report,
            data_quality(self.counts, self.quality),
            windows_total=self.windows_total,
            stale=self.stale_text,
            added=(*added_of(self.alarms), *not_stored(self.unstored)),
            question=self.question,
            epoch=self.epoch,
            retired=self.retired,
            backlog=self.backlog,
        )
        reason, since = self.unstored or (None, None)
        whole |= {
            "alarms": counted(self.alarms),
            "storage": None if self.unstored is None else {"reason": reason, "since": since},
            "last_seen": self.last_seen,
        }
        return replace(self, whole=whole)

    def health(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """`status` and `data` as they are shown with this snapshot's records, report, alarms and open question."""
        added = (*added_of(self.alarms), *not_stored(self.unstored), *asked(self.question))
        return health_of(self.report, self.records, self.stale_text, added, self.backlog)

    @property
    def name(self) -> str:
        """What the asset is called now."""
        return self.label or self.asset

    @property
    def backlog(self) -> Backlog | None:
        """The windows that wait to be assessed."""
        return None if self.waiting is None else self.waiting.as_backlog()

    @property
    def last_seen(self) -> str | None:
        """When the newest frame or window came (ISO 8601)."""
        seen = max((t for t in (self.last_frame_ns, self.received_ns) if t is not None), default=None)
        return None if seen is None else iso_time(seen)

    @property
    def stale_text(self) -> tuple[str, str] | None:
        """Why the figures are out of date, and since when (ISO 8601)."""
        found = self.damaged or self.stale
        return None if found is None else (found.reason, iso_time(found.since_ns))

    def summary(self) -> dict[str, Any]:
        """The asset in the list of assets."""
        data = self.whole.get("data") or {"level": "waiting", "reason": NO_WHOLE_WINDOW}
        return {
            "asset": self.name,
            "status": self.whole.get("status") or none_yet(NO_WHOLE_WINDOW),
            "data": data["level"],
            "reason": data["reason"],
            "alarms": counted(self.alarms),
            "windows": self.windows_total,
            "updates": self.updates,
            "revolutions": self.latest.get("revolutions"),
            "last_window": self.records[-1].get("start_time") if self.records else None,
            "last_frame": None if self.last_frame_ns is None else iso_time(self.last_frame_ns),
            "last_seen": self.last_seen,
            "rig": (self.rig or {}).get("name"),
            "last_event_id": self.last_event_id,
            **overview(self.whole, self.rig),
            "sparkline": self.sparkline.as_json(),
            "retired": self.retired is not None,
        }

    def data_quality(self) -> dict[str, Any]:
        """The section `data_quality` of the state, with the faults of all windows added up."""
        totals = [
            {"kind": kind, "channel": channel, "action": action, "count": count, "windows": windows}
            for (kind, channel, action), (count, windows) in sorted(self.fault_totals.items())
        ]
        return {**data_quality(self.counts, self.quality), "totals": totals}


def has_point(window: StoredWindow) -> bool:
    """Whether a window has a place on the trend: a refused one has not."""
    return window.record.get("quality") != REFUSED


def trend_point(window: StoredWindow) -> dict[str, Any]:
    """One window's figures, to be drawn against revolutions."""
    names = (
        "index", "kind", "start_time", "revolutions", "updated", "quality", "speed_hz", "torque_nm",
        "rms_measured", "rms_predicted", "rms_after", "error_percent",
    )  # fmt: skip
    return {**{name: window.record.get(name) for name in names}, **window.figures}


def _added(totals: FaultTotals, record: Mapping[str, Any]) -> FaultTotals:
    """The totals with one more window's faults."""
    out = dict(totals)
    for key, found in faults_of(record).items():
        count, windows = out.get(key, (0, 0))
        out[key] = (count + found, windows + 1)
    return out
