"""The sources of settings: the configuration file and the environment, each refusing what it does not know."""

from __future__ import annotations

import difflib
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from pydantic_settings import BaseSettings, EnvSettingsSource, InitSettingsSource

from service.configuration.tables import VARIABLE, Place, holds, places
from service.errors import InputErrors
from service.files.documents import load_document

CONFIG = VARIABLE + "CONFIG"
COMMANDS = ("URL", "NAME", "KEY", "CA", "CERTIFICATE", "PRIVATE_KEY")  # read by commands that ask a service
COMPOSE = ("HTTP_PORT", "ZENOH_PORT", "GRAFANA_PORT", "GRAFANA_PASSWORD")  # read by docker/compose.yml
TOOLS = ("SHARED", "CHROMIUM")  # read by tests and benchmarks, as all that begin with TESTS
OTHERS = frozenset(VARIABLE + name for name in (*COMMANDS, *COMPOSE, *TOOLS))
TESTS = VARIABLE + "TEST_"
_IP = r"(\d+(\.\d+){3}|\[?[0-9a-fA-F]*:[0-9a-fA-F:.]*\]?)"
_OF_PORT = r"PORT_\d+_(TCP|UDP|SCTP)"
SERVICE_LINK = re.compile(  # of a Service of Kubernetes whose name begins with gear-twin, by name and value
    rf"GEAR_TWIN_(\w+_)?(SERVICE_HOST={_IP}|SERVICE_PORT(_\w+)?=\d+|(PORT|{_OF_PORT})=(tcp|udp|sctp)://{_IP}:\d+"
    rf"|{_OF_PORT}_(PROTO=(tcp|udp|sctp)|PORT=\d+|ADDR={_IP}))"
)


class FileSource(InitSettingsSource):
    """Settings of a configuration file (TOML); InputErrors names everything that it does not know.

    Paths are relative to the file's folder.
    """

    def __init__(self, settings: type[BaseSettings], path: Path | None) -> None:
        super().__init__(settings, {} if path is None else _settings_in(settings, path))


class Environment(EnvSettingsSource):
    """Settings of the environment; InputErrors names every GEAR_TWIN_ variable that is none.

    Kubernetes gives each pod variables of all Services of its namespace: what reads as one of them is no setting.
    """

    def __call__(self) -> dict[str, Any]:
        known = {VARIABLE + name.upper() for name in self.settings_cls.model_fields}
        given = {name.upper(): value for name, value in os.environ.items()}
        unknown = [name for name in given if name.startswith(VARIABLE) and name not in known]
        lines = [
            f"environment: {name} is no setting{_meant(name, known | OTHERS)}"
            for name in unknown
            if name not in OTHERS and not name.startswith(TESTS) and not SERVICE_LINK.fullmatch(f"{name}={given[name]}")
        ]
        if lines:
            raise InputErrors(lines)
        return super().__call__()


def _settings_in(settings: type[BaseSettings], path: Path) -> dict[str, Any]:
    document = load_document(path, "configuration file")
    tables: dict[str, dict[str, Place]] = {}
    for place in places(settings).values():
        tables.setdefault(place.table, {})[place.key] = place
    lines = list(_faults(document, tables))
    if lines:
        raise InputErrors([f"{path}: {line}" for line in lines])
    found = {tables[table][key].setting: value for table, keys in document.items() for key, value in keys.items()}
    return {name: _beside(path, value) if holds(settings, name, Path) else value for name, value in found.items()}


def _faults(document: Mapping[str, Any], tables: Mapping[str, Mapping[str, Place]]) -> Iterator[str]:
    for table, keys in document.items():
        if table not in tables:
            yield _unknown_table(table, keys, tables)
        elif not isinstance(keys, dict):
            yield f"{table} = {keys!r} must be a table: [{table}] with its keys below"
        else:
            for key in keys:
                if key not in tables[table]:
                    yield f"[{table}] has no key {key!r}{_elsewhere(key, table, tables)}"


def _unknown_table(table: str, keys: Any, tables: Mapping[str, Mapping[str, Place]]) -> str:
    if not isinstance(keys, dict):
        return f"{table} belongs to no table{_elsewhere(table, '', tables)}"
    return f"[{table}] is no table of this file{_meant(table, tables) or '; tables are ' + ', '.join(tables)}"


def _elsewhere(key: str, table: str, tables: Mapping[str, Mapping[str, Place]]) -> str:
    """Where a key belongs, or which one was probably meant."""
    for other, known in tables.items():
        for name, place in known.items():
            if key in (name, place.setting):
                return f"; it is {name!r} in [{other}]"
    near = _meant(key, tables.get(table, {}))
    return near or _meant(key, [str(place) for known in tables.values() for place in known.values()])


def _meant(name: str, known: Iterable[str]) -> str:
    near = difflib.get_close_matches(name, list(known), n=1, cutoff=0.6)
    return f"; did you mean {near[0]}?" if near else ""


def _beside(path: Path, value: Any) -> Any:
    if isinstance(value, list):
        return [_beside(path, each) for each in value]
    if isinstance(value, dict):
        return {name: _beside(path, each) for name, each in value.items()}
    return path.parent / value if isinstance(value, str) else value
