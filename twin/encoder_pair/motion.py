"""Ratio, transmission error and run-out of a gear pair from its two encoders alone, tooth counts unknown.

    θ1 = R·θ2 + c + Σ_w Σ_k (a_wk·cos k·θ_w + b_wk·sin k·θ_w) + Σ_j s_j·[t > t_j] + rest          k = 1, 2

R    ratio, turns of wheel 1 for one of wheel 2
θ_w  angle of wheel w at the edges of wheel 1, its own angle from the times of its edges                   [rad]
a, b once and twice a turn of wheel w: run-out of wheel and disc, which encoders cannot separate       [rad of wheel 1]
s_j  a step at t_j: counts that were missed                                                          [rad of wheel 1]

The remainder is no white noise: teeth and torsion correlate it over a good part of a turn, and the fit has removed its
components at the fitted orders. Standard deviations therefore come from remainders drawn with its spectrum, at the
fitted orders as strong as where it is strongest near them. Steps are found by `jumps.py`. Two terms whose counts differ
by less than one in the window are fitted together and reported as indistinguishable.

Edges are those of the forward sense: an edge is passed where the wheel gets farther than ever before, so that a stretch
that is turned back and passed again counts once. Forward is the sense of the net rotation.

    S(o) = |Σ_n w_n·rest_n·e^{−i·o·θ_n}|²/Σw²         o > o_f;        largest S of o_f … 2·o_f, smoothed, at and below

o    order of wheel 1, o_f the highest that is fitted; w Hann's window

Source   S. Prichard, J. Theiler, Phys. Rev. Lett. 73 (1994) 951–954 (rests drawn with a given spectrum);
         G. Dalpiaz, A. Rivola, R. Rubini, Meccanica 31 (1996) 433–447 (transmission error from encoders)
Holds    runs of a turn and more of either wheel, through run-up and stop; a wheel that swings gives its net angle. What
         the remainder has more strongly below o_f than above is attributed to run-out
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from twin.encoder_pair.jumps import Jump, jumps_of
from twin.errors import WindowError
from twin.thresholds import deciding
from twin.windows import Edges

HARMONICS = 2
MOST_EDGES = 4000  # that are fitted, unless fewer than KEPT_EDGES a turn would be left
KEPT_EDGES = 32
MOST_TURNS = 400.0  # of wheel 1 that are fitted, the first of a window; more say no more
NEAR_FITTED = 2.0  # times the highest fitted order: up to there the remainder shows its strength at the fitted ones
SMOOTHED = 0.8  # orders that its spectrum is averaged over there
DRAWS = 400
TEETH = range(10, 61)  # tooth counts that are tried on the ratio
SEED = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class PairThresholds:
    """When two encoders determine the motion of a pair."""

    least_turns: float = deciding(
        1.0, unit="turns", meaning="rotation of either wheel from which a ratio is given",
        source="derivation: run-out cannot be separated from the ratio on less than its own period",
    )  # fmt: skip
    least_edges: int = deciding(
        16, unit="edges", meaning="edges in a turn of the faster wheel from which run-out is given",
        source="derivation: two harmonics need four, with a factor of four to spare",
    )  # fmt: skip
    lasting: float = deciding(
        0.5, of="sharp step", meaning="difference of a missed count's lasting size from its size at its place",
        source="not derived",
    )  # fmt: skip


DEFAULT = PairThresholds()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Counts:
    """Counts of one quadrature encoder."""

    counts: np.ndarray  # at every sample (n,)
    illegal: int  # transitions in which both levels changed: a count was missed, and its sense is not known
    filled: int  # of those, counted as two in the sense of the counts before and after; the others count nothing
    reversals: int  # changes of the sense of rotation


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Forward:
    """The edges that a wheel passed in the sense in which it turned on the whole."""

    times: np.ndarray  # of each edge after the first sample, rising (m,) [s]
    sense: int  # 1 where the counts rise, −1 where they fall
    reversed_counts: int  # counts in the opposite sense


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
    """The motion of a pair as its two encoders show it."""

    ratio: float  # turns of wheel 1 for one of wheel 2
    ratio_std: float
    turns: tuple[float, float]
    run_out: tuple[RunOut, ...]
    steps: tuple[tuple[float, float], ...]  # time [s] and size [rad of wheel 1] of missed counts
    jumps: tuple[Jump, ...]  # sharp steps that are no missed counts, or may be something else; indices of `time`
    angle: np.ndarray  # of wheel 1 at the edges that were fitted, from the first of them (m,) [rad]
    time: np.ndarray  # (m,) [s]
    before: np.ndarray  # rest with the ratio alone (m,) [rad of wheel 1]
    after: np.ndarray  # with everything (m,) [rad]

    @property
    def teeth(self) -> tuple[Fraction, ...]:
        """Ratios of tooth counts within two deviations, the smallest counts first."""
        near = {Fraction(b, a) for a in TEETH for b in TEETH if abs(b / a - self.ratio) < 2 * self.ratio_std}
        return tuple(sorted(near, key=lambda q: (q.numerator + q.denominator, abs(float(q) - self.ratio))))


def ratio_moved(ratio: float, jump: Jump) -> float:
    """By how much the ratio would be another, were a wheel's sharp step counts that are missed there every turn."""
    every = 1.0 if jump.wheel == 2 else ratio  # of them for each turn of wheel 2
    return -jump.size / (2 * np.pi) * every


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
    return Forward(times=times, sense=sense, reversed_counts=int(-np.minimum(np.diff(ahead), 0).sum()))


