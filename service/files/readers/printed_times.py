"""Dates with times, and times of day, as recorders print them; one column of them as seconds after its first cell.

    2026-11-26T14:15:30.001+01:00    26.11.2026 14:15:30,001    11/26/2026 02:15:30 PM
    26-Nov-2026 14:15:30             14:15:30.001

Of `03/04/2026` the order is the column's: a part above 12 is the day; else the month is first where the times have AM
and PM, and the day is.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import UTC, date, datetime, timedelta

import numpy as np

_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
MONTHS = {name: i for i, name in enumerate(_MONTHS, start=1)} | {"mär": 3, "mrz": 3, "mai": 5, "okt": 10, "dez": 12}
DATE = (
    r"(?P<date>(?P<y>\d{4})[-/.](?P<m>\d{1,2})[-/.](?P<d>\d{1,2})|(?P<a>\d{1,2})[-/.](?P<b>\d{1,2})[-/.](?P<ab_y>\d{4})"
    r"|(?P<month_d>\d{1,2})[-/. ]{1,2}(?P<month>[^\W\d_]{3,9})[-/. ,]{1,2}(?P<month_y>\d{4})"
    r"|(?P<first>[^\W\d_]{3,9})\.? (?P<first_d>\d{1,2}),? (?P<first_y>\d{4}))"
)
CLOCK = r"(?P<hour>\d{1,2}):(?P<minute>\d\d)(?::(?P<second>\d\d)(?:[.,](?P<part>\d+))?)?"
PRINTED = re.compile(
    rf"^(?:{DATE}(?:,?[T ]+|_))?{CLOCK}\s*(?P<half>[AaPp]\.?[Mm]\.?)?\s*(?P<zone>Z|UTC|GMT|[+-]\d\d:?(?:\d\d)?)?$"
)


def is_printed_time(cell: str) -> bool:
    """Whether a cell is a time of day with its seconds, or a date with a time."""
    found = PRINTED.match(cell)
    return found is not None and (found["date"] is not None or found["second"] is not None) and _is_possible(found)


def _is_possible(found: re.Match[str]) -> bool:
    month = (found["month"] or found["first"] or "jan")[:3].lower()
    return month in MONTHS and int(found["hour"]) <= 24 and int(found["minute"]) < 60


def seconds_of(cells: Sequence[str]) -> tuple[np.ndarray, datetime | None]:
    """Seconds after the first cell (n,), and its moment, without a zone where it has none; None without a date.

    A cell that is no time is NaN. Offsets from UTC are taken out; times of day alone that fall are past midnight.
    """
    found = [PRINTED.match(cell) for cell in cells]
    known = [f for f in found if f is not None]
    days: dict[str | None, int] = {None: 0}
    month_first = _month_first(known)
    for each in known:
        if each["date"] not in days:
            days[each["date"]] = _day(each, month_first)
    day = np.array([np.nan if f is None else days[f["date"]] for f in found], dtype=float)
    time = np.array([np.nan if f is None else _of_day(f) for f in found])
    if len(days) == 1:
        day = np.cumsum(np.concatenate(([0], np.diff(time) < -43200.0)))
    first = found[0]
    out = (day - day[0]) * 86400.0 + (time - time[0])
    if first is None or not first["date"]:
        return out, None
    moment = datetime.fromordinal(int(day[0])) + timedelta(seconds=float(time[0]))
    return out, moment.replace(tzinfo=UTC) if first["zone"] else moment


def _month_first(found: Sequence[re.Match[str]]) -> bool:
    pairs = {(int(f["a"]), int(f["b"])) for f in found if f["a"]}
    if any(a > 12 for a, _ in pairs):
        return False
    return any(b > 12 for _, b in pairs) or any(f["half"] for f in found)


def _day(found: re.Match[str], month_first: bool) -> int:
    """The day's number; ValueError where there is no such day."""
    if found["y"]:
        parts = int(found["y"]), int(found["m"]), int(found["d"])
    elif found["a"]:
        month, day = (found["a"], found["b"]) if month_first else (found["b"], found["a"])
        parts = int(found["ab_y"]), int(month), int(day)
    else:
        prefix = "month" if found["month"] else "first"
        parts = int(found[f"{prefix}_y"]), MONTHS[found[prefix][:3].lower()], int(found[f"{prefix}_d"])
    try:
        return date(*parts).toordinal()
    except ValueError:
        raise ValueError(f"there is no day {found['date']!r}") from None


def _of_day(found: re.Match[str]) -> float:
    """Seconds after midnight, of UTC where the cell has an offset from it."""
    hour = int(found["hour"])
    if found["half"]:
        hour = hour % 12 + (12 if found["half"][0] in "Pp" else 0)
    seconds = hour * 3600 + int(found["minute"]) * 60 + int(found["second"] or 0) + float(f"0.{found['part'] or 0}")
    return seconds - _offset(found["zone"]).total_seconds()


def _offset(zone: str | None) -> timedelta:
    if not zone or zone[0] not in "+-":
        return timedelta(0)
    digits = zone[1:].replace(":", "")
    return timedelta(hours=int(digits[:2]), minutes=int(digits[2:] or 0)) * (-1 if zone[0] == "-" else 1)
