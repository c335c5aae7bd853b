"""Settings as text: the effective ones with where each comes from, and a commented file with all of them."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Mapping
from itertools import groupby
from typing import Any

from pydantic import SecretStr

from service.configuration.tables import Place, places
from service.settings import Settings
from service.toml_text import value_text

MASK = "**********"
_CREDENTIALS = re.compile(r"(?<=://)[^/@\s]*:[^/@\s]*(?=@)")
_IN_A_QUERY = re.compile(r"(?<=[?&])(\w*(?:sig|secret|token|password|key)\w*=)[^&#\s]*", re.IGNORECASE)
WIDTH = 110


def effective(settings: Settings, origins: Mapping[str, str]) -> dict[str, dict[str, dict[str, Any]]]:
    """Table, key, then `value` (secrets masked) and `from`; `follows` where it is not set and follows from others."""
    found: dict[str, dict[str, dict[str, Any]]] = {}
    for name, place in places(Settings).items():
        value, why = settings.effective(name)
        origin = origins[name] if why is None else f"{origins[name]}: {why}"
        said = {"value": shown(value), "from": origin} | ({} if why is None else {"follows": True})
        found.setdefault(place.table, {})[place.key] = said
    return found


def effective_text(settings: Settings, origins: Mapping[str, str]) -> str:
    """The effective settings as a configuration file, with where each value comes from behind it."""
    lines = []
    for table, keys in effective(settings, origins).items():
        lines += ["", f"[{table}]"]
        for key, said in keys.items():
            text = f"# {key} is not set" if said["value"] is None else f"{key} = {value_text(said['value'])}"
            text = f"# {text}" if said.get("follows") else text
            lines.append(f"{text:<50}  # {said['from']}")
    return "\n".join(lines[1:])


def example_text() -> str:
    """A configuration file with every setting, commented out, at its default or, where it has none, an example."""
    lines = [
        "# Configuration of gear-twin: gear-twin serve --config FILE, or the variable GEAR_TWIN_CONFIG.",
        "# Every setting is here at its default or, where it has none, with an example. Variables and options take",
        "# precedence over this file. Paths are relative to the folder of this file.",
    ]
    for table, group in groupby(places(Settings).values(), lambda place: place.table):
        lines += ["", f"[{table}]"]
        for place in group:
            lines += _commented(place)
    return "\n".join(lines) + "\n"


def _commented(place: Place) -> list[str]:
    field = Settings.model_fields[place.setting]
    value = shown(field.get_default(call_default_factory=True))
    if value is None or (value in ([], {}) and field.examples):
        value = field.examples[0] if field.examples else f"{place.key}.toml"
    about = textwrap.wrap(field.description or "", WIDTH, initial_indent="# ", subsequent_indent="# ")
    return [*about, f"#{place.key} = {value_text(value)}"]


def shown(value: Any) -> Any:
    """A value for people: secrets, and credentials within addresses, are masked."""
    if isinstance(value, SecretStr):
        return MASK
    if isinstance(value, (list, tuple)):
        return [shown(each) for each in value]
    if isinstance(value, dict):
        return {key: shown(each) for key, each in value.items()}
    if isinstance(value, str):
        return _IN_A_QUERY.sub(rf"\1{MASK}", _CREDENTIALS.sub(MASK, value))
    return value if value is None or isinstance(value, (bool, int, float)) else str(value)
