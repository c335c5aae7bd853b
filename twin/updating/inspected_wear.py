"""Wear from windows and inspections together: a linear Gaussian estimate in closed form.

    x_{j+1} = x_j + κ_j·ΔN,      κ_{j+1} = κ_j + w_κ,      b_{j+1} = ρ·b_j + w_b,      ρ = exp(−|Δ ln x|/ℓ)
    z_j = x_j + h_j·b_j + v_j   (a window)               y_i = x(N_i) + v_i   (an inspection)

x  work, cumulative  [rad/N]     κ  wear rate  [rad/N per revolution]     N  revolutions of the pinion
b  what the depths of one method are off by together, in standard deviations: N(0, 1), alike at neighbouring depths
ℓ  how far, in ln x, depths are alike in it

A Kalman filter takes windows and inspections in the order of their revolutions, whenever they were entered, so an
inspection of an earlier time counts as of that time. b, κ and x are estimated together: an inspection moves the depth,
the rate and what all depths are off by, each as far as its own uncertainty allows.

A doubt D of the windows' method beyond its own scatter (a calibration in question, an estimated rig) is one factor
e^{−s} on all its works, s ~ N(0, D²): the estimate is a mixture over s, each s with the windows rescaled, so that the
growth from window to window is known as well as it was measured.

Either side may be wrong beyond what it states: an effect that the twin lacks shifts all its depths; an inspection can
be of another tooth, flank or count. Each of these faults, one at a time, is a case with a prior probability, a factor
common to all windows or an inspection of a wide standard deviation; the cases are weighted by their likelihoods:

    p(x, κ | all) = Σ_c P(c | all)·N(x, κ; m_c, P_c)

Without inspections the answer is that of the windows (x_w, κ_w, of the latest window and the track), which smooth less
than this filter does (m_0, P_0). As far as the inspections add nothing, their answer is kept:

    x = m_c + P_c/P_0c·(x_w − m_0)

Source   R. E. Kalman, J. Basic Eng. 82 (1960) 35–45; S. J. Press in: Experimental Inductive Reasoning, Oxford (1997):
         contradicting measurements as a mixture of those with and without an undeclared error
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import erf, exp, hypot, log, pi, sqrt

import numpy as np

from twin.thresholds import deciding
from twin.updating.memory import RatePrior
from twin.updating.tracker import RATE, RateDrift, WearTrack
from twin.updating.wear_points import Points, WearPoint


@dataclass(frozen=True, slots=True, kw_only=True)
class InspectionFaults:
    """How far windows are off together, and how probable it is that a window's or an inspection's depth is wrong."""

    alike_fused: float = deciding(
        3.5,
        of="ln of the work",
        meaning="distance over which depths by the encoders are off alike",
        source="tuned on the fresh campaigns without rattle: the correlation of errors falls to 0.83 over a factor of "
        "2.7 in depth",
    )
    alike_rms: float = deciding(
        1.0,
        of="ln of the work",
        meaning="distance over which depths by the RMS are off alike",
        source="tuned on the same: it falls to 0.65 over a factor of 1.9, to 0.2 over a factor of 2.7",
    )
    windows_wrong: float = deciding(
        0.03,
        meaning="probability that the depths of the windows are off by more than they state",
        source="the same campaigns without attribution: 7 of 212 worn windows were off by more than three "
        "standard deviations",
    )
    inspection_wrong: float = deciding(
        0.03,
        meaning="probability that an inspection is off by more than it states",
        source="not derived: as that of the windows, so that one contradiction decides for neither side",
    )
    spread: float = deciding(
        0.5,
        of="ln of the depth",
        meaning="standard deviation of a depth that is off by more than it states",
        source="not derived: wide enough for an undeclared misalignment, whose depths were up to 88 % too large",
    )
    contradiction: float = deciding(
        3.0,
        of="joint standard deviation of windows and inspection",
        meaning="difference from which an inspection is said to contradict the twin",
        source="derivation: three standard deviations, one inspection in 370 by chance",
    )


FAULTS = InspectionFaults()
LEAST_SHARE = 0.01  # of the largest work: below it, distances in ln x are not resolved


@dataclass(frozen=True, slots=True, kw_only=True)
class InspectedWork:
    """One inspection as a work."""

    revolutions: float
    work: float  # y [rad/N]
    std: float  # [rad/N]


@dataclass(frozen=True, slots=True, kw_only=True)
class Agreement:
    """One inspection against the windows alone."""

    work: float  # by the windows, at its revolutions [rad/N]
    work_std: float
    difference: float  # windows less inspection, in joint standard deviations
    contradicts: bool


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Belief:
    """x, κ and b with their covariance; then x and κ as they were at one earlier count, once that was passed."""

    revolutions: float
    mean: np.ndarray  # (3,) or (5,)
    covariance: np.ndarray  # (3, 3) or (5, 5)
    windows: int = 0
    log_likelihood: float = 0.0  # of all that was measured

    def carried(self, revolutions: float, drift: float, alike: float) -> Belief:
        """Carried on to a later count; κ wanders by `drift`, relative, on the way."""
        n = revolutions - self.revolutions
        x, κ = float(self.mean[0]), float(self.mean[1])
        P = self.covariance.copy()
        P[1, 1] += (drift * κ) ** 2 if self.windows else 0.0
        ρ = exp(-_distance(x, x + n * κ) / alike)
        F = np.eye(self.mean.size)
        F[0, 1], F[2, 2] = n, ρ
        P = F @ P @ F.T
        P[2, 2] += 1 - ρ**2
        return replace(self, revolutions=revolutions, mean=F @ self.mean, covariance=P)

    def innovation(self, measured: float, shared: float, std: float) -> tuple[float, float]:
        """What a measure differs by from what is expected, and the standard deviation of that."""
        H = self._row(shared)
        return measured - float(H @ self.mean), sqrt(float(H @ self.covariance @ H) + std**2)

    def corrected(self, measured: float, shared: float, std: float, *, window: bool) -> Belief:
        """After a measured work with its standard deviation; `shared` is h, 0 for an inspection."""
        surprise, s = self.innovation(measured, shared, std)
        H = self._row(shared)
        gain = self.covariance @ H / s**2
        mean = self.mean + gain * surprise
        mean[1] = max(mean[1], RATE.least * self.mean[1])
        rest = np.eye(mean.size) - np.outer(gain, H)
        P = rest @ self.covariance @ rest.T + std**2 * np.outer(gain, gain)  # stays positive, whatever is rounded
        return replace(
            self, mean=mean, covariance=P, windows=self.windows + window,
            log_likelihood=self.log_likelihood - 0.5 * (surprise / s) ** 2 - log(s),
        )  # fmt: skip

    def remembered(self) -> Belief:
        """The belief with its present x and κ kept, to be estimated on by what was measured later."""
        kept = np.eye(3)[[0, 1, 2, 0, 1]]
        return replace(self, mean=kept @ self.mean, covariance=kept @ self.covariance @ kept.T)

    @property
    def kept(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean (2,) and covariance (2, 2) of x and κ at the count that was kept."""
        return self.mean[3:], self.covariance[3:, 3:]

    def _row(self, shared: float) -> np.ndarray:
        H = np.zeros(self.mean.size)
        H[0], H[2] = 1.0, shared
        return H


