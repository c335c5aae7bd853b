"""TOML documents at the edge: read, and their keys, tables and numbers checked; every fault one line with its key."""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

from service.errors import InputError
from service.file_faults import reading
from service.stream.wire.topics import NAME

MOST = sys.float_info.max
LARGEST = 2**20  # of a document that people write [bytes]
PURPOSES = {
    "gear-answers/1": "answers for `gear-twin init`",
    "gear-import/1": "a mapping for `gear-twin import`",
    "gear-series/1": "a series for `gear-twin relate`",
    "gear-rig/1": "a rig file for --rig",
}


def load_document(path: str | Path, what: str) -> dict[str, Any]:
    """A TOML file, called `what` in messages."""
    with reading(path, what), Path(path).open("rb") as file:
        text = file.read(LARGEST + 1)
    return parsed_document(text, f"{path}: {what}")


def parsed_document(text: bytes, what: str) -> dict[str, Any]:
    """The mapping of a TOML document, called `what` in messages."""
    if len(text) > LARGEST:
        raise InputError(f"{what} is larger than {LARGEST // 2**20} MiB: is it another file?")
    try:
        return tomllib.loads(text.decode("utf-8"))
    except RecursionError:
        raise InputError(f"{what} is not TOML that can be used: its tables and lists are nested too deeply") from None
    except ValueError as error:  # TOMLDecodeError, UnicodeDecodeError, and a number of thousands of digits
        raise InputError(f"{what} is not TOML: {error}") from None


@dataclass(frozen=True, slots=True)
class Part:
    """A table of a document, which knows its place: what is wrong with a value is one line with its key."""

    where: str  # the document's name
    values: Mapping[str, Any]
    path: str = ""  # before its keys, such as "file."

    def fault(self, key: str, must: str) -> InputError:
        """What is wrong with a value, to be raised."""
        return InputError(f"{self.where}: {self.path}{key} = {given(self.values.get(key))} {must}")

    def only(self, *known: str) -> Part:
        """The table, if it holds no other keys."""
        for key in self.values:
            if key not in known:
                raise InputError(f"{self.where}: {self.path}{key} is not known; known here: {', '.join(known)}")
        return self

    def of_schema(self, schema: str) -> Part:
        """The document, if it is of this schema; one of another purpose is named."""
        found = self.values.get("schema")
        if found == schema:
            return self
        purpose = PURPOSES.get(found) if isinstance(found, str) else None
        if purpose is None:
            raise self.fault("schema", f"must be {schema!r}")
        raise InputError(f"{self.where}: this file is {purpose}, not {PURPOSES[schema]} (schema {schema!r})")

    def table(self, key: str) -> Part:
        """A table within, empty where it is not there."""
        value = self.values.get(key, {})
        if not isinstance(value, dict):
            raise self.fault(key, "must be a table")
        return Part(self.where, value, f"{self.path}{key}.")

    def text(self, key: str, must: str = "must be text", default: str | None = None, least: int = 1) -> str:
        """A text of at least so many characters."""
        value = self.values.get(key, default)
        if not isinstance(value, str) or len(value) < least:
            raise self.fault(key, must)
        return value

    def texts(self, key: str) -> tuple[str, ...]:
        """A list of texts, empty where it is not there."""
        value = self.values.get(key, [])
        if not isinstance(value, list):
            raise self.fault(key, "must be a list of texts")
        return tuple(map(str, value))

    def one_of(self, key: str, known: Collection[str], default: str | None = None, more: str = "") -> str:
        """One of the texts that are known."""
        value = self.values.get(key, default)
        if not isinstance(value, str) or value not in known:
            said = " or ".join(known) if len(known) == 2 else f"one of {', '.join(known)}"
            raise self.fault(key, f"must be {said}{more}")
        return value

    def number(
        self, key: str, limits: tuple[float, float], unit: str = "", hint: str = "", default: float | None = None
    ) -> float:
        """A finite number within limits, both of them allowed."""
        value = self.values.get(key, default)
        return number_of(f"{self.where}: {self.path}{key}", value, limits, unit, hint)

    def number_if_stated(self, key: str, limits: tuple[float, float], unit: str = "", hint: str = "") -> float | None:
        """The same; None where it is not there."""
        return self.number(key, limits, unit, hint) if key in self.values else None

    def asset(self) -> str:
        """The name of a machine."""
        value = self.values.get("asset")
        if not isinstance(value, str) or not NAME.fullmatch(value):
            raise self.fault("asset", "must be 1 to 64 letters, digits, '_', '-' or '.'")
        return value


def given(value: Any) -> str:
    """A value as a message shows it: as the file has it, or that it is missing."""
    if value is None:
        return "(missing)"
    return value.isoformat() if isinstance(value, date) else repr(value)


def number_of(key: str, value: Any, limits: tuple[float, float], unit: str = "", hint: str = "") -> float:
    """A finite number within limits, both of them allowed."""
    low, high = limits
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not -MOST <= value <= MOST:
        raise InputError(f"{key} = {given(value)} must be a number{f' [{unit}]' if unit else ''}")
    if not low <= value <= high:
        cause = f"; {hint}" if hint else ""
        raise InputError(f"{key} = {value:g}{f' {unit}' if unit else ''} is outside [{low:g}, {high:g}]{cause}")
    return float(value)
