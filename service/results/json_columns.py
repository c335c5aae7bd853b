"""Values as they are kept in columns of the database: strict JSON text."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from service.json_text import JsonText, plain


def dump(value: Any) -> str | None:
    """A value as strict JSON text; None stays None, and what is not finite becomes null."""
    if value is None:
        return None
    if isinstance(value, JsonText):
        return value.text
    try:
        return _COMPACT.encode(value)
    except ValueError:  # a number that is not finite: the slow path replaces it
        return _COMPACT.encode(plain(value))


def _other(value: Any) -> Any:
    """What the encoder does not know: arrays, and mappings other than dicts."""
    if hasattr(value, "tolist") or isinstance(value, Mapping):
        return plain(value)
    raise TypeError(f"Object of type {type(value).__name__} is not JSON serializable")


_COMPACT = json.JSONEncoder(allow_nan=False, separators=(",", ":"), default=_other)


def load(text: str | None) -> Any:
    """A value from JSON text; None stays None."""
    return None if text is None else json.loads(text)
