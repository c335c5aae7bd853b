"""Is the accelerometer's channel turned round, or late? Its polarity and its delay against the encoders.

    ln(Y_a/Y_e) = ln(H_a/H_e) + ln g + i·π·s − i·ω·(τ + r·t) + ε

Y_a, Y_e   mesh lines of acceleration and of transmission error
H_a, H_e   their receptances to a force at the mesh: the ratio does not depend on what excites the mesh
g          a sensor's gain, free within its tolerance          s   0, or 1 where the polarity is wrong
τ, r, t    delay [s], its rate [s/s], time since the first window [s]

Compared by probability (Laplace's approximation) with a channel as it should be, with a resonance of the mount, whose
phase lags as well, and with another structure. Delay and rate have normal priors.

Source   twin/tracing/transfer_path.py (scatter of structures within the rig's tolerance); Gaussian errors
Holds    both encoders; delays are told up to whole periods of the mesh frequency where windows run at one speed
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import log, pi

import numpy as np

from twin.errors import NotAvailable
from twin.thresholds import deciding
from twin.tracing.context import TracedWindow, TracingContext
from twin.tracing.findings import AccelerometerFault
from twin.tracing.mount_resonance import Mounts, within_half_turns
from twin.tracing.transfer_path import THRESHOLDS as PATH
from twin.tracing.transfer_path import path_covariance, path_log


@dataclass(frozen=True, slots=True, kw_only=True)
class AccelerometerFaultThresholds:
    """When the accelerometer's channel is taken to be turned round or late."""

    least_evidence: float = deciding(
        12.0, unit="nat", meaning="evidence over every other explanation of the phases", source="not derived: chosen"
    )
    least_lines: int = deciding(4, meaning="lines of both channels that are compared", source="not derived: chosen")
    suspected: float = deciding(
        3.0,
        meaning="chi-square per line of a good channel, from which on a fault is searched for",
        source="not derived: chosen",
    )
    longest_delay: float = deciding(0.02, unit="s", meaning="delay that is tried", source="not derived: chosen")
    largest_rate: float = deciding(
        4e-5, unit="s/s", meaning="rate of a delay that is tried", source="144 ms an hour; not derived: chosen"
    )
    usual_delay: float = deciding(
        0.004,
        unit="s",
        meaning="standard deviation of a delay before anything is measured",
        source="not derived: chosen",
    )
    usual_rate: float = deciding(
        1e-5, unit="s/s", meaning="the same of its rate", source="36 ms an hour; not derived: chosen"
    )
    least_phase: float = deciding(
        0.3, unit="rad", meaning="phase that a delay must turn the highest line by", source="not derived: chosen"
    )


THRESHOLDS = AccelerometerFaultThresholds()
START_STEP = 0.5  # phase of the lowest lines from one delay, or rate, tried to the next [rad]
MOST_RATES = 200  # to either side
MOST_STARTS = 400
STEPS = 6  # of Gauss and Newton


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Lines:
    """Quotients of all windows (n,)."""

    log: np.ndarray  # ln of measured over nominal, complex
    std: np.ndarray
    frequency: np.ndarray  # [Hz]
    time: np.ndarray  # since the first window [s]
    revolutions: np.ndarray


def accelerometer_fault_of(
    context: TracingContext, limits: AccelerometerFaultThresholds = THRESHOLDS
) -> AccelerometerFault | None:
    """The fault of the accelerometer's channel that explains its phases; None where a good channel does."""
    try:
        model, first = context.model, context.windows[0].features.start_time_ns
        lines = _quotients(context, first)
        if lines is None or lines.log.size < limits.least_lines:
            return None
        mean, C = path_covariance(context.rig, model.calibration.modal_damping, lines.frequency)
    except NotAvailable:
        return None
    n = lines.log.size
    level = np.concatenate((np.ones(n), np.zeros(n)))
    noise = np.diag(np.tile(lines.std**2 + PATH.own_scatter**2, 2))
    C = C + noise + context.rig.tolerances.accelerometer_gain**2 * np.outer(level, level)
    z = np.concatenate((lines.log.real, lines.log.imag)) - mean
    good = _Normal.of(C)
    usual = good.chi_square(within_half_turns(z)[None])[0]
    if usual < limits.suspected * 2 * n:
        return None
    others = [good.log(usual), _other_structure(z, C, n), _resonance(z, good, lines, context.rig.band[1])]
    return _best_fault(z, good, lines, max(others), first, limits)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Normal:
    """A normal density about zero."""

    inverse: np.ndarray  # (m, m)
    log_size: float  # ln det(2π·C)

    @classmethod
    def of(cls, C: np.ndarray) -> _Normal:
        return cls(inverse=np.linalg.inv(C), log_size=float(np.linalg.slogdet(2 * pi * C)[1]))

    def chi_square(self, z: np.ndarray) -> np.ndarray:
        """(k, m) → (k,)."""
        return np.einsum("ki,ki->k", z @ self.inverse, z)

    def log(self, chi_square):
        """ln of the density."""
        return -0.5 * (chi_square + self.log_size)


