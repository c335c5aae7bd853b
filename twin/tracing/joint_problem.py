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

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from twin.dynamics.structure import Structure
from twin.effects import EFFECTS
from twin.effects.addition import Addition
from twin.effects.facts import Facts
from twin.effects.response import Effect, Nearby, Response, solve_with
from twin.effects.size_law import CONSTANT, SizeLaw, factor_between, scaled
from twin.errors import NotConverged
from twin.model import Model
from twin.thresholds import deciding
from twin.tracing.compared import ComparedLines, ComparedMeans
from twin.tracing.observed import CHANNELS, HARMONIC, HARMONICS, HIGHEST, PLACES, Observed
from twin.tracing.scatter import HealthyScatter, LineSizes, Weights
from twin.updating.calibration import NAMES
from twin.wear.profile import WornProfile

SAMPLES = 256  # a mesh period: lines to harmonic 10 within 2e-4

Flanks = WornProfile | Sequence[WornProfile]  # of the whole face, or of every slice across it
Profiles = Callable[[float, Observed], Flanks]  # of a window at a depth [m]


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
    """An effect with free numbers: `make(values)` gives it, `acts(window)` says in which windows it is there.

    Where its size changes after the onset, there is one set of free numbers for each stage, one after the other.
    """

    name: str
    free: tuple[Free, ...]
    make: Callable[[np.ndarray], Effect]
    onset: float = 0.0  # revolutions
    law: SizeLaw = CONSTANT  # its factors are what the numbers of its stages make them

    @property
    def stages(self) -> int:
        return 1 + len(self.law.changes)

    def numbers(self, values: np.ndarray, revolutions: float) -> np.ndarray:
        """Of all free numbers (n,), those of the stage that the effect is in, (n/stages,)."""
        each = values.size // self.stages
        stage = sum(revolutions >= n for n in self.law.changes)
        return values[stage * each : (stage + 1) * each]

    def at(self, values: np.ndarray, window: Observed) -> Effect | None:
        """The effect in a window, for free numbers (n,); None before its onset."""
        if not self.acts(window):
            return None
        effect = self.make(self.numbers(values, window.revolutions))
        if self.law.kind == "linear":
            return scaled(effect, self.law.factor(window.revolutions, self.onset))
        return effect

    def addition(self, values: np.ndarray) -> Addition:
        """The effect with its onset and its law, for free numbers (n,)."""
        effect, law = self.make(self.numbers(values, -np.inf)), self.law
        if law.kind == "stepped":
            later = [self.make(self.numbers(values, n)) for n in law.revolutions]
            law = replace(law, factors=tuple(factor_between(effect, e) for e in later))
        return Addition(effect=effect, onset_revolutions=self.onset, law=law)

    @property
    def facts(self) -> Facts:
        return EFFECTS[self.name].facts

    def acts(self, window: Observed) -> bool:
        return window.revolutions >= self.onset


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Prediction:
    """Lines of one window by the twin."""

    every: np.ndarray  # line of every channel, one below the other (L,) complex
    mean: float
    response: Response
    flanks: Flanks  # that they are the lines of

    @property
    def lines(self) -> dict[str, np.ndarray]:
        """By channel (n,)."""
        return {channel: self.every[at] for channel, at in PLACES.items()}


def predict(
    model: Model, effects: tuple[Effect, ...], flanks: Flanks, window: Observed, start: Response | None = None
) -> Prediction:
    """The mesh lines that the window's channels would show; NotConverged where there is no steady state."""
    per_mesh = _per_mesh(effects)
    first = None if start is None or start.setup.samples != per_mesh else start.steady
    response = solve_with(model, effects, flanks, window.condition, samples=per_mesh, start=first)
    if not response.steady.converged:
        raise NotConverged(f"no steady state at {window.condition.speed_hz:g} Hz with {len(effects)} effects")
    return _seen(window, response, flanks)


