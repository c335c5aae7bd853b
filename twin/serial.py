"""Frozen data to plain dictionaries and back, by the types of its fields.

    plain = to_plain(value);   value == from_plain(type(value), plain)

Holds for dataclasses whose fields are numbers, strings, booleans, None, literals, bytes, dataclasses, tuples, lists,
mappings, fractions, arrays of numpy and unions of these. A union of dataclasses is told by its fields: no two members
may have the same names. A mapping by anything but strings becomes pairs; what is of the type Any stands as it is, which
JSON must know. What a field needs besides, its type says:

    Annotated[tuple[complex, ...], Packed("c16")]   many numbers, as little-endian bytes; `Numbers` are such of floats
    Annotated[Effect, Named(EFFECTS)]               a dataclass of a table, by its name there

Bytes are kept beside the fields, under `arrays`, as text of base 64; those that occur again are written once.
`to_parts` and `from_parts` give them as they are, to a file that has its own place for them.
"""

from __future__ import annotations

from base64 import b64decode, b64encode
from binascii import Error as NoBase64
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from fractions import Fraction
from functools import cache
from itertools import repeat
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from twin.errors import TwinError

T = TypeVar("T")
ARRAYS = "arrays"


@dataclass(frozen=True, slots=True)
class Packed:
    """A tuple of numbers, or of tuples of numbers, is written as bytes."""

    format: str  # of numpy: "f8", "c16", "i2,i2,i2"


Numbers = Annotated[tuple[float, ...], Packed("f8")]


@dataclass(frozen=True, slots=True, eq=False)
class Named:
    """A dataclass is written with the name that its class has in a table."""

    table: Mapping[str, type]


class Misfit(ValueError):
    """Data that no value of the type was written as; the text names the place."""

    def __init__(self, said: str) -> None:
        super().__init__(said)
        self.said = said
        self.place = ""

    def within(self, part: str | int) -> Misfit:
        """The same, seen from outside of a part: a field, or a member of a list."""
        self.place = (f"[{part}]" if isinstance(part, int) else f".{part}") + self.place
        return self

    def __str__(self) -> str:
        return f"{self.place.removeprefix('.') or 'the value'} {self.said}"


def to_plain(value: Any) -> dict[str, Any]:
    """A dataclass as dicts, lists, strings, numbers, booleans and None; exact."""
    plain, arrays = to_parts(value)
    return {**plain, ARRAYS: [b64encode(data).decode("ascii") for data in arrays]} if arrays else plain


def from_plain(kind: type[T], data: Any) -> T:
    """A dataclass from what `to_plain` made of it; Misfit, a ValueError, where it does not fit."""
    arrays = data.get(ARRAYS, []) if isinstance(data, dict) else []
    if arrays:
        data = {name: item for name, item in data.items() if name != ARRAYS}
    return from_parts(kind, data, _decoded(arrays))


def to_parts(value: Any) -> tuple[dict[str, Any], list[bytes]]:
    """The same with its bytes beside it."""
    written = _Written()
    return _form(type(value)).write(value, written), [*written.numbers]


def from_parts(kind: type[T], data: Any, arrays: list[bytes]) -> T:
    """A dataclass from what `to_parts` made of it; Misfit where it does not fit."""
    value: T = _form(kind).read(data, _Kept(arrays, {}))
    return value


def _decoded(texts: Any) -> list[bytes]:
    try:
        return [b64decode(text, validate=True) for text in texts]
    except (TypeError, NoBase64, ValueError) as reason:
        raise Misfit(f"must hold texts of base 64: {reason}").within(ARRAYS) from None


class _Written:
    """The bytes that were written so far, each once."""

    def __init__(self) -> None:
        self.numbers: dict[bytes, int] = {}

    def number(self, data: bytes) -> int:
        """The place of the bytes in the table."""
        return self.numbers.setdefault(data, len(self.numbers))


@dataclass(frozen=True, slots=True)
class _Kept:
    """The table of bytes that is read from, and the tuples that were made of them."""

    table: list[bytes]
    made: dict[tuple[int, str], tuple[Any, ...]]  # by the place in the table, and the format

    def bytes(self, data: Any) -> bytes:
        if type(data) is not int or not 0 <= data < len(self.table):
            raise _refusal(f"the number of one of {len(self.table)} arrays", data)
        return self.table[data]


Write = Callable[[Any, _Written], Any]
Read = Callable[[Any, _Kept], Any]


def _as_it_is(value: Any, written: _Written) -> Any:
    return value


