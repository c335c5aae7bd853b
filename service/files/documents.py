"""TOML documents at the edge: read, and their keys, tables and numbers checked; every fault one line with its key."""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Mapping
from datetime import date
from pathlib import Path
from typing import Any

from service.errors import InputError
from service.stream.wire.topics import NAME

MOST = sys.float_info.max
Keys = Mapping[str, tuple[str, ...]]  # known keys by the path of their table: "" and "file." and the like


LARGEST = 2**20  # of a document that people write [bytes]


def load_document(path: str | Path, what: str) -> dict[str, Any]:
    """A TOML file, called `what` in messages."""
    try:
        with Path(path).open("rb") as file:
            text = file.read(LARGEST + 1)
    except OSError as error:
        raise InputError(f"{path}: {what} cannot be read: {(error.strerror or 'fault').lower()}") from None
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


PURPOSES = {
    "gear-import/1": "a mapping for `gear-twin import`",
    "gear-series/1": "a series for `gear-twin relate`",
    "gear-rig/1": "a rig file for --rig",
}


def check_schema(where: str, data: Mapping[str, Any], schema: str) -> None:
    """That a document is of this schema; one of another purpose is named."""
    found = data.get("schema")
    if found == schema:
        return
    if found in PURPOSES:
        raise InputError(f"{where}: this file is {PURPOSES[found]}, not {PURPOSES[schema]} (schema {schema!r})")
    raise InputError(f"{where}: schema = {given(found)} must be {schema!r}")


def check_asset(where: str, data: Mapping[str, Any]) -> str:
    """The asset of a document."""
    asset = data.get("asset")
    if not isinstance(asset, str) or not NAME.fullmatch(asset):
        raise InputError(f"{where}: asset = {given(asset)} must be 1 to 64 letters, digits, '_', '-' or '.'")
    return asset


def check_keys(where: str, keys: Keys, path: str, table: Mapping[str, Any], shown: str | None = None) -> None:
    """That a table holds known keys alone."""
    for key in table:
        if key not in keys[path]:
            raise InputError(f"{where}: {shown or path}{key} is not known; known here: {', '.join(keys[path])}")


def table_of(where: str, data: Mapping[str, Any], key: str) -> dict[str, Any]:
    """A table of a document, empty where it is not there."""
    value = data.get(key, {})
    if not isinstance(value, dict):
        raise InputError(f"{where}: {key} = {given(value)} must be a table")
    return value


def given(value: Any) -> str:
    """A value as a message shows it: as the file has it, or that it is missing."""
    if value is None:
        return "(missing)"
    return value.isoformat() if isinstance(value, date) else repr(value)


def number_of(where: str, key: str, value: Any, limits: tuple[float, float], unit: str, hint: str = "") -> float:
    """A finite number within limits, both of them allowed."""
    low, high = limits
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not -MOST <= value <= MOST:
        raise InputError(f"{where}: {key} = {given(value)} must be a number{f' [{unit}]' if unit else ''}")
    if not low <= value <= high:
        cause = f"; {hint}" if hint and hint != "?" else ""
        raise InputError(
            f"{where}: {key} = {value:g}{f' {unit}' if unit else ''} is outside [{low:g}, {high:g}]{cause}"
        )
    return float(value)