def _seen(window: Observed, response: Response, flanks: Flanks) -> Prediction:
    """The mesh lines that the channels of a window would show of a response."""
    steady, n = response.steady, response.mesh_periods
    at = slice(n, n * HIGHEST + 1, n)
    ω = steady.omega[at]

    def made_by(direction: np.ndarray, lines: np.ndarray) -> np.ndarray:
        sensor = response.model.accelerometer
        path = _paths(response.structure, ω.tobytes(), direction.tobytes(), sensor.tobytes(), window.pinion_only)
        return path * lines[at][HARMONIC - 1]

    every = -made_by(response.structure.mesh, steady.force_lines)
    for direction, lines in zip(steady.directions, steady.action_lines, strict=True):
        every = every - made_by(direction, lines)
    for load in steady.loads:
        every = every + made_by(load.direction, load.lines)
    every = 2 * every
    for gain in response.gains:
        every[PLACES["acceleration"]] *= gain(ω / (2 * np.pi))[: HARMONICS["acceleration"]]
    return Prediction(every=every, mean=response.mean_transmission_error, response=response, flanks=flanks)


@lru_cache(maxsize=1024)  # 0.3 kB each
def _paths(structure: Structure, omega: bytes, force: bytes, sensor: bytes, pinion_only: bool) -> np.ndarray:
    """What a force along a direction (21,) makes of the lines of all channels at the mesh harmonics (L,)."""
    ω, along = np.frombuffer(omega), np.frombuffer(force)
    channels = {
        "encoder": structure.pinion_motion if pinion_only else structure.transmission_error,
        "torque": structure.torque_meter,
        "acceleration": np.frombuffer(sensor),
    }
    seen = dict(zip(channels, structure.receptances(ω, along, list(channels.values())), strict=True))
    seen["acceleration"] = -(ω**2) * seen["acceleration"]
    return np.concatenate([seen[channel][: HARMONICS[channel]] for channel in CHANNELS])


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


def _transfer_per_error(model: Model, windows: Sequence[Observed]) -> np.ndarray:
    """Size of all channels' lines per metre of transmission error at the mesh orders, one below the other (L, W)."""
    structure, z1 = model.structure, model.mesh.pair.teeth[0]
    out = []
    for w in windows:
        ω = 2 * np.pi * w.condition.speed_hz * z1 * np.arange(1, HIGHEST + 1)
        force, sensor = structure.mesh.tobytes(), model.accelerometer.tobytes()
        size = np.abs(_paths(structure, ω.tobytes(), force, sensor, w.pinion_only))
        error = np.abs(structure.receptance(ω, structure.mesh, structure.transmission_error))
        out.append(size / error[HARMONIC - 1])
    return np.array(out).T


