"""Complex lines at chosen orders of pinion rotation, read from a signal on an even grid of pinion angle.

    x(θ) ≈ Re Σ_j X_j exp(i·o_j·θ)          least squares under a Hann window, all lines at once

θ   absolute pinion angle: zero at edge 0 of the pinion's encoder           [rad]
o   order: cycles per pinion turn; mesh z1·k, gear shaft n·z1/z2
X   complex amplitude (peak), so two windows of a steady machine give the same X

The window keeps what is not among the lines from leaking into them; the joint fit keeps the lines from
leaking into each other, so the number of turns need not be whole. Two lines closer than 1.2/turns cannot be
told apart: the one named first is kept and holds both, the other is NaN.

The standard deviation (of the real and of the imaginary part) comes from the floor around each line, after
all lines are taken out: median power of 2 to 12 resolution steps on both sides.

Source   D. C. Rife, R. R. Boorstyn, Bell Syst. Tech. J. 55 (1976) 1389–1410 (multiple tones);
         F. J. Harris, Proc. IEEE 66 (1978) 51–83 (windows)
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt

import numpy as np
from scipy import fft
from scipy.linalg import lapack

from twin.errors import WindowError
from twin.features.gaps import taper
from twin.features.resample import AngleSignal, at
from twin.features.transforms import bins_within, hann, power_of, powers

RESOLUTION = 1.2  # least distance of two lines, times the turns covered
FEWEST_TURNS = 3.0
WEIGHTS_PER_TURN = 160  # of the window's own transform, where the record has gaps
TAPER_REACH = 40.0  # orders beyond which the tapers towards gaps pass nothing on


@dataclass(frozen=True, slots=True, kw_only=True)
class OrderLines:
    """Complex amplitudes at orders of pinion rotation."""

    orders: np.ndarray  # (n,)
    amplitudes: np.ndarray  # (n,) complex, peak, at absolute pinion angle zero; NaN where not resolved
    std: np.ndarray  # (n,) standard deviation of the real and of the imaginary part

    def at(self, order: float) -> complex:
        """The amplitude at one of the orders."""
        return complex(self.amplitudes[int(np.argmin(np.abs(self.orders - order)))])


def window_weight(signal: AngleSignal) -> np.ndarray:
    """Hann window (n,) that also falls to zero, over a quarter turn, towards what was lost."""
    weight = hann(signal.values.size)
    if signal.usable.all():
        return weight
    return weight * taper(signal.usable, round(0.25 * 2 * pi / signal.step))


class _Transform:
    """Σ_n x_n exp(−i·o·φ_n) at arbitrary orders, φ even and zero in the middle: small matrix products.

    The record is cut into rows. About the middle of a row cosines are even and sines odd, so that half a row of sums
    and half a row of differences give both.
    """

    def __init__(self, n: int, step: float, orders):
        self.n, self.half = n, int(np.ceil(0.5 * sqrt(n)))  # of a row
        self.columns = 2 * self.half
        self.rows = -(-n // self.columns)
        o = np.asarray(orders)
        fast = powers(np.exp(1j * step * o), self.half) * np.exp(0.5j * step * o)
        self.cosine, self.sine = fast.real.copy(), fast.imag.copy()  # behind a row's middle (half, orders)
        middle = np.exp(-0.5j * (n - self.columns) * step * o)
        self.slow = powers(np.exp(1j * step * self.columns * o), self.rows) * middle  # of rows' middles (rows, orders)

    def forward(self, x, weight=1.0) -> np.ndarray:
        """Of x·weight, (n,) real → (orders,) complex."""
        padded = np.empty((self.rows, self.columns))
        flat = padded.reshape(-1)
        np.multiply(x, weight, out=flat[: self.n])
        flat[self.n :] = 0.0
        before, behind = padded[:, : self.half][:, ::-1], padded[:, self.half :]
        cosine, sine = (behind + before) @ self.cosine, (behind - before) @ self.sine
        return np.sum((cosine - 1j * sine) * self.slow.conj(), axis=0)

    def back(self, X) -> np.ndarray:
        """Re Σ_o X_o exp(i·o·φ_n); (orders,) complex → (n,) real."""
        left = self.slow * X
        even, odd = left.real @ self.cosine.T, left.imag @ self.sine.T
        out = np.empty((self.rows, self.columns))
        np.subtract(even, odd, out=out[:, self.half :])
        np.add(even, odd, out=out[:, : self.half][:, ::-1])
        return out.reshape(-1)[: self.n]


def _hann_transforms(orders, n: int, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Σ hann·exp(−i·δ·φ) at the differences δ of all pairs of orders, and at their sums; real, two of (o, o).

    Σ = sin(n·h)·sin²(s/2)·(2·cos²(s/2) − sin²h)/(sin h·(sin²s − sin²h)),   h = δ·step/2,   s = π/n;
    n/2 at h = 0 and n/4 at h = ±s
    """
    half = 0.5 * step * orders
    fast, slow = np.exp(1j * n * half), np.exp(1j * half)
    fast_product, slow_product = np.outer(fast.imag, fast.real), np.outer(slow.imag, slow.real)
    s = pi / n
    factor, whole, edge = np.sin(0.5 * s) ** 2, 2 * np.cos(0.5 * s) ** 2, np.sin(s) ** 2

    def at(combined: np.ufunc) -> np.ndarray:
        above, below = combined(fast_product, fast_product.T), combined(slow_product, slow_product.T)
        square = below * below
        beyond = edge - square
        with np.errstate(divide="ignore", invalid="ignore"):
            out = above * factor * (whole - square) / (below * beyond)
        out[np.abs(beyond) < 1e-12 * np.sin(2 * s)] = 0.25 * n
        out[np.abs(below) < 1e-12] = 0.5 * n
        return out

    return at(np.subtract), at(np.add)


