"""Lowest and highest values of every part of a long history, so that a thinned one does not lose its peaks.

    part of level l, number b    the windows b · 4^l to (b + 1) · 4^l − 1 of one asset and epoch, l = 1 … 10
    kept of each part            the windows with the lowest and the highest measured RMS, and with the highest kurtosis

A window adds to one part of each level, in its own transaction. A history of any length is then thinned by reading as
many parts as the answer has points: its cost does not grow. Refused windows are no extremes, as they have no place on
a trend.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

from sqlalchemy import (
    Connection,
    and_,
    bindparam,
    case,
    cast,
    column,
    func,
    literal_column,
    or_,
    select,
    true,
    union_all,
)

from service.results.schema import EXTREMES, NUMBER, WINDOWS
from service.results.sparse_reading import spread_numbers

FAN_OUT, LEVELS = 4, 10  # parts of a level that make one of the next; the longest part has a million windows
KEPT_LEVEL = 4  # the extremes of its parts, of 256 windows each, stay when a history is thinned by retention
PICKS = 4  # points of an answer from each part: its first window and the three extremes
PAIRS = (("lowest", "lowest_rms", -1), ("highest", "highest_rms", 1), ("sharpest", "highest_kurtosis", 1))
"""Window, its value, and whether the smallest (−1) or the greatest (1) value is kept."""

_GIVEN = (column("number", NUMBER), *(c for c in EXTREMES.columns if c.name not in ("level", "part")))
_LEVELS = union_all(
    *(
        select(literal_column(f"{n}", NUMBER).label("level"), literal_column(f"{FAN_OUT**n}", NUMBER).label("size"))
        for n in range(1, LEVELS + 1)
    )
).subquery()

Rows = Callable[..., Iterable[Any]]


class Bucket(NamedTuple):
    """How a history is divided: into so many parts of a level each."""

    level: int
    parts: int

    @property
    def size(self) -> int:
        """Windows of a bucket."""
        return self.parts * FAN_OUT**self.level


def bucket_for(windows: int, most: int) -> Bucket:
    """The smallest division of so many windows whose points are about `most`."""
    wanted = max(FAN_OUT, -(-windows * PICKS // most))
    level = min(int(math.log(wanted, FAN_OUT) + 1e-9), LEVELS)
    parts = -(-wanted // FAN_OUT**level)
    return Bucket(level + 1, 1) if parts == FAN_OUT and level < LEVELS else Bucket(level, parts)


def extremes_of(record: Mapping[str, Any]) -> dict[str, float | None] | None:
    """What a window's record adds; None where it has none of it."""
    if record.get("quality") == "refused":
        return None
    sensors = (record.get("indicators") or {}).values()
    sharp = (_number(sensor.get("kurtosis")) for sensor in sensors)
    rms, kurtosis = _number(record.get("rms_measured")), max((k for k in sharp if k is not None), default=None)
    return None if rms is kurtosis is None else {"lowest_rms": rms, "highest_rms": rms, "highest_kurtosis": kurtosis}


def _number(value: Any) -> float | None:
    return float(value) if isinstance(value, int | float) and math.isfinite(value) else None