def _distance(before: float, after: float) -> float:
    """How far two works are apart in ln x."""
    if not after > 0:
        return 0.0
    return abs(log(after / max(before, LEAST_SHARE * after)))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class InspectedWear:
    """Wear now, from windows and inspections: a mixture of its cases."""

    revolutions: float
    weights: tuple[float, ...]  # of the cases, their sum is 1
    beliefs: tuple[Belief, ...]
    agreements: tuple[Agreement, ...]  # one an inspection, in the order given
    windows_wrong: float  # probability that the windows are off by more than they state

    def work_quantile(self, probability: float) -> float:
        """The work below which the true one lies with a probability [rad/N]."""
        means = [float(b.kept[0][0]) for b in self.beliefs]
        stds = [sqrt(max(float(b.kept[1][0, 0]), 0.0)) for b in self.beliefs]
        low = min(m - 9 * s for m, s in zip(means, stds, strict=True))
        high = max(m + 9 * s for m, s in zip(means, stds, strict=True))
        for _ in range(80):
            middle = 0.5 * (low + high)
            below = sum(
                w * 0.5 * (1 + erf((middle - m) / (s * sqrt(2)))) if s > 0 else w * (middle >= m)
                for w, m, s in zip(self.weights, means, stds, strict=True)
            )
            low, high = (middle, high) if below < probability else (low, middle)
        return 0.5 * (low + high)

    @property
    def track(self) -> WearTrack:
        """Mean and covariance of the mixture."""
        w = np.array(self.weights)
        means = np.array([b.kept[0] for b in self.beliefs])
        mean = w @ means
        P = sum(
            weight * (b.kept[1] + np.outer(m - mean, m - mean))
            for weight, b, m in zip(w, self.beliefs, means, strict=True)
        )
        return WearTrack(
            revolutions=self.revolutions, work=float(mean[0]), rate=float(mean[1]),
            var_work=float(P[0, 0]), cov=float(P[0, 1]), var_rate=float(P[1, 1]), windows=self.beliefs[0].windows,
        )  # fmt: skip


