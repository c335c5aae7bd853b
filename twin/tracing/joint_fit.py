"""Mesh lines of several windows fitted together: depth of each, the calibration, and the numbers of effects.

    Φ = Σ_lines 2·rᴴ·C⁻¹·r + 2·ln det C + Σ ((p − p₀)/s)²       r_w = z_w·e^{−ikψ} − m_w(depth_w, p)

p      logarithms of stiffness scale, modal damping and damping time about the rig file's; effect numbers; priors s
ψ      phase of the mesh against the zero of the encoder                                                    [rad]
C      covariance of healthy machines (scatter.py)

Weighted least squares: a Gauss–Newton step lowers the squares with C held; C then follows the prediction, until a step
promises or brings nothing more, or MOST_STEPS are done. What ln det C alone would gain by another prediction has no say
in the fit: the minimum of the whole of Φ trusts the sizes in C too much and shrinks effects (misalignments of 32 and
38 µm to 29 and 30 µm). The lines of a window depend on its own depth and on what all windows share; their derivatives
are the sensitivities of its steady state (twin/dynamics/sensitivity.py).

    ln evidence = −½·Φ − ½·ln det H         H = JᵀJ + S⁻²: Laplace's approximation

A depth or a phase that no line depends on makes H singular. Such a value keeps its start, its variance is infinite, and
in ln det H it counts as known to one unit: that a fit loses a depth out of sight is no evidence for it.

Source   D. J. C. MacKay, Information Theory, Inference, and Learning Algorithms, 2003, ch. 27 and 28
         R. J. Carroll, D. Ruppert, Transformation and Weighting in Regression, Chapman and Hall, 1988, ch. 2
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from twin.effects.addition import Addition
from twin.effects.response import Effect, Nearby
from twin.errors import TwinError
from twin.tracing.joint_problem import EffectTrial, Prediction, Problem, Varied
from twin.tracing.scatter import Weights
from twin.updating.calibration import NAMES

STEP = 1e-4  # of a shared value, for its derivative
PHASE_STEP = 1e-5  # [rad]
DEPTH_STEP = 0.02e-6  # [m]
DEPTH_SCALE = 10e-6  # [m]: depths are in these units inside; no prior
MOST_STEPS = 10  # that a fit may take; most end before
MOST_TRIALS = 6  # of the damping, in one step
WIDEST = 3.0  # prior spreads that a calibrated value may move
LEAST_DEPTH = 1e-8  # of a worn window [m]
CONVERGED = 0.05  # of the squares, promised by a full step or reached by one; of a poor fit times its misfit
UNDETERMINED = 1e-9  # information on a phase or depth [1/unit²] that is only rounding
POOR = 2.0  # misfit of a start whose calibration is bent by what the model lacks and would lead astray


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class JointFit:
    """A fit with everything that rests on it."""

    trials: tuple[EffectTrial, ...]
    shared: np.ndarray  # calibration and effect numbers, in units of their priors
    phase: float  # ψ [rad]
    depth: np.ndarray  # (W,) [m]
    covariance: np.ndarray  # of shared, phase, depths of worn windows; infinite variance where nothing determines one
    objective: float
    misfit: float  # squares of the whitened residuals over their number
    log_evidence: float
    predictions: tuple[Prediction, ...]

    def numbers(self, trial: EffectTrial) -> tuple[np.ndarray, np.ndarray]:
        """Values and standard deviations of one trial's free numbers, in units of their priors."""
        at = len(NAMES)
        for other in self.trials:
            if other is trial:
                where = slice(at, at + len(other.free))
                return self.shared[where], np.sqrt(self.covariance.diagonal()[where])
            at += len(other.free)
        raise KeyError(trial.name)

    def covariance_of(self, trial: EffectTrial) -> np.ndarray:
        """Covariance of one trial's free numbers (n, n), in units of their priors."""
        at = len(NAMES)
        for other in self.trials:
            if other is trial:
                where = slice(at, at + len(other.free))
                return self.covariance[where, where]
            at += len(other.free)
        raise KeyError(trial.name)

    def additions(self) -> tuple[Addition, ...]:
        """The effects at the fitted values, with their onsets and laws."""
        return tuple(trial.addition(self.numbers(trial)[0]) for trial in self.trials)

    def effects(self) -> tuple[Effect, ...]:
        """The effects at the fitted values, as large as in their first stage."""
        return tuple(addition.effect for addition in self.additions())


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Point:
    """Values of everything that is fitted, with what the twin makes of them."""

    shared: np.ndarray
    phase: float
    depth: np.ndarray  # (W,) [m]
    predictions: list[Prediction]
    objective: float
    rest: np.ndarray  # whitened residual
    weights: Weights

    @classmethod
    def of(
        cls,
        problem: Problem,
        shared: np.ndarray,
        phase: float,
        depth: np.ndarray,
        before: Sequence[Prediction] | None = None,
    ) -> _Point:
        """The steady states of all windows, from others of the same windows; NotConverged where one has none."""
        near = [None] * len(problem.windows) if before is None else before
        twin = problem.at(shared)
        predictions = [problem.predict(i, twin, depth[i], start) for i, start in enumerate(near)]
        rest, log_det, weights = problem.residual(predictions, phase, depth)
        return cls(
            shared=shared,
            phase=phase,
            depth=depth,
            predictions=predictions,
            objective=float(rest @ rest + log_det + shared @ shared),
            rest=rest,
            weights=weights,
        )

    @property
    def misfit(self) -> float:
        """Squares of the whitened residuals over their number."""
        return float(self.rest @ self.rest / self.rest.size)

    @property
    def negligible(self) -> float:
        """What the squares may still fall by: the fitted values' scatter grows with the misfit, too."""
        return CONVERGED * max(1.0, self.misfit)

    def squares(self, problem: Problem, weights: Weights) -> float:
        """What a step is to lower: the squares at given weights."""
        rest = problem.left(self.predictions, self.phase, weights)
        return float(rest @ rest + self.shared @ self.shared)


