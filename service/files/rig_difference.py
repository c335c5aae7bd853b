"""How two rig files differ, value by value."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

_ABSENT = object()


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """One value that differs, as text; None where it is absent."""

    key: str
    before: str | None
    now: str | None

    def __str__(self) -> str:
        return f"{self.key} = {_named(self.now)} (was {_named(self.before)})"


def differences(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[Difference]:
    """The values that differ between two rig files, by key."""
    old, new = dict(_flat(before)), dict(_flat(now))
    return [
        Difference(key=key, before=_text(old.get(key, _ABSENT)), now=_text(new.get(key, _ABSENT)))
        for key in sorted(old.keys() | new.keys())
        if old.get(key, _ABSENT) != new.get(key, _ABSENT)
    ]


def digest_of(rig: Mapping[str, Any]) -> str:
    """A name for the contents of a rig file: 16 hexadecimal digits."""
    text = json.dumps(rig, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _flat(mapping: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in mapping.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _text(value: Any) -> str | None:
    if value is _ABSENT:
        return None
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _named(text: str | None) -> str:
    return "absent" if text is None else text
