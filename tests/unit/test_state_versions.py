"""States of another version, and damaged ones, are refused."""

import copy
import random

import pytest

from service.json_text import compact
from service.results.json_columns import dump
from tests.stored_states import stored_state
from twin.errors import ParameterError
from twin.serial import Misfit
from twin.state import State


@pytest.mark.parametrize(
    ("data", "said"),
    [
        ({"schema_version": 3}, "schema version 3, this program reads 2: it was written by another gear-twin"),
        ({"schema_version": 1}, "schema version 1, this program reads 2"),
        ({}, "schema version None"),
        ({"schema_version": "two"}, "schema version 'two'"),
        ("a text", "a state of the twin is a mapping"),
    ],
)
def test_state_of_an_unknown_version_is_refused_with_a_sentence(data, said):
    with pytest.raises(ParameterError, match=said):
        State.from_dict(data)


def places(data, place=()):
    """All places of plain data."""
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, item in items:
        yield (*place, key)
        yield from places(item, (*place, key))


@pytest.mark.parametrize("asset", ["unsw-rig", "bench", "two-encoders"])
@pytest.mark.parametrize("wrong", [object(), {"no": object()}, [["no"]]])
def test_a_state_that_is_damaged_anywhere_is_refused_with_the_place(asset, wrong):
    whole = stored_state(asset).to_dict()
    for *place, last in random.Random(1).sample(sorted(places(whole), key=repr), 60):
        if not place and last == "schema_version":
            continue
        data = part = copy.deepcopy(whole)
        for key in place:
            part = part[key]
        part[last] = wrong
        with pytest.raises(Misfit) as refused:
            State.from_dict(data)
        assert str(refused.value).startswith(str((*place, last)[0]))


@pytest.mark.parametrize("name", sorted(stored_state("unsw-rig").to_dict().keys() - {"schema_version"}))
def test_a_state_without_a_part_is_refused(name):
    data = stored_state("unsw-rig").to_dict()
    del data[name]
    with pytest.raises(Misfit, match=f"lacks {name}|one of 0 arrays"):
        State.from_dict(data)


def test_a_state_of_eight_windows_is_small():
    """It was 220 kB, 64 kB compressed: each number in 18 digits, and windows once in the history and in each stage."""
    data = stored_state("unsw-rig").to_dict()
    assert len(stored_state("unsw-rig").tracing.history) == 8
    assert len(compact(data)) < 105_000 and len(dump(data)) < 58_000
