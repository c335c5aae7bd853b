"""What a random effect of the project's own generator came to: the draw itself, not the spread it was drawn from."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from functools import cache
from math import inf
from typing import Any

import numpy as np

from benchmarks.trace_campaigns.benches import BENCHES
from recordings.generator.effects import knobs_at
from recordings.generator.flanks import Pair, pair_of


@cache
def _pair(bench: str) -> Pair:
    return pair_of(tomllib.loads(BENCHES[bench].rig.read_text(encoding="utf-8")))


def with_draws(truth: Mapping[str, Any]) -> dict[str, Any]:
    """The truth with the standard deviations of pitch errors as drawn: 19 teeth miss theirs by a sixth.

    Truths of other simulators, which name their parameters otherwise, stay as they are.
    """
    drawn = [e["name"] == "pitch_error" and "pinion_um" in e["parameters"] for e in truth["effects"]]
    if not any(drawn):
        return dict(truth)
    rows = tuple({**e["parameters"], "name": e["name"], "onset_revolutions": 0.0} for e in truth["effects"])
    knobs, _ = knobs_at(rows, inf, _pair(truth.get("bench", "unsw")), truth["seed"])
    spread = {
        f"{shaft}_um": 1e6 * float(np.std(np.atleast_2d(form).mean(axis=1)))
        for shaft, form in (("pinion", knobs.pinion_form), ("gear", knobs.gear_form))
    }
    effects = [
        {**e, "parameters": {**e["parameters"], **spread}} if is_drawn else e
        for e, is_drawn in zip(truth["effects"], drawn, strict=True)
    ]
    return {**truth, "effects": effects}
