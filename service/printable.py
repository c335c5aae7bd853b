"""Text that others wrote, as it may be shown: nothing in it steers a terminal, or reverses the text next to it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

JOINERS = "\u200c\u200d"  # within words of some scripts


def printable(text: str) -> str:
    """A text without control characters: a space for each that separates, `?` for others."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in JOINERS else " " if c.isspace() else "?" for c in text)


def all_printable(value: Any) -> Any:
    """A document of JSON whose texts, names among them, are printable."""
    if isinstance(value, str):
        return printable(value)
    if isinstance(value, Mapping):
        return {all_printable(key): all_printable(item) for key, item in value.items()}
    return [all_printable(item) for item in value] if isinstance(value, (list, tuple)) else value