def adding(insert: Any) -> Any:
    """The statement that adds a window to its parts of all levels, with the values of `row_of`.

    insert  an insertion into `EXTREMES` of the database's own kind
    """
    given, changed, better = insert.excluded, {}, []
    for window, value, sign in PAIRS:
        kept, new = EXTREMES.c[value], given[value]
        is_better = or_(and_(kept.is_(None), new.is_not(None)), new > kept if sign > 0 else new < kept)
        changed[window] = case((is_better, given[window]), else_=EXTREMES.c[window])
        changed[value] = case((is_better, new), else_=kept)
        better.append(is_better)
    key = [column.name for column in EXTREMES.primary_key.columns]
    values = select(*(cast(bindparam(c.name, type_=c.type), c.type).label(c.name) for c in _GIVEN)).subquery()
    parts = {"level": _LEVELS.c.level, "part": values.c.number // _LEVELS.c.size}
    row = [parts[c.name] if c.name in parts else values.c[c.name] for c in EXTREMES.columns]
    each = select(*row).select_from(values.join(_LEVELS, true()))
    rows = each.where(true())  # SQLite takes the ON of ON CONFLICT for that of a join otherwise
    add = insert.from_select([c.name for c in EXTREMES.columns], rows)
    return add.on_conflict_do_update(index_elements=key, set_=changed, where=or_(*better))


def row_of(asset: str, epoch: int, number: int, record: Mapping[str, Any]) -> dict[str, Any] | None:
    """What a window adds to its part of each level; None where it has nothing to add."""
    values = extremes_of(record)
    if values is None:
        return None
    own = {window: None if values[value] is None else number for window, value, _ in PAIRS}
    return {"asset": asset, "epoch": epoch, "number": number, **own, **values}


_IN_EPOCH = and_(WINDOWS.c.asset == bindparam("of"), WINDOWS.c.epoch == bindparam("epoch", type_=NUMBER))
_ENDS = select(
    select(func.min(WINDOWS.c.number)).where(_IN_EPOCH).scalar_subquery(),
    select(func.max(WINDOWS.c.number)).where(_IN_EPOCH).scalar_subquery(),
)
_SPREAD = spread_numbers(_IN_EPOCH)
_PARTS = (
    select(EXTREMES)
    .where(EXTREMES.c.asset == bindparam("of"), EXTREMES.c.epoch == bindparam("epoch", type_=NUMBER))
    .where(EXTREMES.c.level == bindparam("level"), EXTREMES.c.part >= bindparam("first"))
    .order_by(EXTREMES.c.part)
)


def outline(rows: Rows, asset: str, epoch: int, after: int, most: int) -> list[int] | None:
    """Numbers of the windows above `after` that outline a history; None where there are at most `most`."""
    own = {"of": asset, "epoch": epoch}
    ((first, last),) = rows(_ENDS, own)
    windows = 0 if first is None else last - max(after, first - 1)
    if windows <= most:
        return None
    bucket = bucket_for(windows, most)
    since = max(after, 0) - max(after, 0) % bucket.size
    spread = {"every": bucket.size, "since": since, "most": most, "after": after}
    chosen = {number for (number,) in rows(_SPREAD, {**own, **spread})}
    found: dict[int, dict[str, Any]] = {}
    for row in rows(_PARTS, {**own, "level": bucket.level, "first": since // FAN_OUT**bucket.level}):
        _add(found.setdefault(row.part // bucket.parts, {}), row._mapping)
    for extremes in found.values():
        chosen |= {extremes[window] for window, _, _ in PAIRS if extremes.get(window) is not None}
    return sorted(number for number in chosen if number > after)


def _add(best: dict[str, Any], part: Mapping[str, Any]) -> None:
    """Takes the extremes of one part into those of its bucket."""
    for window, value, sign in PAIRS:
        new = part[value]
        if new is not None and (best.get(value) is None or sign * (new - best[value]) > 0):
            best[window], best[value] = part[window], new


def is_extreme() -> Any:
    """Whether a window of `WINDOWS` is an extreme that stays when its history is thinned."""
    own = and_(
        EXTREMES.c.asset == WINDOWS.c.asset,
        EXTREMES.c.epoch == WINDOWS.c.epoch,
        EXTREMES.c.level == KEPT_LEVEL,
        EXTREMES.c.part == WINDOWS.c.number // FAN_OUT**KEPT_LEVEL,
    )
    return select(1).where(own, or_(*(EXTREMES.c[window] == WINDOWS.c.number for window, _, _ in PAIRS))).exists()


def drop_before(db: Connection, asset: str, number: int) -> None:
    """Deletes the parts whose windows all lie below a number."""
    for level in range(1, LEVELS + 1):
        old = EXTREMES.c.part < number // FAN_OUT**level
        for epoch in db.execute(select(EXTREMES.c.epoch).where(EXTREMES.c.asset == asset).distinct()).scalars().all():
            own = and_(EXTREMES.c.asset == asset, EXTREMES.c.epoch == epoch, EXTREMES.c.level == level)
            db.execute(EXTREMES.delete().where(own, old))
