"""What the depths so far say of the wear to come: histories that the wear rate may have had, each with its weight.

    z_i = x(N_i) + h_i·b_i + s·v_i,      x(N) = κ_0·N + ∫ W dN + c·φ(N) + U(N)

z  work of the depth that a window gave  [rad/N]          N  revolutions of the pinion
W  wander of the rate: a Wiener process of relative standard deviation g over the revolutions so far
U  irregular wear: a Wiener process of relative standard deviation u over the work so far
φ  a change of the rate that has a form: none; a trend, φ' = N/N_now; running-in, φ' = e^{−N/N_r}; a step at N_s,
   φ' = 1 from N_s on
h·b  what neighbouring depths are off by together (twin/updating/wear_points.py), correlated by e^{−|Δ ln x|/ℓ}
v  what is independent from window to window, as stated; s says how much of it there really is

A history is one choice of φ, g, u and s. All is linear in (x, κ, c), so that a history's evidence p(z | history) and
the wear now are those of a Gaussian process in closed form. The weight of a history is its prior times its evidence: a
coefficient that has kept its value for many windows is expected to keep it, and one that wanders to wander on, where
its variance grows with the revolutions ahead. The life is a mixture over the histories, each of them log-normal,

    to_go = κ·L + c·ψ(L),      var ln L = ([1, L, ψ]·P·[1, L, ψ]ᵀ + (g·κ̂)²·L³/(3·N) + (u·κ̂)²·N·L)/(L·dx/dL)²

with P the covariance of (x, κ, c) now and ψ(L) = φ(N + L) − φ(N) − φ'(N)·L.

Source   D. T. Magill, IEEE Trans. Autom. Control 10 (1965) 434–439 (a bank of filters weighted by their evidence);
         C. E. Rasmussen, C. K. I. Williams, Gaussian Processes for Machine Learning, MIT Press (2006), ch. 2, 5 and
         eq. 6.28 (integrated Wiener process); R. P. Adams, D. J. C. MacKay, arXiv:0710.3742 (a step, by its place)
Holds    for several windows of one machine; a change that no window has shown yet is not in it
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import exp, log
from typing import NamedTuple

import numpy as np

from twin.thresholds import deciding
from twin.updating.wear_points import Points


@dataclass(frozen=True, slots=True, kw_only=True)
class RateHistories:
    """Histories of the wear rate that are weighed against each other, and their priors."""

    wanders: tuple[float, ...] = deciding(
        (0.0, 0.05, 0.1, 0.2, 0.4, 0.8),
        of="the wear rate, over the revolutions so far",
        meaning="standard deviations of its wander that are weighed; those above zero are equally probable at first",
        source="derivation: steps of a factor of two, from what a depth within 2 % resolves to a doubled rate",
    )
    steady: float = deciding(
        0.8,
        meaning="probability that the rate does not wander",
        source="tuned on drawn wear histories of even seeds (benchmarks.reliability): constant and drifting rates",
    )
    irregular: tuple[float, ...] = deciding(
        (0.0, 0.004, 0.012),
        of="the work so far",
        meaning="standard deviations of irregular wear, independent from one stretch to the next, that are weighed",
        source="not derived: from below what a depth resolves to the scatter stated from window to window",
    )
    running_in: tuple[float, ...] = deciding(
        (0.05, 0.12, 0.3, 0.7),
        of="the revolutions so far",
        meaning="lengths over which running-in decays by a factor e",
        source="derivation: between the first windows and the whole of what was seen, in even ratios",
    )
    running_in_size: float = deciding(
        1.0,
        of="the mean wear rate so far",
        meaning="standard deviation of what running-in adds to the rate of new flanks",
        source="not derived: running-in takes the rate down by half within thousands of revolutions",
    )
    running_in_prior: float = deciding(
        0.3,
        meaning="probability that a pair runs in so that it can be seen",
        source="not derived: common in new pairs, and shown by the depths where it matters",
    )
    trend_size: float = deciding(
        0.5,
        of="the mean wear rate so far",
        meaning="standard deviation of a steady change of the rate over the revolutions so far",
        source="not derived: half as fast again",
    )
    trend_prior: float = deciding(
        0.1,
        meaning="probability that the rate has changed steadily",
        source="not derived: one machine in ten",
    )
    step_size: float = deciding(
        0.7,
        of="the mean wear rate so far",
        meaning="standard deviation of a sudden change of the rate",
        source="not derived: a factor of two up or down, one standard deviation",
    )
    step_prior: float = deciding(
        0.1,
        meaning="probability that the rate has changed suddenly so far",
        source="not derived: one machine in ten",
    )
    scatters: tuple[float, ...] = deciding(
        (0.25, 1.0),
        of="the stated scatter of a depth from window to window",
        meaning="shares of it that are weighed, equally probable at first",
        source="derivation: windows of constant speed and torque scatter by less than what is stated for all",
    )
    alike: float = deciding(
        3.5,
        of="ln of the work",
        meaning="distance over which depths by the encoders are off alike",
        source="as InspectionFaults.alike_fused",
    )
    most_points: int = deciding(
        16,
        unit="windows",
        meaning="windows that are weighed one by one; of more, older neighbours are merged",
        source="not derived: the time grows with the cube of it",
    )
    most_steps: int = deciding(
        8,
        unit="places",
        meaning="places of a sudden change that are weighed, between windows",
        source="not derived: the time grows with it",
    )


HISTORIES = RateHistories()
LEAST_WORK = 0.01  # of the largest: below it, distances in ln x are not resolved
HALVINGS = 40  # of the search for a life
LONGEST = log(5.0)  # ln of a history's life over that at the present rate, at most
REACHED = 1e-9  # of the revolutions so far: life of a history whose end is reached


class Lives(NamedTuple):
    """Lives of the histories to one work, (h,) each."""

    median: np.ndarray  # [revolutions]
    relative: np.ndarray  # standard deviation
    weights: np.ndarray  # their sum is 1


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class WearForecast:
    """The wear now and to come, by history; h histories."""

    revolutions: float  # N now
    mean: np.ndarray  # of (x, κ, c) now, (h, 3)
    covariance: np.ndarray  # (h, 3, 3)
    weights: np.ndarray  # (h,), their sum is 1
    wander: np.ndarray  # variance of κ per revolution, (h,)
    irregular: np.ndarray  # variance of x per revolution, (h,)
    decay: np.ndarray  # N_r of running-in, infinite where there is none, (h,)
    trend: np.ndarray  # φ″ of a trend, 0 where there is none, (h,)

    @property
    def work(self) -> float:
        """Mean work now [rad/N]."""
        return float(self.weights @ self.mean[:, 0])

    @property
    def rate(self) -> float:
        """Mean wear rate now [rad/N per revolution]."""
        return float(self.weights @ self.mean[:, 1])

    def lives(self, end: float) -> Lives:
        """Each history's life to a work; histories whose rate is not positive are left out."""
        fits = self.mean[:, 1] > 0
        now, P, to_go = self.mean[fits], self.covariance[fits], end - self.mean[fits, 0]
        form, weights = (self.decay[fits], self.trend[fits]), self.weights[fits]
        reached = to_go <= 0
        to_go = np.where(reached, REACHED * self.revolutions * now[:, 1], to_go)
        at = np.log(to_go / now[:, 1])
        low, high = at - LONGEST, at + LONGEST  # a rate that falls along a line would end at none
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            L = np.exp(middle)
            short = now[:, 1] * L + now[:, 2] * self._bent(L, *form)[0] < to_go
            low, high = np.where(short, middle, low), np.where(short, high, middle)
        L = np.exp(0.5 * (low + high))
        ψ, slope = self._bent(L, *form)
        row = np.stack([np.ones_like(L), L, ψ], axis=1)
        var = np.einsum("hi,hij,hj->h", row, P, row) + self.wander[fits] * L**3 / 3 + self.irregular[fits] * L
        growth = np.maximum(now[:, 1] + now[:, 2] * slope, exp(-LONGEST) * to_go / L) * L
        relative = np.where(reached, 0.0, np.sqrt(np.maximum(var, 0.0)) / growth)
        return Lives(median=L, relative=relative, weights=weights / weights.sum())

    def _bent(self, ahead: np.ndarray, decay: np.ndarray, trend: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """ψ and dψ/dL at revolutions ahead, (h,) each: a step is over, running-in and a trend go on."""
        runs = np.isfinite(decay)
        Nr = np.where(runs, decay, 1.0)
        now = np.where(runs, np.exp(-self.revolutions / Nr), 0.0)
        left = np.exp(-ahead / Nr)
        return now * (Nr * (1 - left) - ahead) + 0.5 * trend * ahead**2, now * (left - 1) + trend * ahead


def forecast_of(points: Points, revolutions: float, histories: RateHistories = HISTORIES) -> WearForecast | None:
    """The wear at a count of revolutions not before the last point, and to come; None before the first worn window."""
    if not points or not points[-1].work > 0 or not points[-1].revolutions > 0:
        return None
    N, z, shared, own = _merged(points, histories.most_points)
    now = max(revolutions, float(N[-1]))
    mean_rate = float(z[-1] / N[-1])
    forms, grid = _forms(N, now, histories), _grid(min(histories.most_steps, N.size - 1), histories)
    covariance = _prior(N, now, mean_rate, forms, grid)
    wander, irregular = (grid.wander * mean_rate) ** 2 / now, (grid.irregular * mean_rate) ** 2 * now
    x = np.log(np.maximum(z, LEAST_WORK * z.max()))
    alike = np.exp(-np.abs(x[:, None] - x[None]) / histories.alike)
    n = N.size
    S = covariance[:, :n, :n] + np.outer(shared, shared) * alike + (grid.scatter**2)[:, None, None] * np.diag(own**2)
    seen = covariance[:, :n, n:]
    left = np.broadcast_to((z - mean_rate * N)[None, :, None], (grid.form.size, n, 1))
    root = np.linalg.cholesky(S)
    white = np.linalg.solve(root, np.concatenate([left, seen], axis=2))
    left, seen = white[:, :, 0], white[:, :, 1:]
    evidence = -0.5 * (left**2).sum(axis=1) - np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
    logs = evidence + np.log(grid.prior)
    weights = np.exp(logs - logs.max())
    return WearForecast(
        revolutions=now,
        mean=np.einsum("hni,hn->hi", seen, left) + np.array([mean_rate * now, mean_rate, 0.0]),
        covariance=covariance[:, n:, n:] - np.einsum("hni,hnj->hij", seen, seen),
        weights=weights / weights.sum(), wander=wander, irregular=irregular, decay=forms.decay[grid.form],
        trend=forms.trend[grid.form],
    )  # fmt: skip


class _Grid(NamedTuple):
    """One history a row, (h,) each."""

    form: np.ndarray
    wander: np.ndarray  # g
    irregular: np.ndarray  # u
    scatter: np.ndarray  # s
    prior: np.ndarray


@lru_cache(maxsize=32)
def _grid(steps: int, histories: RateHistories) -> _Grid:
    """All histories; forms other than the plain one have every second g and u."""
    decays = len(histories.running_in)
    step = histories.step_prior if steps else 0.0
    plain = 1 - histories.running_in_prior - histories.trend_prior - step
    forms = [plain, histories.trend_prior, *[histories.running_in_prior / decays] * decays]
    forms += [step / steps] * steps if steps else []
    wanders = np.array(histories.wanders)
    share = np.full(wanders.size, (1 - histories.steady) / (wanders.size - 1))
    share[0] = histories.steady
    cells = []
    for form, prior in enumerate(forms):
        each = slice(None, None, 2 if form else None)
        irregular = histories.irregular[each]
        each_share = share[each] / share[each].sum()
        cells += [
            (form, g, u, s, prior * p / len(irregular) / len(histories.scatters))
            for g, p in zip(wanders[each].tolist(), each_share.tolist(), strict=True)
            for u in irregular
            for s in histories.scatters
        ]
    table = np.array(cells).T
    return _Grid(table[0].astype(int), *table[1:])


class _Forms(NamedTuple):
    """Changes of the rate that have a form, m of them."""

    windows: np.ndarray  # φ at the windows (m, n)
    now: np.ndarray  # φ now (m,)
    slope: np.ndarray  # φ' now (m,)
    size: np.ndarray  # standard deviation of c over the mean rate (m,)
    decay: np.ndarray  # N_r, infinite where there is none (m,)
    trend: np.ndarray  # φ″ of a trend, 0 where there is none (m,)


def _forms(N: np.ndarray, now: float, histories: RateHistories) -> _Forms:
    decays = now * np.array(histories.running_in)
    between = 0.5 * (N[1:] + N[:-1])
    kept = min(histories.most_steps, between.size)
    places = between[np.linspace(0, between.size - 1, kept).round().astype(int)] if kept else np.zeros(0)
    counts = np.append(N, now)
    φ = np.concatenate(
        [
            np.zeros((1, counts.size)),
            counts[None] ** 2 / (2 * now),
            -decays[:, None] * np.expm1(-counts / decays[:, None]),
            np.maximum(counts - places[:, None], 0.0),
        ]
    )
    return _Forms(
        windows=φ[:, :-1],
        now=φ[:, -1],
        slope=np.concatenate([[0.0, 1.0], np.exp(-now / decays), np.ones(places.size)]),
        size=np.repeat(
            [0.0, histories.trend_size, histories.running_in_size, histories.step_size],
            [1, 1, decays.size, places.size],
        ),
        trend=np.concatenate([[0.0, 1 / now], np.zeros(decays.size + places.size)]),
        decay=np.concatenate([[np.inf, np.inf], decays, np.full(places.size, np.inf)]),
    )


def _prior(N: np.ndarray, now: float, mean_rate: float, forms: _Forms, grid: _Grid) -> np.ndarray:
    """Covariance of the works at the windows and of (x, κ, c) now before anything was measured, (h, n + 3, n + 3).

    κ_0 is known within a factor of two, one standard deviation.
    """
    f, n = grid.form, N.size
    counts = np.append(N, now)  # works at the windows, and now
    early, late = np.minimum(counts[:, None], counts), np.maximum(counts[:, None], counts)
    φ, slope = np.concatenate([forms.windows, forms.now[:, None]], axis=1)[f], forms.slope[f]
    c2 = (forms.size[f] * mean_rate) ** 2
    wander, irregular = (grid.wander * mean_rate) ** 2 / now, (grid.irregular * mean_rate) ** 2 * now
    out = np.zeros((f.size, n + 3, n + 3))
    out[:, : n + 1, : n + 1] = (
        mean_rate**2 * np.outer(counts, counts)
        + wander[:, None, None] * (early**2 * (3 * late - early) / 6)
        + irregular[:, None, None] * early
        + c2[:, None, None] * φ[:, :, None] * φ[:, None, :]
    )
    rate = mean_rate**2 * counts + wander[:, None] * (counts**2 / 2) + (c2 * slope)[:, None] * φ
    out[:, n + 1, : n + 1] = out[:, : n + 1, n + 1] = rate
    out[:, n + 2, : n + 1] = out[:, : n + 1, n + 2] = c2[:, None] * φ
    out[:, n + 1, n + 1] = mean_rate**2 + wander * now + c2 * slope**2
    out[:, n + 1, n + 2] = out[:, n + 2, n + 1] = c2 * slope
    out[:, n + 2, n + 2] = c2
    return out


def _merged(points: Points, most: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Revolutions, work, shared and own standard deviation (n,) each; older neighbours merged where there are many."""
    table = np.array([(p.revolutions, p.work, p.shared_std, p.own_std) for p in points])
    while len(table) > most:
        pairs = min(len(table) - most, max(len(table) // 4, 1))
        old, new = table[: 2 * pairs].reshape(pairs, 2, 4), table[2 * pairs :]
        both = old.mean(axis=1)
        both[:, 3] = 0.5 * np.hypot(old[:, 0, 3], old[:, 1, 3])
        table = np.concatenate([both, new])
    return table[:, 0], table[:, 1], table[:, 2], table[:, 3]
