"""Values as TOML text."""

from __future__ import annotations

import json
from typing import Any

DIGITS = 6  # of a number: more than any of them is known to


def value_text(value: Any) -> str:
    """A value as TOML: text, whole number, number, or a list of them."""
    if isinstance(value, (list, tuple)):
        inner = ", ".join(value_text(v) for v in value)
        return f"[{inner}]" if len(inner) < 80 else "[\n    " + ",\n    ".join(value_text(v) for v in value) + ",\n]"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        text = f"{value:.{DIGITS}g}"
        return text if any(c in text for c in ".e") else f"{text}.0"
    return json.dumps(value, ensure_ascii=False) if isinstance(value, str) else str(value)
