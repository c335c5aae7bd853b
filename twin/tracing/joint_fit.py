"""Mesh lines of several windows fitted together: depth of each, the calibration, and the parameters of effects.

    minimise  Σ_lines 2·rᴴ·C⁻¹·r + 2·ln det C + Σ ((p − p₀)/s)²       r_w = z_w·e^{−ikψ} − m_w(depth_w, p)

p      logarithms of stiffness scale, modal damping and damping time about the rig file's; effect parameters; priors s
ψ      phase of the mesh against the encoder's zero
C      scatter.py

Gauss–Newton steps with C held, accepted by the whole function. Every window's lines depend on its own depth and on what
all share; their derivatives are the sensitivities of its steady state (twin/dynamics/sensitivity.py).

    ln evidence = −½·minimum − ½·ln det(H·S²)         H = JᵀJ + S⁻²: Laplace's approximation

Source   D. J. C. MacKay, Information Theory, Inference, and Learning Algorithms, 2003, ch. 27 and 28;
         the mean transmission error joins as differences: its zero and drift are free
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import null_space

from twin.dynamics.structure import direction
from twin.effects import EFFECTS
from twin.effects.facts import Facts
from twin.effects.response import Effect, Nearby, Response, solve_with
from twin.errors import NotConverged, TwinError
from twin.model import Model
from twin.tracing.observed import CHANNELS, HARMONICS, Observed
from twin.tracing.scatter import Weight, weight
from twin.updating.calibration import NAMES
from twin.wear.profile import WornProfile

PRIOR_SPREAD = (0.06, 0.2, 0.3)  # of the logarithms of stiffness scale, modal damping, damping time of healthy machines
SAMPLES = 256  # a mesh period: lines to harmonic 10 within 2e-4
MEAN_STD = 0.5e-6  # of the mean transmission error from window to window: torque wander, depth [m]
MEAN_DRIFT = 10e-6  # of the discs over the whole campaign: heat, creep of a mounting [m]
SAME_TORQUE = 0.1
STEP = 1e-4  # of a parameter over its prior, for its derivative
DEPTH_STEP = 0.02e-6  # [m]
MOST_STEPS = 10
POOR = 2.0  # misfit of a start whose calibration is not worth having
SAME_SPEED = 0.05
DEPTH_SCALE = 10e-6  # [m]: depths are in these units inside; no prior

Profiles = Callable[[float, tuple[Effect, ...], Observed], "WornProfile | Sequence[WornProfile]"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Free:
    """One free number of an effect, in units of its prior."""

    name: str
    start: float
    low: float = -np.inf
    high: float = np.inf


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class EffectTrial:
    """An effect with free numbers: `make(values)` gives it, `acts(window)` says in which windows it is there."""

    name: str
    free: tuple[Free, ...]
    make: Callable[[np.ndarray], Effect]
    onset: float = 0.0  # revolutions

    @property
    def facts(self) -> Facts:
        return EFFECTS[self.name].facts

    def acts(self, window: Observed) -> bool:
        return window.revolutions >= self.onset


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Prediction:
    """Lines of one window by the twin."""

    lines: dict[str, np.ndarray]
    mean: float
    response: Response


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class JointFit:
    """A fit with everything that stands on it."""

    trials: tuple[EffectTrial, ...]
    shared: np.ndarray  # calibration and effect numbers, in units of their priors
    phase: float  # ψ [rad]
    depth: np.ndarray  # (W,) [m]
    covariance: np.ndarray  # of shared, phase, depths of worn windows
    objective: float
    misfit: float  # squares of the whitened residuals over their number
    log_evidence: float
    predictions: tuple[Prediction, ...]
    squares: np.ndarray  # (W, channels) of the whitened residuals, where windows are told apart by their own weight

    def numbers(self, trial: EffectTrial) -> tuple[np.ndarray, np.ndarray]:
        """Values and standard deviations of one trial's free numbers, in units of their priors."""
        at = len(NAMES)
        for other in self.trials:
            if other is trial:
                where = slice(at, at + len(other.free))
                return self.shared[where], np.sqrt(self.covariance.diagonal()[where])
            at += len(other.free)
        raise KeyError(trial.name)

    def effects(self) -> tuple[Effect, ...]:
        """The effects at the fitted values."""
        at, out = len(NAMES), []
        for trial in self.trials:
            out.append(trial.make(self.shared[at : at + len(trial.free)]))
            at += len(trial.free)
        return tuple(out)