def _every(factors: Mapping[str, np.ndarray]) -> np.ndarray:
    """Factors on the lines of some channels (n,) as factors on all lines, one below the other (L,)."""
    out = np.ones(HARMONIC.size, dtype=complex)
    for channel, factor in factors.items():
        out[PLACES[channel]] = factor
    return out


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Varied:
    """The twin with one of the shared values moved."""

    owner: EffectTrial | None  # the trial that the value belongs to; None of the calibration's
    model: Model
    numbers: tuple[np.ndarray, ...]  # free ones of every trial


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
        limits, windows = self.thresholds, self.windows
        group = _grouped([w.condition.speed_hz for w in windows], limits.same_speed)
        load = _grouped([w.condition.torque for w in windows], limits.same_torque)
        # about which point a shaft tilts is not known, so neither is the step of the mean
        turns = np.array([w.revolutions for w in windows])
        steps = [n for t in self.trials if t.facts.tilts_shaft for n in (t.onset, *t.law.changes)]
        tilted = sum((turns >= n).astype(int) for n in steps)
        mounting = np.array([w.mounting for w in windows]) + (1 + max(w.mounting for w in windows)) * tilted
        load = load + (load.max() + 1) * mounting  # means are compared within one number
        self.compared = ComparedLines.of(windows, self.channels)
        self.means = ComparedMeans.of(windows if "encoder" in self.channels else (), load, self.scatter)
        lines = self.compared
        transfer = _transfer_per_error(self.model, windows)[lines.kept]
        self.sizes = LineSizes.of(self.scatter, lines.channel, lines.harmonic, lines.std, transfer, group)
        self.by_teeth = np.zeros(lines.shape)  # share of each line that effects of longer periods make (L, W)
        if self.factors is not None:
            self.by_teeth = 1 - 1 / np.stack([_every(f) for f in self.factors], axis=1)[lines.kept]
        self.worn = np.array([w.worn for w in windows])
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

    def at(self, shared: np.ndarray) -> Varied:
        """The twin with these shared values."""
        numbers = tuple(shared[self.numbers_of(trial)] for trial in self.trials)
        return Varied(owner=None, model=self.calibrated(shared), numbers=numbers)

    def varied(self, shared: np.ndarray, step: float) -> list[Varied]:
        """The twin with each of the shared values moved by a step, one after the other."""
        here, out = self.at(shared), []
        for j in range(self.shared):
            moved, owner = shared.copy(), self.acting_on(j)
            moved[j] += step
            if owner is None:
                out.append(replace(here, model=self.calibrated(moved)))
            else:
                again = moved[self.numbers_of(owner)]
                numbers = tuple(again if t is owner else u for t, u in zip(self.trials, here.numbers, strict=True))
                out.append(replace(here, owner=owner, numbers=numbers))
        return out

    def _acting(self, twin: Varied, window: Observed) -> tuple[Effect, ...]:
        """The effects that act in a window."""
        made = (t.at(u, window) for t, u in zip(self.trials, twin.numbers, strict=True))
        return tuple(effect for effect in made if effect is not None)

    def predict(self, i: int, twin: Varied, depth: float, start: Prediction | None = None) -> Prediction:
        """Lines of window i; NotConverged where there is no steady state."""
        window = self.windows[i]
        flanks = self.profiles(depth, window)
        before = None if start is None else start.response
        return self._with_factors(i, predict(twin.model, self._acting(twin, window), flanks, window, before))

    def near(self, i: int, twin: Varied, flanks: Flanks, nearby: Nearby) -> Prediction:
        """As `predict`, to first order about a prediction of the same window."""
        window = self.windows[i]
        response = nearby.response(twin.model, self._acting(twin, window), flanks)
        return self._with_factors(i, _seen(window, response, flanks))

    def recalibrated(self, i: int, twin: Varied, flanks: Flanks, nearby: Nearby) -> Prediction:
        """The same with other calibrated values alone."""
        return self._with_factors(i, _seen(self.windows[i], nearby.recalibrated(twin.model), flanks))

    def _with_factors(self, i: int, found: Prediction) -> Prediction:
        if self.factors is None:
            return found
        return replace(found, every=found.every * _every(self.factors[i]))

    def residual(
        self, predictions: Sequence[Prediction], phase: float, depth: np.ndarray
    ) -> tuple[np.ndarray, float, Weights]:
        """Whitened residual (n,), Σ ln det, and the weights that were used."""
        m = np.stack([p.every for p in predictions], axis=1)[self.compared.kept]
        weights = self.sizes.weights(m, depth, m * self.by_teeth)
        return self.left(predictions, phase, weights), 2 * weights.log_det, weights

    def left(self, predictions: Sequence[Prediction], phase: float, weights: Weights) -> np.ndarray:
        """The residual (n,), whitened with given weights."""
        m = np.stack([p.every for p in predictions], axis=1)[self.compared.kept]
        rest = self.compared.turned(phase) - m
        means = self.means.measured - np.array([p.mean for p in predictions])
        return self.whitened(rest[..., None], means[:, None], weights)[:, 0]

    def whitened(self, lines: np.ndarray, means: np.ndarray, weights: Weights) -> np.ndarray:
        """Of unit variance (n, c): c sets of lines (L, W, c) and means (W, c) that are not explained."""
        return np.concatenate((self.compared.rows(weights.root @ lines), self.means.rows(means)))
