"""What every check of plausibility is given: one window of a machine, with its shaft angle where that is known."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from twin.errors import TwinError
from twin.features.angle import AngleTrack
from twin.features.extract import pinion_angle
from twin.rig import Rig
from twin.windows import Edges, Samples, Window

SLOW = 0.5  # of the stated speed
SHORTEST = 1.0  # of a record that is examined [s]
FEWEST_TURNS = 1.0  # of a shaft, over which its speed is taken: within one, an encoder's run-out is part of it


@dataclass(frozen=True, eq=False, kw_only=True)
class Examined:
    """One window; quantities that several checks need are computed once."""

    rig: Rig
    window: Window

    @cached_property
    def teeth(self) -> tuple[int, int] | None:
        """Tooth counts of pinion and gear; None where the rig file does not give both."""
        return self.rig.teeth if self.rig.has("gears.pinion.teeth", "gears.gear.teeth") else None

    @cached_property
    def track(self) -> AngleTrack | None:
        """Pinion angle by an encoder or tachometer, or by the mesh lines; None where there is none."""
        try:
            return pinion_angle(self.rig, self.window, self.window.accelerations)
        except TwinError:
            return None

    @property
    def by_encoder(self) -> bool:
        """Whether the angle is that of an encoder or tachometer, and not of the mesh lines themselves."""
        return self.track is not None and self.track.source.startswith("encoder/")

    @property
    def is_slow(self) -> bool:
        """Whether the shaft turns at less than half the stated speed, where the mesh may be lost in the noise."""
        nominal = self.rig.get("operating.pinion_speed_hz")
        return self.track is not None and bool(nominal) and self.track.speed < SLOW * nominal

    def speed_by(self, shaft: str) -> float | None:
        """Speed of one shaft by its own encoder [Hz]; None where it has none that can be used."""
        edges: Edges | None = self.window.encoders.get(shaft)
        if edges is None:
            return None
        known = np.flatnonzero(np.isfinite(edges.times))
        times = edges.times[known]
        turns = (known[-1] - known[0]) / edges.per_rev if known.size else 0.0
        if turns < FEWEST_TURNS or np.any(np.diff(times) <= 0):
            return None
        return float(turns / (times[-1] - times[0]))

    @cached_property
    def vibrations(self) -> dict[str, Samples]:
        """Accelerometers that read something, without a gap and long enough to be examined, their mean left out."""
        out = {}
        for name, samples in self.window.accelerations.items():
            if samples.duration >= SHORTEST and np.isfinite(samples.values).all():
                values = samples.values - samples.values.mean()
                if not np.ptp(values):
                    continue
                out[name] = Samples(rate=samples.rate, start=samples.start, values=values)
        return out

    def angle_at(self, samples: Samples) -> tuple[np.ndarray, slice]:
        """Pinion angle [rad] at the samples that the track covers (n,), and which these are."""
        assert self.track is not None
        grid = np.linspace(self.track.start, self.track.stop, max(2, int(64 * self.track.turns)))
        times = self.track.time(grid)
        t = samples.times
        first, last = np.searchsorted(t, (times[0], times[-1]))
        inside = slice(int(first), int(last))
        return np.interp(t[inside], times, grid), inside


def listed(values: list[str], most: int = 3) -> str:
    """Some of a list in words."""
    shown = ", ".join(values[:most])
    return f"{shown} and {len(values) - most} more" if len(values) > most else shown


__all__ = ["SHORTEST", "Examined", "listed"]
