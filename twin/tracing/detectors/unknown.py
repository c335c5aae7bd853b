"""What no name fits: lines, modulations and noise that are left once all named effects have been sought.

What belongs together is followed over the windows (twin/tracing/unknown_lines.py); each cause enters where it explains
all channels best (twin/tracing/unknown_entry.py) and joins the twin as one `unknown_effect` with all of them. Held-out
windows then decide whether it stays (twin/tracing/unknown_held_out.py).

Holds    lines of the window's resolution; not where teeth that differ fill the spectrum between the orders, nor beside
         a bearing defect, whose own lines these would be
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from twin.effects.unknown_effect import UNITS, UnknownEffect
from twin.errors import NotAvailable
from twin.features.shaft_orders import FRACTION, owner_of
from twin.model import Model
from twin.scales import Scales
from twin.thresholds import deciding
from twin.tracing.attribution import AttributedEffect
from twin.tracing.context import TracedWindow, TracingContext
from twin.tracing.findings import AccelerometerFault, Findings, NonGearContent
from twin.tracing.unknown_entry import Entry, Law, entry_of, law_of
from twin.tracing.unknown_lines import (
    FollowedLine,
    Modulation,
    SeenWindow,
    families,
    followed_lines,
    modulation_of,
)
from twin.tracing.unknown_words import of_fault, of_lines, of_modulation, of_noise
from twin.tracing.unnamed_content import with_unnamed


@dataclass(frozen=True, slots=True, kw_only=True)
class UnknownThresholds:
    """When what is left is reported as an effect of its own."""

    least_acceleration: float = deciding(
        15.0, of="acceleration noise floor", meaning="level of a line that is reported", source="as for lines found"
    )
    least_evidence: float = deciding(
        20.0, unit="nat", meaning="evidence of all lines of one cause against noise", source="as for a bearing defect"
    )
    most_causes: int = deciding(4, meaning="causes that are reported", source="not derived: chosen")


THRESHOLDS = UnknownThresholds()
MOST_EVIDENCE = 1e6  # that is stated [nat]
COLUMNS = (
    "amplitude", "frequency", "order", "entry", "drift", "torque_exponent", "speed_exponent", "growth", "since",
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Cause:
    """Lines of one cause with their entry and their law."""

    lines: tuple[FollowedLine, ...]
    entry: Entry
    law: Law
    onset: float  # revolutions, half-way between the windows without it and with it
    first: float  # revolutions of the first window that shows it: before, the twin with it predicts nothing of it

    @property
    def log_evidence(self) -> float:
        """Of the lines against noise [nat]: half the squared clearness, less two numbers a reading."""
        count = sum(len(line.at) for line in self.lines)
        return 0.5 * sum(line.clearness**2 for line in self.lines) - count * float(np.log(1e3))


@dataclass(frozen=True, slots=True, kw_only=True)
class Unknown:
    """All that is left in a machine's windows."""

    causes: tuple[Cause, ...] = ()
    modulation: Modulation | None = None
    modulation_onset: float = 0.0
    noise: tuple[str, float, float, str, float] | None = None  # kind, RMS with it and without [m/s²], words, onset
    struck: str | None = None  # the shaft that impacts repeat with
    teeth: int | None = None  # of the pinion
    fault: AccelerometerFault | None = None

    @property
    def present(self) -> bool:
        return bool(self.causes) or any(part is not None for part in (self.modulation, self.noise, self.fault))


def detect(context: TracingContext, limits: UnknownThresholds = THRESHOLDS) -> Findings:
    """The findings with an unknown effect where anything is left, and with what is to be said of it."""
    windows = seen_windows(context)
    try:
        model: Model | None = context.model
    except NotAvailable:
        model = None
    findings = with_unnamed(context.findings, context, windows, model)
    beside_defect = len(windows) < 2 or findings.non_gear.defect is not None
    if beside_defect and findings.accelerometer_fault is None:
        return findings
    unknown = Unknown() if beside_defect else find_unknown(context, windows, model, limits)
    unknown = replace(unknown, fault=findings.accelerometer_fault)
    if not unknown.present:
        return findings
    item = attributed(unknown, windows)
    if item.name in context.rejected:
        return findings
    said, orders = item.detail.removesuffix("."), _orders(findings.non_gear, unknown)
    content = replace(findings.non_gear, described=said, orders=orders)
    return replace(findings.adding(item), non_gear=content)


def seen_windows(context: TracingContext) -> list[SeenWindow]:
    """The measurement windows with what they show beside the gears, in order."""
    return [
        _seen(w, w.index not in context.held_out)
        for w in context.windows
        if w.index in context.measurement and w.given.non_gear is not None
    ]


def _seen(window: TracedWindow, fitted: bool) -> SeenWindow:
    beside = window.given.non_gear
    assert beside is not None
    return SeenWindow(
        index=window.index,
        revolutions=window.features.revolutions or 0.0,
        speed_hz=beside.speed_hz,
        torque=window.condition.torque,
        duration=beside.duration,
        fitted=fitted,
        readings=beside.readings,
        acceleration=window.features.acceleration,
    )


