"""Lives from the same measured depths: gear-twin beside ProgPy's unscented Kalman filter and particle filter.

    python -m benchmarks.peers.lives [--number N] [--folder DIR] [--picture]

Drawn wear histories (benchmarks/wear_histories.py, odd seeds). ProgPy's model has the states work and ln of the wear
rate, which grows work and wanders by as much from window to window as the twin's own track allows; it measures depth
through the same wear curve, with the standard deviation that the twin states of it, scatter and common error together.
Its MonteCarlo predictor draws the life. Every table is of the same windows.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from time import process_time

import numpy as np

from benchmarks.peers.asking import Answer, Ask, ask_in
from benchmarks.peers.environments import default_folder
from benchmarks.peers.programs.exchange import write_problem
from benchmarks.reliability_scores import Scored, reached, scored, table
from benchmarks.wear_histories import (
    CLASSES,
    EXPECTED,
    LEAST_WINDOWS,
    MARKS,
    STATED_OWN,
    STATED_SHARED,
    History,
    curve,
    drawn,
    followed,
    wear_points,
)  # fmt: skip
from twin.updating.tracker import RATE

PROBABILITIES = (0.005, 0.01, 0.025, *np.arange(0.05, 0.96, 0.05).round(3).tolist(), 0.975, 0.99, 0.995)
SAMPLES, PARTICLES, STEPS = 300, 1000, 25  # of a prediction; of the filter; to the median of a life
FILTERS = {"unscented": "unscented Kalman", "particles": "particles"}


def asked_of(history: History) -> list[tuple[str, int]]:
    """What is asked of a history, and the number of the window after which."""
    found = [
        (what, int(np.searchsorted(history.counts, share * history.life, side="right")) - 1)
        for what, share in MARKS.items()
    ]
    return [(what, number) for what, number in found if number + 1 >= LEAST_WINDOWS]


def problem_of(folder: Path, histories: Sequence[History]) -> Path:
    """The histories as ProgPy's program reads them; rows are padded."""
    most = max(h.counts.size for h in histories)
    counts, measured, stds = (np.ones((len(histories), most)) for _ in range(3))
    asked = np.full((len(histories), len(MARKS)), -1)
    rates = np.empty(len(histories))
    depths = np.linspace(curve().start_depth, 320e-6, 800)
    for i, history in enumerate(histories):
        n = history.counts.size
        counts[i, :n], measured[i, :n] = history.counts, history.measured
        parts = [np.hypot(relative * history.measured, floor) for relative, floor in (STATED_OWN, STATED_SHARED)]
        stds[i, :n] = np.hypot(*parts)
        numbers = [number for _, number in asked_of(history)]
        asked[i, : len(numbers)] = numbers
        last = wear_points(history)[-1]
        rates[i] = EXPECTED * last.work / last.revolutions
    return write_problem(
        folder / "lives.npz", counts=counts, measured=measured, stds=stds, asked=asked, rates=rates,
        sizes=np.array([h.counts.size for h in histories]), drift=RATE.drift, prior=RATE.prior, particles=PARTICLES,
        samples=SAMPLES, steps=STEPS, probabilities=np.array(PROBABILITIES), depths=depths,
        works=np.array([curve().work_at(d) for d in depths]),
        ends=np.array([curve().work_at(h.end) for h in histories]),
    )  # fmt: skip


def of_peer(answer: Answer, histories: Sequence[History]) -> Iterator[Scored]:
    """The peer's lives against the truth."""
    for name, by in FILTERS.items():
        for history, found in zip(histories, answer.values[name], strict=True):
            for (what, number), quantiles in zip(asked_of(history), found, strict=True):
                left = history.life - float(history.counts[number])
                yield scored(
                    partial(_between, quantiles), left, reached(quantiles, PROBABILITIES, left), group="drawn",
                    kind=history.kind, what=what, campaign=f"{history.kind}-{history.seed}", by=f"ProgPy, {by}",
                )  # fmt: skip


def _between(quantiles: Sequence[float], probability: float) -> float:
    return float(np.interp(probability, PROBABILITIES, quantiles))


def compared(ask: Ask, number: int) -> tuple[list[Scored], list[str]]:
    """All scores, and what they took."""
    histories = [drawn(kind, 2 * i + 1) for kind in CLASSES for i in range(number)]
    begun = process_time()
    own = [row for history in histories for row in followed(history)]
    spent = process_time() - begun
    said = [f"processor time for {len(own)} lives: gear-twin {spent:.1f} s, windows followed and scored as well"]
    theirs: list[Scored] = []
    times = dict.fromkeys(FILTERS, 0.0)
    peer = ""
    for kind in CLASSES:
        here = [history for history in histories if history.kind == kind]
        with tempfile.TemporaryDirectory(prefix="gear-twin-peers-") as made:
            answer = ask("progpy", "lives", problem_of(Path(made), here))
        if answer.missing:
            return own, [*said, f"{answer.peer} is not available: {answer.missing}"]
        theirs += of_peer(answer, here)
        times = {name: spent + answer.times[name] for name, spent in times.items()}
        peer = answer.peer
    said += [f"  {peer}, {by}: {times[name]:.1f} s" for name, by in FILTERS.items()]
    return own + theirs, said


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.peers.lives", description=__doc__)
    parser.add_argument("--number", type=int, default=40, metavar="N", help="histories of each class")
    parser.add_argument("--folder", type=Path, default=default_folder(), help="where the peers' environments are kept")
    given = parser.parse_args(arguments)
    rows, said = compared(ask_in(given.folder), given.number)
    order = {(kind, what): i for i, (kind, what) in enumerate((k, w) for k in CLASSES for w in MARKS)}
    rows.sort(key=lambda r: order[r.kind, r.what])
    print("\n".join(table(rows, lambda r: f"{r.kind}, {r.what}: {r.by}", wide=52)))
    print("\n".join(said))
    return 0


if __name__ == "__main__":
    sys.exit(main())
