"""The JSON of an assessment and its description, both made from the types of its fields and their `Key`s.

    @made_of(assessment.Life)
    class Rul(Made):  # its docstring is that of `Life` where it has none
        of_wear_alone: bool | None = None                   # a key that the service adds
        note: Annotated[str, Said(in_words, after="date")]  # a key that a function of the assessment gives

`Rul` has the keys of `Life`, and those of its own body, which describe in place of keys of the same name.
`json_of(life)` is the same as JSON data: numbers in the units of their keys, null for None and for numbers that are not
finite, objects for dataclasses and mappings, lists for tuples. A dataclass within another needs no class: it has a
model under its own name, or that in `NAMES`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from functools import cache
from keyword import iskeyword
from math import isfinite
from operator import attrgetter
from types import NoneType, UnionType
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self, TypeVar, Union, get_args, get_origin, get_type_hints

from pydantic import Field, create_model

from service.contract.base import ContractModel, iso_time
from service.json_text import plain
from twin import assessment
from twin.assessment.key import ALWAYS, DEFAULT, FILLED, GIVEN, ISO_TIME, NEVER, Key, Shown

Convert = Callable[[Any], Any]
NAMES: Mapping[type, str] = {
    assessment.BaseRadii: "PairBaseRadii",
    assessment.BaselineSufficiency: "Sufficiency",
    assessment.CalibrationAssessment: "Calibration",
    assessment.EffectEvent: "LogEntry",
    assessment.HeldOutErrors: "Errors",
    assessment.LeftOut: "LeavingOut",
    assessment.LineSideband: "Sideband",
    assessment.FusedEstimate: "FusedMethod",
    assessment.MethodEstimates: "Methods",
    assessment.MissedCount: "PairMissedCount",
    assessment.ModelValidity: "Validity",
    assessment.PairCurve: "PairTransmissionError",
    assessment.PossibleCause: "Cause",
    assessment.RmsEstimate: "RmsMethod",
    assessment.RunOut: "PairRunOut",
    assessment.SharpStep: "PairSharpStep",
    assessment.SpectralLine: "Line",
    assessment.SpectrumExcerpt: "Excerpt",
    assessment.StatedRatio: "Stated",
    assessment.WearProfile: "Profile",
}
"""Names of models that no class is made of, where they are not those of the dataclasses."""
_models: dict[type, type[Made]] = {}
_converters: dict[type, Convert] = {}  # of dataclasses that a function of their own converts


class Made(ContractModel):
    """A part of the contract that is made of a dataclass of the assessment."""

    if TYPE_CHECKING:  # most of its keys are declared there

        def __getattr__(self, name: str) -> Any: ...

    @classmethod
    def of(cls, value: Any, unit: float | None = None) -> Self:
        """The part as a model, for who reads it by name."""
        return cls.model_validate(json_of(value, unit))


M = TypeVar("M", bound=Made)


@dataclass(frozen=True, slots=True)
class Said:
    """A key that is computed or put into words from the dataclass."""

    make: Convert
    after: str = ""  # the key that it follows, where it takes the place of none; it comes first where empty
    shown: Shown | Callable[[Any], bool] = ALWAYS


def json_of(value: Any, unit: float | None = None) -> dict[str, Any]:
    """A dataclass of the assessment as JSON data; its numbers in a unit where its fields state none."""
    kind: Any = type(value)
    data: dict[str, Any] = _object(kind, unit)(value)
    return data


def converts(kind: type) -> Callable[[Convert], Convert]:
    """Makes a function the one that converts a dataclass."""

    def noted(function: Convert) -> Convert:
        _converters[kind] = function
        return function

    return noted


def made_of(kind: type) -> Callable[[type[M]], type[M]]:
    """Gives a model the keys of a dataclass, beside those that it declares."""

    def made(bare: type[M]) -> type[M]:
        if kind in _models:
            raise TypeError(f"{bare.__name__}: a model was made of {kind.__name__} before")
        own = {field.alias or name for name, field in bare.model_fields.items()}
        keys: Any = {_name(key): part.described() for key, part in _parts(kind).items() if key not in own}
        about = bare.__doc__ or kind.__doc__
        model = create_model(bare.__name__, __base__=bare, __module__=bare.__module__, __doc__=about, **keys)
        _models[kind] = model
        return model

    return made


def model_of(kind: type) -> type[Made]:
    """The model of a dataclass: the one that was made of it, or one of its keys alone."""
    if kind not in _models:
        made_of(kind)(create_model(NAMES.get(kind, kind.__name__), __base__=Made, __doc__=kind.__doc__))
    return _models[kind]


def _name(key: str) -> str:
    """A key as a name in a model."""
    return f"{key}_" if iskeyword(key) else key


# -- what a dataclass shows --------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Part:
    """One key of an object."""

    read: Convert  # from the dataclass: its value there
    kind: Any
    key: Key
    default: Any = MISSING

    def described(self) -> tuple[Any, Any]:
        """Type and field of the key in a model."""
        kind, shown = _described(self.kind, self.key), self.key.shown
        about: dict[str, Any] = {"description": self.key.meaning or None}
        if iskeyword(self.key.name):
            about["alias"] = self.key.name
        if shown is DEFAULT:
            about |= {"default_factory": list} if self.default == () else {"default": self.default}
        elif shown is not ALWAYS:
            kind, about["default"] = kind | None, None
        return kind, Field(**about)


@cache
def _parts(kind: type) -> dict[str, _Part]:
    """What fields and properties of a dataclass show, by key, in order."""
    hints = get_type_hints(kind, include_extras=True)
    parts = [_part(field.name, hints[field.name], field.default) for field in fields(kind)]
    shown = {part.key.name: part for part in parts if part.key.shown is not NEVER}
    for name, computed in vars(kind).items():
        hint = get_type_hints(computed.fget, include_extras=True)["return"] if isinstance(computed, property) else None
        if _key_of(hint) is not None:
            part = _part(name, hint, MISSING)
            shown = _placed(shown, part.key.name, part, part.key.after)
    return shown


def _part(name: str, hint: Any, default: Any) -> _Part:
    key = _key_of(hint) or Key()
    return _Part(attrgetter(name), hint, replace(key, name=key.name or name), default)


def _key_of(hint: Any) -> Key | None:
    return next((each for each in getattr(hint, "__metadata__", ()) if isinstance(each, Key)), None)


def _placed(rows: Mapping[str, Any], name: str, row: Any, after: str) -> dict[str, Any]:
    """The rows with one more: in the place of the one of its name, behind another, or first."""
    if name in rows:
        return {**rows, name: row}
    if not after:
        return {name: row, **rows}
    order = list(rows)
    at = order.index(after) + 1
    return {each: row if each == name else rows[each] for each in (*order[:at], name, *order[at:])}


def _described(kind: Any, key: Key) -> Any:
    """The type of JSON data that a type of the assessment becomes."""
    origin, members = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _described(members[0], key)
    if origin in (Union, UnionType):
        return Union[tuple(_described(member, key) for member in members)]  # noqa: UP007
    if origin is tuple:
        return list[_described(members[0], key)]  # type: ignore[misc]
    if origin is not None and isinstance(origin, type) and issubclass(origin, Mapping):
        return dict[str, _described(members[1], key)]  # type: ignore[misc]
    if is_dataclass(kind):
        return model_of(kind)  # type: ignore[arg-type]
    if key.unit == ISO_TIME and kind is int:
        return str
    if key.choices and kind is str:
        return Literal[key.choices]
    return kind | None if key.null and kind in (float, str) else kind


# -- how values are converted ------------------------------------------------------------------------------


@cache
def _object(kind: type, unit: Any) -> Convert:
    """Converts a dataclass; `unit` holds where its fields state none."""
    if kind in _converters:
        return _converters[kind]
    rows: dict[str, tuple[Convert, Convert, Any]] = {
        name: (part.read, _converter(part.kind, part.key, part.key.unit or unit), part.key.shown)
        for name, part in _parts(kind).items()
    }
    for name, field in model_of(kind).model_fields.items():
        for said in field.metadata:
            if isinstance(said, Said):
                rows = _placed(rows, field.alias or name, (said.make, plain, said.shown), said.after)
    made = [(name, read, converted, _condition(shown)) for name, (read, converted, shown) in rows.items()]

    def convert(whole: Any) -> dict[str, Any]:
        out = {}
        for name, read, converted, condition in made:
            value = read(whole)
            if condition is None or condition(value, whole):
                out[name] = converted(value)
        return out

    return convert


def _condition(shown: Shown | Callable[[Any], bool]) -> Callable[[Any, Any], bool] | None:
    """Whether a key is there, by its value and the whole dataclass; None where it always is."""
    if shown is GIVEN:
        return lambda value, whole: value is not None
    if shown is FILLED:
        return lambda value, whole: bool(value)
    return None if isinstance(shown, Shown) else lambda value, whole: shown(whole)


def _converter(kind: Any, key: Key, unit: Any) -> Convert:
    """Converts values of a type."""
    origin, members = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _converter(members[0], key, unit)
    if origin in (Union, UnionType):
        return _one_of([member for member in members if member is not NoneType], key, unit)
    if origin is tuple:
        if {*members} - {members[0], Ellipsis}:
            raise TypeError(f"{key.name}: members of different types have no key: they need a dataclass, not {kind}")
        return _items(_converter(members[0], key, unit))
    if origin is not None and isinstance(origin, type) and issubclass(origin, Mapping):
        return _mapping(_converter(members[1], key, unit))
    if is_dataclass(kind):
        return _object(kind, unit)  # type: ignore[arg-type]
    if unit == ISO_TIME and kind is int:
        return iso_time
    if kind is float:
        return _number(unit or 1.0, key.digits)
    if kind is str and key.null:
        return lambda text: text or None
    return plain


def _one_of(kinds: list[Any], key: Key, unit: Any) -> Convert:
    """Converts values of a union of one type and None, or of dataclasses and None."""
    if len(kinds) == 1:
        only = _converter(kinds[0], key, unit)
        return lambda value: None if value is None else only(value)
    by_kind = {kind: _object(kind, unit) for kind in kinds} | {NoneType: lambda value: None}
    return lambda value: by_kind[type(value)](value)


def _items(convert: Convert) -> Convert:
    return lambda values: [convert(value) for value in values]


def _mapping(convert: Convert) -> Convert:
    return lambda values: {str(name): convert(value) for name, value in values.items()}


def _number(unit: float, digits: int | None) -> Convert:
    """Converts a number to multiples of a unit."""

    def convert(value: float) -> float | None:
        shown = float(value / unit)
        if not isfinite(shown):
            return None
        return shown if digits is None else round(shown, digits)

    return convert