def find_unknown(
    context: TracingContext, windows: Sequence[SeenWindow], model: Model | None, limits: UnknownThresholds = THRESHOLDS
) -> Unknown:
    """What no named effect explains."""
    content, full = context.findings.non_gear, context.findings.has("pitch_error")
    modulation, left = (None, tuple(windows)) if full else modulation_of(windows, context.rig.teeth[0])
    lines = [line for line in followed_lines(left) if _loud(line, context, limits)]
    lines = [line for line in lines if line.follows == "clock" or not (full or _explained(line, context, left))]
    causes = []
    for group in families(lines, left, context.rig.teeth[0])[: limits.most_causes]:
        cause = cause_of(model, group, windows, context.scales)
        if cause.log_evidence > limits.least_evidence:
            causes.append(cause)
    return Unknown(
        causes=tuple(causes),
        modulation=modulation,
        modulation_onset=0.0 if modulation is None else _onset(modulation.at, windows),
        noise=_noise(context, content),
        struck=content.struck,
        teeth=context.rig.teeth[0],
    )


def cause_of(
    model: Model | None, lines: Sequence[FollowedLine], windows: Sequence[SeenWindow], scales: Scales
) -> Cause:
    """Lines of one cause with where they enter, how they move and since when."""
    entry = entry_of(model, lines, windows, scales)
    law = law_of(model, entry.place, lines, windows)
    onset = _onset([i for line in lines for i, _ in line.at], windows)
    first = 0.0 if onset == 0 else min(windows[line.first].revolutions for line in lines)
    return Cause(lines=tuple(lines), entry=entry, law=law, onset=onset, first=first)


def _loud(line: FollowedLine, context: TracingContext, limits: UnknownThresholds) -> bool:
    """Whether a line of the acceleration is loud enough; those of other channels have been chosen so already."""
    return line.channel != "acceleration" or line.level > limits.least_acceleration * context.scales.acceleration


def _explained(line: FollowedLine, context: TracingContext, windows: Sequence[SeenWindow]) -> bool:
    """Whether a line that follows the angle belongs to a shaft, or to two lines that effects make together."""
    if line.follows != "angle":
        return False
    width = max(windows[i].step / windows[i].speed_hz for i, _ in line.at)
    teeth = context.rig.teeth
    return owner_of(line.order[0], teeth, width, context.findings.known_orders(teeth)) not in (None, FRACTION)


def _onset(at: Sequence[int], windows: Sequence[SeenWindow]) -> float:
    """Revolutions half-way between the last fitted window without it and the first with it; 0 where all show it."""
    fitted = [i for i, w in enumerate(windows) if w.fitted]
    with_it = [i for i in fitted if i in set(at)] or list(at)
    before = [i for i in fitted if i < min(with_it)]
    return 0.5 * (windows[before[-1]].revolutions + windows[min(with_it)].revolutions) if before else 0.0


def _noise(context: TracingContext, content: NonGearContent) -> tuple[str, float, float, str, float] | None:
    """Broadband noise of impacts or of a rub: its kind, RMS with it and without [m/s²], words, and onset."""
    kind = "impacts" if content.impacts else content.modulated_by
    if kind is None:
        return None
    fitted = [w for w in context.fitting if w.features.noise_rms is not None]
    first = 0.0 if content.first is None else content.first
    before = [w for w in fitted if (w.features.revolutions or 0.0) < first - 0.5]
    since = [w for w in fitted if w not in before]
    if not since:
        return None
    level = float(np.sqrt(np.mean([(w.features.noise_rms or 0.0) ** 2 for w in since])))
    usual = float(np.median([w.features.noise_rms or 0.0 for w in before])) if before else context.scales.acceleration
    onset = 0.5 * ((before[-1].features.revolutions or 0.0) + (since[0].features.revolutions or 0.0)) if before else 0.0
    ringing = [w.given.non_gear.ringing for w in since if w.given.non_gear is not None and w.given.non_gear.ringing]
    words = f", ringing near {np.median(ringing):.0f} Hz" if ringing else ""
    return kind, level, usual, words, onset


def _orders(content: NonGearContent, unknown: Unknown) -> tuple[tuple[float, float], ...]:
    """Lines at orders of no shaft: those that were followed stand for what was seen of them."""
    known = [*content.orders]
    for cause in unknown.causes:
        for line in cause.lines:
            if line.follows == "clock" or line.channel != "acceleration":
                continue
            order, level = line.order[0], line.level
            known = [(o, a) for o, a in known if abs(o - order) > max(0.1, 2 * line.spread * order)]
            known.append((order, level))
    return tuple(sorted(known, key=lambda line: -line[1]))


@dataclass(slots=True)
class _Parts:
    """Of the effect, as its causes are put together."""

    fields: dict[str, Any] = field(default_factory=dict)  # of UnknownEffect
    parameters: dict[str, tuple[float, str, float]] = field(default_factory=dict)
    sentences: list[str] = field(default_factory=list)
    onsets: list[float] = field(default_factory=list)
    evidence: float = 0.0

    def add(self, sentence: str, onset: float, evidence: float, **fields: Any) -> None:
        self.sentences.append(sentence[0].upper() + sentence[1:])
        self.onsets.append(onset)
        self.evidence += evidence
        self.fields |= fields


