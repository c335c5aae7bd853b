"""States of another version are refused."""

import pytest

from twin.errors import ParameterError
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
