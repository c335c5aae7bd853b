"""Every place of the service that writes a log line, found in its source."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

SERVICE = Path(__file__).parents[1] / "service"
LEVELS = {"exception": "error"}  # of a method that is not named as its level
METHODS = ("debug", "info", "warning", "error", "exception", "critical")
SUMMARY = "service.logs", "… more lines within … s were left out: …"  # that the handler itself writes


class Call(NamedTuple):
    """A log line: the logger's name, the constant text, the level."""

    place: str
    text: str
    level: str


def log_calls() -> Iterator[Call]:
    """All log lines; an f-string's parts that vary are one capital word each."""
    for file in sorted(SERVICE.rglob("*.py")):
        module = ".".join(file.relative_to(SERVICE.parent).with_suffix("").parts)
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in METHODS:
                place = _logger(node.func.value, module)
                if place is not None:
                    level = LEVELS.get(node.func.attr, node.func.attr)
                    yield Call(place, _text(node.args[0]), level)
    yield Call(*SUMMARY, "as of the line")


def _logger(value: ast.expr, module: str) -> str | None:
    """The name of a logger that a method is called of; None where it is not one."""
    if isinstance(value, ast.Name) and value.id in ("log", "logger"):
        return module
    if isinstance(value, ast.Call) and ast.unparse(value.func).endswith("getLogger"):
        (name,) = value.args
        return ast.literal_eval(name) if isinstance(name, ast.Constant) else module
    return None


def _text(value: ast.expr) -> str:
    if isinstance(value, ast.JoinedStr):
        return "".join(str(part.value) if isinstance(part, ast.Constant) else "…" for part in value.values)
    text: str = ast.literal_eval(value)
    return text