def attributed(unknown: Unknown, windows: Sequence[SeenWindow]) -> AttributedEffect:
    """All that is left as one effect of the twin, since the first of it."""
    parts = _Parts()
    if unknown.fault is not None:
        _add_fault(parts, unknown.fault)
    _add_causes(parts, unknown.causes, unknown.teeth)
    if unknown.modulation is not None:
        m = unknown.modulation
        std = m.std if m.follows == "clock" else m.std * m.frequency / m.order
        parts.parameters["modulation"] = (m.depth, "", m.depth_std)
        parts.parameters["modulation_frequency"] = (m.frequency, "Hz", std)
        encoder = any("encoder" in r.channels for w in windows for r in w.readings)
        parts.add(
            of_modulation(m, encoder, unknown.modulation_onset),
            unknown.modulation_onset,
            0.5 * (m.depth / m.depth_std) ** 2,
            modulation=m.depth,
            modulation_frequency=m.frequency,
        )
    if unknown.noise is not None:
        kind, level, usual, words, onset = unknown.noise
        own = float(np.sqrt(max(level**2 - usual**2, 0.0)))
        parts.parameters["noise"] = (own, "m/s²", 0.2 * own)
        gain = 2 * len(windows) * float(np.log(max(level / max(usual, 1e-12), 1.0)))
        parts.add(of_noise(kind, own, words, onset, unknown.struck), onset, gain, noise=level, noise_before=usual)
    return AttributedEffect.of(
        UnknownEffect(**parts.fields),
        onset=min(parts.onsets),
        parameters=parts.parameters,
        log_evidence=float(min(parts.evidence, MOST_EVIDENCE)),
        detail=". ".join(parts.sentences) + ".",
    )


def _add_fault(parts: _Parts, fault: AccelerometerFault) -> None:
    """The polarity and the delay of the accelerometer's channel."""
    if fault.polarity < 0:
        parts.parameters["polarity"] = (fault.polarity, "", 0.0)
    if fault.delay:
        parts.parameters["delay"] = (fault.delay, "s", fault.delay_std)
    if fault.rate:
        parts.parameters["delay_rate"] = (fault.rate, "s/s", 0.1 * abs(fault.rate))
    parts.add(
        of_fault(fault), fault.onset, fault.log_evidence, polarity=fault.polarity, delay=fault.delay,
        delay_rate=fault.rate, start_ns=fault.start_ns,
    )  # fmt: skip


def _add_causes(parts: _Parts, causes: Sequence[Cause], teeth: int | None) -> None:
    """Lines, the clearest cause first."""
    columns: dict[str, list[Any]] = {name: [] for name in COLUMNS}
    for number, cause in enumerate(causes, start=1):
        _add(columns, cause)
        parts.parameters |= _parameters(cause, "" if number == 1 else f"_{number}")
        unit = UNITS[cause.entry.place]
        sentence = of_lines(cause.lines, cause.entry, cause.law, unit, cause.onset, teeth)
        parts.add(sentence, cause.onset, cause.log_evidence)
    parts.fields |= {name: tuple(values) for name, values in columns.items()}
    if causes:
        law = causes[0].law
        parts.fields |= {"torque": law.torque, "speed": law.speed, "revolutions": law.revolutions}


def _add(columns: dict[str, list], cause: Cause) -> None:
    """The lines of one cause as columns of the effect."""
    for line, level in zip(cause.lines, cause.law.levels, strict=True):
        by_angle = line.follows == "angle"
        columns["amplitude"].append(level)
        columns["frequency"].append(0.0 if by_angle else line.frequency[0])
        columns["order"].append(line.order[0] if by_angle else 0.0)
        columns["entry"].append(cause.entry.place)
        columns["drift"].append(line.spread if line.follows == "neither" else 0.0)
        columns["torque_exponent"].append(float(cause.law.name == "torque"))
        columns["speed_exponent"].append(2.0 * (cause.law.name == "speed"))
        columns["growth"].append(cause.law.growth)
        columns["since"].append(cause.first)


def _parameters(cause: Cause, suffix: str) -> dict[str, tuple[float, str, float]]:
    """Frequency or order, level and drift of the strongest line of a cause: value, unit, standard deviation."""
    line = cause.lines[0]
    out = {}
    if line.follows == "angle":
        out[f"order{suffix}"] = (line.order[0], "", line.order[1])
    else:
        out[f"frequency{suffix}"] = (line.frequency[0], "Hz", line.frequency[1])
    if line.follows == "neither":
        out[f"drift{suffix}"] = (line.spread, "", line.spread / float(np.sqrt(2 * max(len(line.at) - 1, 1))))
    out[f"amplitude{suffix}"] = (cause.law.levels[0], UNITS[cause.entry.place], cause.law.stds[0])
    return out
