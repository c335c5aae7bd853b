"""What the attribution found, in words and tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import degrees
from typing import Any

from service.cli import encoder_pair as pair
from service.cli import modulation
from service.cli import non_gear as strange
from service.cli.show import number, reason, spread, table
from service.effect_growth import growth_text
from service.moved_lines import moved_text

SMALL = {"m": (1e6, "µm"), "kg·m": (1e6, "g·mm"), "rad": (degrees(1.0), "°")}
EFFECT_COLUMNS = ("effect", "status", "since rev.", "ln evidence", "runner-up", "waveform %", "depth µm", "parameters")
STRONGEST = 6  # unexplained lines that are named
CERTAIN, LIKELY = 10.0, 5.0  # nats over the runner-up
COUNTED = 1e-3  # of a value: a spread that is smaller belongs to a count, such as the number of a tooth


def label(name: str) -> str:
    """What people call an effect; the name itself where the table has none of this name."""
    from twin.effects.channel_faults import label_of

    return label_of(name) or name


def text(answer: Mapping[str, Any]) -> str:
    """The diagnosis as plain text: sentences first, then the evidence."""
    tracing = answer["tracing"]
    lines = [f"Diagnosis of {answer['asset']}", ""]
    lines += sentences(answer)
    if tracing.get("candidates"):
        lines += ["", "Candidates on the mesh, ln evidence over wear alone:"]
        lines += [f"  {c['name']:<22}{c['log_evidence']:>10.1f}" for c in tracing["candidates"]]
    if tracing.get("residual"):
        lines += ["", *_bands(tracing["residual"])]
    breakdown = answer.get("energy_breakdown")
    if isinstance(breakdown, list):
        lines += ["", *strange.energies(breakdown)]
    elif breakdown:
        lines += ["", f"The energy is not attributed to shafts: {breakdown['reason']}."]
    if tracing.get("log"):
        lines += ["", "Changes of the model:"]
        lines += [f"  {change(entry)}" for entry in tracing["log"]]
    return "\n".join(lines)


def sentences(answer: Mapping[str, Any]) -> list[str]:
    """What an engineer may quote."""
    tracing, effects = answer["tracing"], answer["effects"]
    out = [*modulation.sentences(answer.get("modulation")), *verdict(answer), *(sentence(effect) for effect in effects)]
    if answer["wear"].get("reason"):
        out.append(f"Wear depth: {reason(answer['wear'])}.")
    if effects:
        out.append(_together(answer))
    left = answer["unexplained"]
    if left.get("share_percent") is not None and left["share_percent"] <= 100:  # else the reason says by how much
        out.append(f"Unexplained: {number(left['share_percent'], 2)} % of the measured energy above the noise.")
    if left.get("orders"):
        listed = ", ".join(f"{o['frequency_hz']:.2f} Hz (order {o['order']:.3f})" for o in left["orders"][:STRONGEST])
        out.append(f"Its strongest lines: {listed}.")
    if tracing.get("other_structure"):
        out.append(
            "The transfer path from the mesh to the accelerometer differs from that of the rig file (another housing "
            "or mounting), so a changed gain or resonance of the sensor cannot be identified."
        )
    held = tracing.get("held_out") or []
    if held:
        out.append(f"Errors are computed on held-out windows, which no fit used: windows {', '.join(map(str, held))}.")
    found = strange.sentences(answer.get("unattributed_lines") or ())
    others = [*found, *strange.search_sentences(answer.get("unattributed_search")), *pair.sentences(answer.get("pair"))]
    return out + others


def verdict(answer: Mapping[str, Any]) -> list[str]:
    """Which effects are in the model and what is unexplained: the same sentences in every command."""
    tracing, effects = answer.get("tracing") or {}, answer["effects"]
    left = answer.get("unexplained") or {}
    failed = tracing.get("status") == "not available" or tracing.get("reason")
    out = []
    if effects:
        names = ", ".join(label(effect["name"]) for effect in effects)
        if failed:
            out.append(f"The latest search for effects was not completed: {tracing['reason']}.")
        out.append(f"Effects besides wear: {names}.")
        out += dict.fromkeys(caveat for effect in effects for caveat in effect.get("caveats") or ())
    elif failed:
        out.append(f"No effects were evaluated: {tracing['reason']}.")
    else:
        out.append(_without_effects(answer))
    if left.get("verdict") == "unknown_effect":
        out.append(f"Unknown effect: {left.get('reason') or 'vibration that no known effect explains'}.")
    elif left.get("verdict") == "insufficient_data" and left.get("reason") != answer["wear"].get("reason"):
        out.append(f"The residual could not be judged: {left.get('reason')}.")
    elif left.get("verdict") == "explained" and left.get("reason"):
        out.append(f"Small, and of no known effect: {left['reason']}.")
    return out


def _without_effects(answer: Mapping[str, Any]) -> str:
    """What no effect in the answer means."""
    if answer["wear"].get("status") == "not available" and not (answer.get("tracing") or {}).get("fitted"):
        if _has_model(answer):
            return "The model of this machine gives no wear depth, so no effects were evaluated."
        return "No model is available for this machine, so no effects were evaluated."
    if (answer.get("unexplained") or {}).get("verdict") == "explained":
        return "Wear alone explains this machine; no effect was added."
    return "The model contains wear alone; no effect was added."


def _has_model(answer: Mapping[str, Any]) -> bool:
    """Whether a model exists: it is calibrated, or it has predicted the latest window."""
    calibration, windows = answer.get("calibration") or {}, answer.get("windows") or [{}]
    calibrated = bool(calibration) and calibration.get("status") != "not available"
    return calibrated or windows[-1].get("rms_predicted") is not None


def _together(answer: Mapping[str, Any]) -> str:
    """Depth and life with all effects, compared with wear alone."""
    depth = (answer["wear"].get("max_depth_um") or {}).get("combined")
    alone, life = answer["effects"][0]["wear_depth_um_before"], answer["rul"].get("revolutions")
    line = f"Wear depth with all effects: {spread(depth, 'µm')}"
    if alone is not None:
        line += f"; with wear alone {alone:.1f} µm"
    alone_too = " of wear alone" if answer["rul"].get("of_wear_alone") else ""
    return f"{line}. Remaining life{alone_too}: {spread(life, 'revolutions')}."


def sentence(effect: Mapping[str, Any]) -> str:
    """One effect: what, how large, since when, how certain, what it changes."""
    onset = effect["onset_revolutions"]
    about = f" ± {width:.0f}" if onset and (width := effect.get("onset_std_revolutions")) else ""
    since = "from the start" if not onset else f"since {onset:.0f}{about} revolutions"
    sizes = ", ".join(f"{name.replace('_', ' ')} {figure(value)}" for name, value in effect["parameters"].items())
    evidence = effect["evidence"]
    sure = f"ln evidence {nats(evidence['log_evidence'])} over the model without it"
    if evidence.get("runner_up"):
        over = evidence.get("over_runner_up")
        rival = label(evidence["runner_up"])
        sure += f"; next best {rival}" + ("" if over is None else f", {over:.0f} lower ({sureness(over)})")
    alike = evidence.get("indistinguishable_from")
    if alike:
        sure += "; indistinguishable from " + ", ".join(label(name) for name in alike)
    parts = [f"{label(effect['name']).capitalize()}, {since}: {sizes} ({sure})"]
    if growth := growth_text(effect, lambda value, _: figure(value)):
        parts.append(growth)
    before, after = effect["error_before"], effect["error_after"]
    for what, key in (("waveform", "waveform_percent"), ("RMS", "rms_percent")):
        if before.get(key) is not None and after.get(key) is not None:
            parts.append(f"{what} error on held-out windows {before[key]:.1f} % without, {after[key]:.1f} % with it")
    if moved := moved_text(effect):
        parts.append(f"error of the lines that it moves, on held-out windows without → with it: {moved}")
    depth, now = effect["wear_depth_um_before"], effect["wear_depth_um_after"]
    if depth is not None and now is not None and abs(depth - now) > 0.05:
        parts.append(f"wear depth {depth:.1f} µm without, {now:.1f} µm with it")
    lives = [effect.get(f"rul_revolutions_{when}") for when in ("before", "after")]
    if None not in lives and lives[0] != lives[1]:
        parts.append(f"remaining life {lives[0]:,.0f} revolutions without, {lives[1]:,.0f} with it")
    if evidence.get("detail"):
        parts.append(evidence["detail"])
    if effect.get("status") in ("accepted", "pinned"):
        parts.append(f"{effect['status']} by an engineer")
    return "; ".join(parts) + "."


def sureness(over: float) -> str:
    """How surely one explanation is distinguished from the next."""
    if over > CERTAIN:
        return "certain"
    return "likely" if over > LIKELY else "hardly distinguishable"


def figure(value: Mapping[str, Any]) -> str:
    """A parameter with its standard deviation, in the unit that workshops use."""
    factor, unit = SMALL.get(value["unit"], (1.0, value["unit"]))
    if value["value"] is None:
        return "–"
    known = value["std"] is not None and value["std"] > COUNTED * abs(value["value"])
    about = f" ± {number(value['std'] * factor, 2)}" if known else ""
    gap = "" if unit in ("", "°") else " "
    return f"{number(value['value'] * factor, 3)}{about}{gap}{unit}"


def nats(evidence: float | None) -> str:
    """A logarithm of evidence."""
    return "–" if evidence is None else f"{evidence:.0f}"


def turns(revolutions: float | None) -> str:
    """A number of revolutions."""
    return "–" if revolutions is None else f"{revolutions:.0f}"


def change(entry: Mapping[str, Any]) -> str:
    """One entry of the log."""
    turns = entry.get("revolutions")
    at = "" if turns is None else f" at {turns:.0f} revolutions"
    evidence = entry.get("log_evidence")
    why = "" if evidence is None else f", ln evidence {evidence:.0f}"
    return f"window {entry.get('window')}{at}: {entry['name']} {entry['action']}{why}"


def effect_lines(asset: str, effects: Sequence[Mapping[str, Any]]) -> list[str]:
    """The effects in the twin of an asset as a table."""
    if not effects:
        return [f"{asset}: no effect besides wear"]
    rows = []
    for e in effects:
        evidence, before, after = e["evidence"], e["error_before"], e["error_after"]
        over = evidence.get("over_runner_up")
        rows.append(
            (
                e["name"],
                e.get("status", ""),
                turns(e["onset_revolutions"]),
                nats(evidence["log_evidence"]),
                "–" if evidence.get("runner_up") is None else f"{evidence['runner_up']} −{number(over, 3)}",
                f"{number(before.get('waveform_percent'), 3)} → {number(after.get('waveform_percent'), 3)}",
                f"{number(e['wear_depth_um_before'], 3)} → {number(e['wear_depth_um_after'], 3)}",
                ", ".join(f"{name} {figure(value)}" for name, value in e["parameters"].items()),
            )
        )
    return [f"Effects in the twin of {asset}", *table(rows, EFFECT_COLUMNS)]


def _bands(residual: Mapping[str, Any]) -> list[str]:
    out = [
        f"Window {residual['window']}, held out, by mesh harmonic (RMS m/s², ± 2 shaft orders):",
        f"  {'harmonic':>8}{'Hz':>9}{'measured':>11}{'before':>10}{'after':>10}{'res. before':>13}{'res. after':>12}",
    ]
    for b in residual["bands"]:
        levels = f"{b['measured']:>11.3g}{b['before']:>10.3g}{b['after']:>10.3g}"
        left = f"{b['residual_before']:>13.3g}{b['residual_after']:>12.3g}"
        out.append(f"  {b['harmonic']:>8}{b['frequency_hz']:>9.0f}{levels}{left}")
    return out
