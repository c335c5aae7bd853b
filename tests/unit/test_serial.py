"""Frozen data to plain dictionaries and back."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Annotated, Any

import numpy as np
import pytest

from twin.assessment import Interval, LevelReading, Unavailable
from twin.effects import EFFECTS
from twin.effects.response import Effect
from twin.effects.size_law import SizeLaw
from twin.serial import Misfit, Named, Packed, from_parts, from_plain, to_parts, to_plain

Lines = Annotated[tuple[tuple[float, complex], ...], Packed("f8,c16")]


@dataclass(frozen=True)
class Nest:
    part: Interval | Unavailable | None
    parts: tuple[Interval, ...]
    by_name: Mapping[str, LevelReading]
    by_number: Mapping[int, float]
    pair: tuple[int, str]
    number: float | None
    effect: Annotated[Effect, Named(EFFECTS)]
    law: SizeLaw
    lines: Lines
    others: Lines | None
    data: bytes


def nest(part=None, others=None) -> Nest:
    return Nest(
        part,
        (Interval(median=2.0, p05=1.0, p95=3.0),),
        {"a": LevelReading(level=1.5, window=3)},
        {10: 1.0, 9: 2.0},
        (1, "x"),
        None,
        EFFECTS["tooth_crack"](stiffness_loss=0.1),
        SizeLaw(),
        ((1.0, -0.0 + 1e-300j), (0.1, complex("nan-infj"))),
        others,
        b"\0\xff",
    )


def through_json(value):
    return json.loads(json.dumps(to_plain(value), sort_keys=True, allow_nan=False))


@pytest.mark.parametrize("part", [None, Unavailable(reason="no torque"), Interval(median=1.0, p05=0.5, p95=None)])
@pytest.mark.parametrize("others", [None, (), ((2.0, 1j),)])
def test_what_goes_out_comes_back_through_json_to_the_bit(part, others):
    given = nest(part, others)
    again = from_plain(Nest, through_json(given))
    assert repr(again) == repr(given) and list(again.by_number) == [10, 9]


def test_numbers_that_occur_again_are_written_once_and_are_one_tuple():
    lines = nest().lines
    plain = to_plain(nest(others=tuple(lines)))
    assert len(plain["arrays"]) == 2 and plain["lines"] == plain["others"]
    again = from_plain(Nest, plain)
    assert again.lines is again.others


@dataclass(frozen=True)
class Kept:
    order: Fraction
    by_pair: Mapping[tuple[str, str], float]
    array: np.ndarray | None
    known: Mapping[str, Any]


def test_fractions_arrays_pairs_and_what_is_anything_come_back():
    array = np.array([[1.0 + 0j, -0.0 + 1e-300j]])
    given = Kept(Fraction(20, 33), {("gain", "a"): 1.5}, array, {"gears": {"pinion": {"teeth": 19}}})
    assert repr(from_plain(Kept, through_json(given))) == repr(given)
    fields, arrays = to_parts(given)
    assert arrays == [array.tobytes()] and repr(from_parts(Kept, fields, arrays)) == repr(given)
    for harm in ({"order": "1/0"}, {"order": []}, {"array": [0, "O", [1]]}, {"array": [0, "<c16", [3]]}, {"array": 5}):
        with pytest.raises(Misfit, match=f"{next(iter(harm))} (must be a fraction|is no array)"):
            from_parts(Kept, fields | harm, arrays)


def test_zero_and_its_negative_are_not_the_same_numbers():
    plus, minus = ((0.0, 0j),), ((-0.0, 0j),)
    again = from_plain(Nest, to_plain(nest(others=plus)))
    assert repr(again.others) == repr(plus) and repr(again.lines) != repr(minus)
    assert len(to_plain(nest(others=minus))["arrays"]) == 3


@pytest.mark.parametrize(
    ("harm", "said"),
    [
        ({"part": {"reason": "x", "more": 1}}, "part must be the fields of Interval or the fields of Unavailable"),
        ({"part": {"reason": 1}}, "part.reason must be a text, not 1"),
        ({"part": 3}, "part must be"),
        ({"parts": [{"median": 1.0}]}, r"parts\[0\] lacks p05, lacks p95"),
        ({"parts": None}, "parts must be a list"),
        ({"by_name": {"a": {"level": "high", "window": 1}}}, "by_name.a.level must be a number, not 'high'"),
        ({"by_number": [[1, 2.0], [3]]}, r"by_number\[1\] must be a list of 2"),
        ({"pair": [True, "x"]}, r"pair\[0\] must be a whole number, not True"),
        ({"number": [1]}, "number must be a number or null"),
        ({"effect": {"moon": {}}}, "effect must be one of none, pinion_eccentricity"),
        ({"effect": {"tooth_crack": 1}}, "effect.tooth_crack must be the fields of ToothCrack"),
        ({"law": {"kind": "odd", "revolutions": [], "factors": []}}, "law is no SizeLaw: kind = 'odd'"),
        ({"lines": 7}, "lines must be the number of one of 2 arrays, not 7"),
        ({"lines": [1]}, "lines must be the number of one of 2 arrays"),
        ({"lines": 1}, "lines must be an array of 24 bytes a member, not of 2 bytes"),
        ({"arrays": ["?"]}, "arrays must hold texts of base 64"),
        ({"arrays": 3}, "arrays must hold texts of base 64"),
        ({"more": 1}, "has more, which is no field of Nest"),
    ],
)
def test_data_that_do_not_fit_are_refused_with_their_place(harm, said):
    with pytest.raises(Misfit, match=said):
        from_plain(Nest, {**through_json(nest()), **harm})


@pytest.mark.parametrize("data", [None, [], "text", {}, {"arrays": 1}])
def test_data_of_another_kind_are_refused(data):
    with pytest.raises(Misfit):
        from_plain(Nest, data)


@pytest.mark.parametrize("kind", [object, list, Mapping[str, object], Interval | LevelReading | tuple[int] | bytes])
def test_a_type_without_a_form_is_an_error_of_the_program(kind):
    @dataclass(frozen=True)
    class Odd:
        part: kind

    Odd.__annotations__["part"] = kind
    with pytest.raises(TypeError):
        to_plain(Odd(1))
