"""Channels whose samples themselves say that they cannot be compared: dead, at the rail, interrupted.

The same for a recording that is compared as for one that is learned from: a rail is a rail, however often healthy
recordings reach it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from twin.baseline.reading import ChannelLines, WindowReading
from twin.thresholds import deciding


@dataclass(frozen=True, slots=True, kw_only=True)
class UsableThresholds:
    """When a channel cannot be compared, by its samples alone."""

    clipped: float = deciding(
        0.001, meaning="share of samples that pile up at the largest or smallest value, which is clipping",
        source="derivation: of noise, two samples in a window",
    )  # fmt: skip
    dead: float = deciding(
        0.5, meaning="share of the window with one and the same value from which a sensor is dead",
        source="convention: half",
    )  # fmt: skip
    dead_time: float = deciding(
        0.01, meaning="longest run of one value, as a share of the window, that is dead time",
        source="derivation: thousands of samples of noise are never alike",
    )  # fmt: skip


DEFAULT = UsableThresholds()


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorFault:
    """What makes one channel of a window unusable."""

    channel: str
    name: str  # sensor_dead, sensor_unit, sensor_clipping or sensor_dead_time
    share: float  # of the samples
    detail: str


def fault_of(channel: str, lines: ChannelLines, limits: UsableThresholds = DEFAULT) -> SensorFault | None:
    """Why a channel cannot be compared; None where it can."""
    off = lines.off
    if off is None:
        return None
    if off.constant > limits.dead or lines.rms == 0:
        detail = (
            f"{channel} keeps one value for {100 * off.constant:.0f} % of the window: the sensor or its cable is dead"
        )
        return SensorFault(channel=channel, name="sensor_dead", share=off.constant, detail=detail)
    if off.clipped > limits.clipped:
        detail = f"{100 * off.clipped:.1f} % of the samples of {channel} are at its largest or smallest value"
        return SensorFault(channel=channel, name="sensor_clipping", share=off.clipped, detail=detail)
    if off.constant > limits.dead_time:
        detail = f"{channel} keeps one value for {100 * off.constant:.1f} % of the window: samples are missing"
        return SensorFault(channel=channel, name="sensor_dead_time", share=off.constant, detail=detail)
    return None


@dataclass(frozen=True, slots=True, kw_only=True)
class NotLearned:
    """A channel that was not learned from in some windows."""

    channel: str
    name: str  # of the fault
    windows: tuple[str, ...]
    most: float  # largest share of the samples

    @property
    def text(self) -> str:
        """What was left out, in words."""
        what = {
            "sensor_clipping": f"up to {100 * self.most:.1f} % of its samples at its rail",
            "sensor_dead": "a dead sensor",
            "sensor_dead_time": f"one value for up to {100 * self.most:.1f} % of the window",
        }[self.name]
        return f"{self.channel} was not learned from in {', '.join(self.windows)}: {what}"


def only_usable(
    readings: list[WindowReading], limits: UsableThresholds = DEFAULT
) -> tuple[list[WindowReading], tuple[NotLearned, ...]]:
    """Windows without the channels that cannot be used in them, those with none left out; and what was left out."""
    kept, found = [], []
    for reading in readings:
        faults = [f for name, c in reading.channels.items() if (f := fault_of(name, c, limits)) is not None]
        found += [(reading.name, fault) for fault in faults]
        gone = {fault.channel for fault in faults}
        channels = {name: c for name, c in reading.channels.items() if name not in gone}
        if channels:
            kept.append(replace(reading, channels=channels) if gone else reading)
    return kept, tuple(
        NotLearned(
            channel=channel,
            name=name,
            windows=tuple(window for window, f in found if (f.channel, f.name) == (channel, name)),
            most=max(f.share for _, f in found if (f.channel, f.name) == (channel, name)),
        )
        for channel, name in dict.fromkeys((f.channel, f.name) for _, f in found)
    )
