"""A resonance of the accelerometer's mount: every one that is tried, and the likeliest of them.

    ln p(z) = ln mean over f_0 and ζ of N(z − ln g(f; f_0, ζ); 0, C)

z  logarithms of lines' quotients (transfer_path.py), or what these have changed by (gain_change.py); phases within ±π:
   beyond its resonance a mount turns every line by nearly π
g  response of the mount (twin/effects/sensor_resonance.py); every f_0 and ζ of a grid is as likely before

Source   D. J. C. MacKay, Information Theory, Inference, and Learning Algorithms, 2003, ch. 28
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from twin.effects.sensor_resonance import SensorResonance, transmitted
from twin.thresholds import deciding
from twin.tracing.size_laws import UNIFORM

RATIOS = (0.01, 0.014, 0.02, 0.028, 0.04, 0.057, 0.08, 0.113, 0.16)  # damping of the mount, that are tried
FREQUENCIES = 240  # of the mount, that are tried: about 1 % apart, half the width of the sharpest


@dataclass(frozen=True, slots=True, kw_only=True)
class MountThresholds:
    """Where a resonance is sought."""

    resonance_band: tuple[float, float] = deciding(
        (0.25, 3.0),
        of="upper limit of the analysis band",
        meaning="frequencies among which a resonance of the mount is searched for",
        source="not derived: below, the structure's own modes; above, the line of the band hardly moves",
    )


THRESHOLDS = MountThresholds()


def within_half_turns(rest: np.ndarray) -> np.ndarray:
    """Logarithms with their phases, the second half of the last axis, within ±π."""
    out = np.array(rest, dtype=float)
    phases = out[..., out.shape[-1] // 2 :]
    phases[...] = np.angle(np.exp(1j * phases))
    return out


@dataclass(frozen=True, slots=True, kw_only=True)
class Mount:
    """The likeliest resonance."""

    effect: SensorResonance
    std: float  # of ln f_0
    damping_std: float
    log_evidence: float  # of the lines [nat]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Mounts:
    """Every resonance that is tried, with what it makes of n lines: real parts first, then phases."""

    frequency: np.ndarray  # f_0 (m,) [Hz]
    damping_ratio: np.ndarray  # (m,)
    shapes: np.ndarray  # (m, 2n)

    @classmethod
    def of(cls, top: float, frequency: np.ndarray, limits: MountThresholds = THRESHOLDS) -> Mounts:
        """top  upper limit of the analysis band [Hz]; frequency of the lines (n,) [Hz]."""
        low, high = (share * top for share in limits.resonance_band)
        f0, ζ = np.repeat(np.geomspace(low, high, FREQUENCIES), len(RATIOS)), np.tile(RATIOS, FREQUENCIES)
        shapes = np.log(transmitted(frequency / f0[:, None], ζ[:, None]))
        return cls(frequency=f0, damping_ratio=ζ, shapes=np.concatenate((shapes.real, shapes.imag), axis=1))

    def left_of(self, rest: np.ndarray) -> np.ndarray:
        """What each leaves of the lines' logarithms (2n,) → (m, 2n)."""
        return within_half_turns(rest - self.shapes)

    def likeliest(self, likelihood: np.ndarray) -> Mount:
        """The best by ln likelihood (m,); its evidence is the mean over all."""
        best = int(np.argmax(likelihood))
        weight = np.exp(likelihood - likelihood[best])
        weight /= weight.sum()
        logs, ratios = np.log(self.frequency), self.damping_ratio
        step = float((logs[-1] - logs[0]) / (FREQUENCIES - 1))
        return Mount(
            effect=SensorResonance(frequency=float(self.frequency[best]), damping_ratio=float(ratios[best])),
            std=float(np.hypot(np.sqrt(weight @ (logs - weight @ logs) ** 2), step * UNIFORM)),
            damping_std=float(np.sqrt(weight @ (ratios - ratios[best]) ** 2)),
            log_evidence=float(logsumexp(likelihood) - np.log(likelihood.size)),
        )