def pair_motion(first: Edges, second: Edges, limits: PairThresholds = DEFAULT) -> PairMotion:
    """The motion of a pair from the times of the edges of its encoders; lost edges are NaN.

    Raises WindowError where a wheel does not turn far enough, or has too few edges a turn.
    """
    (t1, φ1), (t2, φ2) = _passed(first), _passed(second)
    turns = tuple(float(np.ptp(φ)) / (2 * np.pi) if φ.size else 0.0 for φ in (φ1, φ2))
    if min(turns) < limits.least_turns:
        raise WindowError(
            f"wheels that turn {turns[0]:.2f} and {turns[1]:.2f} times do not determine a ratio: at least "
            f"{limits.least_turns:g} turn of either is needed"
        )
    faster = first.per_rev * min(1.0, turns[0] / turns[1])  # edges of wheel 1 in a turn of the faster one
    if min(faster, second.per_rev) < limits.least_edges:
        raise WindowError(
            f"{first.per_rev} and {second.per_rev} edges a turn do not determine run-out: at least "
            f"{limits.least_edges} in a turn of the faster wheel are needed"
        )
    both = np.flatnonzero((t1 >= t2[0]) & (t1 <= t2[-1]))
    if both.size < 2 or np.ptp(φ1[both]) < 2 * np.pi * limits.least_turns:
        raise WindowError(
            f"the wheels do not turn at the same time for {limits.least_turns:g} turn: encoders of two machines, or "
            "clocks that differ?"
        )
    both = both[: round(MOST_TURNS * first.per_rev)]
    both = both[:: max(1, min(both.size // MOST_EDGES, int(faster / KEPT_EDGES)))]
    t, θ1 = t1[both], φ1[both]
    θ2 = np.interp(t, t2, φ2)
    turned = float(np.ptp(θ1)) / (2 * np.pi)
    plain = np.stack([np.ones(t.size), θ2], axis=1)
    before = θ1 - plain @ _solve(plain, θ1)
    columns, rng = _columns(θ1, θ2), np.random.default_rng(SEED)
    fitted, after, rests = _fitted(columns, θ1, turned, rng)
    jumps = jumps_of(after, rests, (θ1, θ2), turned, 2 * np.pi * max(1 / first.per_rev, fitted[1] / second.per_rev))
    steps = {j: (np.arange(t.size) >= j.index).astype(float) for j in jumps if j.missed}
    steps = _lasting(columns, steps, θ1, limits)
    if steps:
        columns = np.concatenate((columns, np.stack(list(steps.values()), axis=1)), axis=1)
        fitted, after, rests = _fitted(columns, θ1, turned, rng)
    std = np.std(rests @ np.linalg.pinv(columns).T, axis=0)
    unassigned = [j for j in jumps if j.wheel is None and j not in steps]
    spread = std[1] ** 2 + _beyond_draws(columns, fitted[1], θ1, θ2, jumps, unassigned)
    spread += fitted[1] ** 2 * sum(
        (1 / (n.per_rev * turn)) ** 2 / 6 for n, turn in zip((first, second), turns, strict=True)
    )  # of half an edge at either end
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
                alike=_alike((w, k), fitted[1], turned),
            )
            for i, (w, k) in zip(range(2, 2 + 4 * HARMONICS, 2), _terms(HARMONICS), strict=True)
        ),
        steps=tuple(
            (float(t[j.index]), float(size)) for j, size in zip(steps, fitted[2 + 4 * HARMONICS :], strict=True)
        ),
        jumps=tuple(j for j in jumps if j not in steps),
        angle=θ1 - θ1[0],
        time=t,
        before=before,
        after=after,
    )


