"""The section `modulation` in sentences: which shaft modulates the mesh vibration, how deep, and what may cause it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import Any

from service.cli.show import number

TIMES = {1: "once", 2: "twice", 3: "three times"}
MOST = 3  # modulations that are described; the deepest
WHOLE = 100.0  # % of the mesh lines
HARMONICS = 3  # mesh harmonics that are named


def sentences(modulation: Sequence[Mapping[str, Any]] | None) -> list[str]:
    """One paragraph for each modulation, the deepest first, and what it means."""
    if not modulation:
        return []

    def which(found: Mapping[str, Any]) -> tuple[str, int]:
        return found["shaft"], found["per_turn"]

    groups = [list(group) for _, group in groupby(sorted(modulation, key=which), which)]
    groups = [sorted(group, key=lambda m: -m["depth_percent"]) for group in groups]
    groups.sort(key=lambda group: (not group[0].get("new"), -group[0]["depth_percent"]))  # what is new comes first
    out = [_sentence(group) for group in groups[:MOST]]
    if len(groups) > MOST:
        rest = ", ".join(
            f"{g[0]['shaft']} {g[0]['per_turn']}×: {number(g[0]['depth_percent'], 2)} %" for g in groups[MOST:]
        )
        out.append(f"Shallower: {rest}.")
    if not any("healthy_percent" in found for found in modulation):
        out.append(
            "Healthy gears have sidebands, too: whether these are new, a healthy baseline shows (`gear-twin baseline`)."
        )
    return out


def _sentence(group: Sequence[Mapping[str, Any]]) -> str:
    deepest = group[0]
    pairs = sorted(deepest["sidebands"], key=lambda p: -p["mesh_amplitude"])[:HARMONICS]
    harmonics = ", ".join(str(p["mesh_harmonic"]) for p in sorted(pairs, key=lambda p: p["mesh_harmonic"]))
    shaft, n = deepest["shaft"], deepest["per_turn"]
    others = ""
    if len(group) > 1:
        least, most = group[-1]["depth_percent"], group[1]["depth_percent"]
        span = number(most, 2) if least == most else f"{number(least, 2)} to {number(most, 2)}"
        others = f"; {span} % in {len(group) - 1} more"
    size = f"{number(deepest['depth_percent'], 3)} ± {number(deepest['depth_std_percent'], 2)} %"
    what = f"{deepest['kind']} modulation of {size} {TIMES[n]} per {shaft} turn"
    if deepest["depth_percent"] > WHOLE:
        what = f"both together {size} of the mesh lines, more than a modulation can be"
    return (
        f"Sidebands of ±{n} × {shaft} speed ({deepest['frequency_hz']:.4g} Hz) at mesh harmonic {harmonics}: "
        f"{what} ({deepest['channel']}{others}){_against_baseline(deepest)}. "
        f"Possible causes, which cannot be distinguished here: {deepest['possible_causes']}."
    )


def _against_baseline(found: Mapping[str, Any]) -> str:
    """What the recordings of the healthy baseline show of it."""
    if "healthy_percent" not in found:
        return ""
    least, most = (number(depth, 2) for depth in found["healthy_percent"])
    span = f"{least} %" if least == most else f"{least} to {most} %"
    return f", {'new: ' if found['new'] else 'as before: '}{span} in the healthy baseline"