def fit(problem: Problem, start: JointFit | None, phase: float, depth: np.ndarray) -> JointFit:
    """The best values from a start; NotConverged where not even the start has a steady state.

    start  an earlier fit of the same windows with fewer trials, whose calibration and depths are taken over
    phase  of the mesh [rad], and depth (W,) [m]: the start where there is no earlier fit
    """
    point = _started(problem, start, phase, depth)
    slopes, λ = _slopes(problem, point), 1e-3
    for _ in range(MOST_STEPS):
        if slopes.gain < point.negligible:
            break
        better, λ, lower = _stepped(problem, point, slopes, λ)
        if better is None:
            break
        point, λ = better, max(λ / 10, 1e-6)
        slopes = _slopes(problem, point)
        if lower < point.negligible:
            break
    J = slopes.jacobian
    covariance, log_det = inverse(_curvature(problem, J), problem.shared)
    return JointFit(
        trials=problem.trials,
        shared=point.shared,
        phase=point.phase,
        depth=point.depth,
        covariance=covariance,
        objective=point.objective,
        misfit=point.misfit,
        log_evidence=-0.5 * (point.objective + log_det),
        predictions=tuple(point.predictions),
    )


def _started(problem: Problem, start: JointFit | None, phase: float, depth: np.ndarray) -> _Point:
    shared = np.zeros(problem.shared)
    for trial in problem.trials:
        shared[problem.numbers_of(trial)] = [f.start for f in trial.free]
    if start is not None:
        if start.misfit < POOR:
            shared[: len(NAMES)] = start.shared[: len(NAMES)]
        for trial in problem.trials:
            if any(other is trial for other in start.trials):
                shared[problem.numbers_of(trial)] = start.numbers(trial)[0]
        phase, depth = start.phase, start.depth
    before = None if start is None else start.predictions
    return _Point.of(problem, shared, phase, np.where(problem.worn, depth, 0.0), before)


