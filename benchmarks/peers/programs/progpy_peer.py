"""ProgPy: remaining life by its MonteCarlo predictor, one step of its state estimators, and lives from wear histories.

The wear-rate model is linear: work x grows by the rate k with every revolution, and the end is reached when x has grown
by `to_go`. Samples of k are log-normal, as the life is that gear-twin states. States are saved at the end alone.
"""

from __future__ import annotations

import warnings
from time import process_time
from typing import Any

import numpy as np
from exchange import Found, serve, shortest, shortest_after
from progpy import LinearModel, PrognosticsModel
from progpy.predictors import MonteCarlo
from progpy.state_estimators import KalmanFilter, ParticleFilter, UnscentedKalmanFilter
from progpy.uncertain_data import MultivariateNormalDist, UnweightedSamples

SEED = 1
LONGEST = 8.0  # a prediction goes, in medians of the life
NEVER = 1e99  # saving interval: of each sample only its end is kept


class Wear(LinearModel):
    """x' = k, worn when x reaches the parameter `end`."""

    inputs: list[str] = []  # noqa: RUF012 - as ProgPy's models are written
    states = ["x", "k"]  # noqa: RUF012
    outputs = ["x"]  # noqa: RUF012
    events = ["worn"]  # noqa: RUF012
    is_vectorized = True
    A = np.array([[0.0, 1.0], [0.0, 0.0]])
    C = np.array([[1.0, 0.0]])
    F = np.array([[-1.0, 0.0]])


class SolvedWear(Wear):
    """The same as what ProgPy calls a direct model: the time of the event is solved for, not walked to."""

    def time_of_event(self, x: Any, *given: Any, **options: Any) -> dict[str, Any]:
        return {"worn": (self.parameters["end"] - x["x"]) / x["k"]}


def wear(kind: type[Wear], end: float, **parameters: Any) -> Wear:
    model = kind(end=end, process_noise=0.0, measurement_noise=0.0, **parameters)
    model.G = np.array([[end]])
    return model


def band(lives: Any) -> list[float]:
    return [float(q) for q in np.quantile(np.asarray(lives, float), (0.5, 0.05, 0.95))]


def life(problem: dict[str, Any]) -> Found:
    to_go, rate, spread, count = (problem[name] for name in ("to_go", "rate", "spread", "samples"))
    walked, solved = wear(Wear, to_go), wear(SolvedWear, to_go)
    predictor = MonteCarlo(walked)
    lives: dict[str, list[float]] = {}

    def drawn() -> np.ndarray:
        return rate * np.exp(spread * np.random.default_rng(SEED).standard_normal(count))

    def predicted(name: str, dt: Any) -> None:
        rates = drawn()
        state = UnweightedSamples({"x": np.zeros(count), "k": rates}, _type=walked.StateContainer)
        found = predictor.predict(state, dt=dt, save_freq=NEVER)
        lives[name] = band(found.time_of_event.key("worn"))

    def at_once() -> None:
        state = solved.StateContainer(np.array([np.zeros(count), drawn()]))
        lives["direct"] = band(solved.time_of_event(state)["worn"])

    median = to_go / rate
    times = {
        "steps": shortest(lambda: predicted("steps", median / 60), times=3),
        "one_step": shortest(lambda: predicted("one_step", lambda t, x: (to_go - x["x"]) / x["k"] * (1 + 1e-12))),
        "direct": shortest(at_once),
    }
    return times, lives


def filters(problem: dict[str, Any]) -> Found:
    revolutions, measured, std = problem["revolutions"], problem["measured"], problem["std"]
    noises, start = problem["noises"], problem["start_revolutions"]
    model = wear(Wear, 1.0)
    empty = model.InputContainer({})
    known = MultivariateNormalDist(["x", "k"], problem["mean"], problem["covariance"])

    rough = wear(Wear, 1.0)
    interval = float(revolutions[0] - start)
    rough.parameters["process_noise"] = {"x": 0.0, "k": float(np.sqrt(noises[0][1][1])) / interval}

    def gaussian(kind: type) -> Any:
        return kind(model, known, t0=start, dt=NEVER, Q=noises[0], R=np.array([[std**2]]))

    def particles() -> Any:
        np.random.seed(SEED)
        return ParticleFilter(rough, known, t0=start, num_particles=problem["particles"], measurement_noise={"x": std})

    def followed(estimator: Any) -> Any:
        for n, z, noise in zip(revolutions, measured, noises, strict=True):
            if estimator.__class__ is not ParticleFilter:
                estimator.filter.Q = noise
            estimator.estimate(float(n), empty, {"x": float(z)})
        return estimator

    times, values = {}, {}
    for name, begin in (
        ("kalman", lambda: gaussian(KalmanFilter)),
        ("unscented", lambda: gaussian(UnscentedKalmanFilter)),
        ("particles", particles),
    ):
        times[name] = shortest_after(begin, followed) / len(revolutions)
        mean = followed(begin()).x.mean
        values[name] = [float(mean["x"]), float(mean["k"])]
    return times, values


