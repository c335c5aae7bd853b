"""What `gear-twin baseline` and `gear-twin diagnose --baseline` print."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from service.cli import baseline_left_out as left_out
from service.cli import modulation
from service.cli import non_gear as strange
from service.cli.assessing import windowing
from service.cli.diagnosis import label
from service.cli.show import number
from service.files.baseline import answer, compared, read_baseline
from twin.baseline.operating import UNITS as UNITS_OF_AXES

OTHER_LABELS = {
    "tooth_crack": "a local fault of one tooth",
    "mesh_change": "a change of the mesh itself",
    "unknown_effect": "an unknown effect",
}
UNITS = {"turn": "of a turn"}


def baseline_label(name: str) -> str:
    """What people call a change from the healthy baseline, which is less certain than an effect of a model."""
    return OTHER_LABELS.get(name) or label(name).replace("_", " ")


def answered(recording: Path, baseline: Path, rig: Path | None, prefix: str) -> dict[str, Any]:
    """The answer about a recording beside a baseline file."""
    known = read_baseline(baseline)
    loaded, found = compared(known, recording, rig, windowing(), prefix)
    return answer(loaded, known, found)


def learned_text(described: Mapping[str, Any]) -> str:
    """What a baseline holds, in words."""
    points = ", ".join(
        f"{number(v['from'], 6)} to {number(v['to'], 6)} {UNITS_OF_AXES[axis]}"
        for axis, v in described["operating_points"].items()
    )
    shafts = ", ".join(number(s) for s in described["shafts"])
    line = (
        f"Baseline of {_counted(described)}, {points}; channels {', '.join(described['channels'])}; "
        f"shafts of order {shafts} of the pinion's rotation"
    )
    return "\n".join([line, *left_out.sentences(described), *not_judged(described)])


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


def text(answer: Mapping[str, Any]) -> str:
    """The diagnosis as plain text: sentences first, then errors by channel and band."""
    lines = [f"Diagnosis of {answer['asset']} compared with its healthy baseline", ""]
    for effect in answer["effects"]:
        lines.append(_effect(effect))
    deeper = [found for found in answer["modulation"] if found.get("new")]
    lines += modulation.sentences(deeper)
    left = answer["unexplained"]
    if left["verdict"] == "unknown_effect":
        lines.append(f"Unknown effect: {left['reason']}.")
    elif left["verdict"] == "insufficient_data" and not answer["effects"]:
        lines.append(f"No verdict: {left['reason']}; no effect was added.")
    elif not answer["effects"]:
        lines.append(f"Nothing {'else ' if deeper else ''}differs from the healthy baseline; no effect was added.")
    if left["reason"] and left["verdict"] != "unknown_effect" and not lines[-1].startswith("No verdict"):
        lines.append(f"Note: {left['reason']}.")
    lines.append(left_out.raw_sentence(answer["baseline"].get("raw_limit")))
    lines += strange.sentences(answer["unattributed_lines"])
    lines += strange.search_sentences(answer.get("unattributed_search"))
    lines += [*left_out.sentences(answer["baseline"]), *not_judged(answer["baseline"])]
    outside = [w["name"] for w in answer["windows"] if not w["interpolated"]]
    if outside:
        lines.append(f"Outside the learned operating points, compared with the nearest one: {', '.join(outside)}.")
    lines += [f"Not used: {reason}." for reason in answer["refused"]]
    lines.append(f"Wear depth and life: not available: {answer['wear']['reason']}.")
    if answer["residual"].get("channels"):
        lines += ["", "Error on turns that no fit used, before → after:"]
        for channel, e in answer["residual"]["channels"].items():
            lines.append(
                f"  {channel:<8} waveform {e['waveform_before']:6.1f} → {e['waveform_after']:5.1f} %   "
                f"RMS {e['rms_before']:+7.1f} → {e['rms_after']:+6.1f} %"
            )
        lines += ["", "Mesh bands, RMS: measured, baseline, with the effects found:"]
        for b in answer["residual"]["bands"]:
            lines.append(
                f"  {b['channel']:<8} {b['harmonic']} x mesh ({b['frequency_hz']:7.1f} Hz) {number(b['measured']):>9} "
                f"{number(b['predicted_before']):>9} {number(b['predicted']):>9}"
            )
    return "\n".join(lines)


def _effect(effect: Mapping[str, Any]) -> str:
    evidence = effect["evidence"]
    parameters = ", ".join(
        f"{name.replace('_', ' ')} {number(p['value'])} {UNITS.get(p['unit'], p['unit'])}".rstrip()
        + (f" ± {number(p['std'], 2)}" if p["std"] else "")
        for name, p in effect["parameters"].items()
    )
    name = baseline_label(effect["name"])
    said = f"Found {name} ({', '.join(effect['channels'])}): {evidence['detail']}."
    if parameters:
        said += f" {parameters[0].upper()}{parameters[1:]}."
    gain = evidence["log_evidence"]
    said += " No evidence is computed" if gain is None else f" Evidence {gain:.0f} nat over the baseline alone"
    if evidence["over_runner_up"] is not None:
        said += f", {evidence['over_runner_up']:.0f} over {evidence['runner_up']}"
    alike = evidence.get("indistinguishable_from")
    if alike:
        said += f"; indistinguishable from {' or '.join(alike)}"
    return said + "."
