"""When a file says that it was recorded: dates with a time of day, as people and loggers write them.

A date without a zone stays a local time (a `datetime` without `tzinfo`) until somebody states the zone; where nobody
does, UTC stands for it, and that is said. `03/04/2026` is two days, and so no date; nor is a day without a time of day,
or a year before 1971, at which clocks begin that were never set.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime, timedelta, timezone, tzinfo
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
_MONTHS = (
    ("jan",), ("feb",), ("mar", "mär", "mrz"), ("apr",), ("may", "mai"), ("jun",), ("jul",), ("aug",), ("sep",),
    ("oct", "okt"), ("nov",), ("dec", "dez"),
)  # fmt: skip
_DAYS = (
    re.compile(r"(?<!\d)(?P<y>\d{4})[-/.](?P<m>\d{1,2})[-/.](?P<d>\d{1,2})(?!\d)"),
    re.compile(r"(?<!\d)(?P<y>\d{4})(?P<m>\d\d)(?P<d>\d\d)(?=T\d|[ _-]\d{6}|$)"),
    re.compile(r"(?<!\d)(?P<d>\d{1,2})\.\s?(?P<m>\d{1,2})\.\s?(?P<y>\d{4})(?!\d)"),
    re.compile(r"(?<!\d)(?P<d>\d{1,2})[.\s/-]+(?P<m>[A-Za-zä]{3,9})\.?[\s/-]+(?P<y>\d{4})(?!\d)"),
    re.compile(r"(?P<m>[A-Za-zä]{3,9})\.?\s+(?P<d>\d{1,2}),?\s+(?:(?=\d{1,2}:).*\s)?(?P<y>\d{4})(?!\d)"),
    re.compile(r"(?<!\d)(?P<a>\d{1,2})[/-](?P<b>\d{1,2})[/-](?P<y>\d{4})(?!\d)"),
)
_TIME = re.compile(
    r"(?<!\d)(?P<h>\d{1,2}):(?P<min>\d\d)(?::(?P<s>\d\d)(?:[.,](?P<f>\d+))?)?\s*(?P<half>[AaPp]\.?[Mm]\.?)?"
    r"|(?<=\d[T _-])(?P<h2>\d\d)(?P<min2>\d\d)(?P<s2>\d\d)(?!\d)"
)
_ZONE = re.compile(
    r"\s*\(?(?:UTC|GMT)?(?P<sign>[+-])(?P<h>\d{1,2}):?(?P<m>\d\d)?(?![\d.])|\s*\(?(?P<z>Z(?![a-z])|UTC|GMT)(?![+-])"
)
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
    if day is None or found is None:
        return None
    parts = found.groupdict()
    hours = int(parts["h"] or parts["h2"])
    if parts["half"]:
        hours = hours % 12 + 12 * (parts["half"][0] in "pP")
    second = float(f"{parts['s'] or parts['s2'] or 0}.{parts['f'] or 0}")
    minutes = int(parts["min"] or parts["min2"])
    if hours > 23 or minutes > 59 or second >= 60:
        return None
    zone = _ZONE.match(text, found.end())
    return (day + timedelta(hours=hours, minutes=minutes, seconds=second)).replace(tzinfo=_stated_zone(zone))


def _stated_zone(found: re.Match[str] | None) -> tzinfo | None:
    if found is None:
        return None
    if found["z"]:
        return UTC
    offset = timedelta(hours=int(found["h"]), minutes=int(found["m"] or 0))
    return timezone(-offset if found["sign"] == "-" else offset)


def _day_in(text: str) -> datetime | None:
    """The day in a text; None of no day, and of one that may be two."""
    for pattern in _DAYS:
        found = pattern.search(text)
        if found is None:
            continue
        parts = found.groupdict()
        day, month = parts.get("d"), parts.get("m")
        if "a" in parts:  # day or month first: known where one of them is no month
            a, b = int(parts["a"]), int(parts["b"])
            if a <= 12 and b <= 12 and a != b:
                return None
            day, month = (str(a), str(b)) if b <= 12 else (str(b), str(a))
        number = _month(str(month))
        try:
            moment = datetime(int(parts["y"]), number, int(str(day)))
        except ValueError:
            continue
        return moment if moment.year >= _EARLIEST else None
    return None


def _month(text: str) -> int:
    """The number of a month; 0 of no month."""
    if text.isdigit():
        return int(text)
    return next((i for i, names in enumerate(_MONTHS, start=1) if text.lower().startswith(names)), 0)


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
