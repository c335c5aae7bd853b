"""Tables of the configuration file: which setting is written under which key of which table."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, get_args

from pydantic import BaseModel

VARIABLE = "GEAR_TWIN_"


class Table(BaseModel):
    """One table of the file: each field is a setting, and the fields of all tables together are all settings."""

    TABLE: ClassVar[str]
    PREFIX: ClassVar[str] = ""  # of the setting's name, left out in the file
    KEYS: ClassVar[Mapping[str, str]] = {}  # settings whose key is another


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """Where a setting is written."""

    setting: str
    table: str
    key: str

    @property
    def variable(self) -> str:
        return VARIABLE + self.setting.upper()

    def __str__(self) -> str:
        return f"[{self.table}] {self.key}"


def places(settings: type[BaseModel]) -> dict[str, Place]:
    """Every setting's place by the setting's name, in the order of the tables."""
    found = {}
    for base in settings.__mro__:
        if issubclass(base, Table) and "TABLE" in vars(base):
            for name in base.model_fields:
                key = base.KEYS.get(name) or name.removeprefix(base.PREFIX)
                found[name] = Place(setting=name, table=base.TABLE, key=key)
    return found


def holds(settings: type[BaseModel], name: str, kind: type) -> bool:
    """Whether a setting is of a kind, such as a path, or a list or an option of it."""

    def within(annotation: Any) -> bool:
        return annotation is kind or any(within(part) for part in get_args(annotation))

    return within(settings.model_fields[name].annotation)
