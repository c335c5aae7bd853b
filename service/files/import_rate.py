"""When the values of a column were taken: from its own times, the file's time column, or a stated rate; all must agree.

    rate = slope of the row numbers over the printed times
    u    = min(q·rate, 1)/n         its relative uncertainty; where a printed time repeats, of rows at whole ticks

q  distance of two printed times [s]; the times of n rows that are each within q of a line are even

A time column is printed with so many digits, and a clock has its jitter: its steps need not be equal. Where rows
share a printed time, those at which it changes are counted. A step that is longer than 1.5 of the others is a gap, in
which samples are missing; a time column that falls, or whose steps differ for no such reason, is refused. A column
without a unit is in that which makes it a date of 2001 to 2100, else in seconds; one that counts its rows is no time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta

import numpy as np

from service.errors import InputError
from service.files.dates import DAYS, EPOCH, SIZES, TODAY
from service.files.import_mapping import RATES
from service.files.readers import Column, Table
from service.files.readers.stored import PIECE, Row, StoredRow, beginning, changed, pieces
from service.files.readers.table import group_of, rounded_rate, split_unit

AGREEMENT = 1e-3  # relative difference of two statements of one rate: more than a recorder's clock is off
GAP = 1.5  # steps
UNEVEN = 0.05  # share of the steps that may be half as long or as long again as the others
MOSTLY = 0.9  # share of the steps of a time that do not fall; of an uneven or broken one, which is then refused
TIME_NAMES = {
    "time", "t", "zeit", "temps", "tiempo", "timestamp", "time stamp", "datetime", "date/time", "date", "elapsed time",
    "seconds", "sec", "time axis", "x_time", "rel. time", "relative time", "uhrzeit", "ts", "epoch", "unix", "clock",
    "recorded_at", "zeitstempel", "datum", "datum/zeit", "date time", "date_time", "utc",
}  # fmt: skip
TIME_UNITS = {
    "": 1.0, "s": 1.0, "sec": 1.0, "secs": 1.0, "second": 1.0, "seconds": 1.0, "ms": 1e-3, "msec": 1e-3, "us": 1e-6,
    "µs": 1e-6, "μs": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0, "d": 86400.0,
}  # fmt: skip
SLOWEST = 20.0  # rate of a vibration from which times that state no unit may be seconds [Hz]
LEAST_ROWS = 3  # that count the rows, 0, 1, 2: as a spreadsheet or a data frame numbers them


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TimeAxis:
    """Evenly spaced times, from a column of them."""

    name: str  # of the column
    count: int  # values in it
    rate: float  # [Hz]
    start: float  # [s]
    places: np.ndarray | None = None  # of the values on an even grid, where samples are missing between them (n,)
    uncertainty: float = 0.0  # relative, of the rate
    began: datetime | None = None  # where the times are dates as numbers
    assumed: bool = False  # nothing says that they are in seconds

    def laid_out(self, values: Row) -> Row:
        """The values on the even grid, NaN where one is missing."""
        if self.places is None:
            return values
        out = np.full(int(self.places[-1]) + 1, np.nan)
        out[self.places] = np.asarray(values)
        return out

    @property
    def missing(self) -> int:
        """How many samples are missing."""
        return 0 if self.places is None else int(self.places[-1]) + 1 - self.count


def is_time(column: Column) -> bool:
    """Whether a column is the time of the others, by its type or its name, and by rising almost everywhere."""
    values = beginning(column.values).astype(float)
    name = split_unit(group_of(column.name)[1])[0].lower().strip("_ ")
    if not column.is_time and name not in TIME_NAMES | {"time_s", "t_s"}:
        return False
    if values.size < 2 or values[-1] == values[0] or counts_rows(column):
        return False
    return bool(np.mean(np.diff(values) >= 0) > MOSTLY)


def counts_rows(column: Column) -> bool:
    """Whether a column without a unit of time is the number of each row: 0, 1, 2, … or 1, 2, 3, …"""
    values = beginning(column.values).astype(float)
    unit = (column.unit or split_unit(column.name)[1]).lower()
    if unit not in ("", "-") or column.is_time or values.size < LEAST_ROWS or values[0] not in (0.0, 1.0):
        return False
    return bool(np.all(np.diff(values) == 1))


def time_axes(where: str, table: Table, file: str, chosen: str | None, used: set[str]) -> list[TimeAxis]:
    """The file's time columns, the innermost group first; none where it has none.

    chosen  name of the one; empty where no column is a time, None where they are found by name and type
    used    columns that are channels, and so no time
    """
    if chosen == "":
        return []
    if chosen is None:
        found = [c for c in table.columns if c.name not in used and is_time(c)]
        found.sort(key=lambda c: (-len(group_of(c.name)[0]), not c.is_time))
    else:
        column = table.column(chosen)
        if column is None:
            raise InputError(f"{where}: file.time_column = {chosen!r} is not in {file}, which has {_listed(table)}")
        if counts_rows(column):
            raise InputError(
                f"{where}: the column {chosen!r} of {file} counts its rows and is no time; give file.sample_rate_hz"
            )
        found = [column]
    groups: dict[tuple[str, int], TimeAxis] = {}
    for column in found:
        key = (group_of(column.name)[0], column.values.size)
        if key not in groups:
            groups[key] = _axis_of(where, column, file)
    return list(groups.values())


def axis_of(axes: Sequence[TimeAxis], column: Column) -> TimeAxis | None:
    """The time column of a column: of as many values, in its group or one around it; else the file's only one."""
    if column.rate is not None or column.times is not None:
        return None
    fitting = [a for a in axes if a.count == column.values.size]
    around = [a for a in fitting if f"{column.name}/".startswith(group_of(a.name)[0])]
    return around[0] if around else fitting[0] if len(fitting) == 1 else None


