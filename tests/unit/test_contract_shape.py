"""The JSON of a dataclass and its description, by the keys that its fields declare."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf, nan
from typing import Annotated, Literal

import pytest

from service.contract.parts import Band
from service.contract.shape import Made, Said, json_of, made_of, model_of
from twin.assessment import Interval, Unavailable
from twin.assessment.key import DEFAULT, FILLED, GIVEN, HIDDEN, ISO_TIME, MICROMETRE, OPTIONAL, PERCENT, Key


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    share: float
    count: int = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Whole:
    """What is shown."""

    source: Annotated[str, Key("from", meaning="where it comes from")]
    depth: Annotated[Interval | Unavailable, Key("depth_um", MICROMETRE)]
    curve: Annotated[tuple[float, ...], Key("curve_um", MICROMETRE, digits=1, null=True)] = ()
    parts: Annotated[Mapping[str, Part], Key("parts_percent", PERCENT)] = field(default_factory=dict)
    time_ns: Annotated[int | None, Key("time", ISO_TIME, shown=OPTIONAL)] = None
    law: Annotated[str, Key(choices=("even", "odd"))] = "even"
    note: Annotated[str, Key(shown=FILLED)] = ""
    size: Annotated[float | None, Key(shown=GIVEN)] = None
    of_even: Annotated[int, Key(shown=lambda whole: whole.law == "even")] = 4
    new: Annotated[bool, Key(shown=DEFAULT)] = True
    own: Annotated[int, HIDDEN] = 7

    @property
    def twice(self) -> Annotated[float, Key(after="law")]:
        return 2.0 * self.own


@made_of(Whole)
class Answer(Made):
    words: Annotated[str, Said(lambda whole: f"{whole.own} words")]
    added: int | None = None


DEPTH = Interval(median=2e-6, p05=1e-6, p95=None)


def test_numbers_are_in_the_unit_of_their_key_also_within_parts_and_null_where_they_are_not_finite():
    shown = json_of(
        Whole(source="a", depth=DEPTH, curve=(1.26e-6, inf, nan), parts={"x": Part(share=0.5)}, time_ns=1_000)
    )
    assert shown == {
        "words": "7 words", "from": "a", "depth_um": {"median": 2.0, "p05": 1.0, "p95": None},
        "curve_um": [1.3, None, None], "parts_percent": {"x": {"share": 50.0, "count": 2}},
        "time": "1970-01-01T00:00:00.000001000Z", "law": "even", "twice": 14.0, "of_even": 4, "new": True,
    }  # fmt: skip
    assert list(shown)[:2] == ["words", "from"] and list(shown)[-4:] == ["law", "twice", "of_even", "new"]


def test_keys_are_left_out_where_their_field_says_so():
    shown = json_of(Whole(source="a", depth=Unavailable(reason="why"), law="odd", note="said", size=0.0))
    assert shown["depth_um"] == {"status": "not available", "reason": "why"}
    assert shown["note"] == "said" and shown["size"] == 0.0 and shown["time"] is None and "of_even" not in shown


def test_the_model_describes_the_same_keys_and_reads_what_is_shown():
    schema = Answer.model_json_schema()
    known = schema["properties"]
    assert schema["description"] == "What is shown." and known["from"]["description"] == "where it comes from"
    assert set(schema["required"]) == {"words", "from", "depth_um", "curve_um", "parts_percent", "law", "twice"}
    assert known["law"]["enum"] == ["even", "odd"] and known["new"]["default"] is True
    assert known["curve_um"]["items"]["anyOf"] == [{"type": "number"}, {"type": "null"}]
    assert isinstance(Answer.of(Whole(source="a", depth=DEPTH)).depth_um, Band)


def test_members_of_different_types_have_no_keys():
    @dataclass(frozen=True)
    class Pairs:
        pairs: tuple[tuple[str, float], ...]

    with pytest.raises(TypeError, match="pairs: members of different types have no key"):
        json_of(Pairs((("a", 1.0),)))


def test_a_model_is_made_of_a_dataclass_once():
    assert model_of(Whole) is Answer
    with pytest.raises(TypeError, match="Second: a model was made of Whole before"):

        @made_of(Whole)
        class Second(Made):
            status: Literal["second"]
