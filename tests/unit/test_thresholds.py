"""Deciding numbers carry their unit, meaning and source."""

from dataclasses import dataclass

import pytest

from twin.thresholds import deciding, rows_of


@dataclass(frozen=True, slots=True, kw_only=True)
class Example:
    least_gain: float = deciding(6.0, unit="nat", meaning="evidence an effect must add", source="tuned on nothing")
    orders: tuple[int, int] = deciding((3, 15), meaning="orders of a shaft", source="derivation")


def test_rows_of_a_set_hold_value_unit_meaning_and_source_in_the_order_of_definition():
    first, second = rows_of(Example)
    assert (first.group, first.name, first.value, first.about.unit) == ("Example", "least_gain", 6.0, "nat")
    assert second.value == (3, 15) and second.about.source == "derivation"


def test_rows_of_an_instance_hold_its_own_values():
    assert [row.value for row in rows_of(Example(least_gain=9.0))] == [9.0, (3, 15)]


def test_a_deciding_number_cannot_be_changed_in_place():
    with pytest.raises(TypeError, match="tuple"):
        deciding([1.0], meaning="", source="")