def predict(
    model: Model, effects: tuple[Effect, ...], profile, window: Observed, start: Response | None = None
) -> Prediction:
    """The mesh lines that the window's channels would show; NotConverged where there is no steady state."""
    first = None if start is None or start.setup.samples != _samples(effects, model) else start.steady
    response = solve_with(model, effects, profile, window.condition, samples=_per_mesh(effects), start=first)
    if not response.steady.converged:
        raise NotConverged(f"no steady state at {window.condition.speed_hz:g} Hz with {len(effects)} effects")
    return seen_in(window, response)


def seen_in(window: Observed, response: Response) -> Prediction:
    """What the window's channels would show of a response."""
    z1 = response.model.mesh.pair.teeth[0]
    orders = z1 * np.arange(1, max(HARMONICS.values()) + 1)
    if window.pinion_only:
        motion = direction({"th7": response.model.mesh.pair.base_radius[0]})
        step = round(z1 * float(response.setup.turns))
        encoder = response.steady.lines(response.setup.structure, motion)[step - 1 :: step][: HARMONICS["encoder"]]
    else:
        encoder = response.transmission_error(orders[: HARMONICS["encoder"]])
    return Prediction(
        lines={
            "encoder": encoder,
            "torque": response.torque(orders[: HARMONICS["torque"]]),
            "acceleration": response.acceleration(orders[: HARMONICS["acceleration"]]),
        },
        mean=response.mean_transmission_error,
        response=response,
    )


def _per_mesh(effects: tuple[Effect, ...]) -> int | None:
    """Samples a mesh period: fewer than the model's own over one period, the usual ones over longer."""
    return SAMPLES if all(e.period == "mesh" for e in effects) else None


def _samples(effects: tuple[Effect, ...], model: Model) -> int:
    return SAMPLES if all(e.period == "mesh" for e in effects) else -1


def _alike(values: Sequence[float], tolerance: float) -> np.ndarray:
    """A number for each value, the same where two agree within a relative tolerance (n,)."""
    out = np.zeros(len(values), dtype=int)
    for i, value in enumerate(values):
        same = [j for j in range(i) if abs(values[j] / value - 1) < tolerance]
        out[i] = out[same[0]] if same else out[:i].max(initial=-1) + 1
    return out


def _paths(model: Model, windows: Sequence[Observed]) -> dict[str, np.ndarray]:
    """Size of every channel's line per metre of transmission error at the mesh orders, (W, n)."""
    structure, z1 = model.structure, model.mesh.pair.teeth[0]
    (k23,) = model.rig.require("the torque meter", "torsional_stiffness.k_2_3")
    meter = direction({"th2": k23, "th3": -k23})
    motion = direction({"th7": model.mesh.pair.base_radius[0]})
    out: dict[str, list[np.ndarray]] = {channel: [] for channel in CHANNELS}
    for w in windows:
        ω = 2 * np.pi * w.condition.speed_hz * z1 * np.arange(1, max(HARMONICS.values()) + 1)

        def heard(response: np.ndarray, ω: np.ndarray = ω) -> np.ndarray:
            return np.abs(structure.receptance(ω, structure.mesh, response))

        error = heard(structure.transmission_error)
        encoder = heard(motion) / error if w.pinion_only else np.ones(ω.size)
        paths = {
            "encoder": encoder,
            "torque": heard(meter) / error,
            "acceleration": ω**2 * heard(model.accelerometer) / error,
        }
        for channel, count in HARMONICS.items():
            out[channel].append(paths[channel][:count])
    return {channel: np.array(rows) for channel, rows in out.items()}