def _quotients(context: TracingContext, first_ns: int) -> _Lines | None:
    """Lines that both channels show clearly, in windows that take part in fits."""
    least = PATH.least_error * context.scales.graduation[0]
    noise = PATH.error_noise * context.scales.graduation[0]
    rows = []
    for w in context.fitting:
        o = w.observed
        if o.pinion_only:
            continue
        for k in range(1, o.lines["encoder"].size + 1):
            e, y, std = o.lines["encoder"][k - 1], o.lines["acceleration"][k - 1], o.std["acceleration"][k - 1]
            clear = np.isfinite(e) and np.isfinite(y) and abs(e) > least and abs(y) > PATH.clear_line * std
            if not clear:
                continue
            f = k * context.rig.teeth[0] * o.condition.speed_hz
            own = float(np.hypot(np.hypot(noise, o.std["encoder"][k - 1]) / abs(e), std / abs(y)))
            elapsed = (w.features.start_time_ns - first_ns) * 1e-9
            rows.append((complex(np.log(y / e)), own, f, elapsed, o.revolutions))
    if not rows:
        return None
    logs, stds, frequencies, t, turns = (np.array(column) for column in zip(*rows, strict=True))
    nominal = path_log(context.rig, context.model.calibration.modal_damping, frequencies)
    return _Lines(log=logs - nominal, std=stds, frequency=frequencies, time=t, revolutions=turns)


def _other_structure(z: np.ndarray, C: np.ndarray, n: int) -> float:
    """ln of the density where the structure is another one."""
    wide = _Normal.of(C + PATH.other_structure_scatter**2 * np.eye(2 * n))
    return float(wide.log(wide.chi_square(within_half_turns(z)[None])[0]))


def _resonance(z: np.ndarray, good: _Normal, lines: _Lines, top: float) -> float:
    """ln of the density with a resonance of the mount, the best of a grid."""
    left = Mounts.of(top, lines.frequency).left_of(z)
    return float(good.log(good.chi_square(left)).max())


