"""Answers with an ETag."""

from __future__ import annotations

import json

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from service.api.conditional import encoded
from service.json_text import JsonText

VALUES = st.dictionaries(st.text(), st.floats(allow_nan=False, allow_infinity=False) | st.text() | st.none())


@pytest.mark.slow
@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(kept=st.lists(VALUES, max_size=4), other=VALUES, mixed=st.booleans())
def test_texts_of_the_store_are_passed_on_among_other_content(kept, other, mixed):
    texts = [JsonText(json.dumps(one)) for one in kept]
    if mixed and texts:
        texts[-1] = kept[-1]
    assert json.loads(encoded(texts)) == kept
    whole = {**other, "windows": kept}
    assert json.loads(encoded({**other, "windows": texts})) == whole
    assert json.loads(encoded({"windows": texts})) == {"windows": kept}
    for text, one in zip(texts, kept, strict=True):
        assert json.loads(encoded(text)) == one


def test_a_number_that_is_not_finite_is_no_answer():
    with pytest.raises(ValueError, match="JSON"):
        encoded({"windows": [JsonText("{}")], "depth": float("nan")})