class DepthWear(PrognosticsModel):
    """Work x grows by e^{lk} with every revolution; its depth is measured, worn when x reaches the parameter `end`."""

    inputs: list[str] = []  # noqa: RUF012
    states = ["x", "lk"]  # noqa: RUF012
    outputs = ["d"]  # noqa: RUF012
    events = ["worn"]  # noqa: RUF012
    is_vectorized = True

    def next_state(self, x: Any, u: Any, dt: float) -> Any:
        return self.StateContainer(np.array([x["x"] + np.exp(x["lk"]) * dt, x["lk"]]))

    def output(self, x: Any) -> Any:
        return self.OutputContainer(np.array([np.interp(x["x"], self.parameters["works"], self.parameters["depths"])]))

    def event_state(self, x: Any) -> dict[str, Any]:
        return {"worn": 1 - x["x"] / self.parameters["end"]}

    def threshold_met(self, x: Any) -> dict[str, Any]:
        return {"worn": x["x"] >= self.parameters["end"]}


def depth_wear(problem: dict[str, Any], end: float) -> DepthWear:
    table = {"works": problem["works"], "depths": problem["depths"]}
    return DepthWear(end=end, process_noise=0.0, measurement_noise=0.0, **table)


def lives(problem: dict[str, Any]) -> Found:
    """Lives at some windows of every history, by either filter: quantiles; processor time of all steps and lives."""
    times, values = {}, {}
    for name in ("unscented", "particles"):
        begun = process_time()
        values[name] = [life_quantiles(name, problem, i) for i in range(len(problem["ends"]))]
        times[name] = process_time() - begun
    return times, values


def life_quantiles(name: str, problem: dict[str, Any], i: int) -> list[list[float]]:
    """Of one history, at the windows that are asked for."""
    np.random.seed(SEED + i)
    n, drift, count = int(problem["sizes"][i]), problem["drift"], problem["particles"]
    counts, measured, stds = (problem[key][i, :n] for key in ("counts", "measured", "stds"))
    model = depth_wear(problem, problem["ends"][i])
    empty = model.InputContainer({})
    covariance = np.diag([1e-12 * problem["ends"][i] ** 2, problem["prior"] ** 2])
    known = MultivariateNormalDist(["x", "lk"], [0.0, float(np.log(problem["rates"][i]))], covariance)
    noise = np.diag([1e-14 * problem["ends"][i] ** 2, drift**2])
    if name == "unscented":
        estimator: Any = UnscentedKalmanFilter(model, known, t0=0.0, dt=NEVER, Q=noise, R=np.array([[stds[0] ** 2]]))
    else:
        estimator = ParticleFilter(model, known, t0=0.0, dt=NEVER, num_particles=count)
    out, before = [], 0.0
    for j, (now, z, std) in enumerate(zip(counts.tolist(), measured.tolist(), stds.tolist(), strict=True)):
        if name == "unscented":
            estimator.filter.R = np.array([[std**2]])
        else:
            estimator.parameters["measurement_noise"] = {"d": std}
            model.parameters["process_noise"] = {"x": 0.0, "lk": drift / (now - before)}
        estimator.estimate(now, empty, {"d": z})
        if j in problem["asked"][i]:
            out.append(predicted_quantiles(problem, model, estimator, now / (j + 1), float(problem["ends"][i])))
        before = now
    return out


def predicted_quantiles(
    problem: dict[str, Any], model: DepthWear, estimator: Any, interval: float, end: float
) -> list[float]:
    """Of the life from a filter's state, its rate wandering on as it is assumed to have done."""
    states = estimator.x.sample(problem["samples"])
    median = max(end - float(estimator.x.mean["x"]), 1e-3 * end) / float(np.exp(estimator.x.mean["lk"]))
    dt = median / problem["steps"]
    ahead = depth_wear({"works": problem["works"], "depths": problem["depths"]}, end)
    ahead.parameters["process_noise"] = {"x": 0.0, "lk": problem["drift"] * np.sqrt(dt / interval) / dt}
    found = MonteCarlo(ahead).predict(states, dt=dt, save_freq=NEVER, horizon=LONGEST * median)
    lives = [LONGEST * median if t is None else t for t in found.time_of_event.key("worn")]
    return [float(q) for q in np.quantile(np.asarray(lives, float), problem["probabilities"])]


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    serve("progpy", {"life": life, "filters": filters, "lives": lives})
