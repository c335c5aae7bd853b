"""How an effect has gone on after its onset, in a sentence."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

PER_MILLION = "/1e6 rev"  # ends the unit of a rate

Figured = Callable[[Mapping[str, Any], str], str]  # a figure of the JSON and its parameter's name as text


def growth_text(effect: Mapping[str, Any], figured: Figured) -> str:
    """What is said of the growth of one effect of the JSON, without a full stop; empty where its size is constant."""
    growth = effect.get("growth")
    if not growth:
        return ""
    name = growth["parameter"]
    now = f"at the latest window {figured(growth['size_at_latest_window'], name)}"
    if growth["law"] == "linear":
        rate = growth["rate_per_million_revolutions"]
        unit = rate["unit"].removesuffix(PER_MILLION)
        per_million = figured({**rate, "unit": "" if unit == "1" else unit}, name)
        return f"its {name.replace('_', ' ')} grows by {per_million} per million revolutions, {now}"
    at = growth["second_change_at"]
    spread = f" ± {at['std']:,.0f}" if at["std"] else ""
    return f"its {name.replace('_', ' ')} changed again at {at['value']:,.0f}{spread} revolutions, {now}"