def _best_fault(
    z: np.ndarray, good: _Normal, lines: _Lines, others: float, first_ns: int, limits: AccelerometerFaultThresholds
) -> AccelerometerFault | None:
    """The most probable fault over every time of its onset, where it is probable enough."""
    turns = np.unique(lines.revolutions)
    onsets = [0.0, *(0.5 * (turns[:-1] + turns[1:])).tolist()]
    best: AccelerometerFault | None = None
    for onset in onsets:
        for polarity in (1.0, -1.0):
            for drifting in (False, True) if onset == 0 and turns.size > 2 else (False,):
                trial = _Trial.of(z, good, lines, onset, polarity, drifting)
                value, size, std = trial.fitted(limits)
                evidence = value - log(2 * len(onsets)) - others
                if best is None or evidence > best.log_evidence:
                    rate = float(size[1]) if drifting else 0.0
                    best = AccelerometerFault(
                        polarity=polarity, delay=float(size[0]), delay_std=std, rate=rate,
                        start_ns=first_ns, onset=onset, log_evidence=evidence,
                    )  # fmt: skip
    if best is None or best.log_evidence < limits.least_evidence:
        return None
    if best.rate == 0 and abs(best.delay) * 2 * pi * float(lines.frequency.max()) < limits.least_phase:
        return replace(best, delay=0.0) if best.polarity < 0 else None
    return best


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Trial:
    """A polarity and an onset; the delay, and its rate where it drifts, are sought."""

    z: np.ndarray  # (2n,), with the polarity taken off
    good: _Normal
    lines: _Lines
    late: np.ndarray  # 1 for lines since the onset, else 0 (n,)
    columns: np.ndarray  # −∂z/∂(delay, rate) (d, n)

    @classmethod
    def of(cls, z: np.ndarray, good: _Normal, lines: _Lines, onset: float, polarity: float, drifting: bool) -> _Trial:
        n, ω = lines.log.size, 2 * pi * lines.frequency
        late = (lines.revolutions > onset).astype(float)
        moved = z.copy()
        moved[n:] -= late * pi * (polarity < 0)
        columns = np.array([late * ω, late * ω * lines.time] if drifting else [late * ω])
        return cls(z=moved, good=good, lines=lines, late=late, columns=columns)

    def fitted(self, limits: AccelerometerFaultThresholds) -> tuple[float, np.ndarray, float]:
        """ln of the probability of the data, delay and rate (d,), and the delay's standard deviation [s]."""
        spread = np.array([limits.usual_delay, limits.usual_rate])[: len(self.columns)]
        size = self._starts(limits)
        J = np.concatenate((np.zeros_like(self.columns), self.columns), axis=1)  # (d, 2n)
        information = J @ self.good.inverse @ J.T + np.diag(1 / spread**2)
        for _ in range(STEPS):
            left = within_half_turns(self.z + size @ J)
            slope = left @ self.good.inverse @ J.T + size / spread**2
            size = size - np.linalg.solve(information, slope.T).T
        chi = self.good.chi_square(within_half_turns(self.z + size @ J)) + ((size / spread) ** 2).sum(axis=1)
        best = int(np.argmin(chi))
        volume = float(np.linalg.slogdet(information * np.outer(spread, spread))[1])
        std = float(np.sqrt(np.linalg.inv(information)[0, 0]))
        return float(self.good.log(chi[best])) - 0.5 * volume, size[best], std

    def _starts(self, limits: AccelerometerFaultThresholds) -> np.ndarray:
        """Delays and rates (m, d) from which the lowest lines alone are explained best: those least ambiguous."""
        f, n = self.lines.frequency, self.lines.log.size
        low = (f < 1.5 * f.min()) & (self.late > 0)
        if not low.any():
            low = self.late > 0
        step = START_STEP / (2 * pi * float(f[low].max()))
        delays = step * np.arange(-int(limits.longest_delay / step), int(limits.longest_delay / step) + 1)
        if len(self.columns) == 1:
            grid = delays[:, None]
        else:
            rate = step / max(float(self.lines.time.max()), 1.0)
            count = min(int(limits.largest_rate / rate), MOST_RATES)
            rates = rate * np.arange(-count, count + 1)
            grid = np.stack(np.meshgrid(delays, rates, indexing="ij"), axis=-1).reshape(-1, 2)
        phases = np.angle(np.exp(1j * (self.z[n:][low] + grid @ self.columns[:, low])))
        return grid[np.argsort((phases**2).sum(axis=1), kind="stable")[:MOST_STARTS]]


def corrected(context: TracingContext, fault: AccelerometerFault) -> TracingContext:
    """The windows as a good channel would have shown them."""
    teeth = context.rig.teeth[0]
    windows = tuple(_corrected(w, fault, teeth) if w.observed.revolutions > fault.onset else w for w in context.windows)
    worn = None if context.worn is None else replace(context.worn, windows=windows)
    return replace(context, windows=windows, worn=worn, findings=replace(context.findings, accelerometer_fault=fault))


def _corrected(window: TracedWindow, fault: AccelerometerFault, teeth: int) -> TracedWindow:
    features, o = window.features, window.observed
    speed, lines = o.condition.speed_hz, dict(o.lines)
    f = speed * teeth * np.arange(1, lines["acceleration"].size + 1)
    lines["acceleration"] = lines["acceleration"] / fault.gain(f, features.start_time_ns)
    found = features.acceleration
    if found is not None:
        gain = fault.gain(np.array(found.orders) * speed, features.start_time_ns)
        amplitudes = tuple((np.array(found.amplitudes) / gain).tolist())
        features = replace(features, acceleration=replace(found, amplitudes=amplitudes))
    given = replace(window.given, features=features)
    return replace(window, given=given, observed=replace(o, lines=lines))
