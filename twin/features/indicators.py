"""Classic condition indicators of a gear, by the names that MATLAB's gearConditionMetrics uses.

One gear's synchronous average x over one turn is split into
    regular     shaft order 1 and the mesh harmonics with their first sidebands (± 1 order)
    residual    average less shaft order 1 and the mesh harmonics: sidebands stay
    difference  average less the regular part: d = x − regular

    RMS, Kurtosis, CrestFactor     of x; kurtosis N·Σ(x − x̄)⁴/(Σ(x − x̄)²)²; crest = max|x|/RMS
    FM0          = (max x − min x)/Σ_k A_k                    A_k amplitude of mesh harmonic k
    FM4          = N·Σ(d − d̄)⁴/(Σ(d − d̄)²)²                   3 for noise, 1.5 for a line, N for one spike
    M6A, M8A     = N²·Σ(d − d̄)⁶/(…)³,  N³·Σ(d − d̄)⁸/(…)⁴       15 and 105 for noise
    NA4          = N·Σ(r − r̄)⁴/(mean over the record so far of Σ(r − r̄)²)²
    EnergyRatio  = RMS(difference)/RMS(regular)
    EnergyOperator = kurtosis of ψ_n = x_n² − x_{n−1}·x_{n+1}    (Teager; one turn closes on itself)
    SidebandLevelFactor = Σ first sidebands of mesh harmonic 1/RMS(x)
    SidebandRatio = Σ sidebands ± 1 … ± 3/A_k                  of the strongest mesh harmonic

Source   R. M. Stewart, ISVR Machine Health Monitoring Group (1977): FM0, FM4;
         H. R. Martin, IMechE Conf. (1989): M6A, M8A;  J. J. Zakrajsek et al., NASA TM-105950 (1993): NA4;
         H. Ma, J. F. Bu, NASA/TM-2002-211491 collects these and energy ratio, energy operator, sideband level factor;
         names as in the documentation of MATLAB's Predictive Maintenance Toolbox, gearConditionMetrics
Holds    an average with at least 4 values per tooth; a flat average gives NaN, never a number made up
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.errors import ParameterError

PER_TOOTH = 4
SIDEBANDS = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class GearSignals:
    """A synchronous average over one turn of one gear, and what indicators are made of; all (n,)."""

    average: np.ndarray
    regular: np.ndarray
    residual: np.ndarray
    difference: np.ndarray
    spectrum: np.ndarray  # complex peak amplitudes of the average at whole orders, (n//2 + 1,)
    teeth: int


@dataclass(frozen=True, slots=True, kw_only=True)
class GearConditionMetrics:
    """Indicators of one gear; the unit is the average's for RMS, none for the others."""

    RMS: float
    Kurtosis: float
    CrestFactor: float
    FM0: float
    FM4: float
    M6A: float
    M8A: float
    NA4: float
    EnergyRatio: float
    EnergyOperator: float
    SidebandLevelFactor: float
    SidebandRatio: float


def gear_signals(average, teeth: int) -> GearSignals:
    """Split of a synchronous average (n,) over one turn of a gear; its mean is left out."""
    x = np.asarray(average, dtype=float)
    if x.size < PER_TOOTH * teeth:
        raise ParameterError(f"{x.size} values over {teeth} teeth; at least {PER_TOOTH} a tooth are needed")
    X = np.fft.rfft(x) * (2 / x.size)
    X[0] = 0.0
    if x.size % 2 == 0:
        X[-1] /= 2
    order = np.arange(X.size)
    off = np.minimum(order % teeth, -order % teeth)
    meshing = (off == 0) & (order > 0)
    regular = meshing | (order == 1) | ((off == 1) & (order > 1))

    def back(mask) -> np.ndarray:
        Y = np.where(mask, X, 0.0) * (x.size / 2)
        if x.size % 2 == 0:
            Y[-1] *= 2
        return np.fft.irfft(Y, x.size)

    return GearSignals(
        average=back(order > 0),
        regular=back(regular),
        residual=back((order > 0) & ~meshing & (order != 1)),
        difference=back((order > 0) & ~regular),
        spectrum=X,
        teeth=teeth,
    )


