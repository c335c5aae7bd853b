"""Ratio, transmission error and run-out of a gear pair from its two encoders alone, tooth counts unknown.

    θ1 = R·θ2 + c + Σ_w Σ_k (a_wk·cos k·θ_w + b_wk·sin k·θ_w) + Σ_j s_j·[t > t_j] + rest          k = 1, 2

R    ratio, with the sense of rotation taken out
a, b once and twice a turn of wheel w: run-out of wheel and disc, not told apart by encoders alone     [rad of wheel 1]
s_j  a step at t_j: counts that were missed                                                          [rad of wheel 1]

The rest is no white noise: teeth and torsion leave it alike over a good part of a turn. So standard deviations come
from blocks of it, drawn anew (moving-block bootstrap), and a step is believed only where it stands out of what such
blocks do.

Source   H. R. Künsch, Ann. Statist. 17 (1989) 1217–1241 (blocks);
         G. Dalpiaz, A. Rivola, R. Rubini, Meccanica 31 (1996) 433–447 (transmission error from encoders)
Holds    runs of a turn and more of either wheel; a wheel that swings back and forth gives its net angle
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from twin.errors import WindowError

HARMONICS = 2
LEAST_TURNS = 1.0  # of either wheel
MOST_EDGES = 4000  # that are fitted; more say no more
BLOCK_TURNS = 0.15  # of wheel 1: longer than what the rest stays alike over
DRAWS = 400
STEP_TESTS = 60  # places where a step is tried
STEP_LEVEL = 0.99  # share of drawn rests whose best step is smaller than a step that is believed
TEETH = range(10, 61)  # tooth counts that are tried on the ratio
SEED = 1


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Counts:
    """Counts of one quadrature encoder."""

    counts: np.ndarray  # at every sample (n,)
    illegal: int  # transitions in which both levels changed: their sense is not known
    reversals: int  # changes of the sense of rotation


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOut:
    """What comes once, or so many times, a turn of one wheel."""

    wheel: int  # 1 or 2
    multiple: int
    amplitude: float  # [rad of wheel 1]
    std: float


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PairMotion:
    """What two encoders tell of a pair."""

    ratio: float  # turns of wheel 1 for one of wheel 2
    ratio_std: float
    opposite: bool  # whether the wheels turn in opposite senses, as an external pair must
    turns: tuple[float, float]
    run_out: tuple[RunOut, ...]
    steps: tuple[tuple[float, float], ...]  # time [s] and size [rad of wheel 1] of missed counts
    largest_step: tuple[float, float, float]  # of those tried: time [s], size [rad], share of drawn rests below it
    angle: np.ndarray  # of wheel 1 at the edges that were fitted (m,) [rad]
    time: np.ndarray  # (m,) [s]
    before: np.ndarray  # rest with the ratio alone (m,) [rad of wheel 1]
    after: np.ndarray  # with everything (m,) [rad]

    @property
    def teeth(self) -> tuple[Fraction, ...]:
        """Ratios of tooth counts within two deviations, the smallest counts first."""
        near = {Fraction(b, a) for a in TEETH for b in TEETH if abs(b / a - self.ratio) < 2 * self.ratio_std}
        return tuple(sorted(near, key=lambda q: (q.numerator + q.denominator, abs(float(q) - self.ratio))))


def quadrature(a: np.ndarray, b: np.ndarray) -> Counts:
    """Fourfold counts of a quadrature encoder from its two levels, 0 or 1, (n,) each; first count 0."""
    place = np.array([0, 1, 3, 2])[2 * np.asarray(a, dtype=int) + np.asarray(b, dtype=int)]
    step = (np.diff(place) + 1) % 4 - 1
    illegal = step == 2
    step = np.where(illegal, 0, step)
    moved = step[step != 0]
    return Counts(
        counts=np.concatenate(([0], np.cumsum(step))),
        illegal=int(illegal.sum()),
        reversals=int(np.count_nonzero(np.diff(moved))),
    )


def pair_motion(first: np.ndarray, second: np.ndarray, per_turn: tuple[int, int], rate: float) -> PairMotion:
    """What two encoders tell, from counts at every sample (n,) and counts a turn.

    Raises WindowError where a wheel does not turn far enough.
    """
    turns = (float(np.ptp(first)) / per_turn[0], float(np.ptp(second)) / per_turn[1])
    if min(turns) < LEAST_TURNS:
        raise WindowError(
            f"wheels that turn {turns[0]:.2f} and {turns[1]:.2f} times tell no ratio: at least {LEAST_TURNS:g} turn "
            "of either is needed"
        )
    sense = np.sign(first[-1] - first[0]), np.sign(second[-1] - second[0])
    farthest = np.maximum.accumulate(sense[0] * first)
    edges = np.flatnonzero(np.diff(farthest) > 0) + 1  # where wheel 1 comes farther than ever: reversals leave nothing
    edges = edges[:: max(1, edges.size // MOST_EDGES)]
    θ1 = 2 * np.pi / per_turn[0] * (sense[0] * first[edges] - sense[0] * first[0])
    θ2 = 2 * np.pi / per_turn[1] * (sense[1] * second[edges] - sense[1] * second[0])
    t = edges / rate
    plain = np.stack([np.ones(t.size), θ2], axis=1)
    before = θ1 - plain @ _solve(plain, θ1)
    columns = _columns(θ1, θ2)
    fitted = _solve(columns, θ1)
    after = θ1 - columns @ fitted
    rng = np.random.default_rng(SEED)
    blocks = max(8, round(BLOCK_TURNS * 2 * np.pi / np.median(np.diff(θ1))))
    places = np.linspace(0.1, 0.9, STEP_TESTS)
    tried = [t[int(p * t.size)] for p in places]
    inverse, steps = np.linalg.pinv(columns), np.array([(t > s).astype(float) for s in tried])
    free = steps - (steps @ inverse.T) @ columns.T  # of a step, what nothing else explains
    norms = np.sqrt(np.einsum("ij,ij->i", free, free))
    sizes = np.abs(free @ after) / norms
    draws, largest = [], []
    for _ in range(DRAWS):
        rest = _drawn(after, blocks, rng)
        draws.append(fitted + inverse @ rest)
        largest.append(float(np.max(np.abs(free @ rest) / norms)))
    best = int(np.argmax(sizes))
    share = float(np.mean(np.array(largest) < sizes[best]))
    step = float(free[best] @ after / norms[best] ** 2)
    believed = share > STEP_LEVEL
    if believed:
        columns = np.concatenate((columns, steps[best][:, None]), axis=1)
        fitted = _solve(columns, θ1)
        after = θ1 - columns @ fitted
        inverse = np.linalg.pinv(columns)
        draws = [fitted + inverse @ _drawn(after, blocks, rng) for _ in range(DRAWS)]
        step = float(fitted[-1])
    std = np.std(np.array(draws), axis=0)
    # waves longer than a block are in no draw: the ratio moves by them as it does by the higher harmonics, or by the
    # step that would help most, where none is believed
    others = [_columns(θ1, θ2, 1)]
    if not believed:
        others.append(np.concatenate((columns, steps[best][:, None]), axis=1))
    ratio_std = float(np.sqrt(std[1] ** 2 + sum((fitted[1] - _solve(c, θ1)[1]) ** 2 for c in others)))
    return PairMotion(
        ratio=float(fitted[1]),
        ratio_std=ratio_std,
        opposite=bool(sense[0] != sense[1]),
        turns=turns,
        run_out=tuple(
            RunOut(
                wheel=w,
                multiple=k,
                amplitude=float(np.hypot(*fitted[i : i + 2])),
                std=float(np.sqrt(np.mean(std[i : i + 2] ** 2))),
            )
            for i, (w, k) in zip(range(2, 2 + 4 * HARMONICS, 2), _terms(HARMONICS), strict=True)
        ),
        steps=((float(tried[best]), step),) if believed else (),
        largest_step=(float(tried[best]), step, share),
        angle=θ1,
        time=t,
        before=before,
        after=after,
    )


def _terms(harmonics: int) -> Sequence[tuple[int, int]]:
    return [(w, k) for k in range(1, harmonics + 1) for w in (1, 2)]


def _columns(θ1: np.ndarray, θ2: np.ndarray, harmonics: int = HARMONICS) -> np.ndarray:
    columns = [np.ones(θ1.size), θ2]
    for w, k in _terms(harmonics):
        θ = (θ1, θ2)[w - 1]
        columns += [np.cos(k * θ), np.sin(k * θ)]
    return np.stack(columns, axis=1)


def _solve(columns: np.ndarray, values: np.ndarray) -> np.ndarray:
    return np.linalg.lstsq(columns, values, rcond=None)[0]


def _drawn(rest: np.ndarray, block: int, rng: np.random.Generator) -> np.ndarray:
    """A rest made of blocks of the given one, each with a sign of its own."""
    count = -(-rest.size // block)
    starts = rng.integers(0, rest.size - block + 1, count)
    signs = rng.choice([-1.0, 1.0], count)
    drawn = np.concatenate([s * rest[a : a + block] for a, s in zip(starts, signs, strict=True)])
    return drawn[: rest.size]
