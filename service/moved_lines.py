"""The errors of the lines that an effect moves, in words for all who print them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

CHANNELS = {
    "acceleration": "acceleration",
    "transmission_error": "transmission error",
    "pinion_motion": "motion of the pinion",
    "torque": "torque",
}


def moved_text(effect: Mapping[str, Any]) -> str:
    """Error without → with an effect, channel by channel, of the lines that it moves; empty where it moves none."""
    return ", ".join(
        f"{CHANNELS[moved['channel']]} {moved['before_percent']:.0f} → {moved['after_percent']:.0f} %"
        for moved in effect.get("moved_lines") or ()
        if moved["before_percent"] is not None and moved["after_percent"] is not None
    )