def _gaps_transform(δ, weight, step: float) -> np.ndarray:
    """Σ weight·exp(−i·δ·φ) from every m-th value, the weight being smooth; zero beyond the reach of its tapers."""
    n = weight.size
    m = max(1, int(2 * pi / step / WEIGHTS_PER_TURN))
    thin = weight[(n - 1) % m // 2 :: m]
    thin = thin[: (n - 1) // m + 1]
    out = np.zeros(δ.shape, dtype=complex)
    near = np.abs(δ) < TAPER_REACH
    unique, back = np.unique(np.round(δ[near], 9), return_inverse=True)
    offset = 0.5 * step * ((n - 1) - 2 * ((n - 1) % m // 2) - m * (thin.size - 1))  # of the middles
    values = m * _Transform(thin.size, m * step, unique).forward(thin) * np.exp(1j * unique * offset)
    out[near] = values[back]
    return out


def resolved(orders, turns: float) -> np.ndarray:
    """Which orders can be told from all those named before them; (n,) → (n,) bool."""
    near = np.abs(orders[:, None] - orders[None, :]) < RESOLUTION / turns
    keep = np.ones(len(orders), dtype=bool)
    for j in np.flatnonzero(near.sum(axis=1) > 1):
        keep[j] = not np.any(near[j, :j] & keep[:j])
    return keep


def _solve(c, orders, weight, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Amplitudes from the windowed transforms c, and how much the coupling of lines widens their errors."""
    zero = np.flatnonzero(orders == 0)  # the mean has no imaginary part
    c[zero] = c[zero].real
    A, B = _hann_transforms(orders, weight.size, step)
    cosines, sines = 0.5 * (A + B), 0.5 * (A - B)  # of real and of imaginary parts, which do not mix
    sines[zero, :] = sines[:, zero] = 0.0
    sines[zero, zero] = 1.0
    (real, of_real), (imaginary, of_imaginary) = _solved(cosines, c.real), _solved(sines, c.imag)
    return real + 1j * imaginary, np.maximum(of_real, of_imaginary)


def _solved(G, c) -> tuple[np.ndarray, np.ndarray]:
    """Solution x of G·x = c, and how much the coupling widens its errors; G symmetric (n, n), positive definite unless
    lines can hardly be told apart."""
    if c.size == 0:
        return np.empty(0), np.empty(0)
    factor, failed = lapack.dpotrf(G, lower=True, clean=False)
    if failed:
        inverse = np.linalg.inv(G)
        x, own = inverse @ c, inverse.diagonal()
    else:
        x, _ = lapack.dpotrs(factor, c, lower=True)
        own = lapack.dpotri(factor, lower=True, overwrite_c=True)[0].diagonal()
    return x, np.sqrt(np.maximum(own * G.diagonal(), 1.0))


def _solve_with_gaps(c, orders, weight, step: float) -> tuple[np.ndarray, np.ndarray]:
    """The same where the record has gaps, so that real and imaginary parts mix."""
    n = len(orders)
    A = 0.5 * _gaps_transform(orders[:, None] - orders[None, :], weight, step)
    B = 0.5 * _gaps_transform(orders[:, None] + orders[None, :], weight, step)
    G = np.block([[(A + B).real, (B - A).imag], [(A + B).imag, (A - B).real]])
    for j in np.flatnonzero(orders == 0):
        G[n + j, :] = G[:, n + j] = 0.0
        G[n + j, n + j] = 1.0
        c[j] = c[j].real
    inverse = np.linalg.inv(G)
    X = inverse @ np.concatenate((c.real, c.imag))
    widening = np.sqrt(np.maximum(np.diag(inverse) * np.diag(G), 1.0))
    return X[:n] + 1j * X[n:], np.maximum(widening[:n], widening[n:])


def _floor(spectrum, orders, turns: float, per_bin: float) -> np.ndarray:
    """Mean |spectrum|² of the floor around each order, from the median of its neighbours; (m,), (n,) → (n,)."""
    offsets = np.arange(2.0, 12.0, 0.5) / turns
    around = np.concatenate((-offsets[::-1], offsets))
    bins = np.abs(np.rint((np.asarray(orders)[:, None] + around) / per_bin).astype(int))
    bins = np.where(bins >= spectrum.size, 2 * (spectrum.size - 1) - bins, bins)
    power = np.sort(power_of(spectrum[np.clip(bins, 0, spectrum.size - 1)]), axis=1)
    return (power[:, around.size // 2 - 1] + power[:, around.size // 2]) / (2 * np.log(2))


def order_lines(signal: AngleSignal, orders, parts=None) -> OrderLines:
    """Complex amplitude of each order in a signal on an even grid of pinion angle.

    orders  (n,), most wanted first
    parts   the signal as a sum of parts that were each attenuated on the way: pairs of values (m,) and of
            the attenuation at each order (n,); nothing is given back where not given
    """
    orders = np.asarray(orders, dtype=float)
    turns = signal.turns
    if turns < FEWEST_TURNS:
        raise WindowError(f"{turns:.2f} pinion turns are too few to read lines; at least {FEWEST_TURNS:g} are needed")
    n, step = signal.values.size, signal.step
    weight = window_weight(signal)
    total = weight.sum()
    turns *= total / (0.5 * n)  # what gaps leave
    keep = resolved(orders, turns)
    wanted = orders[keep]

    mean = (weight @ signal.values) / total
    x = signal.values - mean
    transform = _Transform(n, step, wanted)
    if parts is None:
        c = transform.forward(x, weight)
    else:
        c = np.zeros(wanted.size, dtype=complex)
        for values, attenuation in parts:
            c += transform.forward(values - (weight @ values) / total, weight) / np.asarray(attenuation)[keep]
    solve = _solve if signal.usable.all() else _solve_with_gaps
    X, widening = solve(c, wanted, weight, step)

    rest = x - transform.back(X)
    rest *= weight
    floor = (2 / total) ** 2 * _floor(fft.rfft(rest, signal.length), wanted, turns, signal.order_of_bin(1))
    std = np.sqrt(floor / 2) * widening
    zero = wanted == 0
    X[zero] += mean
    std[zero] = 0.5 * std[zero] * sqrt(2)

    centre = signal.start + 0.5 * (n - 1) * step
    amplitudes = np.full(orders.size, np.nan + 0j)
    amplitudes[keep] = X * np.exp(-1j * wanted * centre)
    spread = np.full(orders.size, np.nan)
    spread[keep] = std
    return OrderLines(orders=orders, amplitudes=amplitudes, std=spread)


def mesh_bands(signal: AngleSignal, teeth: int, harmonics: int = 5, sidebands: float = 2.0) -> np.ndarray:
    """RMS of each mesh harmonic with its sidebands up to ± 2 shaft orders; → (harmonics,).

    The band's edges lie two resolution steps outside the outermost sidebands, so those count in full; NaN
    where the band reaches beyond half the sampling rate.
    """
    weight = window_weight(signal)
    spectrum = signal.spectrum if signal.usable.all() else signal.spectrum_under(weight)
    margin = min(2 / signal.turns, 0.45)
    out = np.full(harmonics, np.nan)
    for k in range(1, harmonics + 1):
        low, high = k * teeth - sidebands - margin, k * teeth + sidebands + margin
        if high < pi / signal.step:
            inside = spectrum[bins_within((low, high), signal.order_of_bin, spectrum.size)]
            out[k - 1] = sqrt(2 * power_of(inside).sum() / (signal.length * (weight @ weight)))
    return out


def synchronous_average(signal: AngleSignal, period_turns: float, points: int) -> tuple[np.ndarray, int]:
    """Mean over all whole periods that the signal covers without a gap, and their number.

    period_turns  the period in pinion turns: 1 for the pinion, z2/z1 for the gear, 1/z1 for the mesh
    points        values per period, the first at an absolute angle that is a whole number of periods
    """
    angles = averaged_angles(signal.start, signal.step, signal.values.size, period_turns, points)
    position = (angles - signal.start) / signal.step
    values = at(signal.coefficients, position.ravel()).reshape(position.shape)
    return mean_of_whole(values, position, signal.usable, period_turns)


def averaged_angles(start: float, step: float, count: int, period_turns: float, points: int) -> np.ndarray:
    """Angles of all values of the whole periods within an even grid of pinion angle [rad]; (periods, points)."""
    period = 2 * pi * period_turns
    first = int(np.ceil(start / period - 1e-9))
    last = int(np.floor((start + (count - 1) * step) / period + 1e-9))
    if last <= first:
        turns = count * step / (2 * pi)
        raise WindowError(f"a synchronous average over {period_turns:g} turns needs more than {turns:.2f} turns")
    return period * (first + np.arange((last - first) * points) / points).reshape(-1, points)


def mean_of_whole(
    values: np.ndarray, position: np.ndarray, usable: np.ndarray, period_turns: float
) -> tuple[np.ndarray, int]:
    """Mean of the periods without a gap, and their number.

    values, position  of the periods (p, m), the position in samples of the record
    usable            which samples of the record are (n,)
    """
    if usable.all():
        return values.mean(axis=0), len(values)
    near = np.clip(np.rint(position).astype(int), 0, usable.size - 1)
    whole = usable[near].all(axis=1)
    if not whole.any():
        raise WindowError(f"no period of {period_turns:g} turns is without a gap")
    return values[whole].mean(axis=0), int(whole.sum())
