"""When an asset's figures no longer say how the machine is now, though nothing has failed.

Either the stream is silent for longer than is usual for it, or no whole window has come for a long time, or frames keep
coming and none of them ends in a window: their time stamps contradict each other or what was received before, or
channels that a window needs are missing. Time is measured by a clock that cannot step.

    silent for longer than 3·p,      p = median of the times from one window's start to the next

p  usual pause of the stream, by its own time stamps [s]; known from 4 windows on
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import pairwise
from statistics import median
from typing import Any

from service.alarms.keeper import AlarmKeeper
from service.contract.base import spoken_time
from service.contract.verdict import seconds_between
from service.results.asset_table import AssetTable
from service.results.snapshot import Snapshot, Stale
from service.runtime.outcomes import Outcome
from service.runtime.twin_port import Events
from service.steady_clock import steady_time_ns
from service.stream.frames import LENGTH_LIMITS

log = logging.getLogger(__name__)

NS = 1_000_000_000
LOOK_EVERY = 1.0  # how often the assets are looked at [s]
WINDOWS_MISSED = 3.0  # window lengths that frames must have covered before a missing window is a fault
PAUSES_MISSED = 3.0  # usual pauses of a stream after which it is silent
LEAST_STEPS = 3  # between windows, from which the usual pause is known
LEAST_SILENCE = 3 * LENGTH_LIMITS[1]  # three of the longest frames [s]


@dataclass(frozen=True, slots=True, kw_only=True)
class StalenessLimits:
    """How long an asset may be without a whole window [s]."""

    silent: float  # in any case
    fruitless: float  # while frames keep coming


@dataclass(slots=True)
class _Heard:
    """Frames of one asset since its last window, on this machine's clock [ns]."""

    window_ns: int | None = None  # the window that these frames follow
    first_ns: int | None = None
    last_ns: int | None = None


def usual_pause(records: Sequence[Mapping[str, Any]]) -> float | None:
    """Median time from one window's start to the next [s], by the latest records; None where they are too few."""
    starts = [record["start_time"] for record in records if record.get("start_time")]
    steps = [seconds_between(first, second) or 0.0 for first, second in pairwise(starts)]
    usual = [step for step in steps if step > 0]
    return median(usual) if len(usual) >= LEAST_STEPS else None


def silent(now_ns: int, heard_ns: int, pause: float | None) -> Stale | None:
    """Whether a stream is silent by its own rhythm.

    heard_ns  when the latest frame came, or the latest window was committed; Unix time of this machine [ns]
    pause     its usual pause [s]; None where it is not known
    """
    if pause is None or now_ns - heard_ns <= max(PAUSES_MISSED * pause, LEAST_SILENCE) * NS:
        return None
    usual = f"usually a window comes every {spoken_time(pause)}"
    return Stale(since_ns=heard_ns, reason=f"nothing has been received since {_utc(heard_ns)}; {usual}")


def stale(
    now_ns: int, window_ns: int | None, first_ns: int | None, last_ns: int | None, limits: StalenessLimits
) -> Stale | None:
    """Whether an asset is stale; all times are this machine's Unix times [ns].

    window_ns  when its last window was committed, when the service first knew of it, or when it was reinstated
    first_ns   when the first frame since then came, and last_ns the last; None where none came
    """
    if first_ns is not None and last_ns is not None and last_ns - first_ns > limits.fruitless * NS:
        reason = f"frames have been received since {_utc(first_ns)} without a whole measurement window"
        return Stale(since_ns=first_ns, reason=f"{reason}; the data quality section counts why")
    if window_ns is not None and now_ns - window_ns > limits.silent * NS:
        return Stale(
            since_ns=window_ns, reason=f"no whole measurement window has been received since {_utc(window_ns)}"
        )
    return None


