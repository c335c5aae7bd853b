"""Effects and unknown content in sentences: what, how large, since when, how sure, and what it changes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from service.report.words import available, capital, label, sentence, size, sizes

CERTAIN, LIKELY = 10.0, 5.0  # nats over the next best explanation
LEAST_CHANGE = 0.05  # of a depth that is said [µm]
PER_MILLION = "/1e6 rev"  # ends the unit of a rate
ERRORS = (
    ("transmission_error_percent", "transmission error"),
    ("waveform_percent", "vibration waveform"),
    ("rms_percent", "vibration RMS"),
)
CHANNELS = {
    "acceleration": "acceleration",
    "transmission_error": "transmission error",
    "pinion_motion": "motion of the pinion",
    "torque": "torque",
}
BESIDE_A_BASELINE = {  # a comparison is less certain than a model
    "tooth_crack": "a local fault of one tooth",
    "mesh_change": "a change of the mesh itself",
    "unknown_effect": "an unknown effect",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One finding besides wear."""

    title: str
    sentences: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.title}: {' '.join(self.sentences)}"


def findings(answer: Mapping[str, Any]) -> list[Finding]:
    """Every effect in the answer, and vibration of unknown cause."""
    found = [effect_finding(effect) for effect in answer.get("effects") or ()]
    left = answer.get("unexplained") or {}
    if left.get("verdict") == "unknown_effect":
        why = left.get("reason") or "vibration that no known effect explains"
        found.append(Finding(title="Vibration of unknown cause", sentences=(sentence(why),)))
    return found


def effect_label(effect: Mapping[str, Any]) -> str:
    """What people call an effect; a change from a healthy baseline by less than its name."""
    beside = effect.get("channels") and BESIDE_A_BASELINE.get(effect["name"])
    return beside or label(effect["name"])


def effect_finding(effect: Mapping[str, Any]) -> Finding:
    """One effect of the JSON."""
    where = f" ({', '.join(effect['channels'])})" if effect.get("channels") else ""
    shown = "; ".join(part for part in (sizes(effect["parameters"]), _since(effect)) if part)
    said = [sentence(shown)]
    if growth := growth_text(effect):
        said.append(sentence(growth))
    said += [*(effect.get("caveats") or ()), _sureness(effect["evidence"]), *_consequences(effect)]
    if effect["evidence"].get("detail"):
        said.append(sentence(effect["evidence"]["detail"]))
    if effect.get("status") in ("accepted", "pinned"):
        said.append(f"An engineer has {effect['status']} this effect.")
    return Finding(title=f"{capital(effect_label(effect))}{where}", sentences=tuple(said))


def _since(effect: Mapping[str, Any]) -> str:
    if effect.get("channels"):
        return "new since the healthy baseline"
    onset = effect.get("onset_revolutions")
    width = effect.get("onset_std_revolutions")
    about = f" ± {width:,.0f}" if width else ""
    return f"since {onset:,.0f}{about} revolutions" if onset else "present from the first measurement on"


def growth_text(effect: Mapping[str, Any]) -> str:
    """How an effect has gone on after its onset, without a full stop; empty where its size is constant."""
    growth = effect.get("growth")
    if not growth:
        return ""
    name = growth["parameter"]
    now = f"at the latest window {size(growth['size_at_latest_window'], name)}"
    if growth["law"] == "linear":
        rate = growth["rate_per_million_revolutions"]
        unit = rate["unit"].removesuffix(PER_MILLION)
        per_million = size({**rate, "unit": "" if unit == "1" else unit}, name)
        return f"its {name.replace('_', ' ')} grows by {per_million} per million revolutions, {now}"
    at = growth["second_change_at"]
    about = f" ± {at['std']:,.0f}" if at["std"] else ""
    return f"its {name.replace('_', ' ')} changed again at {at['value']:,.0f}{about} revolutions, {now}"


def _sureness(evidence: Mapping[str, Any]) -> str:
    """How surely the effect is distinguished from others, in words with the figures they rest on."""
    alike = [label(name) for name in evidence.get("indistinguishable_from") or ()]
    if alike:
        return f"These channels cannot distinguish it from: {', '.join(alike)}."
    gain, over = evidence.get("log_evidence"), evidence.get("over_runner_up")
    basis = "" if gain is None else f"log evidence {gain:,.0f} over a model without it"
    if evidence.get("runner_up") is None or over is None:
        return f"No other known effect was a candidate{f' ({basis})' if basis else ''}."
    rival = label(evidence["runner_up"])
    basis = f" ({f'{basis}, ' if basis else ''}{over:,.0f} over the next best)"
    if over > CERTAIN:
        return f"Clearly distinguished from the next best explanation, {rival}{basis}."
    if over > LIKELY:
        return f"More likely than the next best explanation, {rival}{basis}."
    return f"Hardly distinguishable from {rival}{basis}."


def _consequences(effect: Mapping[str, Any]) -> list[str]:
    """What the model explains better or worse with the effect, and what that does to depth and life."""
    before, after = effect.get("error_before") or {}, effect.get("error_after") or {}
    errors = [
        f"{what} {before[key]:.1f} → {after[key]:.1f} %"
        for key, what in ERRORS
        if before.get(key) is not None and after.get(key) is not None
    ]
    out = [f"Model errors on held-out measurements without → with it: {', '.join(errors)}."] if errors else []
    moved = ", ".join(
        f"{CHANNELS[line['channel']]} {line['before_percent']:.0f} → {line['after_percent']:.0f} %"
        for line in effect.get("moved_lines") or ()
        if line["before_percent"] is not None and line["after_percent"] is not None
    )
    if moved:
        out.append(f"Of the lines that it moves, on the same measurements: {moved}.")
    without, with_it = (effect.get(f"wear_depth_um_{when}") for when in ("before", "after"))
    if without is not None and with_it is not None and abs(without - with_it) > LEAST_CHANGE:
        lives = [effect.get(f"rul_revolutions_{when}") for when in ("before", "after")]
        life = "" if None in lives else f"; remaining life {lives[0]:,.0f} → {lives[1]:,.0f} revolutions"
        out.append(f"Taking it into account changes the wear depth {without:.1f} → {with_it:.1f} µm{life}.")
    return out


# -- the answer as a whole -------------------------------------------------------------------------------


def verdict(answer: Mapping[str, Any]) -> list[str]:
    """Which effects are in the model and what is unexplained: the same sentences everywhere."""
    tracing, effects = answer.get("tracing") or {}, answer.get("effects") or ()
    left = answer.get("unexplained") or {}
    failed = tracing.get("status") == "not available" or tracing.get("reason")
    out = []
    if effects:
        if failed:
            out.append(f"The latest search for effects was not completed: {tracing['reason']}.")
        out.append(f"Effects besides wear: {', '.join(effect_label(effect) for effect in effects)}.")
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
        calibrated, windows = available(answer.get("calibration")), answer.get("windows") or [{}]
        if calibrated or windows[-1].get("rms_predicted") is not None:
            return "The model of this machine gives no wear depth, so no effects were evaluated."
        return "No model is available for this machine, so no effects were evaluated."
    if (answer.get("unexplained") or {}).get("verdict") == "explained":
        return "Wear alone explains this machine; no effect was added."
    return "The model contains wear alone; no effect was added."
