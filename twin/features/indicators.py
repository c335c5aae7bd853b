"""Condition indicators of a gear, and of the signal as a whole.

One gear's synchronous average x over one turn is split into
    regular     order 1 and the mesh harmonics with their first sidebands (± 1 order)
    residual    average less order 1 and the mesh harmonics: sidebands stay
    difference  average less the regular part: d = x − regular

    FM0                    (max x − min x)/Σ_k A_k                    A_k amplitude of mesh harmonic k
    FM4, M6A, M8A          μ_4/μ_2², μ_6/μ_2³, μ_8/μ_2⁴ of d           3, 15, 105 for Gaussian noise
    NA4                    μ_4 of the residual/(mean of its μ_2 over the record so far)²
    energy ratio           RMS(difference)/RMS(regular)
    sideband level factor  first sidebands of mesh harmonic 1, summed, over RMS(x)

and of a sensor's own samples, without their mean:
    RMS;   kurtosis μ_4/μ_2², 3 for Gaussian noise;   crest factor max|x|/RMS

μ_n  central moment of order n over one turn, or over the samples

Source   R. M. Stewart, Report MHM/R/10/77, ISVR, University of Southampton (1977): FM0, FM4;
         H. R. Martin, Proc. 7th Int. Modal Analysis Conf. (1989) 1016–1021: M6A, M8A;
         J. J. Zakrajsek, D. P. Townsend, H. J. Decker, NASA TM-105950 (1993): NA4;
         N. S. Swansson, Friction and Wear in Engineering, IE Australia (1980): energy ratio;
         M. Lebold et al., Proc. 54th Meeting of the Society for MFPT (2000): sideband level factor, and all of these;
         names as MATLAB's gearConditionMetrics has them, in lower case
Holds    an average with at least 4 values a tooth; indicators of windows of one speed and one load may be compared
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np
from scipy import fft

from twin.assessment import GearIndicators, SensorIndicators
from twin.compiled.statistics import moments
from twin.errors import ParameterError, TwinError, WindowError
from twin.features.averages import Average
from twin.windows import Samples

PER_TOOTH = 4  # values of an average, at least
LEAST_TURNS = 3  # of a gear that an average is made of: fewer leave most of the noise in it
ROUNDING = 1e-9  # of the average's RMS with its mean: what is smaller is rounding
GEARS = ("pinion", "gear")

Averages = Callable[[], Sequence[Average | WindowError]]


def periods_of(teeth: tuple[int, int]) -> tuple[float, ...]:
    """A turn of each gear, in pinion turns."""
    return 1.0, teeth[1] / teeth[0]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class GearSignals:
    """A synchronous average over one turn of one gear, and its parts; all (n,) without the mean."""

    average: np.ndarray
    regular: np.ndarray
    residual: np.ndarray
    difference: np.ndarray
    spectrum: np.ndarray  # complex peak amplitudes of the average at whole orders, (n//2 + 1,)
    teeth: int


def gear_signals(average, teeth: int) -> GearSignals:
    """Parts of a synchronous average (n,) over one turn of a gear; its mean is left out."""
    x = np.asarray(average, dtype=float)
    if x.size < PER_TOOTH * teeth:
        raise ParameterError(f"{x.size} values over {teeth} teeth; at least {PER_TOOTH} a tooth are needed")
    X = fft.rfft(x) * (2 / x.size)
    X[0] = 0.0
    if x.size % 2 == 0:
        X[-1] /= 2
    parts = np.zeros((2, X.size), dtype=complex)  # with the sidebands next to the mesh harmonics, and without
    for first, step in ((teeth, teeth), (1, X.size)):
        parts[:, first::step] = X[first::step]
    for first in (teeth - 1, teeth + 1):
        parts[0, first::teeth] = X[first::teeth]
    parts *= x.size / 2
    if x.size % 2 == 0:
        parts[:, -1] *= 2
    regular, periodic = fft.irfft(parts, x.size)
    average = x - x.mean()
    return GearSignals(
        average=average,
        regular=regular,
        residual=average - periodic,
        difference=average - regular,
        spectrum=X,
        teeth=teeth,
    )


def normalised_moments(x, halves: Sequence[int]) -> list[float | None]:
    """μ_2h/μ_2^h for rising h: kurtosis for 2, M6A for 3, M8A for 4; (n,) → one for each h, None of a constant."""
    d = np.asarray(x, dtype=float) - np.mean(x)
    square = d * d
    mean = float(square.mean())
    if not mean > 0:
        return [None for _ in halves]
    square /= mean
    power = square
    out: list[float | None] = []
    for h in range(2, max(halves) + 1):
        power = power * square
        if h in halves:
            out.append(float(power.mean()))
    return out


def gear_indicators(average, teeth: int, turns: int = 1) -> GearIndicators:
    """Indicators of one gear from its synchronous average (n,) over one turn, of so many turns; all but NA4."""
    s = gear_signals(average, teeth)
    amplitude = np.abs(s.spectrum)
    rms, mesh = _rms(s.average), float(amplitude[teeth::teeth].sum())
    scale = _rms(np.asarray(average, dtype=float))
    present = _rms(s.difference) > ROUNDING * scale
    moments = normalised_moments(s.difference, (2, 3, 4)) if present else [None] * 3
    residual = s.residual if _rms(s.residual) > ROUNDING * scale else np.zeros_like(s.residual)
    return GearIndicators(
        turns=turns,
        fm0=_ratio(float(np.ptp(s.average)), mesh, scale),
        fm4=moments[0],
        m6a=moments[1],
        m8a=moments[2],
        energy_ratio=_ratio(_rms(s.difference), _rms(s.regular), scale),
        sideband_level_factor=_ratio(float(amplitude[teeth - 1] + amplitude[teeth + 1]), rms, scale),
        residual_moments=(float(residual @ residual) / residual.size, float(np.mean((residual * residual) ** 2))),
    )


def _rms(x: np.ndarray) -> float:
    return sqrt(float(x @ x) / x.size)


def _ratio(above: float, below: float, scale: float) -> float | None:
    """above/below; None where the lower is nothing but rounding against the scale."""
    return above / below if below > ROUNDING * scale else None


def sensor_indicators(
    samples: Samples, averages: Averages | None = None, teeth: tuple[int, int] | None = None
) -> SensorIndicators:
    """Indicators of one accelerometer's samples; WindowError where not one of them is valid.

    averages  gives the synchronous averages over a turn of each gear, with about as many values a turn as the sensor's
              own, or why there is none; None where the angle is not known
    teeth     numbers of teeth of pinion and gear, None where they are not known
    """
    own = moments(samples.values)
    if own.finite == 0:
        raise WindowError("not one of the channel's samples is valid")
    rms = sqrt(own.square)
    gears, unavailable = _of_gears(averages, teeth)
    return SensorIndicators(
        rms=rms,
        kurtosis=own.kurtosis if own.square > 0 else None,
        crest_factor=_ratio(own.most, rms, 0.0),
        gears=gears,
        unavailable=unavailable,
    )


def _of_gears(
    averages: Averages | None, teeth: tuple[int, int] | None
) -> tuple[dict[str, GearIndicators], dict[str, str]]:
    """Indicators by gear, and why those of a gear are not there."""
    if averages is None or teeth is None:
        reason = "no shaft angle is known" if averages is None else "the rig file does not give both numbers of teeth"
        return {}, dict.fromkeys(GEARS, reason)
    try:
        found = averages()
    except WindowError as error:
        return {}, dict.fromkeys(GEARS, str(error))
    gears: dict[str, GearIndicators] = {}
    unavailable: dict[str, str] = {}
    for gear, z, average in zip(GEARS, teeth, found, strict=True):
        try:
            gears[gear] = _of_gear(average, z)
        except TwinError as error:
            unavailable[gear] = str(error)
    return gears, unavailable


def _of_gear(average: Average | WindowError, teeth: int) -> GearIndicators:
    """One gear's indicators."""
    if isinstance(average, WindowError):
        raise average
    values, turns = average
    if turns < LEAST_TURNS:
        raise WindowError(f"the window has {turns} whole turns of this gear; an average needs {LEAST_TURNS}")
    return gear_indicators(values, teeth, turns)
