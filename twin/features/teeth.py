"""What differs from tooth to tooth, from the shaft lines below the mesh order.

    pattern_k = Re Σ_m X_m·exp(2πi·m·k/z)             k = 0 … z − 1, tooth 0 at absolute angle zero
    change(θ) = Re Σ_m (X_m' − X_m)·exp(i·m·θ)        m of the gear's own turn, lowest … highest
    share     = energy of the change within ± 2 tooth pitches of where it is greatest / all of it
    χ²        = Δᵀ·(cov + cov')⁻¹·Δ                   of the real and imaginary parts of the changes

X  shaft lines of one channel, (0, m, 0) or (0, 0, m), of a `Stack`
z  tooth count

A cracked tooth changes the transmission error while it carries load, two pitches either side at most; what is
spread over the turn (tooth-to-tooth wear, noise) has about 5/z of its energy there. Pitch errors are there from
the first window and stay. Angles count from edge 0 of the encoder: how the disc sits on the shaft is not known,
so tooth 0 is a mark, not a maker's number.

Source   P. D. McFadden, Mech. Syst. Signal Process. 1 (1987) 173–183 (local change in the synchronous signal);
         ISO 1328-1:2013 (single and cumulative pitch deviations)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from twin.errors import NotAvailable, ParameterError
from twin.features.synchronous import Stack

LOWEST = 3  # below are eccentricity, run-out and the encoder's graduation
NEAR = 2.0  # tooth pitches either side that a local change reaches
FINE = 16  # angles per tooth
SURROGATES = 400


@dataclass(frozen=True, slots=True, kw_only=True)
class ToothPattern:
    """A quantity at each tooth of one gear, constant part left out."""

    values: np.ndarray  # (z,) in the channel's unit
    covariance: np.ndarray  # (z, z)

    @property
    def std(self) -> np.ndarray:
        """Standard deviation at each tooth, (z,)."""
        return np.sqrt(self.covariance.diagonal())


@dataclass(frozen=True, slots=True, kw_only=True)
class LocalChange:
    """Where on a gear's turn, and how locally, its lines changed."""

    angle: float  # of the gear's own turn where the change is greatest, 0 … 2π [rad]
    tooth: int  # nearest tooth, counted from absolute angle zero
    peak: float  # change there, in the channel's unit
    share: float  # of the change's energy within two tooth pitches
    share_if_spread: float  # what a change of the same lines at random phases reaches once in a hundred
    rms: float  # of the change over the turn
    chi2: float
    freedom: int
    false_alarm: float  # probability of so great a χ² from noise alone


def _lines(stack: Stack, gear: str, lowest: int, highest: int) -> list[int]:
    """Positions in the stack of one gear's lines m = lowest … highest."""
    if gear not in ("pinion", "gear"):
        raise ParameterError(f"gear = {gear!r} is neither pinion nor gear")
    own = 1 if gear == "pinion" else 2
    chosen = [
        i for i, key in enumerate(stack.keys) if key[0] == 0 and key[3 - own] == 0 and lowest <= key[own] <= highest
    ]
    if not chosen:
        raise NotAvailable(f"no {gear} line of orders {lowest} to {highest} was read")
    return chosen


def _multiples(stack: Stack, gear: str, chosen: Sequence[int]) -> np.ndarray:
    return np.array([stack.keys[i][1 if gear == "pinion" else 2] for i in chosen])


def _teeth(stack: Stack, gear: str) -> int:
    return stack.teeth[0 if gear == "pinion" else 1]


