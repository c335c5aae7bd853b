"""The list of assets by pages: the most severe first, found by name, area, level or what is said of them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from service.contract.finding import SEVERITY

PAGE = 100  # assets of one page where no other number is asked for
MOST = 1000  # assets of one page at most
CURSOR = rf"[0-{len(SEVERITY) - 1}]\.[A-Za-z0-9_.\-]{{1,64}}"
"""A severity and the name of an asset."""

KIND_WORDS = {
    "model": "rig model",
    "baseline": "healthy baseline",
    "encoders": "two encoders",
    "level": "vibration level",
}
"""As the page says what the answers about a machine rest on."""

_AREAS = (re.compile(r"(.+)\.[^.]+?"), re.compile(r"(.+)[-_][^.]+?"))


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """Where a page ends: the severity and the name of its last asset."""

    severity: int
    asset: str

    @property
    def cursor(self) -> str:
        """The place as a text for whoever asks for the next page."""
        return f"{self.severity}.{self.asset}"

    @classmethod
    def of(cls, cursor: str) -> Place:
        """The place that a text of the form CURSOR says."""
        severity, _, asset = cursor.partition(".")
        return cls(severity=int(severity), asset=asset)


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """Which assets of the list are asked for.

    words    each is part of what is searched: `words_of`
    area     the part of the plant; None for all
    levels   of the status; empty for all
    retired  whether assets out of use are listed, too
    """

    after: Place | None = None
    limit: int = PAGE
    words: tuple[str, ...] = ()
    area: str | None = None
    levels: tuple[str, ...] = ()
    retired: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class Page:
    """One page of the list."""

    summaries: Sequence[Mapping[str, Any]]
    next: Place | None  # where the next page begins; None at the end


def area_of(asset: str) -> str:
    """The part of the plant that an asset's name states: all before its last `.`, or before the last `-` or `_`."""
    found = (area.fullmatch(asset) for area in _AREAS)
    return next((match[1] for match in found if match), "")


def severity_of(level: str) -> int:
    """The place of a level of the status among all, the worst highest."""
    return SEVERITY.index(level)  # type: ignore[arg-type]


def words_of(summary: Mapping[str, Any]) -> str:
    """What a search looks at: name, rig file, level, reasons and action, in small letters."""
    status = summary["status"]
    level, kind = status["level"].replace("_", " "), KIND_WORDS[summary["kind"]]
    texts = (summary["asset"], summary["rig"], level, kind, status.get("action"), *status["reasons"])
    return "\n".join(str(text) for text in texts if text).lower()


def area_entry(area: str, *, levels: Mapping[str, int], alarms: int, retired: int) -> dict[str, Any]:
    """One area as it is answered: levels from the worst."""
    ordered = {level: levels[level] for level in reversed(SEVERITY) if levels.get(level)}
    return {"area": area, "assets": sum(ordered.values()), "levels": ordered, "alarms": alarms, "retired": retired}
