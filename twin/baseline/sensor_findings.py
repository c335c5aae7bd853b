"""What single sensors and measures off the lines show, as named changes: before any fault of the gears is considered.

A sensor that is dead, clipped or interrupted is named and takes no part in the comparison of lines. Changed measures
of a channel are named by the first of these that there is: hum, noise, impacts; anything else is an unknown effect.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin.assessment import ParameterValue
from twin.baseline.findings import BaselineComparison
from twin.baseline.learned import Baseline
from twin.baseline.named import Named, majority
from twin.baseline.off_line_changes import DEFAULT as OFF_LINES
from twin.baseline.off_line_changes import OffLineChange, OffLineThresholds, off_line_changes
from twin.baseline.reading import WindowReading
from twin.baseline.sensor_timing import TimingChange

FAULTS = ("sensor_dead", "sensor_clipping", "sensor_dead_time")  # with these a channel's lines cannot be compared
MOST_SAID = 3  # measures in one sentence
CABLE = "another mount, cable or place of the sensor"


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorFault:
    """What makes one channel of a window unusable."""

    channel: str
    name: str  # of `FAULTS`
    share: float  # of the samples
    detail: str


def sensor_faults(
    baseline: Baseline, reading: WindowReading, limits: OffLineThresholds = OFF_LINES
) -> tuple[SensorFault, ...]:
    """Channels of a window that are dead, clipped or interrupted."""
    out = []
    for channel, lines in reading.channels.items():
        off = lines.off
        healthy = [c for r in baseline.readings if (c := r.channels.get(channel)) is not None and c.off is not None]
        if off is None or not healthy:
            continue
        level = float(np.log(max(lines.rms, 1e-30)) - np.mean([np.log(max(c.rms, 1e-30)) for c in healthy]))
        clipped = max(c.off.clipped for c in healthy if c.off is not None)
        run = max(c.off.constant for c in healthy if c.off is not None)
        if off.constant > limits.dead or level < limits.silent:
            detail = f"{channel} gives {np.exp(level):.2g} times the healthy level: the sensor or its cable is dead"
            out.append(SensorFault(channel=channel, name="sensor_dead", share=off.constant, detail=detail))
        elif off.constant > max(limits.dead_time, limits.clipped_over_healthy * run):
            detail = f"{channel} keeps one value for {100 * off.constant:.1f} % of the window: samples are missing"
            out.append(SensorFault(channel=channel, name="sensor_dead_time", share=off.constant, detail=detail))
        elif off.clipped > max(limits.clipped, limits.clipped_over_healthy * clipped):
            detail = f"{100 * off.clipped:.1f} % of the samples of {channel} are at its largest or smallest value"
            out.append(SensorFault(channel=channel, name="sensor_clipping", share=off.clipped, detail=detail))
    return tuple(out)


def without(reading: WindowReading, faults: Iterable[SensorFault]) -> WindowReading:
    """A reading without the channels that cannot be compared; all of them where none would be left."""
    gone = {fault.channel for fault in faults}
    left = {name: c for name, c in reading.channels.items() if name not in gone}
    return replace(reading, channels=left) if left else reading


def faults_named(found: Sequence[Sequence[SensorFault]]) -> list[Named]:
    """Faults of sensors in most windows."""
    out = []
    for name in FAULTS:
        for channel in dict.fromkeys(f.channel for window in found for f in window if f.name == name):
            at = {i: f for i, w in enumerate(found) for f in w if f.channel == channel and f.name == name}
            if majority(list(at), len(found)):
                fault = next(iter(at.values()))
                share = {"share": ParameterValue(value=fault.share, unit="", std=0.0)}
                out.append(
                    Named(
                        name=name, channels=(channel,), parameters=share, log_evidence=0.0,
                        detail=fault.detail, windows=tuple(at),
                    )
                )  # fmt: skip
    return out


def timing_named(found: Sequence[Sequence[TimingChange]]) -> list[Named]:
    """Reversed and delayed sensors in most windows."""
    out = []
    for channel in dict.fromkeys(t.channel for window in found for t in window):
        at = {i: t for i, w in enumerate(found) for t in w if t.channel == channel}
        if not majority(list(at), len(found)):
            continue
        change = next(iter(at.values()))
        delay = {"delay": ParameterValue(value=change.delay, unit="s", std=0.0)}
        fit = f"{change.after:.2f} instead of {change.before:.2f}"
        said = f"the pattern of the teeth in {channel} fits the baseline to {fit}"
        out.append(
            Named(
                name="sensor_polarity" if change.reversed else "sensor_delay",
                channels=(channel,),
                parameters=delay,
                log_evidence=0.0,
                indistinguishable_from=("a sensor mounted the other way round",) if change.reversed else (),
                detail=said + (" with its sign reversed" if change.reversed else "")
                + f" and {1e3 * change.delay:+.3f} ms later than the other sensors",
                windows=tuple(at),
            )
        )  # fmt: skip
    return out


def off_lines_named(
    baseline: Baseline,
    compared: Sequence[BaselineComparison],
    known: Iterable[Named],
    limits: OffLineThresholds = OFF_LINES,
) -> list[Named]:
    """Changes off the lines in most windows, one for each channel that nothing else is known of.

    compared  windows with all channels that can be compared
    known     what the lines and sensors have shown
    """
    explained = {channel for effect in known for channel in effect.channels}
    readings = [c.reading for c in compared]
    changes = [
        [
            change
            for change in off_line_changes(
                baseline, c.reading, c.expected.wider, max((p.common_power for p in c.paths), key=abs, default=0.0)
            )
            if abs(change.deviation) > limits.changed
        ]
        for c in compared
    ]
    out = []
    for channel in dict.fromkeys(c.channel for window in changes for c in window):
        at = {i: own for i, w in enumerate(changes) if (own := [c for c in w if c.channel == channel])}
        if channel in explained or not majority(list(at), len(readings)):
            continue
        i, strongest = max(at.items(), key=lambda item: abs(item[1][0].deviation))
        out.append(_off_line(readings[i], channel, strongest, tuple(at), limits))
    return out


def _off_line(
    reading: WindowReading,
    channel: str,
    changes: Sequence[OffLineChange],
    windows: tuple[int, ...],
    limits: OffLineThresholds,
) -> Named:
    """One channel's changes off the lines, by the kind of the clearest."""
    rises = [c for c in changes if c.deviation > 0]
    floors = [c for c in rises if c.measure.startswith("noise floor")]
    off = reading.channels[channel].off
    every = 0 if off is None else sum(name.startswith("noise floor") for name in off.names)
    tones = [c for c in rises if c.measure.startswith("tone")]
    turns = [c for c in rises if c.measure.startswith("impacts once")]
    free = [c for c in rises if c.measure.startswith("impacts of no shaft")]
    name, shown = "unknown_effect", changes
    alike: tuple[str, ...] = ("the sensor's path: " + CABLE,)
    if floors and len(floors) >= limits.noise_bands * every:
        name, alike, shown = "sensor_noise", ("noise of the machine at this sensor",), floors
    elif tones and len(floors) == 0 and not turns:
        name, alike, shown = "hum", ("a machine nearby that turns at this frequency",), tones
    elif free or turns:
        shown = max((turns, free), key=lambda some: max((c.deviation for c in some), default=0.0))
        alike = ("bearing_defect",) if shown is free else ("tooth_crack", "a coupling or seat that knocks once a turn")
    said = ", ".join(f"{c.measure}: {np.exp(c.change):.2f} times" for c in shown[:MOST_SAID])
    deviation = abs(shown[0].deviation)
    parameters = {"deviation": ParameterValue(value=deviation, unit="", std=1.0)}
    if shown is free and off is not None:
        parameters["order"] = ParameterValue(value=off.free_order, unit="", std=0.0)
    return Named(
        name=name,
        channels=(channel,),
        parameters=parameters,
        log_evidence=0.5 * deviation**2,
        indistinguishable_from=alike,
        detail=f"off the lines of {channel}, {said} the healthy value for this operating point ({deviation:.0f} "
        "standard deviations)",
        windows=windows,
    )