def _axis_of(where: str, column: Column, file: str) -> TimeAxis:
    unit = (column.unit or split_unit(column.name)[1]).lower()
    place = f"{where}: the time column {column.name!r} of {file}"
    if unit == "" or (
        unit in TIME_UNITS and not column.is_time and _of_today(float(column.values[0]), TIME_UNITS[unit])
    ):
        return _dated_axis(place, column)
    if unit not in TIME_UNITS:
        raise InputError(f"{place} is in {unit!r}, must be in s, ms, us or min")
    return even_axis(place, column.name, column.values, TIME_UNITS[unit])


def _of_today(first: float, unit: float) -> bool:
    return bool(TODAY[0] < first * unit < TODAY[1])


def _dated_axis(where: str, column: Column) -> TimeAxis:
    """The even grid of times without a unit, which their size tells where they are dates."""
    values = column.values
    first = float(values[0])
    length = float(values[-1]) - first
    size = next((unit for unit in SIZES if _of_today(first, unit)), None)
    zero = next((d for d in DAYS if _of_today(first - d, 86400.0)), None)
    if size is not None:
        axis = even_axis(where, column.name, changed(values, lambda part: part - values[0]), size)
        return replace(axis, began=EPOCH + timedelta(seconds=first * size))
    if zero is not None and 0 < length < 1 and values.size > RATES[1] * length:
        axis = even_axis(where, column.name, changed(values, lambda part: part - values[0]), 86400.0)
        return replace(axis, began=EPOCH.replace(tzinfo=None) + timedelta(days=first - zero))  # of a local clock
    return replace(even_axis(where, column.name, values), assumed=True)


def _listed(table: Table) -> str:
    return ", ".join(table.names) or "no named column"


def even_axis(where: str, name: str, values: Row, seconds: float = 1.0) -> TimeAxis:
    """The even grid of a column of times, whose unit has so many seconds; InputError where they are not even."""
    t = changed(values, lambda part: part.astype(float) * seconds)
    missing = sum(int(np.count_nonzero(~np.isfinite(part))) for part in pieces(t))
    if t.size < 2 or missing:
        raise InputError(f"{where} has {t.size} values, of which {missing} are empty; every row must have its time")
    printed = _resolution(values) * seconds
    length, start = float(t[-1]) - float(t[0]), float(t[0])
    steps = _steps_of(where, t, printed)
    if length == 0:
        raise InputError(f"{where} is {start:g} s throughout")
    if steps.zero > UNEVEN * (t.size - 1):  # several rows share a printed time
        return _coarse(where, name, t)
    rate, low, high = _line(StoredRow(size=t.size, dtype=np.dtype(float), read=_numbers), t)
    if high - low <= 1.1 * printed and steps.long > 2:  # unequal steps of an even time, as printed
        return _axis(name, t, rate, printed * rate / t.size)
    if steps.odd > UNEVEN * (t.size - 1):
        raise InputError(
            f"{where} is not evenly spaced: steps from {steps.low:.3g} to {steps.high:.3g} s, half of them below "
            f"{steps.usual:.3g} s; resample the data evenly first"
        )
    if not steps.long:
        return _axis(name, t, (t.size - 1) / length, max(printed, 1e-3 * steps.usual) / length)
    return _with_gaps(where, name, t, GAP * steps.usual, printed)


