"""What single sensors show, as named changes: before any fault of the gears is considered.

A sensor that is dead, clipped or interrupted is named and takes no part in the comparison of lines: the samples
themselves say so, and no evidence is computed. The evidence of a reversed or late sensor is that of its lines,

    Σ (|Y − x|² − |Y′ − x|²)/σ² − 1      Y′ the corrected lines, x the healthy ones of their scatter σ [nat]
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
from twin.baseline.off_line_changes import OffLineThresholds
from twin.baseline.reading import WindowReading
from twin.baseline.sensor_timing import TimingChange

FAULTS = ("sensor_dead", "sensor_clipping", "sensor_dead_time")  # with these a channel's lines cannot be compared


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
                        name=name, channels=(channel,), parameters=share, log_evidence=None,
                        detail=fault.detail, windows=tuple(at),
                    )
                )  # fmt: skip
    return out


def timing_named(
    found: Sequence[Sequence[TimingChange]], measured: Sequence[WindowReading], compared: Sequence[BaselineComparison]
) -> list[Named]:
    """Reversed and delayed sensors in most windows.

    measured  windows before they were corrected
    compared  the same, corrected
    """
    out = []
    for channel in dict.fromkeys(t.channel for window in found for t in window):
        at = {i: t for i, w in enumerate(found) for t in w if t.channel == channel}
        if not majority(list(at), len(found)):
            continue
        first, change = next(iter(at.items()))
        delay = {"delay": ParameterValue(value=change.delay, unit="s", std=change.delay_std)}
        fit = f"{change.after:.2f} instead of {change.before:.2f}"
        said = f"the pattern of the teeth in {channel} fits the baseline to {fit}"
        out.append(
            Named(
                name="sensor_polarity" if change.reversed else "sensor_delay",
                channels=(channel,),
                parameters=delay,
                log_evidence=_timing_evidence(channel, measured[first], compared[first]),
                indistinguishable_from=("a sensor mounted the other way round",) if change.reversed else (),
                detail=said + (" with its sign reversed" if change.reversed else "")
                + f" and {1e3 * change.delay:+.3f} ms later than the other sensors",
                windows=tuple(at),
            )
        )  # fmt: skip
    return out


def _timing_evidence(channel: str, measured: WindowReading, compared: BaselineComparison) -> float | None:
    """Evidence of a corrected channel over the channel as it was measured [nat]; None where it is not compared."""
    x = compared.expected.lines.get(channel)
    if x is None or channel not in measured.channels:
        return None
    σ = compared.expected.std[channel]
    before, after = (r.channels[channel].lines[: x.size] for r in (measured, compared.reading))
    return float(np.sum((np.abs(before - x) ** 2 - np.abs(after - x) ** 2) / σ**2)) - 1.0
