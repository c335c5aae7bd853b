"""Mesh lines of several windows, the twin and the effects that are tried: everything a joint fit needs.

    r_w = z_w·e^{−ikψ} − m_w(depth_w, p)

z_w    measured mesh lines of window w, per channel                                   [m], [N·m], [m/s²]
m_w    lines that the twin predicts
p      calibration and numbers of effects, in units of their priors
ψ      phase of the mesh against the zero of the encoder                              [rad]

The residual is whitened with the covariance of healthy machines (scatter.py). The mean of the transmission error joins
as differences between windows: its zero and its drift are free.

Source   D. J. C. MacKay, Information Theory, Inference, and Learning Algorithms, 2003, ch. 27
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import null_space

from twin.effects import EFFECTS
from twin.effects.facts import Facts
from twin.effects.response import Effect, Nearby, Response, solve_with
from twin.errors import NotConverged
from twin.model import Model
from twin.thresholds import deciding
from twin.tracing.observed import CHANNELS, HARMONICS, Observed
from twin.tracing.scatter import HealthyScatter, Weight, weight
from twin.updating.calibration import NAMES
from twin.wear.profile import WornProfile

SAMPLES = 256  # a mesh period: lines to harmonic 10 within 2e-4

Profiles = Callable[[float, tuple[Effect, ...], Observed], "WornProfile | Sequence[WornProfile]"]


@dataclass(frozen=True, slots=True, kw_only=True)
class JointFitThresholds:
    """What the windows of one machine may differ by while nothing is wrong with it."""

    calibration_spread: tuple[float, float, float] = deciding(
        (0.06, 0.2, 0.3),
        meaning="spread of ln stiffness scale, ln modal damping, ln damping time over healthy machines. Narrower than "
        "calibration.PRIOR_SPREAD (0.10, 0.25, 0.5), which must also hold for a rig file whose values are wrong: here "
        "a calibration that may move as far would explain an effect away",
        source="an estimate of healthy machines, not derived; the tracing was tuned on T01–T58 with it",
    )
    same_torque: float = deciding(
        0.1, of="torque", meaning="windows within this of one another are of one load: their means are compared",
        source="an estimate, not derived; the tracing was tuned on T01–T58 with it",
    )  # fmt: skip
    same_speed: float = deciding(
        0.05, of="speed", meaning="windows within this of one another share the departure of the structure",
        source="an estimate, not derived; the tracing was tuned on T01–T58 with it",
    )  # fmt: skip


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


def predict(
    model: Model, effects: tuple[Effect, ...], profile, window: Observed, start: Response | None = None
) -> Prediction:
    """The mesh lines that the window's channels would show; NotConverged where there is no steady state."""
    per_mesh = _per_mesh(effects)
    first = None if start is None or start.setup.samples != per_mesh else start.steady
    response = solve_with(model, effects, profile, window.condition, samples=per_mesh, start=first)
    if not response.steady.converged:
        raise NotConverged(f"no steady state at {window.condition.speed_hz:g} Hz with {len(effects)} effects")
    return channel_lines(window, response)


def channel_lines(window: Observed, response: Response) -> Prediction:
    """The mesh lines that the channels of a window would show of a response."""
    z1 = response.model.mesh.pair.teeth[0]
    orders = z1 * np.arange(1, max(HARMONICS.values()) + 1)
    if window.pinion_only:
        motion = response.setup.structure.pinion_motion
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


def _grouped(values: Sequence[float], tolerance: float) -> np.ndarray:
    """A number for each value, the same where two agree within a relative tolerance (n,)."""
    out = np.zeros(len(values), dtype=int)
    for i, value in enumerate(values):
        same = [j for j in range(i) if abs(values[j] / value - 1) < tolerance]
        out[i] = out[same[0]] if same else out[:i].max(initial=-1) + 1
    return out


def _transfer_per_error(model: Model, windows: Sequence[Observed]) -> dict[str, np.ndarray]:
    """Size of every channel's line per metre of transmission error at the mesh orders, (W, n)."""
    structure, z1 = model.structure, model.mesh.pair.teeth[0]
    meter, motion = structure.torque_meter, structure.pinion_motion
    out: dict[str, list[np.ndarray]] = {channel: [] for channel in CHANNELS}
    for w in windows:
        ω = 2 * np.pi * w.condition.speed_hz * z1 * np.arange(1, max(HARMONICS.values()) + 1)

        def size(response: np.ndarray, ω: np.ndarray = ω) -> np.ndarray:
            return np.abs(structure.receptance(ω, structure.mesh, response))

        error = size(structure.transmission_error)
        transfer = {
            "encoder": size(motion) / error if w.pinion_only else np.ones(ω.size),
            "torque": size(meter) / error,
            "acceleration": ω**2 * size(model.accelerometer) / error,
        }
        for channel, count in HARMONICS.items():
            out[channel].append(transfer[channel][:count])
    return {channel: np.array(rows) for channel, rows in out.items()}


