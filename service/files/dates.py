"""Dates with a time of day, as people and loggers write them: when a file was recorded, and columns of moments.

    2026-11-26T14:15:30.001+01:00    26.11.2026 14:15:30,001    11/26/2026 02:15:30 PM    26-Nov-2026 14:15:30

A date without a zone stays a local time (a `datetime` without `tzinfo`) until somebody states the zone; where nobody
does, UTC stands for it, and that is said. `03/04/2026` is two days, and so no date; nor is a day without a time of day,
or a year before 1971, at which clocks begin that were never set.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime, timedelta, timezone, tzinfo
from functools import lru_cache
from typing import Any
from zoneinfo import ZoneInfo

import numpy as np

from service.errors import InputError

EXAMPLE = "2026-03-12T08:14:00+01:00"
_EARLIEST = 1971
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
TODAY = (978_307_200.0, 4_102_444_800.0)  # 2001 to 2100, after EPOCH [s]
SIZES = (1.0, 1e-3, 1e-6, 1e-9)  # units of a date as a number [s]
DAYS = (25569.0, 719529.0)  # EPOCH as a number of days in spreadsheets, and in MATLAB
_ENGLISH = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_MONTHS = {name: i for i, name in enumerate(_ENGLISH, start=1)} | {"mär": 3, "mrz": 3, "mai": 5, "okt": 10, "dez": 12}
_DAYS = (
    re.compile(r"(?<!\d)(?P<y>\d{4})[-/.](?P<m>\d{1,2})[-/.](?P<d>\d{1,2})(?!\d)"),
    re.compile(r"(?<!\d)(?P<y>\d{4})(?P<m>\d\d)(?P<d>\d\d)(?=T\d|[ _-]\d{6}|$)"),
    re.compile(r"(?<!\d)(?P<d>\d{1,2})[.\s/-]+(?P<m>[^\W\d_]{3,9})\.?[\s/,-]+(?P<y>\d{4})(?!\d)"),
    re.compile(r"(?P<m>[^\W\d_]{3,9})\.?\s+(?P<d>\d{1,2}),?\s+(?:(?=\d{1,2}:).*\s)?(?P<y>\d{4})(?!\d)"),
    re.compile(r"(?<!\d)(?P<a>\d{1,2})(?:(?P<dot>\.\s?)|[/-])(?P<b>\d{1,2})(?:\.\s?|[/-])(?P<y>\d{4})(?!\d)"),
)
_CLOCK = r"(?P<h>\d{1,2}):(?P<min>\d\d)(?::(?P<s>\d\d)(?:[.,](?P<f>\d+))?)?\s*(?P<half>[AaPp]\.?[Mm]\.?)?"
_TIME = re.compile(rf"(?<!\d){_CLOCK}|(?<=\d[T _-])(?P<h2>\d\d)(?P<min2>\d\d)(?P<s2>\d\d)(?!\d)")
_ZONE = re.compile(
    r"\s*\(?(?:UTC|GMT)?(?P<sign>[+-])(?P<h>\d{1,2}):?(?P<m>\d\d)?(?![\d.])|\s*\(?(?P<z>Z(?![a-z])|UTC|GMT)(?![+-])"
)
_CELL = re.compile(rf"(?:(?P<date>[^:]*?)(?:,?[T ]+|_))?{_CLOCK}\s*(?P<zone>.*)")
_NAMES = re.compile(
    r"(?i)(^|[^a-z])(date|datum|fecha|data|day|start|begin|beginn|record|acqui|aufnahme|mess|test|time ?stamp|"
    r"zeitpunkt|wf_start|origination|when)"
)
_NOT_THE_START = re.compile(
    r"(?i)(calib|kalib|modif|change|geänd|export|print|install|service|warrant|due|fällig|birth)"
)


def moment_in(text: str) -> datetime | None:
    """The date with its time of day in a text, without `tzinfo` where the text states no zone; None of no date."""
    day = _day_in(text)
    found = None if day is None else _TIME.search(text)
    seconds = None if found is None else _of_day(found)
    if day is None or found is None or seconds is None:
        return None
    return (day + timedelta(seconds=seconds)).replace(tzinfo=_stated_zone(_ZONE.match(text, found.end())))


def _stated_zone(found: re.Match[str] | None) -> tzinfo | None:
    if found is None:
        return None
    if found["z"]:
        return UTC
    offset = timedelta(hours=int(found["h"]), minutes=int(found["m"] or 0))
    return timezone(-offset if found["sign"] == "-" else offset)


def _of_day(found: re.Match[str]) -> float | None:
    """Seconds after midnight of a time of day; None of none that there is."""
    parts = found.groupdict()
    hours, minutes = int(parts["h"] or parts["h2"]), int(parts["min"] or parts["min2"])
    if parts["half"]:
        hours = hours % 12 + 12 * (parts["half"][0] in "pP")
    seconds = int(parts["s"] or parts.get("s2") or 0)
    if hours > 24 or minutes > 59 or seconds > 60:
        return None
    return hours * 3600 + minutes * 60 + seconds + float(f"0.{parts['f'] or 0}")


def _day_in(text: str) -> datetime | None:
    """The day in a text; None of no day, and of one that may be two."""
    for pattern in _DAYS:
        found = pattern.search(text)
        first = None if found is None else _month_first([found])
        if found is not None and first is None:
            return None
        if found is not None and (day := _day(found, bool(first))) is not None:
            return day if day.year >= _EARLIEST else None
    return None


def _month_first(found: Iterable[re.Match[str]]) -> bool | None:
    """Whether days are written month first, by a part that is no month or by their dots; None where nothing says."""
    parts = [day.groupdict() for day in found]
    pairs = [(int(day["a"]), int(day["b"]), day["dot"]) for day in parts if "a" in day]
    if any(a > 12 for a, _, _ in pairs):
        return False
    if any(b > 12 for _, b, _ in pairs):
        return True
    return False if all(a == b or dot for a, b, dot in pairs) else None


def _day(found: re.Match[str], month_first: bool) -> datetime | None:
    """The day that was written; None where there is none of this number or name."""
    parts = found.groupdict()
    if "a" in parts:
        parts["m"], parts["d"] = (parts["a"], parts["b"]) if month_first else (parts["b"], parts["a"])
    month = int(parts["m"]) if parts["m"].isdigit() else _MONTHS.get(parts["m"][:3].lower(), 0)
    try:
        return datetime(int(parts["y"]), month, int(parts["d"]))
    except ValueError:
        return None


@lru_cache(256)
def _written_day(text: str) -> re.Match[str] | None:
    """A text that is a day and nothing else."""
    return next((found for pattern in _DAYS if (found := pattern.fullmatch(text)) and _a_month(found)), None)


def _a_month(found: re.Match[str]) -> bool:
    month = found.groupdict().get("m", "1")
    return month.isdigit() or month[:3].lower() in _MONTHS


@lru_cache(256)
def _offset(text: str) -> float | None:
    """Seconds that a clock of this zone is ahead of UTC, 0 without a zone; None of what is no zone."""
    if not text:
        return 0.0
    zone = _stated_zone(_ZONE.fullmatch(text))
    return None if zone is None else EPOCH.astimezone(zone).utcoffset().total_seconds()  # type: ignore[union-attr]


def _cell(text: str) -> re.Match[str] | None:
    """A cell that is a time of day, or a day with one."""
    found = _CELL.fullmatch(text)
    if found is None or _of_day(found) is None or _offset(found["zone"]) is None:
        return None
    return None if found["date"] is not None and _written_day(found["date"]) is None else found


def is_printed_time(cell: str) -> bool:
    """Whether a cell is a time of day with its seconds, or a date with a time."""
    found = _cell(cell)
    return found is not None and (found["date"] is not None or found["s"] is not None)


def seconds_of(cells: Sequence[str]) -> tuple[np.ndarray, datetime | None]:
    """Seconds after the first cell (n,), and its moment, without a zone where it has none; None without a sure date.

    A cell that is no time is NaN. Offsets from UTC are taken out; times of day alone that fall are past midnight. Where
    all days together do not tell whether the month is first, it is where the times have AM and PM.
    """
    found = [_cell(cell) for cell in cells]
    written = {f["date"]: _written_day(f["date"]) for f in found if f is not None and f["date"]}
    first = _month_first(day for day in written.values() if day is not None)
    month_first = any(f is not None and f["half"] for f in found) if first is None else first
    days: dict[str | None, float] = {None: 0.0}
    for text, day in written.items():
        if day is None or (moment := _day(day, month_first)) is None:
            raise ValueError(f"there is no day {text!r}")
        days[text] = float(moment.toordinal())
    time = np.array([np.nan if f is None else (_of_day(f) or 0.0) - (_offset(f["zone"]) or 0.0) for f in found])
    day_of = np.array([np.nan if f is None else days[f["date"]] for f in found])
    if len(days) == 1:
        day_of = np.cumsum(np.concatenate(([0], np.diff(time) < -43200.0)))
    out = (day_of - day_of[0]) * 86400.0 + (time - time[0])
    if found[0] is None or not found[0]["date"] or first is None:
        return out, None
    moment = datetime.fromordinal(int(day_of[0])) + timedelta(seconds=float(time[0]))
    return out, moment.replace(tzinfo=UTC) if found[0]["zone"] else moment


def stated_in(entries: Mapping[str, Any] | Iterable[tuple[str, Any]]) -> datetime | None:
    """The earliest start that named entries state: `Datum: 12.03.2026 08:14:00`; also a day and a time in two entries.

    Of entries whose name says that they are of something else, such as a calibration, none is read.
    """
    pairs = entries.items() if isinstance(entries, Mapping) else entries
    texts = [(name, _text_of(value) or _text_of(_counted(name, value))) for name, value in pairs]
    kept = [(name, text) for name, text in texts if text and not _NOT_THE_START.search(name)]
    named = [(name, text) for name, text in kept if _NAMES.search(name)]
    found = [moment for _, text in named if (moment := moment_in(text)) is not None]
    if not found:
        day = next((text for _, text in named if _day_in(text) is not None), None)
        hour = next((text for name, text in kept if _TIME.search(text) and _day_in(text) is None), None)
        return None if day is None or hour is None else moment_in(f"{day} {hour}")
    return found[0]


def _counted(name: str, value: Any) -> datetime | None:
    """The date that a number of such a name counts up to: from 1970 in UTC, or days by a local clock."""
    if not _NAMES.search(name) or isinstance(value, bool) or not isinstance(value, (int, float, np.number)):
        return None
    number = float(value)
    size = next((unit for unit in SIZES if TODAY[0] < number * unit < TODAY[1]), None)
    if size is not None:
        return EPOCH + timedelta(seconds=number * size)
    zero = next((days for days in DAYS if TODAY[0] < (number - days) * 86400.0 < TODAY[1]), None)
    if zero is None or number == int(number):  # a day without a time of day
        return None
    return EPOCH.replace(tzinfo=None) + timedelta(seconds=round((number - zero) * 86400.0, 3))


def _text_of(value: Any) -> str:
    if isinstance(value, bytes):
        return value.decode("utf-8", errors="replace")
    if isinstance(value, datetime):
        return value.isoformat()
    return str(value) if isinstance(value, str) or type(value).__name__ in ("str_", "bytes_", "datetime64") else ""


def zone_of(text: str) -> tzinfo:
    """A zone as a person states it: `Europe/Berlin`, `+01:00` or `UTC`; InputError for anything else."""
    found = _ZONE.fullmatch(text.strip())
    if found is not None:
        return _stated_zone(found) or UTC
    try:
        return ZoneInfo(text.strip())
    except (OSError, ValueError, KeyError):
        raise InputError(f"zone = {text!r} must be the name of a zone such as Europe/Berlin, +01:00 or UTC") from None


def without_zone(where: str, moment: datetime) -> str:
    """What is said of a local time for which nobody states a zone."""
    return f"{where}: it began at {moment:%Y-%m-%d %H:%M:%S} by a clock whose zone is not stated"


def in_zone(where: str, moment: datetime, zone: str | None) -> tuple[datetime, str]:
    """A moment with its zone, and a note where nobody states it and UTC stands for it.

    InputError of a local time that came twice in its zone, or never.
    """
    if moment.tzinfo is not None:
        return moment, ""
    said = without_zone(where, moment)
    if zone is None:
        return moment.replace(tzinfo=UTC), f"{said}, taken for UTC; give --zone, such as Europe/Berlin, +01:00 or UTC"
    first, second = (moment.replace(tzinfo=zone_of(zone), fold=fold) for fold in (0, 1))
    if first.utcoffset() != second.utcoffset():
        ways = " or ".join(each.strftime("%z") for each in (first, second))
        raise InputError(f"{said}: on that night the clocks of {zone} were set; give --zone {ways}")
    return first, ""