@dataclass(eq=False)
class Problem:
    """Windows, twin and trials, ready to be fitted."""

    model: Model
    windows: Sequence[Observed]
    profiles: Profiles
    trials: tuple[EffectTrial, ...]
    channels: tuple[str, ...] = CHANNELS
    factors: Sequence[dict[str, np.ndarray]] | None = None  # of each window's lines, by effects of longer periods

    def __post_init__(self) -> None:
        self.group = _alike([w.condition.speed_hz for w in self.windows], SAME_SPEED)
        load = _alike([w.condition.torque for w in self.windows], SAME_TORQUE)
        # about which point a shaft tilts is not known, so neither is the step of the mean
        tilted = sum(np.array([t.acts(w) for w in self.windows], dtype=int) for t in self.trials if t.facts.tilts_shaft)
        mounting = np.array([w.mounting for w in self.windows]) + (1 + max(w.mounting for w in self.windows)) * tilted
        self.load = load + (load.max() + 1) * mounting  # means are compared within one number
        self.path = _paths(self.model, self.windows)
        self.worn = np.array([w.worn for w in self.windows])
        self.shared = len(NAMES) + sum(len(t.free) for t in self.trials)

    def calibrated(self, shared: np.ndarray) -> Model:
        prior = self.model.calibration
        values = {
            n: getattr(prior, n) * float(np.exp(u * s)) for n, u, s in zip(NAMES, shared, PRIOR_SPREAD, strict=False)
        }
        return self.model.calibrated(**values)

    def effects(self, shared: np.ndarray, window: Observed) -> tuple[Effect, ...]:
        out: list[Effect] = []
        at = len(NAMES)
        for trial in self.trials:
            if trial.acts(window):
                out.append(trial.make(shared[at : at + len(trial.free)]))
            at += len(trial.free)
        return tuple(out)

    def predict(self, i: int, shared: np.ndarray, depth: float, start: Prediction | None = None) -> Prediction:
        window = self.windows[i]
        effects = self.effects(shared, window)
        profile = self.profiles(depth, effects, window)
        before = None if start is None else start.response
        return self._with_factors(i, predict(self.calibrated(shared), effects, profile, window, before))

    def near(self, i: int, model: Model, shared: np.ndarray, depth: float, nearby: Nearby) -> Prediction:
        """As `predict`, to first order about a prediction of the same window."""
        window = self.windows[i]
        effects = self.effects(shared, window)
        response = nearby.response(model, effects, self.profiles(depth, effects, window))
        return self._with_factors(i, seen_in(window, response))

    def _with_factors(self, i: int, found: Prediction) -> Prediction:
        if self.factors is None:
            return found
        lines = {channel: found.lines[channel] * factor for channel, factor in self.factors[i].items()}
        return replace(found, lines=found.lines | lines)

    def residual(
        self, predictions: Sequence[Prediction], phase: float, depth: np.ndarray, weights=None
    ) -> tuple[np.ndarray, float, list]:
        """Whitened residual, Σ ln det, and the weights that were used (or given)."""
        out: list[np.ndarray] = []
        used: list[Weight] = []
        log_det = 0.0
        for channel in self.channels:
            for k in range(1, HARMONICS[channel] + 1):
                z = np.array([w.lines[channel][k - 1] for w in self.windows])
                σ = np.array([w.std[channel][k - 1] for w in self.windows])
                there = np.isfinite(z) & np.isfinite(σ)
                if not there.any():
                    continue
                m = np.array([p.lines[channel][k - 1] for p in predictions])[there]
                if weights is None:
                    path = self.path[channel][there, k - 1]
                    added = m * self.by_teeth(channel, k)[there]
                    w = weight(channel, k, m, σ[there], depth[there], path, self.group[there], added)
                else:
                    w = weights[len(used)]
                out.append(w.whitened(z[there] * np.exp(-1j * k * phase) - m))
                log_det += 2 * w.log_det
                used.append(w)
        out.append(self._mean(predictions))
        return np.concatenate(out), log_det, used

    def by_teeth(self, channel: str, k: int) -> np.ndarray:
        """Share of line k that effects of longer periods make, of each window (W,)."""
        if self.factors is None:
            return np.zeros(len(self.windows))
        return np.array([1 - 1 / f[channel][k - 1] if channel in f else 0.0 for f in self.factors])

    def _mean(self, predictions: Sequence[Prediction]) -> np.ndarray:
        """Whitened means of the transmission error: their zero, its drift and what load adds are free."""
        rest = np.array(
            [
                np.nan if w.mean is None or not w.torque_known else w.mean - p.mean
                for w, p in zip(self.windows, predictions, strict=True)
            ]
        )
        there = np.isfinite(rest)
        if there.sum() < 2 or "encoder" not in self.channels:
            return np.empty(0)
        turns = np.array([w.revolutions for w in self.windows])[there]
        drift = MEAN_DRIFT * (turns - turns.mean()) / max(float(np.ptp(turns)), 1.0)
        C = MEAN_STD**2 * np.eye(turns.size) + np.outer(drift, drift)
        zeros = self.load[there][:, None] == np.unique(self.load[there])  # one unknown zero for each load
        contrasts = null_space(zeros.T.astype(float))
        if contrasts.shape[1] == 0:
            return np.empty(0)
        rest = contrasts.T @ (rest[there] - rest[there][0])
        return np.linalg.solve(np.linalg.cholesky(contrasts.T @ C @ contrasts), rest)


