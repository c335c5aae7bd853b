"""When an asset's figures no longer say how the machine is now, though nothing has failed: noticed as frames come.

Either the stream is silent for longer than is usual for it, or no whole window has come for a long time, or frames keep
coming and none of them ends in a window: their time stamps contradict each other or what was received before, or
channels that a window needs are missing. Time is measured by a clock that cannot step. Whoever computes shows it
(notices.py).

    silent for longer than 3·p,      p = median of the times from one window's start to the next

p  usual pause of the stream, by its own time stamps [s]; known from 4 windows on
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from itertools import pairwise
from statistics import median

from service.contract.base import spoken_time
from service.contract.verdict import seconds_between
from service.results.asset_table import AssetTable
from service.results.jobs import STALE, Notice
from service.results.snapshot import TAIL, Snapshot, Stale
from service.settings import Settings
from service.steady_clock import steady_time_ns
from service.stream.frames import LENGTH_LIMITS

NS = 1_000_000_000
EPOCH = "1970-01-01T00:00:00Z"
LOOK_EVERY = 1.0  # how often the assets are looked at [s]
WINDOWS_MISSED = 3.0  # window lengths that frames must have covered before a missing window is a fault
PAUSES_MISSED = 3.0  # usual pauses of a stream after which it is silent
LEAST_STEPS = 3  # between windows, from which the usual pause is known
LEAST_SILENCE = 3 * LENGTH_LIMITS[1]  # three of the longest frames [s]


UNKNOWN = Stale(since_ns=0, reason="")  # it may have been kept, or not: a commit had no answer


@dataclass(frozen=True, slots=True, kw_only=True)
class StalenessLimits:
    """How long an asset may be without a whole window [s]."""

    silent: float  # in any case
    fruitless: float  # while frames keep coming

    @classmethod
    def of(cls, settings: Settings) -> StalenessLimits:
        fruitless = max(settings.fruitless_after, WINDOWS_MISSED * settings.window_length)
        return cls(silent=settings.stale_after, fruitless=fruitless)


@dataclass(slots=True)
class _Heard:
    """What has come of one asset, on this machine's clock [ns], and what was noticed of that."""

    window_ns: int  # when the newest window came; when the service first knew of the asset, or it was reinstated
    first_ns: int | None = None  # the first frame since then
    last_ns: int | None = None  # the newest frame
    starts: deque[float] = field(default_factory=lambda: deque(maxlen=TAIL))  # of windows, on the stream's clock [s]
    pause: float | None = None  # that is usual between them [s]
    noticed: Stale | None = None
    judged: bool = False  # whether that is of this run: alarms may have other rules than in the last one
    retired: bool = False


def usual_pause(starts: Iterable[float]) -> float | None:
    """Median time from one window's start to the next [s], of the newest ones; None where they are too few."""
    steps = [second - first for first, second in pairwise(starts) if second > first]
    return median(steps) if len(steps) >= LEAST_STEPS else None


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
    """Looks at all assets once a second, and notices those that become stale, or are so no longer.

    table    knows the assets; how they are shown is read at the start alone
    waiting  when the newest window of an asset was received that waits, this machine's Unix time [ns]; 0 for none
    notice   keeps what is to be judged
    """

    def __init__(
        self,
        table: AssetTable,
        notice: Callable[..., None],
        limits: StalenessLimits,
        *,
        waiting: Callable[[str], int] = lambda asset: 0,
        clock: Callable[[], int] = steady_time_ns,
    ) -> None:
        self._table, self._notice, self._limits, self._clock = table, notice, limits, clock
        self._looked, self._heard = 0, dict[str, _Heard]()
        for snapshot in table.every():
            self._begin(snapshot, waiting(snapshot.asset))

    def _begin(self, snapshot: Snapshot, waiting_ns: int) -> None:
        """Goes on from what an earlier run has left."""
        heard = self._of(snapshot.asset)
        if snapshot.received_ns is not None or waiting_ns:
            heard.window_ns = min(max(snapshot.received_ns or 0, waiting_ns), heard.window_ns)
        starts = (seconds_between(EPOCH, record.get("start_time")) for record in snapshot.records)
        heard.starts.extend(start for start in starts if start is not None)
        heard.pause = usual_pause(heard.starts)
        heard.noticed, heard.retired = snapshot.stale, snapshot.retired is not None

    def heard(self, asset: str) -> None:
        """A frame of the asset has come, valid or not."""
        heard = self._of(asset)
        heard.last_ns = self._clock()
        if heard.first_ns is None:
            heard.first_ns = heard.last_ns

    def closed(self, asset: str, start_ns: int) -> None:
        """A whole window of the asset has come."""
        heard = self._of(asset)
        heard.window_ns, heard.first_ns = self._clock(), None
        heard.starts.append(start_ns / NS)
        heard.pause = usual_pause(heard.starts)

    def stored(self, asset: str) -> None:
        """A window of the asset waits for its turn, which ends what was noticed before: it may have come long ago."""
        self._of(asset).noticed = None

    def retire(self, asset: str, retired: bool) -> None:
        """The asset has been retired, and is shown as that; or was reinstated, and has time to send."""
        heard = self._of(asset)
        heard.window_ns, heard.first_ns, heard.last_ns = self._clock(), None, None
        heard.noticed, heard.retired = None, retired

    def __call__(self) -> None:
        """Looks at the assets, if that is due."""
        now = self._clock()
        if now - self._looked < LOOK_EVERY * NS:
            return
        self._looked = now
        found = {asset: self._found(now, self._of(asset)) for asset in self._table.known()}
        seen = [asset for asset, stale in found.items() if self._is_news(self._heard[asset], stale)]
        for asset in seen:
            self._heard[asset].noticed = UNKNOWN
        if seen:
            self._notice(*(_noticed(asset, found[asset]) for asset in seen))
        for asset in seen:
            self._heard[asset].noticed, self._heard[asset].judged = found[asset], True

    def _of(self, asset: str) -> _Heard:
        if asset not in self._heard:
            self._heard[asset] = _Heard(self._clock())
        return self._heard[asset]

    def _is_news(self, heard: _Heard, stale: Stale | None) -> bool:
        return stale != heard.noticed or (stale is not None and not heard.judged)

    def _found(self, now: int, heard: _Heard) -> Stale | None:
        """Whether an asset is stale now; one that is retired never is, and what was before that no longer counts."""
        if heard.retired:
            return None
        last_ns = None if heard.first_ns is None else heard.last_ns
        found = stale(now, heard.window_ns, heard.first_ns, last_ns, self._limits)
        return found or silent(now, max(heard.window_ns, heard.last_ns or 0), heard.pause)


def _noticed(asset: str, found: Stale | None) -> Notice:
    seen = {"reason": None} if found is None else {"since_ns": found.since_ns, "reason": found.reason}
    return Notice(asset=asset, about=STALE, seen=seen)


def _utc(time_ns: int) -> str:
    return datetime.fromtimestamp(time_ns // NS, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