def _ratio(above: float, below: float, scale: float = 0.0) -> float:
    """above/below; NaN where the lower is nothing but rounding beside the scale."""
    return float(above / below) if below > 1e-12 * scale else float("nan")


def normalised_moment(x, half: int) -> float:
    """N^(h−1)·Σ(x − x̄)^(2h)/(Σ(x − x̄)²)^h: kurtosis for h = 2, M6A for 3, M8A for 4; (n,) → number."""
    d = np.asarray(x) - np.mean(x)
    rms = np.sqrt(np.mean(d**2))
    return float(np.mean((d / rms) ** (2 * half))) if rms > 0 else float("nan")


def fm0(signals: GearSignals) -> float:
    """Peak to peak of the average over the sum of mesh amplitudes."""
    mesh = np.abs(signals.spectrum[signals.teeth :: signals.teeth]).sum()
    return _ratio(np.ptp(signals.average), mesh, np.ptp(signals.average))


def na4(residual, earlier: Sequence[np.ndarray] = ()) -> float:
    """Fourth moment of the residual (n,) over the squared mean variance of it and all earlier residuals."""
    r = np.asarray(residual) - np.mean(residual)
    variance = np.mean([np.var(e) for e in (*earlier, residual)])
    return _ratio(np.mean(r**4), variance**2)


def energy_operator(average) -> float:
    """Kurtosis of the Teager energy x_n² − x_{n−1}·x_{n+1} over one turn; (n,) → number."""
    x = np.asarray(average)
    ψ = x**2 - np.roll(x, 1) * np.roll(x, -1)
    if np.ptp(ψ) <= 1e-9 * np.abs(ψ).max(initial=0.0):
        return float("nan")  # one line has constant energy
    return normalised_moment(ψ, 2)


def sideband_level_factor(signals: GearSignals) -> float:
    """First sidebands of the first mesh harmonic over the RMS of the average."""
    A, z = np.abs(signals.spectrum), signals.teeth
    return _ratio(A[z - 1] + A[z + 1], float(np.sqrt(np.mean(signals.average**2))))


def sideband_ratio(signals: GearSignals) -> float:
    """Three sidebands on both sides of the strongest mesh harmonic over its amplitude."""
    A, z = np.abs(signals.spectrum), signals.teeth
    mesh = z * np.arange(1, (A.size - 1 - SIDEBANDS) // z + 1)
    if mesh.size == 0:
        return float("nan")
    k = int(mesh[np.argmax(A[mesh])])
    return _ratio(A[k - SIDEBANDS : k + SIDEBANDS + 1].sum() - A[k], A[k], float(A.max()))


def gear_condition_metrics(average, teeth: int, earlier: Sequence[np.ndarray] = ()) -> GearConditionMetrics:
    """All indicators of one gear from its synchronous average over one turn.

    average  (n,), at least four values a tooth; `orders.synchronous_average` gives one
    earlier  residuals of earlier averages, for NA4
    """
    s = gear_signals(average, teeth)
    scale = float(np.sqrt(np.mean(s.average**2)))
    d = s.difference
    alive = np.sqrt(np.mean(d**2)) > 1e-9 * scale  # else only rounding is left of the difference
    moments = [normalised_moment(d, h) if alive else float("nan") for h in (2, 3, 4)]
    return GearConditionMetrics(
        RMS=scale,
        Kurtosis=normalised_moment(s.average, 2),
        CrestFactor=_ratio(np.abs(s.average).max(), scale),
        FM0=fm0(s),
        FM4=moments[0],
        M6A=moments[1],
        M8A=moments[2],
        NA4=na4(s.residual, earlier) if np.sqrt(np.mean(s.residual**2)) > 1e-9 * scale else float("nan"),
        EnergyRatio=_ratio(np.sqrt(np.mean(d**2)), np.sqrt(np.mean(s.regular**2)), scale),
        EnergyOperator=energy_operator(s.average),
        SidebandLevelFactor=sideband_level_factor(s),
        SidebandRatio=sideband_ratio(s),
    )
