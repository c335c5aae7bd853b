"""Frozen data to plain dictionaries and back."""

import json
from collections.abc import Mapping
from dataclasses import dataclass

import pytest

from twin.assessment import Interval, LevelReading, Unavailable
from twin.serial import from_plain, to_plain


@dataclass(frozen=True)
class Nest:
    part: Interval | Unavailable | None
    parts: tuple[Interval, ...]
    by_name: Mapping[str, LevelReading]
    pair: tuple[int, str]
    number: float | None


@pytest.mark.parametrize("part", [None, Unavailable(reason="no torque"), Interval(median=1.0, p05=0.5, p95=None)])
def test_what_goes_out_comes_back_through_json(part):
    nest = Nest(
        part, (Interval(median=2.0, p05=1.0, p95=3.0),), {"a": LevelReading(level=1.5, window=3)}, (1, "x"), None
    )
    assert from_plain(Nest, json.loads(json.dumps(to_plain(nest)))) == nest


@pytest.mark.parametrize("data", [{"reason": "x", "more": 1}, {}])
def test_data_of_other_fields_are_refused(data):
    with pytest.raises(ValueError, match=r"field|no type"):
        from_plain(Unavailable, data)
    with pytest.raises(ValueError, match="no type"):
        from_plain(Interval | Unavailable, data)


@dataclass(frozen=True)
class _Grown:
    first: float
    later: str | None = None  # added after data had been written


def test_field_with_a_default_may_be_absent_from_older_data():
    assert from_plain(_Grown | None, {"first": 1.0}) == _Grown(first=1.0)
    with pytest.raises(ValueError, match="_Grown has the fields first, later"):
        from_plain(_Grown, {"later": "x"})
