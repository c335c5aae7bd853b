"""Settings from file, environment and options; every mistake is one line that says where, what, and what is right."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import SecretStr, ValidationError
from pydantic_settings import SettingsError

from service.configuration import new_assets, plant
from service.configuration.printed import shown
from service.configuration.sources import CONFIG, Environment, FileSource
from service.configuration.tables import Place, holds, places
from service.errors import InputErrors
from service.settings import Settings

DEFAULT, OPTION = "default", "option"

# what a setting with a pattern must be like
READ = {
    "http": "must be HOST:PORT, such as 127.0.0.1:8080",
    "prefix": "must be letters, digits, '_', '-' and '.', in parts separated by '/', such as gearbox",
    **plant.READ,
    **new_assets.READ,
}
_FIELD = re.compile(r'field "(\w+)"')


def load(**given: Any) -> Settings:
    """Settings of file, environment and options; InputErrors with one line a mistake.

    given  options by the setting's name; None or an empty list where an option was not given
    """
    values = {name: value for name, value in given.items() if value not in (None, [])}
    try:
        return Settings(**values)
    except ValidationError as error:
        raise InputErrors([_line(dict(fault), values) for fault in error.errors()]) from None
    except SettingsError as error:
        raise InputErrors([_not_json(error)]) from None


def origins(given: Mapping[str, Any]) -> dict[str, str]:
    """Where each setting's value comes from: `option`, `environment GEAR_TWIN_…`, `file …` or `default`."""
    path = config_file(given)
    from_file, from_environment = FileSource(Settings, path)(), Environment(Settings)()
    return {name: _origin(place, given, from_environment, from_file, path) for name, place in places(Settings).items()}


def config_file(given: Mapping[str, Any]) -> Path | None:
    """The configuration file in use."""
    path = given.get("config") or os.environ.get(CONFIG)
    return Path(path) if path else None


def _origin(place: Place, given: Mapping[str, Any], environment: Any, file: Any, path: Path | None) -> str:
    if given.get(place.setting) not in (None, []):
        return OPTION
    if place.setting in environment:
        return f"environment {place.variable}"
    return f"file {path}" if place.setting in file else DEFAULT


def _line(fault: dict[str, Any], given: Mapping[str, Any]) -> str:
    message = fault["msg"].removeprefix("Value error, ")
    if not fault["loc"]:
        return f"settings: {message}"
    name = str(fault["loc"][0])
    right = READ.get(name) if fault["type"] == "string_pattern_mismatch" else None
    item = "".join(f", item {part + 1}" for part in fault["loc"][1:] if isinstance(part, int))
    value = "" if holds(Settings, name, SecretStr) else f" = {shown(fault['input'])!r}"
    return f"{_where(name, given)}{item}{value}: {right or message}"


def _where(name: str, given: Mapping[str, Any]) -> str:
    place, origin = places(Settings).get(name), origins(given).get(name, DEFAULT)
    if place is not None and origin.startswith("file"):
        return f"{config_file(given)}: {place}"
    if place is not None and origin.startswith("environment"):
        return f"environment: setting {name} ({place.variable})"
    return f"setting {name}"


def _not_json(error: SettingsError) -> str:
    found = _FIELD.search(str(error))
    place = places(Settings).get(found[1]) if found else None
    if place is None:
        return f"environment: {error}"
    return f'environment: {place.variable} = {os.environ.get(place.variable)!r} must be JSON, a list such as ["a"]'
