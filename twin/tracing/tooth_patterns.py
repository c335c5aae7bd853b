"""Lines at whole orders of one gear's turn, below the mesh: what differs from tooth to tooth.

    X_m = R_m·Σ_k f_k·e^{−2πi·m·k/z}          lines of the transmission error at whole orders m of one gear's turn

f_k  displacement of tooth k along the line of action, or whatever tooth k does to the response      [m]
R_m  response to one tooth's unit displacement, by the harmonic balance

Pitch errors are there from the first window, constant and spread over the turn. A crack is local: what it changes lies
within two tooth pitches, at the passage of one tooth. Teeth that wear a little differently make lines that grow from
nothing with depth. The lowest orders belong to run-out and the encoder's graduation.

Source   P. D. McFadden, Mech. Syst. Signal Process. 1 (1987) 173–183
Holds    both encoders; windows that resolve the orders (8 turns and more)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from twin.effects.response import Effect
from twin.effects.size_law import CONSTANT, SizeLaw
from twin.features.window_features import WindowFeatures
from twin.thresholds import deciding

NAMES = ("pinion", "gear")
NEAR = 2.0  # tooth pitches either side that a local change reaches
FINE = 16  # angles per tooth
SURROGATES = 400


@dataclass(frozen=True, slots=True, kw_only=True)
class PatternThresholds:
    """Which lines make a gear's pattern."""

    lowest_order: tuple[int, int] = deciding(
        (3, 4),
        unit="order of the gear's own turn",
        meaning="first order of pinion and gear that counts: eccentricity and graduation are below",
        source="not derived: chosen; run-out is order 1, the graduation of the generator's discs orders 1 to 3",
    )
    highest_share: float = deciding(
        0.8,
        of="number of teeth",
        meaning="last order that counts: those near the number of teeth are the mesh line's sidebands",
        source="orders 15 and 41 of 19 and 52 teeth; not derived",
    )
    healthy_pattern: tuple[float, float] = deciding(
        (0.2, 0.1375),
        of="graduation error of the gear's disc",
        meaning="rms of the pattern of a healthy machine's pinion and gear in its first windows",
        source="measured: 0.12 and 0.22 µm on healthy campaigns of the reference rig; not verified on another",
    )
    least_lines: int = deciding(5, meaning="orders that all windows must resolve", source="not derived: chosen")
    first_windows: int = deciding(
        3,
        meaning="windows that count as the first, before teeth wear differently",
        source="not derived: chosen",
    )

    def orders(self, gear: int, teeth: tuple[int, int], lowest: int | None = None) -> range:
        """Orders of the pinion's (0) or the gear's (1) own turn."""
        return range(self.lowest_order[gear] if lowest is None else lowest, int(self.highest_share * teeth[gear]) + 1)


PATTERNS = PatternThresholds()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Pattern:
    """Lines of one gear's own orders in one window, in the model's angle."""

    revolutions: float
    orders: np.ndarray  # m (n,)
    lines: np.ndarray  # X_m complex (n,) [m]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ToothFinding:
    """Pitch errors or a crack."""

    effect: Effect
    onset: float  # revolutions
    log_evidence: float
    std: float  # of the stiffness loss; of the displacement of a tooth [m]
    rms_std: Mapping[str, float] = field(default_factory=dict)  # of the pitch errors' rms, by gear [m]
    chance: float | None = None  # of so large pitch errors by the noise of the lines alone
    tooth_std: float = 0.0  # of the cracked tooth's number
    onset_std: float | None = None  # [revolutions]; None where it was there from the start
    law: SizeLaw = CONSTANT  # of a crack
    over_healthy: float = 0.0  # energy of pitch errors' lines beyond that of a healthy machine's, over it
    detail: str


def rms_of(lines: np.ndarray) -> float:
    """RMS over a turn of lines (n,) complex."""
    return float(np.sqrt(0.5 * np.sum(np.abs(lines) ** 2)))


def pinion_orders(orders: np.ndarray, gear: int, teeth: tuple[int, int]) -> np.ndarray:
    """Orders of a gear's own turn (n,) as orders of the pinion's (n,)."""
    return orders * (1.0, teeth[0] / teeth[1])[gear]


def patterns(
    windows: Sequence[WindowFeatures],
    teeth: tuple[int, int],
    phase: float,
    gear: int,
    lowest: int | None = None,
    limits: PatternThresholds = PATTERNS,
) -> list[Pattern]:
    """Lines of the pinion (0) or the gear (1) in every window, at the orders that all of them resolve."""
    keys = [(0, m, 0) if gear == 0 else (0, 0, m) for m in limits.orders(gear, teeth, lowest)]
    shown = [(w, te) for w in windows if (te := w.transmission_error) is not None and te.unit == "m"]
    read = [dict(zip(te.keys, te.amplitudes, strict=True)) for _, te in shown]
    keys = [k for k in keys if all(k in lines for lines in read)]
    m = np.array([k[1 + gear] for k in keys], dtype=int)
    turn = np.exp(-1j * pinion_orders(m, gear, teeth) * phase / teeth[0])
    out = []
    for (w, _), lines in zip(shown, read, strict=True):
        values = np.array([lines[k] for k in keys], dtype=complex)
        out.append(Pattern(revolutions=w.revolutions or 0.0, orders=m, lines=values * turn))
    return out if m.size >= limits.least_lines else []


def tooth_shifts(z: int, m: np.ndarray, one: np.ndarray, next_one: np.ndarray) -> np.ndarray:
    """e^{∓2πi·m·k/z} for all teeth (n, z), in the sense in which the passages count them.

    one, next_one  lines (n,) of the same effect on tooth 0 and on tooth 1
    """
    forward = np.exp(-2j * np.pi * m / z)
    against = np.abs(next_one - one * forward.conj()).sum() < np.abs(next_one - one * forward).sum()
    base = forward.conj() if against else forward
    return base[:, None] ** np.arange(z)[None, :]


def local_share(change: np.ndarray, m: np.ndarray, z: int) -> tuple[float, float]:
    """Share of a change's energy within two tooth pitches, and what one of all teeth alike reaches in a hundred.

    Where every tooth differs by itself, line z − m has the phase of line m turned round: both belong together.
    """
    teeth = np.random.default_rng(z).normal(size=(SURROGATES, z))
    made = teeth @ np.exp(-2j * np.pi * np.outer(np.arange(z), m) / z)
    turned = np.abs(change) * np.exp(1j * np.angle(made))
    whole = max(rms_of(change) ** 2, 1e-300)
    (share, *others) = near_energy(np.vstack([change, turned]), m, z).max(axis=1) / whole
    return float(share), float(np.quantile(others, 0.99))


def near_energy(changes: np.ndarray, m: np.ndarray, z: int) -> np.ndarray:
    """Mean square over a turn of what changes (r, n) have within two tooth pitches of every angle; (r, FINE·z)."""
    n = FINE * z
    spectrum = np.zeros((changes.shape[0], n // 2 + 1), dtype=complex)
    spectrum[:, m] = changes
    turn = np.fft.irfft(spectrum, n, axis=1) * (n / 2)
    box = np.zeros(n)
    box[np.arange(-int(NEAR * FINE), int(NEAR * FINE) + 1) % n] = 1.0
    energy = np.fft.irfft(np.fft.rfft(turn**2, axis=1) * np.fft.rfft(box), n, axis=1) / n
    return np.maximum(energy, 0.0)
