"""What the depths so far say of the wear to come: histories that the wear rate may have had, each with its weight.

    z_i = x(N_i) + h_i·b_i + q·z_i·1(i ≥ j) + s·v_i,      x(N) = κ_0·N + ∫ W dN + c·φ(N) + U(N)

z  work of the depth that a window gave  [rad/N]          N  revolutions of the pinion
W  wander of the rate: a Wiener process of relative standard deviation g over the revolutions so far
U  irregular wear: a Wiener process of relative standard deviation u over the work so far
φ  a change of the rate that has a form: none; a trend, φ' = N/N_now; a power, φ' = (N/N_now)^{p−1}; running-in,
   φ' = e^{−N/N_r}; a step at N_s, φ' = 1 from N_s on
q  a shift of all depths from window j on: an effect that has set in and is not in the model; none in most histories
h·b  what neighbouring depths are off by together (twin/updating/wear_points.py), correlated by e^{−|Δ ln x|/ℓ}
v  what is independent from window to window, as stated; s says how much of it there really is

A history is one choice of φ, g, u and s. All is linear in (x, κ, c), so that a history's evidence p(z | history) and
the wear now are those of a Gaussian process in closed form. The weight of a history is its prior times its evidence: a
coefficient that has kept its value for many windows is expected to keep it, and one that wanders to wander on, where
its variance grows with the revolutions ahead. Running-in and a power have c > 0, or new flanks would wear more slowly
and a rate end at none: their evidence is taken times P(c > 0 | z)/P(c > 0), exact for a prior that ends at zero.
The life is a mixture over the histories, each of them log-normal,

    to_go = κ·L + c·ψ(L),      var ln L = ([1, L, ψ]·P·[1, L, ψ]ᵀ + (g·κ̂)²·L³/(3·N) + (u·κ̂)²·N·L)/(L·dx/dL)²

with P the covariance of (x, κ, c) now and ψ(L) = φ(N + L) − φ(N) − φ'(N)·L. A trend is damped ahead,
φ'(N + L) = φ'(N) + (D/N)·(1 − e^{−L/D}), and changes the rate by a factor, c → κ·(e^{c·D/(N·κ)} − 1)·N/D: a rate that
falls along a line would end at none.

Source   D. T. Magill, IEEE Trans. Autom. Control 10 (1965) 434–439 (a bank of filters weighted by their evidence);
         C. E. Rasmussen, C. K. I. Williams, Gaussian Processes for Machine Learning, MIT Press (2006), ch. 2, 5 and
         eq. 6.28 (integrated Wiener process); R. P. Adams, D. J. C. MacKay, arXiv:0710.3742 (a step, by its place);
         E. S. Gardner, E. McKenzie, Management Science 31 (1985) 1237–1246 (damped trends)
Holds    for several windows of one machine; a change that no window has shown yet is not in it
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import exp, log
from typing import NamedTuple

import numpy as np
from scipy.special import log_ndtr

from twin.roots import rising_roots
from twin.updating.rate_histories import HISTORIES, RateHistories, forms_of, grid_of
from twin.updating.wear_points import Points

LEAST_WORK = 0.01  # of the largest: below it, distances in ln x are not resolved
LONGEST = log(5.0)  # ln of a history's life over that at the present rate, at most
KEPT = 8  # forecasts and lives: the answer and the stages of one window ask for the same
LEAST_WEIGHT = 1e-4  # histories below it change no quantile that is stated
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
    power: np.ndarray  # p of a change as N^p, 1 where there is none, (h,)
    damping: float  # D, revolutions over which a trend fades

    @property
    def work(self) -> float:
        """Mean work now [rad/N]."""
        return float(self.weights @ self.mean[:, 0])

    @property
    def rate(self) -> float:
        """Mean wear rate now [rad/N per revolution]."""
        return float(self.weights @ self.mean[:, 1])

    @lru_cache(maxsize=KEPT)  # noqa: B019 (few, and compared by identity)
    def lives(self, end: float) -> Lives:
        """Lives to a work of the histories that count; those whose rate is not positive are left out."""
        fits = self.mean[:, 1] > 0
        fits &= self.weights > LEAST_WEIGHT * self.weights[fits].sum()
        now, P, to_go = self.mean[fits], self.covariance[fits], end - self.mean[fits, 0]
        form, weights = (self.decay[fits], self.trend[fits], self.power[fits]), self.weights[fits]
        c, by_c = self._ahead(now[:, 1], now[:, 2], form[1])
        reached = to_go <= 0
        to_go = np.where(reached, REACHED * self.revolutions * now[:, 1], to_go)
        at = np.log(to_go / now[:, 1])

        def worn(logs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            L = np.exp(logs)
            ψ, slope = self._bent(L, *form)
            return (now[:, 1] * L + c * ψ) / to_go - 1, (now[:, 1] + c * slope) * L / to_go

        # a rate that falls along a line would end at none
        L = np.exp(rising_roots(worn, at, at - LONGEST, at + LONGEST))
        ψ, slope = self._bent(L, *form)
        row = np.stack([np.ones_like(L), L, by_c * ψ], axis=1)
        var = np.einsum("hi,hij,hj->h", row, P, row) + self.wander[fits] * L**3 / 3 + self.irregular[fits] * L
        growth = np.maximum(now[:, 1] + c * slope, exp(-LONGEST) * to_go / L) * L
        relative = np.where(reached, 0.0, np.sqrt(np.maximum(var, 0.0)) / growth)
        return Lives(median=L, relative=relative, weights=weights / weights.sum())

    def _ahead(self, rate: np.ndarray, c: np.ndarray, trend: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """c as it counts ahead, and its derivative by c: a trend goes on as a factor of the rate."""
        far = trend * self.damping  # what a trend adds to the rate in the end, over c
        ratio = np.clip(far * c / rate, -LONGEST, LONGEST)
        follows = far > 0
        over = np.where(follows, far, 1.0)
        return np.where(follows, rate * np.expm1(ratio) / over, c), np.where(follows, np.exp(ratio), 1.0)

    def _bent(
        self, ahead: np.ndarray, decay: np.ndarray, trend: np.ndarray, power: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """ψ and dψ/dL at revolutions ahead, (h,) each: a step is over, all other changes go on."""
        runs = np.isfinite(decay)
        Nr = np.where(runs, decay, 1.0)
        now = np.where(runs, np.exp(-self.revolutions / Nr), 0.0)
        left = np.exp(-ahead / Nr)
        D = self.damping
        faded = -np.expm1(-ahead / D)
        longer = 1 + ahead / self.revolutions
        return (
            now * (Nr * (1 - left) - ahead)
            + trend * D * (ahead - D * faded)
            + self.revolutions * (longer**power - 1) / power
            - ahead,
            now * (left - 1) + trend * D * faded + longer ** (power - 1) - 1,
        )


@lru_cache(maxsize=KEPT)
def forecast_of(points: Points, revolutions: float, histories: RateHistories = HISTORIES) -> WearForecast | None:
    """The wear at a count of revolutions not before the last point, and to come; None before the first worn window."""
    if not points or not points[-1].work > 0 or not points[-1].revolutions > 0:
        return None
    N, z, shared, own = _merged(points, histories.most_points)
    now = max(revolutions, float(N[-1]))
    mean_rate = float(z[-1] / N[-1])
    forms, grid = forms_of(N, now, histories), grid_of(min(histories.most_steps, N.size - 1), histories)
    wander, irregular = (grid.wander * mean_rate) ** 2 / now, (grid.irregular * mean_rate) ** 2 * now
    sizes = forms.size * mean_rate
    changes = sizes[:, None] * forms.windows + histories.shift_size * z * forms.shifted  # of the works, by b
    prior = _prior(np.append(N, now), mean_rate, wander, irregular)  # of the works at the windows, x and κ now
    n, S = N.size, prior[:, : N.size, : N.size]
    x = np.log(np.maximum(z, LEAST_WORK * z.max()))
    S = S + np.outer(shared, shared) * np.exp(-np.abs(x[:, None] - x) / histories.alike)
    S += (grid.scatter**2)[:, None, None] * np.diag(own**2)
    root = np.linalg.cholesky(S)
    columns = np.concatenate([(z - mean_rate * N)[:, None], changes.T], axis=1)
    columns = np.broadcast_to(columns, (len(S), *columns.shape))
    white = np.linalg.solve(root, np.concatenate([prior[:, :n, n:], columns], axis=2))
    seen, left, bent = white[:, :, :2], white[:, :, 2:3], white[:, :, 3:]
    form, choice = grid.form, grid.choice
    evidence = -0.5 * (left**2).sum(axis=(1, 2)) - np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
    told = (bent**2).sum(axis=1)[choice, form]  # of b by the windows, over what was known of it before
    b = (left * bent).sum(axis=1)[choice, form] / (1 + told)
    ahead = sizes * np.stack([forms.now, forms.slope, np.ones(sizes.size)])  # of (x, κ, c) by b
    by_b = ahead[:, form].T
    by_b[:, :2] -= (seen.transpose(0, 2, 1) @ bent)[choice, :, form]
    mean, covariance = np.zeros((len(S), 3)), np.zeros((len(S), 3, 3))
    mean[:, :2] = np.array([mean_rate * now, mean_rate]) + (seen * left).sum(axis=1)
    covariance[:, :2, :2] = prior[:, n:, n:] - seen.transpose(0, 2, 1) @ seen
    logs = evidence[choice] + 0.5 * b**2 * (1 + told) - 0.5 * np.log1p(told) + np.log(grid.prior)
    signed = (np.isfinite(forms.decay) | (forms.power != 1.0))[form]
    logs[signed] += log_ndtr((b * np.sqrt(1 + told))[signed]) + log(2.0)  # P(c > 0 | z)/P(c > 0)
    weights = np.exp(logs - logs.max())
    return WearForecast(
        revolutions=now,
        mean=mean[choice] + b[:, None] * by_b,
        covariance=covariance[choice] + (by_b[:, :, None] * by_b[:, None, :]) / (1 + told)[:, None, None],
        weights=weights / weights.sum(), wander=wander[choice], irregular=irregular[choice], decay=forms.decay[form],
        trend=forms.trend[form], power=forms.power[form], damping=histories.trend_damping * now,
    )  # fmt: skip


def _prior(counts: np.ndarray, mean_rate: float, wander: np.ndarray, irregular: np.ndarray) -> np.ndarray:
    """Covariance of the works at counts of revolutions and of the rate at the last, before anything was measured.

    (k, n + 1, n + 1) for wander and irregular wear (k,). κ_0 is known within a factor of two, one standard deviation.
    """
    early, late = np.minimum(counts[:, None], counts), np.maximum(counts[:, None], counts)
    out = np.empty((wander.size, counts.size + 1, counts.size + 1))
    out[:, :-1, :-1] = (
        mean_rate**2 * np.outer(counts, counts)
        + wander[:, None, None] * (early**2 * (3 * late - early) / 6)
        + irregular[:, None, None] * early
    )
    out[:, -1, :-1] = out[:, :-1, -1] = mean_rate**2 * counts + wander[:, None] * (counts**2 / 2)
    out[:, -1, -1] = mean_rate**2 + wander * counts[-1]
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
