"""Ratio, transmission error and run-out of a gear pair from its two encoders alone, tooth counts unknown.

    θ1 = R·θ2 + c + Σ_w Σ_k (a_wk·cos k·θ_w + b_wk·sin k·θ_w) + Σ_j s_j·[t > t_j] + rest          k = 1, 2

R    ratio, turns of wheel 1 for one of wheel 2
θ_w  angle of wheel w at the edges of wheel 1, its own angle from the times of its edges                   [rad]
a, b once and twice a turn of wheel w: run-out of wheel and disc, not told apart by encoders alone     [rad of wheel 1]
s_j  a step at t_j: counts that were missed                                                          [rad of wheel 1]

The rest is no white noise: teeth and torsion leave it alike over a good part of a turn. So standard deviations come
from blocks of it, drawn anew (moving-block bootstrap), and a step is believed only where it stands out of what such
blocks do. Two terms that come as often within less than a turn are fitted together and said to be not told apart.

Edges are those of the forward sense: one is passed where the wheel comes farther than ever, so that a stretch that is
taken back and passed again counts once. Forward is the sense in which the wheel turns on the whole.

Source   H. R. Künsch, Ann. Statist. 17 (1989) 1217–1241 (blocks);
         G. Dalpiaz, A. Rivola, R. Rubini, Meccanica 31 (1996) 433–447 (transmission error from encoders)
Holds    runs of a turn and more of either wheel, through run-up and stop; a wheel that swings gives its net angle
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from twin.errors import WindowError
from twin.windows import Edges

HARMONICS = 2
LEAST_TURNS = 1.0  # of either wheel
LEAST_EDGES = 16  # a turn: two harmonics with room to spare
MOST_EDGES = 4000  # that are fitted; more say no more
BLOCK_TURNS = 0.15  # of wheel 1: longer than what the rest stays alike over
DRAWS = 400
STEP_TESTS = 60  # places where a step is tried
STEP_LEVEL = 0.99  # share of drawn rests whose best step is smaller than a step that is believed
NEARLY = 0.9  # of the largest step tried: others as large could as well be there
TEETH = range(10, 61)  # tooth counts that are tried on the ratio
SEED = 1


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Counts:
    """Counts of one quadrature encoder."""

    counts: np.ndarray  # at every sample (n,)
    illegal: int  # transitions in which both levels changed: a count was missed, and its sense is not known
    filled: int  # of those, taken for two counts in the sense of the counts before and behind; the others count nothing
    reversals: int  # changes of the sense of rotation


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Forward:
    """The edges that a wheel passed in the sense in which it turned on the whole."""

    times: np.ndarray  # of each edge after the first sample, rising (m,) [s]
    sense: int  # 1 where the counts rise, −1 where they fall
    taken_back: int  # counts gone back


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOut:
    """What comes once, or so many times, a turn of one wheel."""

    wheel: int  # 1 or 2
    multiple: int
    amplitude: float  # [rad of wheel 1]
    std: float
    alike: tuple[tuple[int, int], ...]  # wheel and multiple of terms that come as often within less than a turn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PairMotion:
    """What two encoders tell of a pair."""

    ratio: float  # turns of wheel 1 for one of wheel 2
    ratio_std: float
    turns: tuple[float, float]
    run_out: tuple[RunOut, ...]
    steps: tuple[tuple[float, float], ...]  # time [s] and size [rad of wheel 1] of missed counts
    largest_step: tuple[float, float, float]  # of those tried: time [s], size [rad], share of drawn rests below it
    angle: np.ndarray  # of wheel 1 at the edges that were fitted, from the first of them (m,) [rad]
    time: np.ndarray  # (m,) [s]
    before: np.ndarray  # rest with the ratio alone (m,) [rad of wheel 1]
    after: np.ndarray  # with everything (m,) [rad]

    @property
    def teeth(self) -> tuple[Fraction, ...]:
        """Ratios of tooth counts within two deviations, the smallest counts first."""
        near = {Fraction(b, a) for a in TEETH for b in TEETH if abs(b / a - self.ratio) < 2 * self.ratio_std}
        return tuple(sorted(near, key=lambda q: (q.numerator + q.denominator, abs(float(q) - self.ratio))))


def quadrature(a: np.ndarray, b: np.ndarray) -> Counts:
    """Fourfold counts of a quadrature encoder from its two levels, 0 or 1, (n,) each; first count 0.

    Counts rise where b leads a.
    """
    place = np.array([0, 1, 3, 2])[2 * np.asarray(a, dtype=int) + np.asarray(b, dtype=int)]
    step = (np.diff(place) + 1) % 4 - 1
    illegal = np.flatnonzero(step == 2)
    step[illegal] = 0
    moved = np.flatnonzero(step)
    if moved.size and illegal.size:
        behind = np.searchsorted(moved, illegal)
        inside = (behind > 0) & (behind < moved.size)
        before = step[moved[np.maximum(behind - 1, 0)]]
        after = step[moved[np.minimum(behind, moved.size - 1)]]
        step[illegal] = np.where(inside & (before == after), 2 * before, 0)
    return Counts(
        counts=np.concatenate(([0], np.cumsum(step))),
        illegal=illegal.size,
        filled=int(np.count_nonzero(step[illegal])),
        reversals=int(np.count_nonzero(np.diff(np.sign(step[step != 0])))),
    )


def forward_edges(counts: np.ndarray, rate: float) -> Forward:
    """Edges from counts at every sample (n,) and the sampling rate [Hz], each half-way between two samples.

    Two counts between the same samples stand at a quarter and three quarters of the way. Raises WindowError where the
    wheel has no net turn.
    """
    net = int(counts[-1] - counts[0])
    if net == 0:
        raise WindowError("the counts end where they began: a wheel that does not turn on has no forward sense")
    sense = 1 if net > 0 else -1
    ahead = sense * (counts - counts[0])
    passed = np.diff(np.maximum.accumulate(ahead))
    at = np.flatnonzero(passed)
    number = passed[at]
    within = np.arange(number.sum()) - np.repeat(np.cumsum(number) - number, number)
    times = (np.repeat(at, number) + (within + 0.5) / np.repeat(number, number)) / rate
    return Forward(times=times, sense=sense, taken_back=int(-np.minimum(np.diff(ahead), 0).sum()))


def pair_motion(first: Edges, second: Edges) -> PairMotion:
    """What two encoders tell, from the times of their edges; lost edges are NaN.

    Raises WindowError where a wheel does not turn far enough, or has too few edges a turn.
    """
    (t1, φ1), (t2, φ2) = _passed(first), _passed(second)
    turns = tuple(float(np.ptp(φ)) / (2 * np.pi) if φ.size else 0.0 for φ in (φ1, φ2))
    if min(turns) < LEAST_TURNS:
        raise WindowError(
            f"wheels that turn {turns[0]:.2f} and {turns[1]:.2f} times tell no ratio: at least {LEAST_TURNS:g} turn "
            "of either is needed"
        )
    if min(first.per_rev, second.per_rev) < LEAST_EDGES:
        raise WindowError(
            f"{first.per_rev} and {second.per_rev} edges a turn tell no run-out: at least {LEAST_EDGES} of either "
            "wheel are needed"
        )
    both = np.flatnonzero((t1 >= t2[0]) & (t1 <= t2[-1]))
    if both.size < LEAST_EDGES:
        raise WindowError("the wheels do not turn at the same time: encoders of two machines, or clocks apart?")
    both = both[:: max(1, both.size // MOST_EDGES)]
    t, θ1 = t1[both], φ1[both]
    θ2 = np.interp(t, t2, φ2)
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
    # waves longer than a block are in no draw: the ratio moves by them as it does by the higher harmonics, or, where no
    # step is believed, by one of those that would help most
    moved = [fitted[1] - _solve(_columns(θ1, θ2, 1), θ1)[1]]
    if not believed:
        shifts = (inverse[1] @ steps.T) * (free @ after) / norms**2
        moved.append(np.abs(shifts[sizes >= NEARLY * sizes[best]]).max())
    ends = sum((1 / (n.per_rev * turn)) ** 2 for n, turn in zip((first, second), turns, strict=True))  # an edge each
    spread = std[1] ** 2 + fitted[1] ** 2 * ends + sum(m**2 for m in moved)
    return PairMotion(
        ratio=float(fitted[1]),
        ratio_std=float(np.sqrt(spread)),
        turns=(turns[0], turns[1]),
        run_out=tuple(
            RunOut(
                wheel=w,
                multiple=k,
                amplitude=float(np.hypot(*fitted[i : i + 2])),
                std=float(np.sqrt(np.mean(std[i : i + 2] ** 2))),
                alike=_alike((w, k), fitted[1], turns[0]),
            )
            for i, (w, k) in zip(range(2, 2 + 4 * HARMONICS, 2), _terms(HARMONICS), strict=True)
        ),
        steps=((float(tried[best]), step),) if believed else (),
        largest_step=(float(tried[best]), step, share),
        angle=θ1 - θ1[0],
        time=t,
        before=before,
        after=after,
    )


def _passed(edges: Edges) -> tuple[np.ndarray, np.ndarray]:
    """Times of the edges that are there (m,) [s], and the wheel's angle at each, from a whole turn (m,) [rad]."""
    good = np.flatnonzero(np.isfinite(edges.times))
    return edges.times[good], (edges.first_index % edges.per_rev + good) * (2 * np.pi / edges.per_rev)


def _alike(term: tuple[int, int], ratio: float, turns: float) -> tuple[tuple[int, int], ...]:
    """Terms that in so many turns of wheel 1 come within one as often."""

    def often(wheel: int, multiple: int) -> float:
        return multiple * turns / (1 if wheel == 1 else ratio)

    return tuple(o for o in _terms(HARMONICS) if o != term and abs(often(*o) - often(*term)) < 1)


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