def wear_with_inspections(
    points: Points,
    inspections: Sequence[InspectedWork],
    prior: RatePrior,
    by_windows: WearTrack,
    alike: float,
    doubt: float = 0.0,
    faults: InspectionFaults = FAULTS,
    drift: RateDrift = RATE,
) -> InspectedWear:
    """The wear at the count of revolutions of `by_windows`, from windows and inspections.

    prior       κ before the first worn window: of the rig file, or of the pair before
    by_windows  work and rate without inspections
    alike       ℓ, of the method that gave the points
    doubt       D, relative
    """
    problem = _Problem(points, tuple(inspections), prior, alike, doubt, drift)
    agreements = tuple(problem.agreement(own, faults) for own in inspections)
    cases = problem.as_stated(agreements)
    if any(a.contradicts for a in agreements):
        cases += problem.windows_wrong(agreements, faults) if points else []
        cases += problem.inspection_wrong(agreements, faults)
    beliefs = [problem.estimated(by_windows.revolutions, case) for case in cases]
    logs = np.array([case.log_prior + b.log_likelihood for case, b in zip(cases, beliefs, strict=True)])
    weights = np.exp(logs - logs.max())
    weights /= weights.sum()
    return InspectedWear(
        revolutions=by_windows.revolutions,
        weights=tuple(weights.tolist()),
        beliefs=tuple(
            b if case.windows_wrong else problem.continued(b, case, by_windows)
            for case, b in zip(cases, beliefs, strict=True)
        ),
        agreements=agreements,
        windows_wrong=float(sum(w for w, case in zip(weights, cases, strict=True) if case.windows_wrong)),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Case:
    """What may be wrong: nothing, the windows' depths by a common factor, or one inspection."""

    log_prior: float
    factor: float = 1.0  # true work over that of the windows
    windows_wrong: bool = False  # the factor is beyond what the windows state
    wrong: int | None = None  # number of the inspection
    std: float = 0.0  # its standard deviation then [rad/N]


NOTHING_WRONG = _Case(log_prior=0.0)
NODES, NODE_WEIGHTS = np.polynomial.hermite_e.hermegauss(5)


@dataclass(frozen=True, slots=True)
class _Problem:
    """Windows and inspections, and the filter over them."""

    points: Points
    inspections: tuple[InspectedWork, ...]
    prior: RatePrior
    alike: float
    doubt: float
    drift: RateDrift

    def estimated(self, at: float, case: _Case = NOTHING_WRONG, *, inspected: bool = True) -> Belief:
        """Everything in the order of its revolutions; x and κ at a count are kept."""
        prior = np.diag([0.0, self.prior.std**2, 1.0])
        points = self.points if case.factor == 1.0 else [p.rescaled(case.factor) for p in self.points]
        belief = Belief(revolutions=0.0, mean=np.array([0.0, self.prior.rate, 0.0]), covariance=prior)
        events: list[tuple[float, WearPoint | tuple[int, InspectedWork]]] = [(p.revolutions, p) for p in points]
        events += [(own.revolutions, (i, own)) for i, own in enumerate(self.inspections) if inspected]
        kept = False
        for count, event in sorted(events, key=lambda e: e[0]):
            if count > at and not kept:
                belief, kept = self._carried(belief, at).remembered(), True
            if isinstance(event, WearPoint):
                belief = self._with_window(belief, event)
            else:
                number, own = event
                std = case.std if number == case.wrong else own.std
                belief = self._carried(belief, count).corrected(own.work, 0.0, std, window=False)
        return belief if kept else self._carried(belief, at).remembered()

    def continued(self, belief: Belief, case: _Case, by_windows: WearTrack) -> Belief:
        """A belief that goes over into the windows' own answer as far as the inspections add nothing."""
        alone = self.estimated(by_windows.revolutions, replace(case, wrong=None), inspected=False)
        left = np.diag(belief.kept[1]) / np.maximum(np.diag(alone.kept[1]), 1e-300)
        shift = case.factor * np.array([by_windows.work, by_windows.rate]) - alone.kept[0]
        mean = belief.mean.copy()
        mean[3:] += np.clip(left, 0.0, 1.0) * shift
        mean[4] = max(mean[4], RATE.least * belief.mean[4])
        return replace(belief, mean=mean)

    def agreement(self, own: InspectedWork, faults: InspectionFaults) -> Agreement:
        """An inspection against the windows alone, those after it too."""
        mean, covariance = self.estimated(own.revolutions, inspected=False).kept
        std = hypot(sqrt(max(float(covariance[0, 0]), 0.0)), self.doubt * float(mean[0]))
        difference = (float(mean[0]) - own.work) / hypot(std, own.std)
        return Agreement(
            work=float(mean[0]), work_std=std, difference=difference,
            contradicts=abs(difference) > faults.contradiction,
        )  # fmt: skip

    def as_stated(self, agreements: Sequence[Agreement]) -> list[_Case]:
        """The case of nothing wrong; with a doubt of the windows, nodes over the factor that it leaves open."""
        nodes = list(self._factors(agreements, self.doubt)) if self.points and self.doubt > 0 else []
        return [_Case(log_prior=weight, factor=factor) for weight, factor in nodes] or [NOTHING_WRONG]

    def windows_wrong(self, agreements: Sequence[Agreement], faults: InspectionFaults) -> list[_Case]:
        """Cases of a factor e^{−s} common to all windows that is beyond what they state."""
        return [
            _Case(log_prior=log(faults.windows_wrong) + weight, factor=factor, windows_wrong=True)
            for weight, factor in self._factors(agreements, faults.spread)
        ]

    def _factors(self, agreements: Sequence[Agreement], spread: float) -> Iterator[tuple[float, float]]:
        """ln weight and value of factors e^{−s}, s ~ N(0, spread²): nodes about the s that the inspections show."""
        shown = [
            (log(a.work / own.work), hypot(self._own_std(a) / a.work, own.std / own.work))
            for a, own in zip(agreements, self.inspections, strict=True)
            if a.work > 0 and own.work > 0
        ]
        if not shown:
            return
        information = 1 / spread**2 + sum(1 / std**2 for _, std in shown)
        centre, std = sum(s / own**2 for s, own in shown) / information, 1 / sqrt(information)
        for node, weight in zip(NODES.tolist(), NODE_WEIGHTS.tolist(), strict=True):
            s = centre + std * node
            prior = -log(spread) - 0.5 * (s / spread) ** 2
            measure = log(weight * std) + 0.5 * node**2 - 0.5 * log(2 * pi)
            jacobian = -s * len(self.points)  # the windows' works are rescaled
            yield prior + measure + jacobian, exp(-s)

    def _own_std(self, agreement: Agreement) -> float:
        """Of the windows without the doubt."""
        return sqrt(max(agreement.work_std**2 - (self.doubt * agreement.work) ** 2, 0.0))

    def inspection_wrong(self, agreements: Sequence[Agreement], faults: InspectionFaults) -> list[_Case]:
        """A case for each inspection that contradicts."""
        return [
            _Case(
                log_prior=log(faults.inspection_wrong), wrong=i,
                std=hypot(faults.spread * max(a.work, own.work), own.std),
            )
            for i, (a, own) in enumerate(zip(agreements, self.inspections, strict=True))
            if a.contradicts
        ]  # fmt: skip

    def _carried(self, belief: Belief, count: float) -> Belief:
        """Carried on to a count between windows, or beyond the last."""
        last = not self.points or count > self.points[-1].revolutions
        return belief.carried(count, self.drift.drift if last and count > belief.revolutions else 0.0, self.alike)

    def _with_window(self, belief: Belief, point: WearPoint) -> Belief:
        ahead = belief.carried(point.revolutions, self.drift.drift, self.alike)
        surprise, s = ahead.innovation(point.work, point.shared_std, point.own_std)
        if belief.windows and abs(surprise) > self.drift.surprise * s:
            ahead = belief.carried(point.revolutions, self.drift.running_in, self.alike)
        return ahead.corrected(point.work, point.shared_std, point.own_std, window=True)
