"""Values as they are kept in columns of the database: strict JSON text."""

from __future__ import annotations

import json
from typing import Any

from service.json_text import plain


def dump(value: Any) -> str | None:
    """A value as strict JSON text; None stays None."""
    return None if value is None else json.dumps(plain(value), allow_nan=False, separators=(",", ":"))


def load(text: str | None) -> Any:
    """A value from JSON text; None stays None."""
    return None if text is None else json.loads(text)
