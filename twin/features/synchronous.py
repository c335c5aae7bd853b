"""Lines synchronous with pinion, gear and hunting tooth, from several windows together by absolute count.

    x_w(θ) = Re Σ_j X_j·exp(i·o_j·θ) + Re Σ_l Y_wl·exp(i·o_l·θ) + noise        window w, Hann weight, all at once

θ    absolute pinion angle: edge counts never stop, so a line keeps its phase from one window to the next   [rad]
X    lines that all windows share                                           complex, peak
Y    lines of each window alone (what grows with wear: mesh lines, the mean), eliminated window by window
o    orders of pinion rotation, of keys (k, p, g): k·z1 + p + g·z1/z2; those with p and g belong to the
     hunting period of z2/gcd(z1, z2) pinion turns

    (Σ_w s_w⁻²·S_w)·X = Σ_w s_w⁻²·r_w,      S = G_XX − G_XY·G_YY⁻¹·G_YX       (Schur complement of the lines Y)
    cov X_jk = σ_j·σ_k·κ·(Σ_w S_w)⁻¹,       κ = Σw²/Σw

A window of 25 turns does not resolve orders closer than 1/20; the phases between windows hundreds of turns apart
do. A line that the windows leave less than a tenth of its own after those named before it is unresolved.

Source   D. C. Rife, R. R. Boorstyn, Bell Syst. Tech. J. 55 (1976) 1389–1410 (multiple tones);
         N. R. Lomb, Astrophys. Space Sci. 39 (1976) 447–462 (one phase over gaps)
Holds    shared lines constant over the windows; both encoders' counts never lost between them
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import gcd

import numpy as np
from scipy import fft, linalg

from twin.errors import NotAvailable, WindowError
from twin.features.angle import AngleTrack
from twin.features.lines import mesh_keys, order_of, shaft_keys
from twin.features.orders import _floor, _Transform, _window_transform, window_weight
from twin.features.resample import AngleSignal, on_angle, spline_response
from twin.features.transmission_error import transmission_error
from twin.features.window_features import Key
from twin.windows import Samples, Window

LEAST_LEFT = 0.1  # share of a line's own weight that the lines before it must leave
LEAST_TURNS = 3.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """One channel of one window on an even grid of angle, and what interpolation left of each order."""

    signal: AngleSignal
    parts: Callable  # orders (n,) → pairs of values (m,) and attenuation (n,)
    unit: str


def sampled_reading(samples: Samples, track: AngleTrack, unit: str) -> Reading:
    """Reading of an accelerometer or a torque meter."""
    signal, per_turn = on_angle(samples, track)
    return Reading(signal=signal, parts=lambda o: [(signal.values, spline_response(o / per_turn))], unit=unit)


def transmission_error_reading(
    window: Window, track: AngleTrack, teeth: tuple[int, int], base_radius: float | None
) -> Reading:
    """Reading of the transmission error, from both encoders."""
    missing = [s for s in ("pinion", "gear") if s not in window.encoders]
    if missing:
        raise NotAvailable(f"transmission error is not available: no encoder on the {' and the '.join(missing)}")
    te = transmission_error(window.encoders["pinion"], window.encoders["gear"], teeth, base_radius, track)

    def parts(orders):
        h1, h2 = te.responses(orders)
        return [(te.pinion.values, h1), (-te.gear.values, h2)]

    return Reading(signal=te.signal, parts=parts, unit=te.unit)


@dataclass(frozen=True, slots=True, kw_only=True)
class Stack:
    """Lines of one channel that several windows share, and those of each window."""

    unit: str
    teeth: tuple[int, int]
    keys: tuple[Key, ...]
    orders: np.ndarray  # (n,)
    amplitudes: np.ndarray  # (n,) complex, peak, phase at absolute pinion angle zero
    covariance: np.ndarray  # (2n, 2n) of the real parts, then the imaginary parts
    unresolved: tuple[Key, ...]  # nearly held by lines named before them
    own_keys: tuple[Key, ...]
    own_amplitudes: np.ndarray  # (windows, m) complex
    noise: np.ndarray  # (windows, n) std of re and im that each window's floor gives a lone line
    misfit: float  # mean residual power at the shared orders over the floor beside them: near 1 for many windows of
    # constant lines, less for few (one window's own lines leave nothing)

    def get(self, key: Key) -> complex | None:
        """The amplitude of one shared line; None where it was not resolved."""
        return complex(self.amplitudes[self.keys.index(key)]) if key in self.keys else None

    def std(self, key: Key) -> float:
        """Standard deviation of the real or the imaginary part, the larger."""
        j, n = self.keys.index(key), len(self.keys)
        variance = self.covariance.diagonal()
        return float(np.sqrt(max(variance[j], variance[n + j])))


def tooth_keys(teeth: tuple[int, int]) -> list[Key]:
    """Pinion and gear orders below the mesh order and its sidebands: what differs from tooth to tooth."""
    return shaft_keys(teeth, teeth[0] - 3)


def own_mesh_keys(teeth: tuple[int, int], harmonics: int = 3) -> list[Key]:
    """The mean and the mesh harmonics with two sidebands of each shaft, which each window has for itself."""
    return [(0, 0, 0), *mesh_keys(harmonics, harmonics)]


def hunting_key(multiple: int, teeth: tuple[int, int]) -> Key:
    """The key (0, p, g) of a multiple of the hunting frequency, gcd(z1, z2)/z2 of the pinion's."""
    d = gcd(*teeth)
    z1, z2 = teeth[0] // d, teeth[1] // d
    g = multiple * pow(z1, -1, z2) % z2 if z2 > 1 else 0
    g -= z2 if g > z2 // 2 else 0
    return (0, (multiple - g * z1) // z2, g)


def _block(A, B) -> np.ndarray:
    """The real form of X → A·X + B·conj(X); (n, m) twice → (2n, 2m)."""
    return np.block([[(A + B).real, (B - A).imag], [(A + B).imag, (A - B).real]])


@dataclass(frozen=True, slots=True, kw_only=True)
class _Part:
    """One window's normal equations at absolute angle, in real form, and what its residual needs."""

    reading: Reading
    weight: np.ndarray
    mean: float
    transform: _Transform
    turn: np.ndarray  # exp(i·o·centre), (n,)
    G: np.ndarray  # (2n, 2n)
    r: np.ndarray  # (2n,)
    turns: float


def _part(reading: Reading, orders) -> _Part:
    signal = reading.signal
    if signal.turns < LEAST_TURNS:
        raise WindowError(f"{signal.turns:.2f} pinion turns are too few to read lines; at least {LEAST_TURNS:g} needed")
    n, step = signal.values.size, signal.step
    gaps = not signal.usable.all()
    weight = window_weight(signal)
    total = weight.sum()
    transform = _Transform(n, step, orders)
    c = np.zeros(orders.size, dtype=complex)
    for values, attenuation in reading.parts(orders):
        c += transform.forward(weight * (values - (weight @ values) / total)) / np.asarray(attenuation)
    turn = np.exp(1j * orders * (signal.start + 0.5 * (n - 1) * step))
    A = 0.5 * _window_transform(orders[:, None] - orders[None, :], weight, step, gaps)
    B = 0.5 * _window_transform(orders[:, None] + orders[None, :], weight, step, gaps)
    G = _block(turn.conj()[:, None] * A * turn, turn.conj()[:, None] * B * turn.conj())
    c = c * turn.conj()
    for j in np.flatnonzero(orders == 0):  # the mean has no imaginary part
        G[orders.size + j, :] = G[:, orders.size + j] = 0.0
        G[orders.size + j, orders.size + j] = 1.0
        c[j] = c[j].real
    return _Part(
        reading=reading,
        weight=weight,
        mean=float((weight @ signal.values) / total),
        transform=transform,
        turn=turn,
        G=G,
        r=np.concatenate((c.real, c.imag)),
        turns=signal.turns * total / (0.5 * n),
    )


def _halves(index, n: int) -> np.ndarray:
    return np.concatenate((index, index + n))


def _eliminate(part: _Part, shared, own) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Schur complement of a window's own lines: S, r, and G_YY⁻¹·G_YX and G_YY⁻¹·r_Y for the way back."""
    if own.size == 0:
        empty = np.zeros((0, shared.size))
        return part.G[np.ix_(shared, shared)], part.r[shared], empty, np.zeros(0)
    factor = linalg.cho_factor(part.G[np.ix_(own, own)])
    coupling = part.G[np.ix_(own, shared)]
    back, rest = linalg.cho_solve(factor, coupling), linalg.cho_solve(factor, part.r[own])
    S = part.G[np.ix_(shared, shared)] - coupling.T @ back
    return 0.5 * (S + S.T), part.r[shared] - coupling.T @ rest, back, rest


def _told_apart(H, alone) -> np.ndarray:
    """Which lines keep a tenth of what they would have alone after all kept before them; (2n, 2n), (2n,) → (n,)."""
    n = H.shape[0] // 2
    scale = np.sqrt(alone)
    R = H / np.outer(scale, scale)
    keep = np.zeros(n, dtype=bool)
    for j in range(n):
        pair = [j, n + j]
        block = R[np.ix_(pair, pair)]
        if np.linalg.eigvalsh(block)[0] < LEAST_LEFT:
            continue
        keep[j] = True
        R = R - R[:, pair] @ np.linalg.solve(block, R[pair, :])
    return keep


def _residual(part: _Part, X) -> np.ndarray:
    """Power spectrum, scaled to line amplitude squared, of what the lines X (n,) leave of a window."""
    signal = part.reading.signal
    rest = part.weight * (signal.values - part.mean - part.transform.back(X * part.turn))
    length = fft.next_fast_len(rest.size, real=True)
    return np.abs(fft.rfft(rest, length)) ** 2 * (2 / part.weight.sum()) ** 2


def stack(readings: Sequence[Reading], keys: Sequence[Key], teeth: tuple[int, int], own: Sequence[Key] = ()) -> Stack:
    """Lines that several windows of one channel share, most wanted first, beside lines of each window's own.

    readings  one a window, on absolute angles of one zero
    keys      shared lines
    own       lines fitted for each window by itself; none of the shared ones
    """
    if not readings:
        raise NotAvailable("synchronous lines are not available: no window")
    keys, own = list(dict.fromkeys(keys)), [k for k in dict.fromkeys(own) if k not in set(keys)]
    own = _apart(own, teeth, min(r.signal.turns for r in readings))
    orders = np.array([order_of(k, teeth) for k in (*keys, *own)])
    parts = [_part(r, orders) for r in readings]
    n, m = len(keys), len(own)
    eliminated = [_eliminate(p, _halves(np.arange(n), n + m), _halves(np.arange(n, n + m), n + m)) for p in parts]
    keep = _told_apart(sum(S for S, *_ in eliminated), sum(p.G.diagonal()[_halves(np.arange(n), n + m)] for p in parts))
    if not keep.any():
        raise NotAvailable("synchronous lines are not available: the windows tell none of them apart")
    chosen = _halves(np.flatnonzero(keep), n)

    weights = np.ones(len(parts))
    for _ in range(2):  # the second time each window weighs by its own floor
        H = sum(a * S[np.ix_(chosen, chosen)] for a, (S, *_) in zip(weights, eliminated, strict=True))
        x = np.zeros(2 * n)
        x[chosen] = linalg.solve(H, sum(a * r[chosen] for a, (_, r, *_) in zip(weights, eliminated, strict=True)))
        Y = np.array([rest - back @ x for *_, back, rest in eliminated])
        X = [np.concatenate((x[:n] + 1j * x[n:], y[:m] + 1j * y[m:])) for y in Y]
        power = [_residual(p, a) for p, a in zip(parts, X, strict=True)]
        floor = np.array([_around(p, s, orders[:n][keep]) for p, s in zip(parts, power, strict=True)])
        weights = 1 / np.median(floor, axis=1) / np.array([p.weight @ p.weight / p.weight.sum() ** 2 for p in parts])
        weights = np.where(np.isfinite(weights), weights, 1.0) / max(float(np.max(weights)), 1e-300)
        weights = np.maximum(weights, 1e-12)

    H = sum(a * S[np.ix_(chosen, chosen)] for a, (S, *_) in zip(weights, eliminated, strict=True))
    # noise of the right-hand side: each window's floor through its own weight, κ·σ²·S
    inverse = linalg.inv(H)
    middle = np.zeros_like(H)
    for a, (S, *_), p, f in zip(weights, eliminated, parts, floor, strict=True):
        σ = np.tile(np.sqrt(f / 4) * p.weight.sum() / np.sqrt(p.weight @ p.weight), 2)
        κ = (p.weight @ p.weight) / p.weight.sum()
        middle += a**2 * κ * np.outer(σ, σ) * S[np.ix_(chosen, chosen)]
    covariance = inverse @ middle @ inverse
    at = [power[i][_bins(p, orders[:n][keep], power[i].size)] for i, p in enumerate(parts)]
    for y, p, j in ((y, p, j) for y, p in zip(Y, parts, strict=True) for j in range(m) if own[j] == (0, 0, 0)):
        y[j] += p.mean
    return Stack(
        unit=readings[0].unit,
        teeth=teeth,
        keys=tuple(k for k, ok in zip(keys, keep, strict=True) if ok),
        orders=orders[:n][keep],
        amplitudes=(x[:n] + 1j * x[n:])[keep],
        covariance=0.5 * (covariance + covariance.T),
        unresolved=tuple(k for k, ok in zip(keys, keep, strict=True) if not ok),
        own_keys=tuple(own),
        own_amplitudes=Y[:, :m] + 1j * Y[:, m:],
        noise=np.sqrt(floor / 2),
        misfit=float(np.mean(np.array(at) / floor)),
    )


def _apart(keys: Sequence[Key], teeth: tuple[int, int], turns: float) -> list[Key]:
    """Keys of one window's own lines that lie 1.2/turns or more from those named before them."""
    out: list[Key] = []
    for key in keys:
        if all(abs(order_of(key, teeth) - order_of(k, teeth)) >= 1.2 / turns for k in out):
            out.append(key)
    return out


def _bins(part: _Part, orders, size: int) -> np.ndarray:
    length = fft.next_fast_len(part.weight.size, real=True)
    at = np.rint(np.asarray(orders) * length * part.reading.signal.step / (2 * np.pi)).astype(int)
    return np.clip(at, 0, size - 1)


def _around(part: _Part, power, orders) -> np.ndarray:
    length = fft.next_fast_len(part.weight.size, real=True)
    return _floor(power, orders, part.turns, 2 * np.pi / (length * part.reading.signal.step))
