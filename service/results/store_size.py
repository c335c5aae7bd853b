"""How large a database becomes: what it holds now, and what it will hold once its retention is reached.

    size   = FIXED + Σ assets (asset + windows · window + others · other)
    window = PAGE / ⌊(PAGE − 12) / (body + name + 54)⌋ + (4 · name + 96) / 0.7 + (name + 60) / 3 / 0.7
    kept   = (whole + (days − whole) · thinned) / spacing,   thinned = 1/every + (1 − 1/every) · (notable + 3/256)

window   bytes of a window: its row, of which as many as fit share a page of 4096, and three indexes with the event
         that refers to it, whose pages are filled to 0.7, and its share of the extremes of the history
body     record and figures of a window as they are kept, compressed: the mean of the newest
name     length of the asset's name
asset    state, report and what else an asset has, compressed; that of an overflowing row fills whole pages
other    an event that is no window's, with its index
notable  share of windows that updated the twin, found an effect or were refused
spacing  mean time between the newest windows [days]

Holds    for SQLite, 10 %; PostgreSQL takes about the same. Segments of windows that wait and raw signals are files,
         with bounds of their own in the settings; the few windows whose signals are kept longer are not counted.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, floor
from pathlib import Path

import sqlalchemy as sa
from sqlalchemy import Connection, func, select

from service.results.backends import backend_of
from service.results.extremes import FAN_OUT, KEPT_LEVEL, PAIRS
from service.results.retention import DAY_NS, NOTABLE, Retention
from service.results.schema import ASSETS, EVENTS, METADATA, WINDOWS

PAGE = 4096  # bytes of a page of SQLite
NEWEST = 500  # windows whose size and spacing stand for the others
FILL = 0.7  # of a page of an index whose entries come in any order


@dataclass(frozen=True, slots=True, kw_only=True)
class Forecast:
    """The size of a database by the formula [bytes]."""

    windows: int  # that are kept now
    now: float
    windows_then: int  # that are kept once the retention is reached
    then: float

    def __str__(self) -> str:
        return (
            f"{self.windows} windows take {self.now / 1e6:.0f} MB by the formula; at this rate the retention keeps "
            f"{self.windows_then} in {self.then / 1e6:.0f} MB"
        )


def window_bytes(body: float, name: int) -> float:
    """What one window with its event takes."""
    return _row_bytes(body + name + 54) + (4 * name + 96) / FILL + (name + 60) / (FAN_OUT - 1) / FILL


def forecast_of(where: Path | str, retention: Retention) -> Forecast:
    """That of a database; the service may run."""
    engine = backend_of(where).for_reading()
    try:
        with engine.connect() as db:
            return forecast(db, retention)
    finally:
        engine.dispose()


def forecast(db: Connection, retention: Retention) -> Forecast:
    """The size of what a database holds, and will hold at the present rate."""
    fixed = PAGE * (1 + sum(1 + len(table.indexes) for table in METADATA.tables.values()))
    count, now, count_then, then = 0, float(fixed), 0, float(fixed)
    for asset in db.execute(select(ASSETS.c.asset)).scalars().all():
        body, spacing, notable, windows = _windows(db, asset)
        others, other = _other_events(db, asset)
        window = window_bytes(body, len(asset.encode()))
        kept = _kept(retention, spacing, notable) if spacing else float(windows)
        own = _asset_bytes(db, asset)
        others_then = min(retention.events, others * kept / windows if windows else others)
        count, now = count + windows, now + own + windows * window + others * other
        count_then, then = count_then + round(kept), then + own + kept * window + others_then * other
    return Forecast(windows=count, now=now, windows_then=count_then, then=then)


def _kept(retention: Retention, spacing: float, notable: float) -> float:
    """Windows of an asset that the retention keeps."""
    extreme = len(PAIRS) / FAN_OUT**KEPT_LEVEL
    thinned = 1 / retention.every + (1 - 1 / retention.every) * min(notable + extreme, 1.0)
    return (retention.whole_days + max(retention.days - retention.whole_days, 0.0) * thinned) / spacing


def _row_bytes(cell: float) -> float:
    """What a row takes: a share of a page, or pages of its own."""
    return PAGE / floor((PAGE - 12) / cell) if cell <= PAGE - 12 else PAGE * ceil(cell / (PAGE - 4))


def _windows(db: Connection, asset: str) -> tuple[float, float, float, int]:
    """Mean bytes and spacing [days] of the newest windows, the share of notable ones, and how many there are."""
    own = WINDOWS.c.asset == asset
    size = func.length(WINDOWS.c.record) + func.length(WINDOWS.c.figures)
    newest = select(size.label("size"), WINDOWS.c.start_ns).where(own).order_by(WINDOWS.c.number.desc()).limit(NEWEST)
    part = newest.subquery()
    mean, first, last, count = db.execute(
        select(func.avg(part.c.size), func.min(part.c.start_ns), func.max(part.c.start_ns), func.count())
    ).one()
    windows, notable = db.execute(
        select(func.count(), func.sum(sa.case((WINDOWS.c.notable == NOTABLE, 1), else_=0))).where(own)
    ).one()
    spacing = (last - first) / DAY_NS / (count - 1) if count > 1 else 0.0
    return float(mean or 0), spacing, (notable or 0) / windows if windows else 0.0, windows


def _other_events(db: Connection, asset: str) -> tuple[int, float]:
    """How many events are no window's, and what one takes."""
    own = select(func.count(), func.avg(func.length(EVENTS.c.data))).where(
        EVENTS.c.asset == asset, EVENTS.c.start_ns.is_(None)
    )
    count, mean = db.execute(own).one()
    return count, _row_bytes(float(mean or 0) + len(asset) + 20) + (len(asset) + 12) / FILL


def _asset_bytes(db: Connection, asset: str) -> float:
    """What state, report and the other parts of an asset take."""
    parts = (c for c in ASSETS.c if isinstance(c.type, sa.LargeBinary))
    size = sum((func.coalesce(func.length(part), 0) for part in parts), sa.literal(0))
    return _row_bytes(float(db.execute(select(size).where(ASSETS.c.asset == asset)).scalar_one()) + 60)
