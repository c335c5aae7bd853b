"""What is compared with a baseline and what not, false alarms, and the limit on raw levels, in sentences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import Any

from service.cli.show import number

RAISED = 1.0  # factor of a limit that leaving out has not raised


def sentences(described: Mapping[str, Any]) -> list[str]:
    """What the healthy recordings repeat of one another, and what was not learned from."""
    found = described.get("left_out")
    out = [f"Not learned: {said}." for said in described.get("not_learned") or ()]
    if found is None:
        return out
    compared = [c for c in found["compared"] if c["limit_factor"] is not None]
    out.append(f"Compared: {_listed(compared)}.")
    if raised := [c for c in compared if c["limit_factor"] > RAISED]:
        limits = ", ".join(f"{_of(c)} {number(c['limit_factor'], 2)} times" for c in raised)
        out.append(f"Limits raised, as healthy recordings left out exceed them: {limits}.")
    without = [c for c in found["compared"] if c["limit_factor"] is None]
    for reason, same in groupby(sorted(without, key=lambda c: c["reason"]), key=lambda c: c["reason"]):
        out.append(f"Not compared: {_listed(list(same))}, because {reason}.")
    out.append(false_alarms(found))
    return out


def false_alarms(found: Mapping[str, Any]) -> str:
    """How often healthy recordings that were left out are called changed."""
    count, meant = found["recordings"], number(found["meant_percent"], 2)
    if not count:
        return "False alarms: not known, too few recordings to leave one out; no verdict with this baseline is certain."
    return (
        f"False alarms: {found['false_alarms']} of {count} healthy recordings left out in turn are called changed, "
        f"{found['raw_false_alarms']} by a limit on raw RMS and kurtosis (meant for a verdict: {meant} %, half by that "
        "limit). No verdict with this baseline is more certain than that."
    )


def raw_sentence(raw: Mapping[str, Any] | None) -> str:
    """The limit on raw RMS and kurtosis beside a verdict; empty where nothing was compared."""
    if raw is None:
        return ""
    if raw["not_compared"]:
        return f"Limit on raw RMS and kurtosis: none, because {raw['not_compared']}."
    rate = f"set for {number(raw['false_alarms_percent'], 2)} % false alarms"
    if not raw["exceeded"]:
        return f"Limit on raw RMS and kurtosis ({rate}): not exceeded."
    alone = "; it decides alone: nothing else that is compared has changed" if raw["decides_alone"] else ""
    beyond = ", ".join(
        f"{m['channel']} {'RMS' if m['name'] == 'rms' else m['name']} {number(m['value'])} (healthy "
        f"{number(m['from'])} to {number(m['to'])})"
        for m in raw["measures"]
        if m["beyond"]
    )
    return f"Limit on raw RMS and kurtosis ({rate}): exceeded by {beyond}{alone}."


def _listed(compared: Sequence[Mapping[str, Any]]) -> str:
    """Kinds of comparisons, each with its channels."""
    out = []
    for what, same in groupby(compared, key=lambda c: c["what"]):
        channels = [c["channel"] for c in same if c["channel"]]
        out.append(f"{what} ({', '.join(channels)})" if channels else what)
    return ", ".join(out)


def _of(one: Mapping[str, Any]) -> str:
    return f"{one['what']} in {one['channel']}" if one["channel"] else str(one["what"])