@dataclass(frozen=True, slots=True)
class _Form:
    """How values of one type are written and read."""

    said: str  # for errors
    read: Read
    write: Write = _as_it_is
    classes: tuple[type, ...] = ()  # of the values that are written otherwise
    plain: frozenset[type] = frozenset()  # of the values that stand for themselves, and are not read
    names: frozenset[str] | None = None  # of the fields of a dataclass


_PLAIN = {
    float: ("a number", (float, int)),
    int: ("a whole number", (int,)),
    str: ("a text", (str,)),
    bool: ("true or false", (bool,)),
    NoneType: ("null", (NoneType,)),
}


def _form_of(kind: Any) -> _Form:
    """The form of a type; TypeError where there is none."""
    origin, members = get_origin(kind), get_args(kind)
    if kind in _PLAIN:
        return _standing(*_PLAIN[kind])
    if kind in _OTHERS:
        return _OTHERS[kind]
    if getattr(kind, "__name__", "") == "ndarray":
        return _Form("an array", _array, _array_written, (kind,))
    if origin is Annotated:
        how = next((extra for extra in members[1:] if isinstance(extra, Named | Packed)), None)
        if how is None:  # what it says is not of how it is written
            return _form(members[0])
        return _named(how.table) if isinstance(how, Named) else _packed(how.format)
    if origin in (Union, UnionType):
        return _union([_form(member) for member in members])
    if origin is Literal:
        return _chosen(members)
    if origin is list:
        return _items([_form(members[0])], list, alike=True)
    if origin is tuple:
        return _items([_form(member) for member in members if member is not Ellipsis], alike=Ellipsis in members)
    if isinstance(origin, type) and issubclass(origin, Mapping):
        key, item = _form(members[0]), _form(members[1])
        return _mapping(item) if members[0] is str else _pairs(_items([key, item], alike=False))
    if is_dataclass(kind):
        return _dataclass(kind)
    raise TypeError(f"no plain form of {kind} is known")


_form: Callable[[Any], _Form] = cache(_form_of)


def _refusal(wanted: str, data: Any) -> Misfit:
    return Misfit(f"must be {wanted}, not {data!r:.60}")


def _taken(names: Iterable[str | int], forms: Iterable[_Form], items: Iterable[Any], kept: _Kept) -> list[Any]:
    """The values of parts by their names or numbers, their forms and data: as many of each."""
    made: list[Any] = []
    try:
        for form, data in zip(forms, items, strict=True):
            made.append(data if type(data) in form.plain else form.read(data, kept))
    except Misfit as misfit:
        raise misfit.within([*names][len(made)]) from None
    return made


def _standing(said: str, plain: tuple[type, ...]) -> _Form:
    def read(data: Any, kept: _Kept) -> Any:
        if isinstance(data, plain) and not isinstance(data, bool):  # a number of numpy, which was not through JSON
            return data
        raise _refusal(said, data)

    return _Form(said, read, plain=frozenset(plain))


def _chosen(values: tuple[Any, ...]) -> _Form:
    said = f"one of {', '.join(map(repr, values))}"

    def read(data: Any, kept: _Kept) -> Any:
        if data not in values:
            raise _refusal(said, data)
        return data

    return _Form(said, read)


def _packed(name: str) -> _Form:
    import numpy as np  # a start of the service does without: it knows the types of answers alone

    format = np.dtype(name).newbyteorder("<")

    def write(value: Any, written: _Written) -> int:
        return written.number(np.array(list(value), format).tobytes())

    def read(data: Any, kept: _Kept) -> tuple[Any, ...]:
        raw = kept.bytes(data)
        if len(raw) % format.itemsize:
            raise Misfit(f"must be an array of {format.itemsize} bytes a member, not of {len(raw)} bytes")
        if (data, name) not in kept.made:
            kept.made[data, name] = tuple(np.frombuffer(raw, format).tolist())
        return kept.made[data, name]

    return _Form("an array", read, write, (tuple,))


def _fraction(data: Any, kept: _Kept) -> Fraction:
    try:
        return Fraction(data)
    except (TypeError, ValueError, ZeroDivisionError):
        raise _refusal("a fraction", data) from None


def _array_written(value: Any, written: _Written) -> list[Any]:
    return [written.number(value.tobytes()), value.dtype.str, list(value.shape)]


def _array(data: Any, kept: _Kept) -> Any:
    import numpy as np

    try:
        number, dtype, shape = data
        return np.frombuffer(kept.bytes(number), np.dtype(dtype)).reshape(shape).copy()
    except (TypeError, ValueError) as reason:
        raise Misfit(f"is no array: {reason}") from None


_OTHERS = {
    Any: _Form("anything", lambda data, kept: data),
    bytes: _Form("an array", lambda data, kept: kept.bytes(data), lambda v, written: written.number(v), (bytes,)),
    Fraction: _Form("a fraction", _fraction, lambda v, written: str(v), (Fraction,)),
}


