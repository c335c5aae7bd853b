"""Rises of the misalignment study at the nominal estimates, on the coarse grid: its own figures, no proof of anything.

    python -m tests.golden.misalignment        writes tests/golden/misalignment.json anew

Other estimates turn the order of these about: what holds over them is in tests/validation.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from studies.misalignment.dabrowski_2012 import system
from studies.misalignment.study import COARSE, RESIDUALS, Rise, rises_of

FILE = Path(__file__).with_suffix(".json")
VARIANTS = ("rigid", "bearings", "shafts", "both")


def figures() -> dict[str, Any]:
    given = system()
    smooth = replace(given, law=given.law.without_friction())
    return {
        "tilted": {
            f"{v} {t}": _rises(rises_of(given, v, t, *COARSE)) for v in VARIANTS for t in ("normal", "in_plane")
        },
        "without_friction": {v: _rises(rises_of(smooth, v, "normal", *COARSE)) for v in ("rigid", "both")},
        "relative_to_a_misaligned_state": {
            f"{v} {state}": _rises(rises_of(given, v, "normal", *COARSE, against=state))
            for v in ("rigid", "both")
            for state in RESIDUALS
        },
    }


def _rises(rises: tuple[Rise, ...]) -> list[dict[str, Any]]:
    return [
        {
            "acceleration": round(r.acceleration, 3),
            "force": round(r.force, 3),
            "bands": [round(x, 3) for x in r.bands],
            "along": [round(r.acceleration_along, 3), round(r.force_along, 3)],
        }
        for r in rises
    ]


if __name__ == "__main__":
    FILE.write_text(json.dumps(figures(), indent=1) + "\n")
