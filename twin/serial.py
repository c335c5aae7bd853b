"""Frozen data to plain dictionaries and back, by the types of its fields.

    plain = to_plain(value);   value == from_plain(type, plain)

Holds for dataclasses whose fields are numbers, strings, booleans, None, dataclasses, tuples, mappings by string, and
unions of these. A union of dataclasses is told by its fields: no two members may have the same names. A field that has
a default may be absent: it was added after the data had been written.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints


def to_plain(value: Any) -> Any:
    """The value as dicts, lists, strings, numbers, booleans and None; exact."""
    if is_dataclass(value) and not isinstance(value, type):
        return {f.name: to_plain(getattr(value, f.name)) for f in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): to_plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [to_plain(item) for item in value]
    return value


def from_plain(kind: Any, data: Any) -> Any:
    """A value of the type `kind` from what `to_plain` made of it; ValueError where it does not fit."""
    origin = get_origin(kind)
    if origin in (Union, UnionType):
        return _member(get_args(kind), data)
    if origin is tuple:
        members = get_args(kind)
        if len(members) == 2 and members[1] is Ellipsis:
            return tuple(from_plain(members[0], item) for item in data)
        return tuple(from_plain(member, item) for member, item in zip(members, data, strict=True))
    if origin is not None and issubclass(origin, Mapping):
        member = get_args(kind)[1]
        return {key: from_plain(member, item) for key, item in data.items()}
    if is_dataclass(kind):
        types = _types(kind)  # type: ignore[arg-type]
        if not isinstance(data, Mapping) or not _fits(kind, data):
            raise ValueError(f"{getattr(kind, '__name__', kind)} has the fields {', '.join(types)}, not {data!r:.80}")
        return kind(**{name: from_plain(types[name], item) for name, item in data.items()})  # type: ignore[operator]
    return data


def _member(members: tuple[Any, ...], data: Any) -> Any:
    """A value of that member of a union which the data fit."""
    if data is None and NoneType in members:
        return None
    if isinstance(data, Mapping):
        kinds = [member for member in members if is_dataclass(member)]
        exact = [kind for kind in kinds if _types(kind).keys() == data.keys()]  # type: ignore[arg-type]
        for member in exact or [kind for kind in kinds if _fits(kind, data)]:
            return from_plain(member, data)
    rest = [m for m in members if m is not NoneType and not is_dataclass(m)]
    if not rest:
        raise ValueError(f"no type of {', '.join(str(m) for m in members)} has the fields of {data!r:.80}")
    return from_plain(rest[0], data)


def _fits(kind: Any, data: Mapping[str, Any]) -> bool:
    """Whether data have the fields of a dataclass, those with a default perhaps left out."""
    required = {f.name for f in fields(kind) if f.default is MISSING and f.default_factory is MISSING}
    return required <= data.keys() <= _types(kind).keys()


@cache
def _types(kind: Any) -> dict[str, Any]:
    hints = get_type_hints(kind)
    return {f.name: hints[f.name] for f in fields(kind)}
