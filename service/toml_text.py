"""Values and documents as TOML text."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any

DIGITS = 6  # of a number that is written for people: more than any of them is known to


def value_text(value: Any, digits: int | None = None) -> str:
    """A value as TOML: text, number, a list or a table of them; numbers as they are, or with so many digits."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key_text(k)} = {value_text(v, digits)}" for k, v in value.items()) + "}"
    if isinstance(value, (list, tuple)):
        inner = [value_text(each, digits) for each in value]
        line = f"[{', '.join(inner)}]"
        return line if digits is None or len(line) < 82 else "[\n    " + ",\n    ".join(inner) + ",\n]"
    if isinstance(value, float):
        text = repr(float(value)) if digits is None else f"{value:.{digits}g}"
        return text if any(c in text for c in ".en") else f"{text}.0"
    if isinstance(value, (str, bool)):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return str(value)


def key_text(name: str) -> str:
    """A name as a key, or as a part of a table's name."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else value_text(name)


def lines_of(values: Mapping[str, Any], about: Mapping[str, str] | None = None) -> list[str]:
    """Keys with their values, and behind them what is to be said about them; what is None is left out."""
    said = {key: f"  # {text}" for key, text in (about or {}).items()}
    return [f"{key_text(k)} = {value_text(v)}{said.get(k, '')}" for k, v in values.items() if v is not None]


def document_text(document: Mapping[str, Any], table: str = "") -> str:
    """A mapping as a TOML document; what is None is left out."""
    tables = {key: value for key, value in document.items() if isinstance(value, Mapping)}
    lines = [f"[{table}]"] if table else []
    lines += lines_of({key: value for key, value in document.items() if key not in tables})
    parts = ["\n".join(lines) + "\n"] if len(lines) > bool(table) else []
    inside = f"{table}." if table else ""
    parts += [document_text(value, f"{inside}{key_text(key)}") for key, value in tables.items()]
    return "\n".join(parts)
