"""What a healthy baseline holds and suffices for, and what differs from it, in sentences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import Any

from service.report.findings import effect_finding
from service.report.lines import modulation_sentences, search_sentences, spacing_sentences
from service.report.words import number, table

UNITS = {"torque_nm": "N·m", "speed_hz": "Hz"}  # of the axes of operating points
RAISED = 1.0  # factor of a limit that leaving out has not raised


def learned_text(described: Mapping[str, Any]) -> str:
    """What a baseline holds, in words."""
    points = ", ".join(
        f"{number(v['from'], 6)} to {number(v['to'], 6)} {UNITS[axis]}"
        for axis, v in described["operating_points"].items()
    )
    shafts = ", ".join(number(s) for s in described["shafts"])
    line = (
        f"Baseline of {_counted(described)}, {points}; channels {', '.join(described['channels'])}; "
        f"shafts of order {shafts} of the pinion's rotation"
    )
    return "\n".join([line, *left_out_sentences(described), *not_judged(described)])


def _counted(described: Mapping[str, Any]) -> str:
    """How many recordings a baseline has, of how many windows, days and loads."""
    windows, found = len(described["recordings"]), described.get("sufficiency") or {}
    if found.get("days") is None:
        return f"{windows} windows"
    counts = {"recording": found["recordings"], "window": windows, "day": found["days"], "load": found["loads"]}
    first, *rest = (f"{count} {what}{'' if count == 1 else 's'}" for what, count in counts.items())
    return f"{first} ({', '.join(rest)})"


def not_judged(described: Mapping[str, Any]) -> list[str]:
    """What the baseline does not suffice for yet, a line each."""
    known = (described.get("sufficiency") or {}).get("not_judged") or ()
    return [f"Not judged with this baseline: {kind['what']} ({kind['reason']})." for kind in known]


def comparison_text(answer: Mapping[str, Any]) -> str:
    """The diagnosis as plain text: sentences first, then errors by channel and band."""
    lines = [f"Diagnosis of {answer['asset']} compared with its healthy baseline", "", *comparison_sentences(answer)]
    return "\n".join([*lines, *error_lines(answer["residual"]), *_band_lines(answer["residual"])])


def comparison_sentences(answer: Mapping[str, Any]) -> list[str]:
    """What differs, what was not compared, and how certain it is."""
    known, left = answer["baseline"], answer["unexplained"]
    deeper = [found for found in answer["modulation"] if found.get("new")]
    lines = [*(str(effect_finding(effect)) for effect in answer["effects"]), *modulation_sentences(deeper)]
    if left["verdict"] == "unknown_effect":
        lines.append(f"Unknown effect: {left['reason']}.")
    elif left["verdict"] == "insufficient_data" and not answer["effects"]:
        lines.append(f"No verdict: {left['reason']}; no effect was added.")
    elif not answer["effects"]:
        lines.append(f"Nothing {'else ' if deeper else ''}differs from the healthy baseline; no effect was added.")
    if left["reason"] and left["verdict"] != "unknown_effect" and not lines[-1].startswith("No verdict"):
        lines.append(f"Note: {left['reason']}.")
    lines += [raw_sentence(known.get("raw_limit")), *spacing_sentences(answer["unattributed_lines"])]
    lines += [*search_sentences(answer.get("unattributed_search")), *left_out_sentences(known), *not_judged(known)]
    outside = [w["name"] for w in answer["windows"] if not w["interpolated"]]
    if outside:
        lines.append(f"Outside the learned operating points, compared with the nearest one: {', '.join(outside)}.")
    lines += [f"Not used: {reason}." for reason in answer["refused"]]
    lines.append(f"Wear depth and life: not available: {answer['wear']['reason']}.")
    return [line for line in lines if line]


def error_lines(residual: Mapping[str, Any]) -> list[str]:
    """Errors by channel; empty where none was computed."""
    rows = [
        (
            channel,
            f"{e['waveform_before']:.1f} → {e['waveform_after']:.1f} %",
            f"{e['rms_before']:+.1f} → {e['rms_after']:+.1f} %",
        )
        for channel, e in (residual.get("channels") or {}).items()
    ]
    heads = ("channel", "waveform", "RMS")
    return ["", "Error on turns that no fit used, before → after:", *table(rows, heads, right=(1,))] if rows else []


def _band_lines(residual: Mapping[str, Any]) -> list[str]:
    keys = ("measured", "predicted_before", "predicted")
    rows = [
        (b["channel"], f"{b['harmonic']} x mesh", f"{b['frequency_hz']:.1f}", *(number(b[key], 4) for key in keys))
        for b in residual["bands"]
    ]
    heads = ("channel", "band", "Hz", "measured", "baseline", "with the effects found")
    return (
        ["", "Mesh bands, RMS:", *table(rows, heads, right=(2, 3, 4, 5))] if rows and residual.get("channels") else []
    )


def left_out_sentences(described: Mapping[str, Any]) -> list[str]:
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
