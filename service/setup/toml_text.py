"""Values and documents as TOML text."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
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


def document_text(document: Mapping[str, Any], table: str = "") -> str:
    """A mapping as a TOML document, every number as it is; what is None is left out."""
    tables = {key: value for key, value in document.items() if isinstance(value, Mapping)}
    lines = [f"[{table}]"] if table else []
    for key, value in document.items():
        if value is not None and key not in tables:
            lines.append(f"{_key(key)} = {_exactly(value)}")
    parts = ["\n".join(lines) + "\n"] if len(lines) > bool(table) else []
    parts += [document_text(value, f"{table}.{_key(key)}" if table else _key(key)) for key, value in tables.items()]
    return "\n".join(parts)


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else json.dumps(name, ensure_ascii=False)


def _exactly(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{_key(k)} = {_exactly(v)}" for k, v in value.items() if v is not None) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_exactly(each) for each in value) + "]"
    return repr(float(value)) if isinstance(value, float) else value_text(value)
