"""Changed measures off the lines as named changes: the first of these that a channel shows.

    noise                               white, of one power in all bands
    hum                                 a tone at a multiple of 50 or 60 Hz
    anything else                       unknown_effect, with what it may be

Impacts once a turn (turn_impact_findings.py) are heard by every sensor: what other channels show of impacts beside them
is no finding of its own.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from twin.assessment import ParameterValue
from twin.baseline.findings import BaselineComparison
from twin.baseline.learned import Baseline
from twin.baseline.named import Named, majority
from twin.baseline.off_line_changes import (
    DEFAULT,
    AddedNoise,
    OffLineChange,
    OffLineThresholds,
    added_noise,
    off_line_changes,
)
from twin.baseline.off_lines import TONE_BLOCK, OffLines
from twin.baseline.repeats import NOISE, OFF_LINES
from twin.baseline.shaft_names import LOCAL_ALTERNATIVES
from twin.features.shaft_orders import owner_of

MOST_SAID = 3  # measures in one sentence
SENSORS_PATH: tuple[str, ...] = ("another mount, cable or place of the sensor",)
MAINS = (50.0, 60.0)  # [Hz]
TIMING = ("sensor_polarity", "sensor_delay")  # these change nothing off the lines

Changes = Sequence[OffLineChange]


def changes_of(baseline: Baseline, compared: Sequence[BaselineComparison]) -> list[tuple[OffLineChange, ...]]:
    """Measures off the lines of every window against the baseline, largest deviation first."""
    return [
        off_line_changes(
            baseline, c.reading, c.expected.wider, max((p.common_power for p in c.paths), key=abs, default=0.0)
        )
        for c in compared
    ]


def off_lines_named(
    baseline: Baseline,
    compared: Sequence[BaselineComparison],
    changes: Sequence[Changes],
    known: Iterable[Named],
    struck: Sequence[Named],
    limits: OffLineThresholds = DEFAULT,
) -> list[Named]:
    """Changes off the lines in most windows.

    compared  windows with all channels that can be compared
    changes   of every window, by `changes_of`
    known     what the lines and sensors have shown: of these channels, nothing more is named
    struck    impacts once a turn
    """
    explained = {channel for effect in known if effect.name not in TIMING for channel in effect.channels}
    out = []
    for channel in dict.fromkeys(c.channel for window in changes for c in window):
        raised = baseline.repeats.factor(OFF_LINES, channel)
        own = [[c for c in window if c.channel == channel] for window in changes]
        noise = {i: n for i, w in enumerate(own) if (n := added_noise(w, len(baseline.std))) is not None}
        heard = {i for i, n in noise.items() if n.over > baseline.repeats.factor(NOISE, channel)}
        at = {i: w for i, w in enumerate(own) if w and (w[0].over > raised or i in heard)}
        if channel in explained or not majority(list(at), len(changes)):
            continue
        i, strongest = max(at.items(), key=lambda item: abs(item[1][0].deviation))
        named = _off_line(baseline, compared[i], channel, strongest, tuple(sorted(at)), raised, noise.get(i), limits)
        if not struck or named.name != "unknown_effect":
            out.append(named)
    return out


def nearly_changed(baseline: Baseline, changes: Sequence[Changes], limits: OffLineThresholds = DEFAULT) -> str:
    """That a measure is near what would be named; empty where none is."""
    raised = {c.channel: baseline.repeats.factor(OFF_LINES, c.channel) for w in changes for c in w}
    near = [next((c for c in w if c.over > limits.suspected * raised[c.channel]), None) for w in changes]
    found = [c for c in near if c is not None]
    if not majority(range(len(found)), len(changes)):
        return ""
    most = max(found, key=lambda c: abs(c.deviation))
    changed = most.limit * raised[most.channel]
    return (
        f"{most.measure} of {most.channel} is {np.exp(most.change):.2f} times the healthy value "
        f"({abs(most.deviation):.1f} standard deviations, where {changed:.3g} are a change)"
    )


def _off_line(
    baseline: Baseline,
    compared: BaselineComparison,
    channel: str,
    changes: Changes,
    windows: tuple[int, ...],
    raised: float,
    noise: AddedNoise | None,
    limits: OffLineThresholds,
) -> Named:
    """One channel's changes off the lines, by the first kind that it shows."""
    off = compared.reading.channels[channel].off
    clear = [c for c in changes if c.over > raised]
    rises = [c for c in clear if c.deviation > 0]
    free = [c for c in rises if c.measure.startswith("impacts of no shaft")]
    turns = [c for c in rises if c.measure.startswith("impacts once")]
    tones = [c for c in rises if c.measure.startswith("tone")]
    resolution = 1 / min(TONE_BLOCK, compared.reading.duration)
    mains = {} if free or turns or off is None else _of_mains(tones, changes, off, resolution, limits)
    name, shown, alike, owner = "unknown_effect", clear, SENSORS_PATH, None
    parameters: dict[str, ParameterValue] = {}
    if noise is not None:
        name, shown, alike = "sensor_noise", [c for c in rises if "floor" in c.measure], (
            "noise of the machine at this sensor",
        )  # fmt: skip
        parameters["rms"] = ParameterValue(value=noise.rms, unit="m/s²", std=noise.rms / noise.deviation)
    elif mains:
        shown, name, alike = [c for c in tones if c.measure in mains], "hum", ("a machine nearby at this frequency",)
        parameters["frequency"] = ParameterValue(value=mains[shown[0].measure], unit="Hz", std=resolution)
    elif free or turns:
        shown = max((turns, free), key=lambda some: max((c.deviation for c in some), default=0.0))
        width = 1 / compared.reading.turns
        owner = None if off is None else owner_of(off.free_order, baseline.rig.teeth, width)
        bearing = shown is free and owner is None
        alike = ("bearing_defect",) if bearing else ("tooth_crack", *LOCAL_ALTERNATIVES)
        if shown is free and off is not None:
            parameters["order"] = ParameterValue(value=off.free_order, unit="", std=0.0)
    deviation = abs(shown[0].deviation) if noise is None else noise.deviation
    parameters["deviation"] = ParameterValue(value=deviation, unit="", std=1.0)
    said = _said(shown, owner) if shown else f"white noise of {parameters['rms'].value:.3g} m/s² more than"
    return Named(
        name=name,
        channels=(channel,),
        parameters=parameters,
        log_evidence=shown[0].log_evidence if noise is None else noise.log_evidence,
        indistinguishable_from=alike,
        detail=f"off the lines of {channel}, {said} the healthy value for this operating point ({deviation:.0f} "
        "standard deviations)",
        windows=windows,
    )


def _said(changes: Changes, owner: str | None) -> str:
    """Measures by how much they have changed; `owner` is what impacts of no shaft belong to by their order."""
    said = ", ".join(f"{c.measure}: {np.exp(c.change):.2f} times" for c in changes[:MOST_SAID])
    return said if owner is None else said.replace("impacts of no shaft", f"impacts of the {owner}")


def _of_mains(
    tones: Changes, changes: Changes, off: OffLines, resolution: float, limits: OffLineThresholds
) -> dict[str, float]:
    """Frequency [Hz] of tones at a multiple of the mains frequency within a resolution [Hz], by measure."""
    stretches = [c.measure for c in sorted(changes, key=lambda c: _start(c.measure)) if c.measure.startswith("tone")]
    places = dict(zip(stretches, off.tones, strict=False))
    out = {}
    for tone in tones:
        f = places.get(tone.measure, 0.0)
        if any(f > 0.5 * m and abs(f - m * round(f / m)) < resolution + limits.of_mains * f for m in MAINS):
            out[tone.measure] = f
    return out


def _start(measure: str) -> float:
    """From where a tone's stretch goes [Hz]; 0 for other measures."""
    return float(measure.split()[1]) if measure.startswith("tone") else 0.0
