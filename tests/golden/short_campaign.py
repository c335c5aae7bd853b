"""What the twin says of recordings/short-campaign.mcap today: its own figures, no proof of anything.

    python -m tests.golden.short_campaign        writes tests/golden/short_campaign.json anew

Run it after a change that is meant to move the figures, and say in the commit why they moved.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from benchmarks.scoring import ROOT, run, windows_of
from tests.updating_cases import curve

FILE = Path(__file__).with_suffix(".json")
RECORDING = ROOT / "recordings" / "short-campaign.mcap"
NAMES = ("revolutions", "rms_measured", "rms_predicted", "rms_after", "wear_depth_um", "k_wear_per_n")
DEPTHS_UM = (1.0, 10.0, 30.0, 60.0)


def figures() -> dict[str, Any]:
    rig, windows = windows_of(RECORDING)
    _, estimates = run(rig, windows)
    report = estimates[-1].report
    wear = curve()
    return {
        "windows": [{name: e.record[name] for name in NAMES} for e in estimates],
        "calibration": report["calibration"]["values"],
        "remaining_revolutions": report["rul"]["revolutions"],
        "curve": [
            {
                "depth_um": d,
                "work": wear.work_at(d * 1e-6),
                "transmission_error_um": [abs(x) * 1e6 for x in wear.lines_at(d * 1e-6).transmission_error[:3]],
                "acceleration": [abs(x) for x in wear.lines_at(d * 1e-6).acceleration[:5]],
            }
            for d in DEPTHS_UM
        ],
    }


if __name__ == "__main__":
    FILE.write_text(json.dumps(figures(), indent=1) + "\n")
