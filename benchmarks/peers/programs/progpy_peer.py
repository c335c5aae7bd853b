"""ProgPy: remaining life by its MonteCarlo predictor, and one step of its state estimators.

The wear-rate model is linear: work x grows by the rate k with every revolution, and the end is reached when x has grown
by `to_go`. Samples of k are log-normal, as the life is that gear-twin states. States are saved at the end alone.
"""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from exchange import Found, serve, shortest, shortest_after
from progpy import LinearModel
from progpy.predictors import MonteCarlo
from progpy.state_estimators import KalmanFilter, ParticleFilter, UnscentedKalmanFilter
from progpy.uncertain_data import MultivariateNormalDist, UnweightedSamples

SEED = 1
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


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    serve("progpy", {"life": life, "filters": filters})
