"""Answers as JSON text: what is not finite becomes null, since JSON has no word for it."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from service.errors import InputError


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


def json_text(value: Any) -> str:
    """A value as indented JSON."""
    return json.dumps(plain(value), indent=2, ensure_ascii=False, allow_nan=False)


def write_text(path: str | Path, text: str) -> None:
    """Writes text to a file, or to standard output for `-`."""
    if str(path) == "-":
        print(text)
        return
    try:
        Path(path).write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {(error.strerror or 'fault').lower()}") from None


def wrote_json(value: Any, path: Path | None) -> bool:
    """Writes a value where `--json` says so; whether that is standard output, which then carries nothing else."""
    if path is None:
        return False
    write_text(path, json_text(value))
    return str(path) == "-"
