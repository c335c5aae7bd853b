"""Effects and unknown content in sentences: what, how large, since when, how sure, and what it changes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import degrees
from typing import Any

from service.effect_growth import growth_text
from service.moved_lines import moved_text

SMALL = {"m": (1e6, "µm"), "kg·m": (1e6, "g·mm"), "rad": (degrees(1.0), "°"), "1/N": (1.0, "1/N")}
CERTAIN, LIKELY = 10.0, 5.0  # nats over the next best explanation
COUNTED = 1e-3  # of a value: a spread that is smaller belongs to a count, such as the number of a tooth
LEAST_CHANGE = 0.05  # of a depth that is said [µm]
ERRORS = (
    ("transmission_error_percent", "transmission error"),
    ("waveform_percent", "vibration waveform"),
    ("rms_percent", "vibration RMS"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One finding besides wear."""

    title: str
    sentences: tuple[str, ...]


def number(value: Any, digits: int = 3) -> str:
    """A number to so many digits, without an exponent where it can be read without; a dash where there is none."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return "–"
    if value == 0 or 1e-3 <= abs(value) < 10**digits:
        return f"{value:.{digits}g}"
    return f"{value:,.0f}" if 1 <= abs(value) < 1e9 else f"{value:.{digits}g}"


def label(name: str) -> str:
    """What people call an effect; the name in words where the table has none of this name."""
    from twin.effects.channel_faults import label_of

    return label_of(name) or name.replace("_", " ")


def findings(answer: Mapping[str, Any]) -> list[Finding]:
    """Every effect in the answer, and vibration of unknown cause."""
    found = [_effect(effect) for effect in answer.get("effects") or ()]
    left = answer.get("unexplained") or {}
    if left.get("verdict") == "unknown_effect":
        why = left.get("reason") or "vibration that no known effect explains"
        found.append(Finding(title="Vibration of unknown cause", sentences=(_sentence(why),)))
    return found


def _effect(effect: Mapping[str, Any]) -> Finding:
    where = f" ({', '.join(effect['channels'])})" if effect.get("channels") else ""
    title = f"{_capital(label(effect['name']))}{where}"
    sizes = ", ".join(f"{name.replace('_', ' ')} {_size(value, name)}" for name, value in effect["parameters"].items())
    sentences = [f"{_capital(sizes)}; {_since(effect)}." if sizes else f"{_capital(_since(effect))}."]
    if growth := growth_text(effect, _size):
        sentences.append(f"{_capital(growth)}.")
    sentences += [*(effect.get("caveats") or ()), _sureness(effect["evidence"]), *_consequences(effect)]
    if effect.get("status") in ("accepted", "pinned"):
        sentences.append(f"An engineer has {effect['status']} this effect.")
    return Finding(title=title, sentences=tuple(sentences))


def _since(effect: Mapping[str, Any]) -> str:
    if effect.get("channels"):
        return "new since the healthy baseline"
    onset = effect.get("onset_revolutions")
    width = effect.get("onset_std_revolutions")
    about = f" ± {width:,.0f}" if width else ""
    return f"since {onset:,.0f}{about} revolutions" if onset else "present from the first measurement on"


def _size(figure: Mapping[str, Any], name: str) -> str:
    if figure["value"] is None:
        return "–"
    share = not figure["unit"] and name.endswith(("_share", "_loss"))
    factor, unit = (100.0, "%") if share else SMALL.get(figure["unit"], (1.0, figure["unit"]))
    known = figure["std"] is not None and figure["std"] > COUNTED * abs(figure["value"])
    spread = f" ± {number(figure['std'] * factor, 2)}" if known else ""
    return f"{number(figure['value'] * factor)}{spread}{'' if unit in ('', '°') else ' '}{unit}"


def _sureness(evidence: Mapping[str, Any]) -> str:
    """How surely the effect is distinguished from others, in words with the figure they rest on."""
    alike = [label(name) for name in evidence.get("indistinguishable_from") or ()]
    if alike:
        return f"These channels cannot distinguish it from: {', '.join(alike)}."
    gain, over = evidence.get("log_evidence"), evidence.get("over_runner_up")
    basis = "" if gain is None else f" (log evidence {gain:,.0f} over a model without it)"
    if evidence.get("runner_up") is None or over is None:
        return f"No other known effect was a candidate{basis}."
    rival = label(evidence["runner_up"])
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
    if moved := moved_text(effect):
        out.append(f"Of the lines that it moves, on the same measurements: {moved}.")
    without, with_it = (effect.get(f"wear_depth_um_{when}") for when in ("before", "after"))
    if without is not None and with_it is not None and abs(without - with_it) > LEAST_CHANGE:
        lives = [effect.get(f"rul_revolutions_{when}") for when in ("before", "after")]
        life = "" if None in lives else f"; remaining life {lives[0]:,.0f} → {lives[1]:,.0f} revolutions"
        out.append(f"Taking it into account changes the wear depth {without:.1f} → {with_it:.1f} µm{life}.")
    return out


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _sentence(text: str) -> str:
    text = _capital(text)
    return text if text.endswith(".") else f"{text}."