def fit(problem: Problem, start: JointFit | None, phase: float, depth: np.ndarray) -> JointFit:
    """The best values from a start; NotConverged where not even the start has a steady state.

    start  an earlier fit of the same windows with fewer trials, whose calibration and depths are taken over
    """
    n, W = problem.shared, len(problem.windows)
    shared = np.zeros(n)
    at = len(NAMES)
    for trial in problem.trials:
        shared[at : at + len(trial.free)] = [f.start for f in trial.free]
        at += len(trial.free)
    if start is not None:
        if start.misfit < POOR:  # a calibration bent by what the model lacks leads astray
            shared[: len(NAMES)] = start.shared[: len(NAMES)]
        at = len(NAMES)
        for trial in problem.trials:
            for other in start.trials:
                if other is trial:
                    shared[at : at + len(trial.free)] = start.numbers(trial)[0]
            at += len(trial.free)
        phase, depth = start.phase, start.depth
    low = np.concatenate((np.full(len(NAMES), -3.0), [f.low for t in problem.trials for f in t.free]))
    high = np.concatenate((np.full(len(NAMES), 3.0), [f.high for t in problem.trials for f in t.free]))
    worn = np.flatnonzero(problem.worn)
    depth = np.where(problem.worn, depth, 0.0)

    def all_predicted(shared, depth, before=None):
        return [problem.predict(i, shared, depth[i], None if before is None else before[i]) for i in range(W)]

    def total(predictions, shared, phase, depth):
        rest, log_det, used = problem.residual(predictions, phase, depth)
        return float(rest @ rest + log_det + shared @ shared), rest, used

    predictions = all_predicted(shared, depth)
    objective, rest, used = total(predictions, shared, phase, depth)
    λ = 1e-3
    for _ in range(MOST_STEPS):
        J = _jacobian(problem, predictions, shared, phase, depth, rest, used)
        prior = np.zeros(J.shape[1])
        prior[:n] = 1.0
        H = J.T @ J + np.diag(prior)
        gradient = J.T @ rest
        gradient[:n] += shared
        improved = False
        for _ in range(6):
            step = -np.linalg.solve(H + λ * np.diag(H.diagonal()), gradient)
            shared2 = np.clip(shared + step[:n], low, high)
            depth2 = depth.copy()
            depth2[worn] = np.maximum(depth[worn] + DEPTH_SCALE * step[n + 1 :], 1e-8)
            phase2 = phase + step[n]
            try:
                trial = all_predicted(shared2, depth2, predictions)
            except TwinError:
                λ = max(10 * λ, 1e-2)
                continue
            objective2, rest2, used2 = total(trial, shared2, phase2, depth2)
            if objective2 < objective:
                improved = True
                break
            λ = max(10 * λ, 1e-2)
        if not improved:
            break
        gain = objective - objective2
        shared, depth, phase, predictions = shared2, depth2, phase2, trial
        objective, rest, used = objective2, rest2, used2
        λ = max(λ / 10, 1e-6)
        if gain < 0.05:
            break
    J = _jacobian(problem, predictions, shared, phase, depth, rest, used)
    prior = np.zeros(J.shape[1])
    prior[:n] = 1.0
    H = J.T @ J + np.diag(prior)
    _, log_det = np.linalg.slogdet(H)
    return JointFit(
        trials=problem.trials,
        shared=shared,
        phase=phase,
        depth=depth,
        covariance=np.linalg.inv(H),
        objective=objective,
        misfit=float(rest @ rest / rest.size),
        log_evidence=-0.5 * (objective + log_det),
        predictions=tuple(predictions),
        squares=_squares(problem, predictions, phase, depth),
    )