def _beyond_draws(
    columns: np.ndarray,
    ratio: float,
    θ1: np.ndarray,
    θ2: np.ndarray,
    jumps: Sequence[Jump],
    unassigned: Sequence[Jump],
) -> float:
    """Variance of the ratio that drawn remainders do not contain.

    Higher harmonics of the run-out, sharp steps that may be miscounts, and recurring steps of a wheel, were they
    miscounts.
    """
    steps = [(np.arange(θ1.size) >= j.index)[:, None] for j in unassigned]
    moved = (
        ratio - _solve(_columns(θ1, θ2, 1), θ1)[1],
        ratio - _solve(np.concatenate((columns, *steps), axis=1), θ1)[1],
        *(ratio_moved(ratio, j) for j in jumps if j.wheel is not None),
    )
    return sum(m**2 for m in moved)


def _fitted(
    columns: np.ndarray, θ1: np.ndarray, turns: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The fit (k,), its remainder (n,), and remainders drawn with the same spectrum (DRAWS, n)."""
    fitted = _solve(columns, θ1)
    after = θ1 - columns @ fitted
    return fitted, after, _drawn(after, turns, fitted[1], rng)


def _lasting(
    columns: np.ndarray, steps: dict[Jump, np.ndarray], θ1: np.ndarray, limits: PairThresholds
) -> dict[Jump, np.ndarray]:
    """The sharp steps that last: fitted together they are as large as they are sharp."""
    if not steps:
        return steps
    sizes = _solve(np.concatenate((columns, np.stack(list(steps.values()), axis=1)), axis=1), θ1)[columns.shape[1] :]
    return {j: c for (j, c), size in zip(steps.items(), sizes, strict=True) if abs(size / j.size - 1) < limits.lasting}


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


def _drawn(rest: np.ndarray, turns: float, ratio: float, rng: np.random.Generator) -> np.ndarray:
    """Remainders (DRAWS, n) with the spectrum of the given one (n,), at the fitted orders as strong as near them."""
    n = rest.size
    weight = np.hanning(n)
    spectrum = np.abs(np.fft.rfft(weight * (rest - rest.mean()), 2 * n)) ** 2 / (weight @ weight)
    order = np.arange(spectrum.size) / (2 * turns)
    highest = HARMONICS * max(1.0, 1 / ratio) + 1 / turns
    near = (order > highest) & (order < NEAR_FITTED * highest)
    width = max(1, round(2 * turns * SMOOTHED))
    smooth = np.convolve(spectrum, np.ones(width) / width, "same")
    spectrum[order <= highest] = smooth[near].max() if near.any() else smooth.max()  # none: most edges are lost
    size = np.sqrt(n * spectrum)  # of the components of a draw twice as long, of which one half is used
    out = np.empty((DRAWS, n))
    for row in out:
        row[:] = np.fft.irfft(size * (rng.normal(size=size.size) + 1j * rng.normal(size=size.size)), 2 * n)[:n]
    return out
