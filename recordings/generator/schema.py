"""Rules for the values of a spec: one small class a kind of value, and the check of a whole table."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from recordings.generator.errors import SpecError

REQUIRED = object()


@dataclass(frozen=True, slots=True)
class Number:
    """One number of a spec, its unit, its range and what it is when left out."""

    unit: str
    low: float
    high: float
    default: Any = REQUIRED
    integer: bool = False

    def read(self, name: str, value: Any) -> float | int:
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise SpecError(f"{name} = {value!r} must be a number [{self.unit}]")
        if not self.low <= value <= self.high:
            raise SpecError(f"{name} = {value:g} {self.unit} is outside [{self.low:g}, {self.high:g}] {self.unit}")
        if self.integer and value != int(value):
            raise SpecError(f"{name} = {value:g} must be a whole number")
        return int(value) if self.integer else float(value)


@dataclass(frozen=True, slots=True)
class Numbers:
    """A list of numbers, each with the same range."""

    each: Number
    default: Any = REQUIRED

    def read(self, name: str, value: Any) -> tuple:
        if not isinstance(value, (list, tuple)):
            raise SpecError(f"{name} = {value!r} must be a list of numbers [{self.each.unit}]")
        return tuple(self.each.read(f"{name}[{i}]", v) for i, v in enumerate(value))


@dataclass(frozen=True, slots=True)
class Text:
    default: Any = REQUIRED

    def read(self, name: str, value: Any) -> str:
        if not isinstance(value, str) or not value:
            raise SpecError(f"{name} = {value!r} must be text")
        return value


@dataclass(frozen=True, slots=True)
class Choices:
    """A list of words out of a few."""

    allowed: tuple[str, ...]
    default: Any = ()

    def read(self, name: str, value: Any) -> tuple[str, ...]:
        if not isinstance(value, (list, tuple)) or not set(value) <= set(self.allowed):
            raise SpecError(f"{name} = {value!r} must be a list out of {', '.join(self.allowed)}")
        return tuple(value)


@dataclass(frozen=True, slots=True)
class Flag:
    default: Any = REQUIRED

    def read(self, name: str, value: Any) -> bool:
        if not isinstance(value, bool):
            raise SpecError(f"{name} = {value!r} must be true or false")
        return value


@dataclass(frozen=True, slots=True)
class Rows:
    """A list of tables of one kind."""

    schema: Mapping[str, Any]
    default: Any = ()

    def read(self, name: str, value: Any) -> tuple:
        if not isinstance(value, (list, tuple)) or not all(isinstance(v, Mapping) for v in value):
            raise SpecError(f"{name} must be a list of tables, [[{name}]]")
        return tuple(checked(v, self.schema, f"{name}[{i}].") for i, v in enumerate(value))


@dataclass(frozen=True, slots=True)
class Named:
    """A list of tables, each with the keys that its `name` (or `kind`) calls for."""

    key: str
    common: Mapping[str, Any]
    table: Mapping[str, Any]  # of things with `parameters`, a schema of their own
    default: Any = ()

    def read(self, name: str, value: Any) -> tuple:
        if not isinstance(value, (list, tuple)) or not all(isinstance(v, Mapping) for v in value):
            raise SpecError(f"{name} must be a list of tables, [[{name}]]")
        return tuple(self._row(f"{name}[{i}].", row) for i, row in enumerate(value))

    def _row(self, path: str, row: Mapping) -> dict[str, Any]:
        kind = row.get(self.key)
        if not isinstance(kind, str) or kind not in self.table:
            raise SpecError(f"{path}{self.key} = {kind!r} must be one of {', '.join(self.table)}")
        return checked(row, {self.key: Text(), **self.common, **self.table[kind].parameters}, path)


def checked(values: Mapping[str, Any], schema: Mapping[str, Any], path: str = "") -> dict[str, Any]:
    """The mapping with every key checked and every default filled in."""
    for key in values:
        if key not in schema:
            near = difflib.get_close_matches(key, schema, n=1, cutoff=0.4)
            known = f"did you mean {path}{near[0]}?" if near else f"known here: {', '.join(schema)}"
            raise SpecError(f"{path}{key} is not a key of a campaign's spec; {known}")
    out: dict[str, Any] = {}
    for key, rule in schema.items():
        name = f"{path}{key}"
        if isinstance(rule, Mapping):
            table = values.get(key, {})
            if not isinstance(table, Mapping):
                raise SpecError(f"{name} must be a table, not {table!r}")
            out[key] = checked(table, rule, f"{name}.")
        elif key in values:
            out[key] = rule.read(name, values[key])
        elif rule.default is REQUIRED:
            raise SpecError(f"{name} is missing")
        else:
            out[key] = rule.default
    return out