def _named(table: Mapping[str, type]) -> _Form:
    names, said = {kind: name for name, kind in table.items()}, f"one of {', '.join(table)}"

    def write(value: Any, written: _Written) -> dict[str, Any]:
        return {names[type(value)]: _form(type(value)).write(value, written)}

    def read(data: Any, kept: _Kept) -> Any:
        if type(data) is not dict or len(data) != 1 or not data.keys() <= table.keys():
            raise _refusal(said, data)
        return _taken(data, [_form(table[name]) for name in data], data.values(), kept)[0]

    return _Form(said, read, write, tuple(table.values()))


def _union(members: list[_Form]) -> _Form:
    said, as_they_are = " or ".join(form.said for form in members), tuple({k for form in members for k in form.plain})
    written_otherwise = [form for form in members if form.classes]
    if not written_otherwise:
        return _standing(said, as_they_are)
    writers = {kind: form.write for form in written_otherwise for kind in form.classes}
    by_names = {form.names: form for form in written_otherwise}  # at None: the one that is no dataclass
    if len(by_names) < len(written_otherwise):
        raise TypeError(f"{said} cannot be told apart")
    alone = written_otherwise[0] if len(written_otherwise) == 1 else None

    def write(value: Any, written: _Written) -> Any:
        writer = writers.get(type(value))
        if writer is None and not isinstance(value, as_they_are):
            raise TypeError(f"{value!r:.60} is not {said}")
        return value if writer is None else writer(value, written)

    def read(data: Any, kept: _Kept) -> Any:
        form = alone or (type(data) is dict and by_names.get(frozenset(data))) or by_names.get(None)
        if not form:
            raise _refusal(said, data)
        return form.read(data, kept)

    return _Form(said, read, write, tuple(writers), frozenset(as_they_are))


def _items(members: list[_Form], kind: type = tuple, *, alike: bool) -> _Form:
    """A tuple or list of as many members as are given, or of any number of one."""
    said = "a list" if alike else f"a list of {len(members)}"
    stand = all(not form.classes for form in members)

    def forms(count: int) -> Iterable[_Form]:
        return repeat(members[0], count) if alike else members

    def write(value: Any, written: _Written) -> list[Any]:
        pairs = zip(forms(len(value)), value, strict=True)
        return list(value) if stand else [form.write(item, written) for form, item in pairs]

    def read(data: Any, kept: _Kept) -> Any:
        if type(data) is not list or not (alike or len(data) == len(members)):
            raise _refusal(said, data)
        return kind(_taken(range(len(data)), forms(len(data)), data, kept))

    return _Form(said, read, write, (kind,))


def _mapping(member: _Form) -> _Form:
    said = f"a mapping, each {member.said}"

    def write(value: Any, written: _Written) -> dict[str, Any]:
        return {key: member.write(item, written) for key, item in value.items()} if member.classes else dict(value)

    def read(data: Any, kept: _Kept) -> dict[str, Any]:
        if type(data) is not dict:
            raise _refusal(said, data)
        return dict(zip(data, _taken(data, repeat(member, len(data)), data.values(), kept), strict=True))

    return _Form(said, read, write, (dict,))


def _pairs(pair: _Form) -> _Form:
    form = _items([pair], alike=True)

    def write(value: Any, written: _Written) -> Any:
        return form.write(tuple(value.items()), written)

    return _Form(form.said, lambda data, kept: dict(form.read(data, kept)), write, (dict,))


def _dataclass(kind: Any) -> _Form:
    hints, called = get_type_hints(kind, include_extras=True), kind.__name__
    forms = {f.name: _form(hints[f.name]) for f in fields(kind) if f.init}
    names, writers = frozenset(forms), [(name, form.write) for name, form in forms.items() if form.classes]

    def write(value: Any, written: _Written) -> dict[str, Any]:
        out = {name: getattr(value, name) for name in forms}
        for name, writer in writers:
            out[name] = writer(out[name], written)
        return out

    def read(data: Any, kept: _Kept) -> Any:
        if type(data) is not dict:
            raise _refusal(f"the fields of {called}", data)
        if data.keys() != names:
            faults = [f"lacks {name}" for name in forms if name not in data]
            faults += [f"has {name}, which is no field of {called}" for name in data if name not in names]
            raise Misfit(", ".join(faults))
        values = _taken(forms, forms.values(), map(data.__getitem__, forms), kept)
        try:
            return kind(**dict(zip(forms, values, strict=True)))
        except TwinError as reason:
            raise Misfit(f"is no {called}: {reason}") from None

    return _Form(f"the fields of {called}", read, write, (kind,), names=names)