@dataclass(eq=False, kw_only=True)
class Problem:
    """Windows, twin and trials, ready to be fitted."""

    model: Model
    windows: Sequence[Observed]
    profiles: Profiles
    trials: tuple[EffectTrial, ...]
    channels: tuple[str, ...] = CHANNELS
    factors: Sequence[dict[str, np.ndarray]] | None = None  # of each window's lines, by effects of longer periods
    thresholds: JointFitThresholds = field(default_factory=JointFitThresholds)
    scatter: HealthyScatter

    def __post_init__(self) -> None:
        limits = self.thresholds
        self.group = _grouped([w.condition.speed_hz for w in self.windows], limits.same_speed)
        load = _grouped([w.condition.torque for w in self.windows], limits.same_torque)
        # about which point a shaft tilts is not known, so neither is the step of the mean
        tilted = sum(np.array([t.acts(w) for w in self.windows], dtype=int) for t in self.trials if t.facts.tilts_shaft)
        mounting = np.array([w.mounting for w in self.windows]) + (1 + max(w.mounting for w in self.windows)) * tilted
        self.load = load + (load.max() + 1) * mounting  # means are compared within one number
        self.transfer = _transfer_per_error(self.model, self.windows)
        self.worn = np.array([w.worn for w in self.windows])
        self.shared = len(NAMES) + sum(len(t.free) for t in self.trials)

    def numbers_of(self, trial: EffectTrial) -> slice:
        """Where a trial's numbers are among the shared values."""
        at = len(NAMES)
        for other in self.trials:
            if other is trial:
                return slice(at, at + len(trial.free))
            at += len(other.free)
        raise KeyError(trial.name)

    def acting_on(self, j: int) -> EffectTrial | None:
        """The trial that shared value j belongs to; None of the calibration's."""
        at = len(NAMES)
        if j < at:
            return None
        for trial in self.trials:
            at += len(trial.free)
            if j < at:
                return trial
        raise IndexError(j)

    def calibrated(self, shared: np.ndarray) -> Model:
        prior, spread = self.model.calibration, self.thresholds.calibration_spread
        values = {
            n: getattr(prior, n) * float(np.exp(u * s))
            for n, u, s in zip(NAMES, shared[: len(NAMES)], spread, strict=True)
        }
        return self.model.calibrated(**values)

    def effects(self, shared: np.ndarray, window: Observed) -> tuple[Effect, ...]:
        """The effects that act in a window, with these shared values."""
        return tuple(trial.make(shared[self.numbers_of(trial)]) for trial in self.trials if trial.acts(window))

    def predict(self, i: int, shared: np.ndarray, depth: float, start: Prediction | None = None) -> Prediction:
        """Lines of window i; NotConverged where there is no steady state."""
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
        return self._with_factors(i, channel_lines(window, response))

    def _with_factors(self, i: int, found: Prediction) -> Prediction:
        if self.factors is None:
            return found
        lines = {channel: found.lines[channel] * factor for channel, factor in self.factors[i].items()}
        return replace(found, lines=found.lines | lines)

    def residual(
        self,
        predictions: Sequence[Prediction],
        phase: float,
        depth: np.ndarray,
        weights: Sequence[Weight] | None = None,
    ) -> tuple[np.ndarray, float, list[Weight]]:
        """Whitened residual (n,), Σ ln det, and the weights that were used (or given)."""
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
                w = self._weight(channel, k, m, σ[there], depth, there) if weights is None else weights[len(used)]
                out.append(w.whitened(z[there] * np.exp(-1j * k * phase) - m))
                log_det += 2 * w.log_det
                used.append(w)
        out.append(self._mean(predictions))
        return np.concatenate(out), log_det, used

    def _weight(
        self, channel: str, k: int, m: np.ndarray, σ: np.ndarray, depth: np.ndarray, there: np.ndarray
    ) -> Weight:
        """Weight of line k of the windows that have it (n,), from their predictions m (n,) and noise σ (n,)."""
        transfer = self.transfer[channel][there, k - 1]
        added = m * self.by_teeth(channel, k)[there]
        return weight(channel, k, m, σ, depth[there], transfer, self.group[there], added, self.scatter)

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
        drift = self.scatter.mean_drift * (turns - turns.mean()) / max(float(np.ptp(turns)), 1.0)
        C = self.scatter.mean_std**2 * np.eye(turns.size) + np.outer(drift, drift)
        zeros = self.load[there][:, None] == np.unique(self.load[there])  # one unknown zero for each load
        contrasts = null_space(zeros.T.astype(float))
        if contrasts.shape[1] == 0:
            return np.empty(0)
        rest = contrasts.T @ (rest[there] - rest[there][0])
        return np.linalg.solve(np.linalg.cholesky(contrasts.T @ C @ contrasts), rest)