def _with_gaps(where: str, name: str, times: Row, longest: float, printed: float) -> TimeAxis:
    """The grid of times of which some steps are longer than the longest of a whole recording [s]."""
    t = np.asarray(times)
    steps = np.diff(t)
    regular = float(np.mean(steps[steps <= longest]))
    places = np.concatenate(([0], np.cumsum(np.maximum(1, np.rint(steps / regular))))).astype(np.int64)
    if places[-1] + 1 > 2 * t.size:
        raise InputError(
            f"{where} has gaps of {np.sum(steps[steps > longest]):.4g} s, longer than its {t.size} values at "
            f"{1 / regular:.6g} Hz; import the parts one by one"
        )
    axis = _axis(name, t, places[-1] / (t[-1] - t[0]), (printed + regular) / (t[-1] - t[0]))
    return replace(axis, places=places)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Steps:
    """The steps of a column of times."""

    usual: float  # the median [s]
    low: float
    high: float
    zero: int  # how many are 0
    long: int  # how many are a gap
    odd: int  # how many are half as long, or half as long again, as no gap and no printed time makes them


def _steps_of(where: str, t: Row, printed: float) -> _Steps:
    """The steps of times that are printed with such a distance [s]; InputError where one falls."""
    usual = float(np.median(np.diff(beginning(t))))
    low, high, counted, row = np.inf, -np.inf, np.zeros(3, dtype=int), 0
    before = np.empty(0)
    for part in pieces(t):
        steps = np.diff(np.concatenate((before, part)))
        if np.any(steps < 0):
            row += int(np.argmax(steps < 0))
            raise InputError(
                f"{where} falls from {t[row]:.9g} s to {t[row + 1]:.9g} s at row {row + 2}; two records in one?"
            )
        low, high = min(low, steps.min(initial=np.inf)), max(high, steps.max(initial=-np.inf))
        long, short = steps > GAP * usual, steps < 0.5 * usual
        odd = short | (long & (steps < 2 * usual - 0.5 * printed))
        counted += [np.count_nonzero(each) for each in (steps == 0, long, odd)]
        row, before = row + steps.size, part[-1:]
    zero, long_ones, odd_ones = (int(n) for n in counted)
    return _Steps(usual=usual, low=low, high=high, zero=zero, long=long_ones, odd=odd_ones)


def _axis(name: str, t: Row, rate: float, uncertainty: float, start: float | None = None) -> TimeAxis:
    return TimeAxis(
        name=name, count=t.size, rate=rounded_rate(rate, uncertainty), start=float(t[0] if start is None else start),
        uncertainty=uncertainty,
    )  # fmt: skip


def _numbers(begin: int, end: int) -> np.ndarray:
    return np.arange(begin, end, dtype=float)


def _line(rows: Row, t: Row) -> tuple[float, float, float]:
    """The rate of times at rows, by least squares, and the ends of their distances from it [s]."""
    n0, s0 = (sum(float(part.sum()) for part in pieces(each)) / each.size for each in (rows, t))
    both = [0.0, 0.0]
    for n, s in zip(pieces(rows), pieces(t), strict=True):
        both[0] += float((n - n0) @ (s - s0))
        both[1] += float((n - n0) @ (n - n0))
    step = both[0] / both[1]
    low, high = 0.0, 0.0
    for n, s in zip(pieces(rows), pieces(t), strict=True):
        rest = (s - s0) - step * (n - n0)
        low, high = min(low, float(rest.min())), max(high, float(rest.max()))
    return 1 / step, low, high


