"""Answers as JSON text: what is not finite becomes null, since JSON has no word for it."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pydantic_core import from_json

from service.file_faults import writing


class JsonText(Mapping[str, Any]):
    """A mapping as the JSON text that it was written in; parsed where somebody looks into it."""

    __slots__ = ("_value", "text")

    def __init__(self, text: str) -> None:
        self.text = text
        self._value: Mapping[str, Any] | None = None

    def __getitem__(self, key: str) -> Any:
        return self._parsed()[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._parsed())

    def __len__(self) -> int:
        return len(self._parsed())

    def _parsed(self) -> Mapping[str, Any]:
        if self._value is None:
            value = from_json(self.text)  # two to three times as fast as the standard library's
            if not isinstance(value, dict):
                raise ValueError(f"a text of JSON must hold a mapping, not {value!r:.60}")
            self._value = value
        return self._value


def plain(value: Any) -> Any:
    """A value as dicts, lists, strings, finite numbers, booleans and None."""
    if hasattr(value, "tolist"):  # numpy arrays and scalars
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def compact(value: Any) -> str:
    """A value as JSON without spaces."""
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


def json_text(value: Any) -> str:
    """A value as indented JSON."""
    return json.dumps(plain(value), indent=2, ensure_ascii=False, allow_nan=False)


def write_text(path: str | Path, text: str) -> None:
    """Writes text to a file, or to standard output for `-`."""
    if str(path) == "-":
        print(text)
        return
    write_bytes(Path(path), f"{text}\n".encode())


def write_bytes(path: Path, content: bytes) -> None:
    """Writes a file; InputError names one that cannot be written."""
    with writing(path):
        path.write_bytes(content)


def wrote_json(value: Any, path: Path | None) -> bool:
    """Writes a value where `--json` says so; whether that is standard output, which then carries nothing else."""
    if path is None:
        return False
    write_text(path, json_text(value))
    return str(path) == "-"
