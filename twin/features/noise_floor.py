"""The noise floor of a spectrum, estimated from the spectrum itself, and how far a line must stand above it.

    P_m = |Σ_n w_n x_n exp(−2πi·m·n/N)|²                  noise: P_m/floor is exponential, mean 1 (χ² of 2 degrees)
    floor = median{P_j : j near m, no line}/(1/1 − 1/2 + 1/3 − …)     over K bins of one block
    a line where  P/floor > ν·(q^(−1/ν) − 1),   1 − (1 − q)^M = α      F(2, 2ν): the floor is itself uncertain

w   Hann window
K   bins of a block that are no line's
ν   degrees of freedom of the floor: (ln 2)²·K/1.94, the last because neighbouring Hann bins are correlated
M   independent bins searched
α   probability that noise alone gives one line or more among all M

Bins that stand out are left out with their neighbours and the floor is estimated again, starting from a low
quantile, so that lines may fill half of the bins.

Source   J. S. Bendat, A. G. Piersol, Random Data, 4th ed. (2010), section 8.5 (distribution of spectral estimates);
         B. Allen et al., Phys. Rev. D 85 (2012) 122006, appendix B (bias of the median)
Holds    noise whose spectrum changes little across a block; Gaussian, or not far from it
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin import compiled
from twin.errors import NotAvailable, ParameterError

BLOCK = 96  # bins
HANN_CORRELATION = 1.0 + 2 * (4 / 9 + 1 / 36)  # Σ over lags of the squared correlation of Hann bins
CLIPPED = 1e-4  # probability at which a bin is taken for part of a line while the floor is estimated
PASSES = 4
FIRST_QUANTILE = 0.25  # in place of the median in the first pass
LEAST_BINS = 12  # a block with fewer bins between lines takes its neighbours' floor


@dataclass(frozen=True, slots=True, kw_only=True)
class NoiseFloor:
    """Mean power of noise in each bin of a spectrum, and the degrees of freedom behind it."""

    power: np.ndarray  # (m,) in the unit of the spectrum's power
    freedom: float  # ν, of the typical block

    def threshold(self, false_alarm: float, searched: int) -> float:
        """Ratio of a bin's power to the floor that noise passes with this probability, once in so many bins."""
        return threshold(false_alarm, searched, self.freedom)


def threshold(false_alarm: float, searched: int, freedom: float = np.inf) -> float:
    """Power over floor that noise alone exceeds anywhere among `searched` bins with probability `false_alarm`."""
    if not 0 < false_alarm < 1:
        raise ParameterError(f"false_alarm = {false_alarm:g} is outside (0, 1); it is a probability")
    q = -np.expm1(np.log1p(-false_alarm) / max(searched, 1))
    if np.isinf(freedom):
        return float(-np.log(q))
    return float(freedom * np.expm1(-np.log(q) / freedom))


def exceedance(ratio, freedom: float = np.inf) -> np.ndarray:
    """Probability that noise in one bin exceeds each ratio of power to floor; any shape."""
    ratio = np.asarray(ratio, dtype=float)
    if np.isinf(freedom):
        return np.exp(-ratio)
    return np.exp(-freedom * np.log1p(ratio / freedom))


def median_bias(count) -> np.ndarray:
    """Mean of the median of so many independent exponential values of mean 1, ln 2 for many; any shape."""
    n = np.maximum(np.asarray(count, dtype=int), 1)
    alternating = np.cumsum(-((-1.0) ** np.arange(1, n.max() + 1)) / np.arange(1, n.max() + 1))
    odd = n - (n + 1) % 2
    return alternating[odd - 1]


def noise_floor(power, lines=None, block: int = BLOCK) -> NoiseFloor:
    """Floor of a Hann spectrum's power, between its lines.

    power   (m,) of neighbouring bins without zero padding
    lines   (m,) bool, bins known to belong to lines; those that stand out are found besides
    block   bins over which noise is taken for level
    """
    power = np.asarray(power, dtype=float)
    if power.size < 2 * LEAST_BINS:
        raise NotAvailable(f"the noise floor is not available: {power.size} bins are too few, {2 * LEAST_BINS} needed")
    block = min(block, power.size)
    known = np.zeros(power.size, dtype=bool) if lines is None else np.asarray(lines, dtype=bool)
    found = compiled.noise_floor(
        power, known, block, least=LEAST_BINS, bias=median_bias(np.arange(block + 1)),
        first=(FIRST_QUANTILE, -float(np.log1p(-FIRST_QUANTILE))), clipped=CLIPPED, correlation=HANN_CORRELATION,
        passes=PASSES,
    )  # fmt: skip
    if found is None:
        raise NotAvailable("the noise floor is not available: lines fill the whole spectrum")
    floor, freedom = found
    return NoiseFloor(power=floor, freedom=freedom)