def _resolution(values: Row) -> float:
    """The distance of two times as printed, in their unit: the last decimal that they need, or that of the number."""
    t = np.asarray(values[-PIECE:]).astype(float)
    late = t[np.flatnonzero(np.diff(t) > 0) + 1][-1000:]
    largest = max(float(np.abs(part).max()) for part in pieces(values))
    spacing = float(np.spacing(largest)) if values.dtype.kind == "f" else 0.0
    for decimals in range(13):
        scaled = late * 10.0**decimals
        if np.all(np.abs(scaled - np.rint(scaled)) <= 1e-3 + 4 * np.spacing(np.abs(scaled))):
            return max(10.0**-decimals, spacing)
    return spacing


def _coarse(where: str, name: str, times: Row) -> TimeAxis:
    """The grid of times of which several rows share one, by the rows at which the printed time changes."""
    t = np.asarray(times)
    changes = np.flatnonzero(np.diff(t) > 0) + 1
    ticks = t[changes]
    if changes.size < 2:
        raise InputError(
            f"{where} is printed in steps of {t[-1] - t[0]:.3g} s, of which none is whole; print more digits, or give "
            f"the sample rate (--rate, file.sample_rate_hz)"
        )
    rate, low, high = _line(changes, ticks)
    rest = max(-low, high)
    tick = float(np.median(np.diff(ticks)))
    if rest > tick:
        raise InputError(f"{where} is printed in steps of {tick:.3g} s and does not rise evenly; print more digits")
    scatter = 2 * rest * rate if changes.size > 2 else 0.0  # rows
    start = float(ticks.mean() - changes.mean() / rate)
    return _axis(name, t, rate, max(1.0, scatter) / float(changes[-1] - changes[0]), start)


def timing_of(
    place: str, given: float | None, column: Column, table: Table, axes: Sequence[TimeAxis], slow: bool
) -> tuple[float, float, TimeAxis | None]:
    """Rate [Hz], start [s] and even grid of a sampled column; InputError where no rate is stated, or two contradict.

    place  of the column's channel, for messages
    given  rate of the mapping file [Hz]; None where it states none
    """
    file = table.format
    own = axis_of(axes, column)
    if column.times is not None:
        own = even_axis(f"{place}: the times of {column.name!r}", column.name, column.times)
    stated = [
        (given, f"file.sample_rate_hz = {given or 0:.9g} Hz"),
        (column.rate, f"the {file} file states {column.rate or 0:.9g} Hz for {column.name!r}"),
        (table.rate if column.rate is None else None, f"the {file} file states {table.rate or 0:.9g} Hz"),
        (own.rate if own else None, f"the times of {own.name if own else ''!r} give {own.rate if own else 0:.9g} Hz"),
    ]
    known = [(rate, text) for rate, text in stated if rate is not None]
    if not known:
        raise InputError(
            f"{place}: no sample rate is known: none of {_listed(table)} is recognised as the time "
            f"or the rate of {column.name!r}; give file.sample_rate_hz, or file.time_column"
        )
    rate, first = known[0]
    doubt = own.uncertainty if own else 0.0
    for other, text in known[1:]:
        if abs(other / rate - 1) > max(AGREEMENT, doubt):
            raise InputError(f"{place}: {first}, but {text}; {_cause(rate, other, given)}")
    if len(known) == 1 and doubt > AGREEMENT and not slow:
        raise InputError(
            f"{place}: {first} ± {100 * doubt:.2g} %, and {100 * AGREEMENT:g} % is needed; give the "
            f"sample rate (--rate, file.sample_rate_hz), or times of more digits"
        )
    least = SLOWEST if len(known) == 1 and own is not None and own.assumed else RATES[0]
    if not (rate > 0 if slow else rate >= least) or rate > RATES[1]:
        raise InputError(f"{place}: {first}, which is outside [{least:g}, {RATES[1]:g}] Hz; {HINT}")
    return rate, own.start if own else column.start, own


HINT = "is the time in ms or µs? Its unit goes into the header, such as 'Time (ms)'"


def _cause(rate: float, other: float, given: float | None) -> str:
    """What would be right where two statements of a rate contradict."""
    ratio = max(rate / other, other / rate)
    if any(abs(ratio / k - 1) < AGREEMENT for k in (1e3, 1e6)):
        return HINT
    if given is not None:
        return "leave file.sample_rate_hz out where the file is right"
    return 'give the right one as file.sample_rate_hz, and time_column = "" where the times are wrong'