def tooth_pattern(stack: Stack, gear: str, lowest: int = 1, highest: int | None = None) -> ToothPattern:
    """The lines of one gear laid out on its teeth.

    gear     pinion or gear
    lowest   first multiple of the gear's turn that counts (3 leaves out eccentricity and graduation)
    highest  last one; half the tooth count where not given, which is all that one value a tooth can hold
    """
    z, n = _teeth(stack, gear), len(stack.keys)
    chosen = _lines(stack, gear, lowest, z // 2 if highest is None else highest)
    angle = 2 * np.pi * np.outer(np.arange(z), _multiples(stack, gear, chosen)) / z
    T = np.concatenate((np.cos(angle), -np.sin(angle)), axis=1)
    both = [*chosen, *(n + i for i in chosen)]
    X = stack.amplitudes[chosen]
    return ToothPattern(
        values=T @ np.concatenate((X.real, X.imag)), covariance=T @ stack.covariance[np.ix_(both, both)] @ T.T
    )


def _shares(Δ, multiples, z: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Changes on a fine angle, its middle of greatest energy and the share there; (r, m) → (r, n), (r,), (r,)."""
    n = FINE * z
    spectrum = np.zeros((Δ.shape[0], n // 2 + 1), dtype=complex)
    spectrum[:, multiples] = Δ
    change = np.fft.irfft(spectrum, n, axis=1) * (n / 2)
    reach = int(NEAR * FINE)
    box = np.zeros(n)
    box[np.arange(-reach, reach + 1) % n] = 1.0
    local = np.fft.irfft(np.fft.rfft(change**2, axis=1) * np.fft.rfft(box), n, axis=1)
    middle = np.argmax(local, axis=1)
    rows = np.arange(Δ.shape[0])
    return change, middle, local[rows, middle] / np.maximum((change**2).sum(axis=1), 1e-300)


def local_change(
    before: Stack, after: Stack, gear: str = "pinion", lowest: int = LOWEST, highest: int | None = None
) -> LocalChange:
    """How one gear's lines changed between two stacks of the same channel."""
    z = _teeth(before, gear)
    top = z - 3 if highest is None else highest
    first, second = _lines(before, gear, lowest, top), _lines(after, gear, lowest, top)
    common = sorted({before.keys[i] for i in first} & {after.keys[i] for i in second})
    if not common:
        raise NotAvailable(f"no {gear} line was read both before and after")
    a, b = [before.keys.index(k) for k in common], [after.keys.index(k) for k in common]
    Δ = after.amplitudes[b] - before.amplitudes[a]
    na, nb = len(before.keys), len(after.keys)
    ia, ib = [*a, *(na + i for i in a)], [*b, *(nb + i for i in b)]
    covariance = before.covariance[np.ix_(ia, ia)] + after.covariance[np.ix_(ib, ib)]
    x = np.concatenate((Δ.real, Δ.imag))
    chi2 = float(x @ np.linalg.solve(covariance, x))
    multiples = _multiples(before, gear, a)
    (change,), (middle,), (share,) = _shares(Δ[None, :], multiples, z)
    rng = np.random.default_rng(z)
    turned = np.abs(Δ) * np.exp(2j * np.pi * rng.random((SURROGATES, Δ.size)))
    near = np.arange(middle - int(NEAR * FINE), middle + int(NEAR * FINE) + 1) % change.size
    top_at = int(near[np.argmax(np.abs(change[near]))])
    return LocalChange(
        angle=2 * np.pi * top_at / change.size,
        tooth=round(top_at / FINE) % z,
        peak=float(change[top_at]),
        share=float(share),
        share_if_spread=float(np.quantile(_shares(turned, multiples, z)[2], 0.99)),
        rms=float(np.sqrt(np.mean(change**2))),
        chi2=chi2,
        freedom=2 * len(common),
        false_alarm=float(stats.chi2.sf(chi2, 2 * len(common))),
    )


def constant_share(patterns: Sequence[ToothPattern]) -> float:
    """Share of the patterns' energy that is the same in all of them: |mean|²/mean |pattern|², 1/n for noise."""
    values = np.array([p.values for p in patterns])
    if len(values) < 2:
        raise NotAvailable(f"a constant share needs two patterns or more, not {len(values)}")
    return float(np.sum(values.mean(axis=0) ** 2) / np.mean(np.sum(values**2, axis=1)))
