"""When the values of a column were taken: from its own times, the file's time column, or a stated rate; all must agree.

    rate = (n − 1)/(t_last − t_first) of a time column with n values

A time column is printed with so many digits, and a clock has its jitter: its steps need not be equal. A step that is
longer than 1.5 of the others is a gap, in which samples are missing; a time column that falls, or whose steps differ
for no such reason, is refused.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from service.errors import InputError
from service.files.import_mapping import RATES, ImportMapping
from service.files.readers import Column, Table
from service.files.readers.table import rounded_rate, split_unit

AGREEMENT = 1e-3  # relative difference of two statements of one rate: more than a recorder's clock is off
GAP = 1.5  # steps
UNEVEN = 0.05  # share of the steps that may be half as long or as long again as the others
MOSTLY = 0.9  # share of the steps of a time that do not fall; of an uneven or broken one, which is then refused
TIME_NAMES = {
    "time", "t", "zeit", "temps", "tiempo", "timestamp", "time stamp", "datetime", "date/time", "date", "elapsed time",
    "seconds", "sec", "time_s", "t_s", "time_ms", "time axis", "x_time", "rel. time", "relative time", "uhrzeit",
}  # fmt: skip
TIME_UNITS = {
    "": 1.0, "s": 1.0, "sec": 1.0, "secs": 1.0, "second": 1.0, "seconds": 1.0, "ms": 1e-3, "msec": 1e-3, "us": 1e-6,
    "µs": 1e-6, "μs": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0,
}  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TimeAxis:
    """Evenly spaced times, from a column of them."""

    name: str  # of the column
    count: int  # values in it
    rate: float  # [Hz]
    start: float  # [s]
    places: np.ndarray | None = None  # of the values on an even grid, where samples are missing between them (n,)

    def laid_out(self, values: np.ndarray) -> np.ndarray:
        """The values on the even grid, NaN where one is missing."""
        if self.places is None:
            return values
        out = np.full(int(self.places[-1]) + 1, np.nan)
        out[self.places] = values
        return out

    @property
    def missing(self) -> int:
        """How many samples are missing."""
        return 0 if self.places is None else int(self.places[-1]) + 1 - self.count


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Timing:
    """Rate and start of one column, with its even grid where the times show missing samples."""

    rate: float  # [Hz]
    start: float  # of the first value [s]
    axis: TimeAxis | None


def is_time(column: Column) -> bool:
    """Whether a column is the time of the others, by its name and by rising almost everywhere."""
    name = split_unit(column.name)[0].lower().strip("_ ")
    values = np.asarray(column.values, dtype=float)
    return name in TIME_NAMES and values.size > 1 and bool(np.mean(np.diff(values) >= 0) > MOSTLY)


def time_axis(where: str, table: Table, file: str, chosen: str | None, used: set[str]) -> TimeAxis | None:
    """The file's time column; None where it has none.

    chosen  its name; empty where no column is a time, None where it is to be found by its name
    used    columns that are channels, and so no time
    """
    if chosen == "":
        return None
    if chosen is None:
        column = next((c for c in table.columns if c.name not in used and is_time(c)), None)
    else:
        column = table.column(chosen)
        if column is None:
            raise InputError(f"{where}: file.time_column = {chosen!r} is not in {file}, which has {_listed(table)}")
    if column is None:
        return None
    unit = (column.unit or split_unit(column.name)[1]).lower()
    if unit not in TIME_UNITS:
        raise InputError(
            f"{where}: the time column {column.name!r} of {file} is in {unit!r}, must be in s, ms, us or min"
        )
    return even_axis(
        f"{where}: the time column {column.name!r} of {file}", column.name, column.values, TIME_UNITS[unit]
    )


def _listed(table: Table) -> str:
    return ", ".join(table.names) or "no named column"


def even_axis(where: str, name: str, values: np.ndarray, seconds: float = 1.0) -> TimeAxis:
    """The even grid of a column of times, whose unit has so many seconds; InputError where they are not even."""
    t = np.asarray(values, dtype=float) * seconds
    if t.size < 2 or not np.isfinite(t).all():
        missing = int(np.count_nonzero(~np.isfinite(t)))
        raise InputError(f"{where} has {t.size} values, of which {missing} are empty; every row must have its time")
    steps = np.diff(t)
    if np.any(steps < 0):
        row = int(np.argmax(steps < 0))
        raise InputError(
            f"{where} falls from {t[row]:.9g} s to {t[row + 1]:.9g} s at row {row + 2}; two records in one?"
        )
    if t[-1] == t[0]:
        raise InputError(f"{where} is {t[0]:g} s throughout")
    printed = _resolution(steps)
    step = float(np.median(steps))
    if printed > GAP * (t[-1] - t[0]) / (t.size - 1):  # several rows share a printed time
        return _coarse(where, name, t, printed)
    long, short = steps > GAP * step, steps < 0.5 * step
    if short.mean() + (long & (steps < 2 * step - 0.5 * printed)).mean() > UNEVEN:
        raise InputError(
            f"{where} is not evenly spaced: steps from {steps.min():.3g} to {steps.max():.3g} s, half of them below "
            f"{step:.3g} s; resample the data evenly first"
        )
    if not long.any():
        rate = (t.size - 1) / (t[-1] - t[0])
        return TimeAxis(name=name, count=t.size, rate=rounded_rate(rate, printed / (t[-1] - t[0])), start=float(t[0]))
    regular = float(np.mean(steps[~long]))
    places = np.concatenate(([0], np.cumsum(np.maximum(1, np.rint(steps / regular))))).astype(np.int64)
    if places[-1] + 1 > 2 * t.size:
        raise InputError(
            f"{where} has gaps of {np.sum(steps[long]):.4g} s, longer than its {t.size} values at {1 / regular:.6g} "
            f"Hz; import the parts one by one"
        )
    rate = rounded_rate(places[-1] / (t[-1] - t[0]), (printed + regular) / (t[-1] - t[0]))
    return TimeAxis(name=name, count=t.size, rate=rate, start=float(t[0]), places=places)


def _resolution(steps: np.ndarray) -> float:
    """The distance of two times as printed [s]: the median step that is not zero, of the last thousand."""
    late = steps[-1000:]
    return float(np.median(late[late > 0])) if np.any(late > 0) else 0.0


def _coarse(where: str, name: str, t: np.ndarray, printed: float) -> TimeAxis:
    """The grid of times that are printed too coarsely to tell one row from the next."""
    even = np.linspace(t[0], t[-1], t.size)
    if np.max(np.abs(t - even)) > 2 * printed:
        raise InputError(f"{where} is printed in steps of {printed:.3g} s and does not rise evenly; print more digits")
    rate = (t.size - 1) / (t[-1] - t[0])
    return TimeAxis(name=name, count=t.size, rate=rounded_rate(rate, printed / (t[-1] - t[0])), start=float(t[0]))


def timing_of(mapping: ImportMapping, key: str, column: Column, table: Table, axis: TimeAxis | None) -> Timing:
    """Rate and start of a sampled column; InputError where none is stated, or where two statements contradict."""
    file = table.format
    own = None
    if column.times is not None:
        own = even_axis(f"{mapping.where}: {key}: the times of {column.name!r}", column.name, column.times)
    elif axis is not None and axis.count == column.values.size and column.rate is None:
        own = axis
    stated = [
        (mapping.sample_rate, f"file.sample_rate_hz = {mapping.sample_rate or 0:.9g} Hz"),
        (column.rate, f"the {file} file states {column.rate or 0:.9g} Hz for {column.name!r}"),
        (table.rate if column.rate is None else None, f"the {file} file states {table.rate or 0:.9g} Hz"),
        (own.rate if own else None, f"the times of {own.name if own else ''!r} give {own.rate if own else 0:.9g} Hz"),
    ]
    known = [(rate, text) for rate, text in stated if rate is not None]
    if not known:
        raise InputError(
            f"{mapping.where}: {key}: no sample rate is known: the file has no time column that fits {column.name!r} "
            f"and states none; give file.sample_rate_hz, or file.time_column"
        )
    rate, first = known[0]
    for other, text in known[1:]:
        if abs(other / rate - 1) > AGREEMENT:
            raise InputError(f"{mapping.where}: {key}: {first}, but {text}; {_cause(rate, other, mapping)}")
    if not RATES[0] <= rate <= RATES[1] and not _is_slow(rate):
        raise InputError(f"{mapping.where}: {key}: {first}, which is outside [{RATES[0]:g}, {RATES[1]:g}] Hz; {HINT}")
    return Timing(rate=rate, start=own.start if own else column.start, axis=own)


HINT = "is the time in ms or µs? Its unit goes into the header, such as 'Time (ms)'"


def _is_slow(rate: float) -> bool:
    return 0 < rate < RATES[0]


def _cause(rate: float, other: float, mapping: ImportMapping) -> str:
    """What would be right where two statements of a rate contradict."""
    ratio = max(rate / other, other / rate)
    if any(abs(ratio / k - 1) < AGREEMENT for k in (1e3, 1e6)):
        return HINT
    if mapping.sample_rate is not None:
        return "leave file.sample_rate_hz out where the file is right"
    return 'give the right one as file.sample_rate_hz, and time_column = "" where the times are wrong'
