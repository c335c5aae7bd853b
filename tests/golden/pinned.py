"""Figures that are pinned, and which of them have moved."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any


def leaves(data: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Every number with where it stands."""
    if isinstance(data, dict):
        for key, value in data.items():
            yield from leaves(value, f"{path}.{key}")
    elif isinstance(data, list):
        for i, value in enumerate(data):
            yield from leaves(value, f"{path}[{i}]")
    else:
        yield path, data


def pinned_and_now(file: Path, figures: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    """Both flat, by where each number stands."""
    return dict(leaves(json.loads(file.read_text(encoding="utf-8")))), dict(leaves(figures))