def _jacobian(problem: Problem, predictions, shared, phase, depth, rest, used) -> np.ndarray:
    """∂(whitened residual)/∂(shared, phase, depths of worn windows), weights held.

    By the sensitivities of the steady states: one factorisation a window serves all columns.
    """
    n = problem.shared
    nearby = [Nearby(p.response) for p in predictions]
    worn = np.flatnonzero(problem.worn)
    J = np.zeros((rest.size, n + 1 + worn.size))

    def column(changed, ψ=phase):
        return problem.residual(changed, ψ, depth, used)[0] - rest

    for j in range(n):
        moved = shared.copy()
        moved[j] += STEP
        model = problem.calibrated(moved)
        changed = []
        for i, window in enumerate(problem.windows):
            if j >= len(NAMES) and not _trial_of(problem, j).acts(window):
                changed.append(predictions[i])
            else:
                changed.append(problem.near(i, model, moved, depth[i], nearby[i]))
        J[:, j] = column(changed) / STEP
    J[:, n] = column(predictions, phase + 1e-5) / 1e-5
    model = problem.calibrated(shared)
    for c, i in enumerate(worn.tolist()):
        changed = list(predictions)
        changed[i] = problem.near(i, model, shared, depth[i] + DEPTH_STEP, nearby[i])
        J[:, n + 1 + c] = column(changed) / (DEPTH_STEP / DEPTH_SCALE)
    return J


def _trial_of(problem: Problem, j: int) -> EffectTrial:
    at = len(NAMES)
    for trial in problem.trials:
        at += len(trial.free)
        if j < at:
            return trial
    raise IndexError(j)


def _squares(problem: Problem, predictions, phase, depth) -> np.ndarray:
    """Squares of each window's residuals over what that window alone may scatter, by channel (W, channels)."""
    out = np.zeros((len(problem.windows), len(problem.channels)))
    for c, channel in enumerate(problem.channels):
        for i, window in enumerate(problem.windows):
            total, count = 0.0, 0
            for k in range(1, HARMONICS[channel] + 1):
                z, σ = window.lines[channel][k - 1], window.std[channel][k - 1]
                if np.isfinite(z) and np.isfinite(σ):
                    m = predictions[i].lines[channel][k - 1]
                    path = problem.path[channel][[i], k - 1]
                    added = m * problem.by_teeth(channel, k)[[i]]
                    w = weight(channel, k, np.array([m]), np.array([σ]), depth[[i]], path, problem.group[[i]], added)
                    total += float((w.whitened(np.array([z * np.exp(-1j * k * phase) - m])) ** 2).sum())
                    count += 2
            out[i, c] = total / max(count, 1)
    return out


__all__ = ["EffectTrial", "Free", "JointFit", "Observed", "Prediction", "Problem", "fit", "predict", "replace"]
