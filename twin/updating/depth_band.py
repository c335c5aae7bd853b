"""What the 5–95 % band of a depth by the encoders rests on.

    σ² = (τ·Σ_j (Re Σ_k g_k·s_jk·m_k)²)  +  (c·σ_fit)²  +  (a·σ_mean)²  +  σ_noise²  +  (r·d)²  +  f²  +  σ_shape²

g_k      change of the depth by a change of mesh line k: slope over variance, over the information of all
s_jk     change of ln m_k by value j of the rig file, one standard deviation of its tolerance (line_scatter.py)
σ_fit    standard deviation of the depth by the deviations that the fit left: its own times √misfit
σ_mean   what the mean of the transmission error, as uncertain as its drift lets it be, does to the depth
r        what all lines are off by alike, so that no fit shows it: width of the contact, differing teeth
f        deviation of real unworn teeth, in a depth as in the zero that it counts from

The structure is the same in every window of a machine under one condition, so are r, the shape of the flanks and the
zero: all but the noise is shared by a machine's depths (measurement.py).

Source   first-order propagation of errors (JCGM 100:2008, section 5); the factors are tuned, see their sources
Holds    where the effects that are there are in the model; their sizes join the band (outcome.py)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.thresholds import deciding

TUNED = (
    "tuned on 93 campaigns, of draw 1 of the wide set (spreads doubled, up to N117) and of draw 2 of the clean set: "
    "the band of an established depth holds the truth in 86 % of the windows of the first, 91 % of the second"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class BandModel:
    """How much each part of a depth's uncertainty counts in its band."""

    tolerance: float = deciding(
        1.2,
        of="the standard deviation by the rig file's tolerances",
        meaning="what the structure counts by",
        source="derivation: tolerances are estimates, trusted within a factor of two; root mean square of a factor "
        "that is even on a logarithmic scale between a half and two",
    )
    fit: float = deciding(
        0.6,
        of="the standard deviation by the fit's own misfit",
        meaning="what deviations of the lines that no value of the rig file makes count by",
        source=TUNED,
    )
    mean: float = deciding(
        0.5,
        of="the standard deviation by the mean of the transmission error",
        meaning="what the mean counts by: its zero is learned from the lines, and drifts less than it may",
        source=TUNED,
    )
    alike: float = deciding(
        0.005,
        of="the depth",
        meaning="standard deviation of what all lines are off by alike; three times that by the pinion's encoder alone",
        source=TUNED,
    )
    floor: float = deciding(
        0.08e-6,
        unit="m",
        meaning="standard deviation of a depth near zero",
        source=TUNED,
    )
    effects: float = deciding(
        0.02,
        of="the depth",
        meaning="standard deviation of a depth by the sizes of effects in the model that change the mesh lines",
        source=TUNED,
    )


BAND = BandModel()


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthParts:
    """Standard deviations of a depth by their cause [m]."""

    structure: float  # the rig file's tolerances
    fit: float  # what the fit left
    mean: float  # drift and noise of the mean transmission error
    noise: float  # of the lines
    shape: float  # of the worn flanks
    alike: float = 1.0  # over that of two encoders: what all lines are off by alike

    def std(self, depth: float, band: BandModel = BAND) -> float:
        """What a band states: ± Z95 of it hold 90 % [m]."""
        parts = (
            band.tolerance * self.structure,
            band.fit * self.fit,
            band.mean * self.mean,
            self.noise,
            band.alike * self.alike * depth,
            band.floor,
            self.shape,
        )
        return float(np.sqrt(np.sum(np.square(parts))))


def structure_std(gain: np.ndarray, model: np.ndarray, sources: np.ndarray) -> float:
    """Standard deviation of a depth [m] by what the structure does to its lines.

    gain     g_k, change of the depth by a line (HARMONICS,)
    model    m_k at the depth [m] (HARMONICS,)
    sources  s_jk, changes of ln m_k by independent causes (causes, HARMONICS)
    """
    return float(np.linalg.norm(np.real(sources @ (gain * model))))
