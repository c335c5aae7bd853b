"""What single sensors show, as named changes: before any fault of the gears is considered.

A sensor that is dead, clipped or interrupted is named and takes no part in the comparison of lines: the samples
themselves say so, and no evidence is computed. The evidence of a reversed or late sensor is that of its lines,

    Σ (|Y − x|² − |Y′ − x|²)/σ² − 1      Y′ the corrected lines, x the healthy ones of their scatter σ [nat]
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from twin.assessment import ParameterValue
from twin.baseline.findings import BaselineComparison
from twin.baseline.learned import Baseline
from twin.baseline.named import Named, majority
from twin.baseline.off_line_changes import DEFAULT as OFF_LINES
from twin.baseline.off_line_changes import OffLineThresholds
from twin.baseline.reading import WindowReading
from twin.baseline.sensor_timing import TimingChange
from twin.baseline.usable import SensorFault, fault_of

FAULTS = (
    "sensor_unit",
    "sensor_dead",
    "sensor_clipping",
    "sensor_dead_time",
)  # with these a channel's lines cannot be compared


def sensor_faults(
    baseline: Baseline, reading: WindowReading, limits: OffLineThresholds = OFF_LINES
) -> tuple[SensorFault, ...]:
    """Channels of a window that are dead, clipped or interrupted, whether or not healthy recordings were so."""
    out = []
    silent: list[float] = []
    for channel, lines in reading.channels.items():
        fault = fault_of(channel, lines)
        healthy = [c for r in baseline.readings if (c := r.channels.get(channel)) is not None]
        if not healthy and all(one.channel != channel for one in baseline.not_learned):
            continue  # the baseline does not know this channel
        level = float(np.log(max(lines.rms, 1e-30)) - np.mean([np.log(max(c.rms, 1e-30)) for c in healthy] or [0.0]))
        if healthy and level < limits.silent and (fault is None or fault.name != "sensor_dead"):
            detail = f"{channel} gives {np.exp(level):.2g} times the healthy level: the sensor or its cable is dead"
            share = 0.0 if lines.off is None else lines.off.constant
            fault = SensorFault(channel=channel, name="sensor_dead", share=share, detail=detail)
            silent.append(level)
        if fault is not None:
            out.append(fault)
    if len(silent) > 1 and len(silent) == len(reading.channels) and np.ptp(silent) < limits.one_factor:
        detail = (
            f"all {len(silent)} accelerometers give {np.exp(np.mean(silent)):.2g} times the healthy level: their unit, "
            f"sensitivity or scale"
        )
        return tuple(replace(fault, name="sensor_unit", detail=detail) for fault in out)
    return tuple(out)


def without(reading: WindowReading, faults: Iterable[SensorFault]) -> WindowReading:
    """A reading without the channels that cannot be compared; all of them where none would be left."""
    gone = {fault.channel for fault in faults}
    left = {name: c for name, c in reading.channels.items() if name not in gone}
    return replace(reading, channels=left) if left else reading


def faults_named(baseline: Baseline, found: Sequence[Sequence[SensorFault]]) -> list[Named]:
    """Faults of sensors in most windows, without those that the healthy recordings show as much."""
    out = []
    for name in FAULTS:
        seen = tuple(dict.fromkeys(f.channel for window in found for f in window if f.name == name))
        for channels in [seen] if name == "sensor_unit" and seen else [(channel,) for channel in seen]:
            at = {i: f for i, w in enumerate(found) for f in w if f.channel in channels and f.name == name}
            fault = next(iter(at.values()))
            if majority(list(at), len(found)) and not _is_healthy(baseline, fault):
                share = {"share": ParameterValue(value=fault.share, unit="", std=0.0)}
                out.append(
                    Named(
                        name=name, channels=channels, parameters=share, log_evidence=None,
                        detail=fault.detail, windows=tuple(at),
                    )
                )  # fmt: skip
    return out


def known_faults(baseline: Baseline, found: Sequence[Sequence[SensorFault]]) -> str:
    """What sensors show now as in the healthy recordings, so that it is not new; empty where nothing."""
    said = {f.channel: f.detail for window in found for f in window if _is_healthy(baseline, f)}
    return "; ".join(f"{detail}, as in healthy recordings: its lines are not compared" for detail in said.values())


def _is_healthy(baseline: Baseline, fault: SensorFault, limits: OffLineThresholds = OFF_LINES) -> bool:
    """Whether healthy recordings had this fault about as much."""
    most = max(
        (x.most for x in baseline.not_learned if (x.channel, x.name) == (fault.channel, fault.name)), default=0.0
    )
    return fault.share <= limits.over_healthy * most


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