def _limits(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest shared values."""
    widest = np.full(len(NAMES), WIDEST)
    low = np.concatenate((-widest, [f.low for t in problem.trials for f in t.free]))
    high = np.concatenate((widest, [f.high for t in problem.trials for f in t.free]))
    return low, high


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Slopes:
    """Half of the squares to second order about a point, C held, in shared values, phase and depths of worn windows."""

    jacobian: np.ndarray  # of the whitened residual (m, n)
    gradient: np.ndarray  # (n,)
    curvature: np.ndarray  # (n, n)
    free: np.ndarray  # values that something depends on and no limit holds back (n,) bool
    gain: float  # of the squares, promised by a full step


def _slopes(problem: Problem, point: _Point) -> _Slopes:
    J = _jacobian(problem, point)
    gradient, H = J.T @ point.rest, _curvature(problem, J)
    gradient[: problem.shared] += point.shared
    low, high = _limits(problem)
    lowest, highest = np.full(gradient.size, -np.inf), np.full(gradient.size, np.inf)
    lowest[: problem.shared], highest[: problem.shared] = low, high
    lowest[problem.shared + 1 :] = LEAST_DEPTH / DEPTH_SCALE
    here = np.concatenate((point.shared, [point.phase], point.depth[problem.worn] / DEPTH_SCALE))
    free = ~((here <= lowest) & (gradient > 0) | (here >= highest) & (gradient < 0)) & (H.diagonal() > 0)
    step = _step(gradient, H, free, 0.0)
    return _Slopes(jacobian=J, gradient=gradient, curvature=H, free=free, gain=float(-gradient @ step))


def _step(gradient: np.ndarray, H: np.ndarray, free: np.ndarray, λ: float) -> np.ndarray:
    """Levenberg's and Marquardt's step in the free values (n,), 0 in the others."""
    step = np.zeros(gradient.size)
    A = H[np.ix_(free, free)]
    step[free] = -np.linalg.lstsq(A + λ * np.diag(A.diagonal()), gradient[free], rcond=None)[0]
    return step


def _stepped(problem: Problem, point: _Point, slopes: _Slopes, λ: float) -> tuple[_Point | None, float, float]:
    """A better point, the damping λ that led there, and by how much its squares are lower; None where there is none."""
    n, worn = problem.shared, np.flatnonzero(problem.worn)
    low, high = _limits(problem)
    before = point.squares(problem, point.weights)
    for _ in range(MOST_TRIALS):
        step = _step(slopes.gradient, slopes.curvature, slopes.free, λ)
        depth = point.depth.copy()
        depth[worn] = np.maximum(depth[worn] + DEPTH_SCALE * step[n + 1 :], LEAST_DEPTH)
        shared = np.clip(point.shared + step[:n], low, high)
        try:
            tried = _Point.of(problem, shared, point.phase + step[n], depth, point.predictions)
        except TwinError:
            tried = None
        lower = -np.inf if tried is None else before - tried.squares(problem, point.weights)
        if tried is not None and lower > 0:
            return tried, λ, lower
        λ = max(10 * λ, 1e-2)
    return None, λ, 0.0


def _curvature(problem: Problem, J: np.ndarray) -> np.ndarray:
    """H = JᵀJ + S⁻²: shared values have a prior, phase and depths have none."""
    prior = np.zeros(J.shape[1])
    prior[: problem.shared] = 1.0
    return J.T @ J + np.diag(prior)


def inverse(H: np.ndarray, shared: int) -> tuple[np.ndarray, float]:
    """Covariance H⁻¹ (n, n) and ln det H of a symmetric matrix whose first rows, `shared` many, have a prior.

    The others, phase and depths, may be undetermined: what the lines leave wider than one unit (1 rad, DEPTH_SCALE)
    counts as known to one unit in ln det H, and has its own variance, infinite where no line depends on it.
    """
    A, B = H[:shared, :shared], H[:shared, shared:]
    S = H[shared:, shared:] - B.T @ np.linalg.solve(A, B)
    values, vectors = np.linalg.eigh(0.5 * (S + S.T))
    if values.min(initial=np.inf) >= 1.0:
        return np.linalg.inv(H), float(np.linalg.slogdet(H)[1])
    bounded = np.maximum(values, 1.0)
    C = (vectors / bounded) @ vectors.T
    G = np.linalg.solve(A, B)
    covariance = np.block([[np.linalg.inv(A) + G @ C @ G.T, -G @ C], [-C @ G.T, C]])
    known = values > UNDETERMINED
    variance = (vectors[:, known] ** 2 / values[known]).sum(axis=1)
    variance[(vectors[:, ~known] ** 2).sum(axis=1) > UNDETERMINED] = np.inf
    at = np.arange(shared, H.shape[0])
    covariance[at, at] = variance
    return covariance, float(np.linalg.slogdet(A)[1] + np.log(bounded).sum())


def _jacobian(problem: Problem, point: _Point) -> np.ndarray:
    """∂(whitened residual)/∂(shared, phase, depths of worn windows) (m, n), weights held.

    By the sensitivities of the steady states: one factorisation a window serves all columns.
    """
    n, compared = problem.shared, problem.compared
    lines = np.zeros((*compared.shape, n + 1 + int(problem.worn.sum())), dtype=complex)
    means = np.zeros(lines.shape[1:])
    varied = problem.varied(point.shared, STEP)
    for i, prediction in enumerate(point.predictions):
        for column, step, moved in _moved(problem, point, varied, i):
            lines[:, i, column] = ((prediction.every - moved.every) / step)[compared.kept]
            means[i, column] = (prediction.mean - moved.mean) / step
    lines[:, :, n] = (compared.turned(point.phase + PHASE_STEP) - compared.turned(point.phase)) / PHASE_STEP
    return problem.whitened(lines, means, point.weights)


def _moved(
    problem: Problem, point: _Point, varied: Sequence[Varied], i: int
) -> Iterator[tuple[int, float, Prediction]]:
    """Window i with each value moved that its lines depend on: column of the value, step in its unit, prediction.

    varied  the twin with each of the shared values moved
    """
    window, before = problem.windows[i], point.predictions[i]
    nearby = Nearby(before.response)
    for j, twin in enumerate(varied):
        if twin.owner is None:
            yield j, STEP, problem.recalibrated(i, twin, before.flanks, nearby)
        elif twin.owner.acts(window):
            yield j, STEP, problem.near(i, twin, before.flanks, nearby)
    if window.worn:
        deeper = problem.profiles(point.depth[i] + DEPTH_STEP, window)
        column = problem.shared + 1 + int(problem.worn[:i].sum())
        yield column, DEPTH_STEP / DEPTH_SCALE, problem.near(i, problem.at(point.shared), deeper, nearby)