class StalenessWatch:
    """Looks at all assets once a second; an asset that becomes stale is shown so, with an event.

    keep  keeps what that changes, and shows it
    """

    def __init__(
        self,
        table: AssetTable,
        keep: Callable[[Outcome], None],
        limits: StalenessLimits,
        *,
        clock: Callable[[], int] = steady_time_ns,
    ) -> None:
        self._table, self._keep, self._limits, self._clock = table, keep, limits, clock
        self._since = dict.fromkeys(table.known(), clock())  # when the service first knew of an asset [ns]
        self._retired: dict[str, int] = {}  # when an asset was last seen to be retired [ns]
        self._judged: dict[str, tuple[Mapping[str, Any], ...]] = {}  # alarms that the last evaluation left open
        self._looked = 0
        self._heard: dict[str, _Heard] = {}
        self._window: dict[str, tuple[int, int]] = {}  # when the latest window was committed, and by this clock [ns]

    def heard(self, asset: str) -> None:
        """A frame of the asset has come, valid or not."""
        now, snapshot = self._clock(), self._table.latest(asset)
        window_ns = snapshot.received_ns if snapshot else None
        heard = self._heard.setdefault(asset, _Heard(window_ns=window_ns))
        if heard.first_ns is None or heard.window_ns != window_ns:
            heard.first_ns, heard.window_ns = now, window_ns
        heard.last_ns = now

    def __call__(self) -> None:
        """Looks at the assets, if that is due."""
        now, before = self._clock(), self._looked
        if now - before < LOOK_EVERY * NS:
            return
        self._looked = now
        for asset in self._table.known():
            snapshot = self._table.latest(asset)
            if snapshot is None:
                continue
            found = self._found(now, before, snapshot)
            if found != snapshot.stale or (found is not None and self._alarms_differ(snapshot)):
                self._show(asset, found)

    def _committed(self, now: int, before: int, snapshot: Snapshot) -> int:
        """When the latest window was committed, by this clock: of one since the look `before`, between that and now."""
        if snapshot.received_ns is None:
            return self._since.setdefault(snapshot.asset, now)
        known = self._window.get(snapshot.asset)
        if known is None or known[0] != snapshot.received_ns:
            at = min(max(snapshot.received_ns, 0 if known is None else before), now)
            known = self._window[snapshot.asset] = snapshot.received_ns, at
        return known[1]

    def _found(self, now: int, before: int, snapshot: Snapshot) -> Stale | None:
        """Whether an asset is stale now; one that is retired never is, and what was before that no longer counts."""
        asset = snapshot.asset
        self._since.setdefault(asset, now)
        if snapshot.retired is not None:
            self._heard.pop(asset, None)
            self._retired[asset] = now
            return None
        heard = self._heard.get(asset, _Heard())
        current = heard.window_ns == snapshot.received_ns  # else a window has come since the last frame
        first, last = (heard.first_ns, heard.last_ns) if current else (None, None)
        window_ns = max(self._committed(now, before, snapshot), self._retired.get(asset, 0))
        found = stale(now, window_ns, first, last, self._limits)
        return found or silent(now, max(window_ns, heard.last_ns or 0), usual_pause(snapshot.records))

    def _alarms_differ(self, snapshot: Snapshot) -> bool:
        """Whether other alarms are open than at the last evaluation: where one was cleared, its cause still lasts."""
        return snapshot.alarms != self._judged.get(snapshot.asset)

    def _show(self, asset: str, found: Stale | None) -> None:
        before = self._table.latest(asset)
        events: Events = ()
        if found is not None and (before is None or found != before.stale):
            log.warning("%s: %s", asset, found.reason, extra={"asset": asset})
            fault = {
                "window": None, "kind": "stale", "channel": "all", "count": 1, "action": "none",
                "detail": found.reason,
            }  # fmt: skip
            events = (("data_fault", fault),)

        def judge(alarms: AlarmKeeper, data: Mapping[str, Any]) -> Events:
            return alarms.data(asset, data)

        outcome = Outcome(asset=asset, changed={"stale": found}, events=events, judge=judge)
        self._keep(outcome)
        shown = self._table.latest(asset)
        self._judged[asset] = () if shown is None else shown.alarms


def _utc(time_ns: int) -> str:
    return datetime.fromtimestamp(time_ns // NS, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
