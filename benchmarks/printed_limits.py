"""Whether the single effect of a campaign is as large as the detection limit that is printed for its machine.

Limits are read from what `gear-twin detectability --json` writes, one file a machine. A size counts by its distance
from the value at which an effect does nothing; of a gain, by its logarithm; of a resonance, the lower the larger.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from math import isinf, log
from pathlib import Path
from typing import Any

from benchmarks.tracing_score import SAME
from twin.detectability.limits import size_of
from twin.effects import EFFECTS

Limits = Mapping[str, Mapping[str, float | None]]  # by machine and effect, in SI units; None where none is found


def read_limits(paths: Iterable[Path]) -> dict[str, dict[str, float | None]]:
    """The limits of several machines; an effect that was not simulated has none and is left out."""
    out: dict[str, dict[str, float | None]] = {}
    for path in paths:
        data = json.loads(path.read_text(encoding="utf-8"))
        out[data["rig"]] = {
            one["name"]: one["value"]
            for one in data["detection_limits"]
            if one["value"] is not None or one["largest_tried"] is not None
        }
    return out


def above_limit(truth: Mapping[str, Any], rig: str, limits: Limits) -> bool | None:
    """Whether the one effect is above its machine's limit; None where no limit was simulated, or effects are several.

    rig  name of the machine
    """
    known = limits.get(rig, {})
    if len(truth["effects"]) != 1 or truth["effects"][0]["name"] not in known:
        return None
    effect = truth["effects"][0]
    limit, size = known[effect["name"]], _true_size(effect)
    if size is None:
        return None
    return limit is not None and _distance(effect["name"], size) >= _distance(effect["name"], limit)


def _true_size(effect: Mapping[str, Any]) -> float | None:
    """The true value of the parameter that the limit is stated for, in its unit; None where the truth has none."""
    name, values = effect["name"], effect["parameters"]
    if name == "tooth_crack" and "loss" not in values:
        return 1.0 - float(values["remaining_stiffness"])
    stated = size_of(EFFECTS[name]).name
    for key, names, factor in SAME[name]:
        if stated in names and values.get(key):
            return float(values[key]) / factor
    return None


def _distance(name: str, size: float) -> float:
    """How far a size is from doing nothing."""
    first = size_of(EFFECTS[name])
    if isinf(first.neutral):
        return 1.0 / size
    return abs(log(size / first.neutral)) if first.neutral else abs(size)
