"""How a problem reaches a peer's program, how both sides are timed, and how the program answers.

A problem is one .npz file of arrays, numbers and texts. A program is called with the name of a task, that file and the
name of the file that it writes: JSON with its version, times [s] and values by name. Libraries print what they like.
gear-twin times itself with the same `shortest`.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping
from importlib.metadata import version
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

LEAST = 0.5  # measured at least, all calls together: the shortest of many is that of a quiet moment [s]
Found = tuple[dict[str, float], dict[str, Any]]  # times [s] and values, by name


def write_problem(path: Path, **values: Any) -> Path:
    """Keeps arrays, numbers and texts by name."""
    np.savez(path, **values)
    return path


def read_problem(path: str | Path) -> dict[str, Any]:
    """What was kept: arrays as they were, numbers and texts as Python has them."""
    with np.load(path) as kept:
        return {name: kept[name] if kept[name].ndim else kept[name].item() for name in kept.files}


def shortest(run: Callable[[], object], times: int = 5, count: int = 1) -> float:
    """Shortest processor time of one call [s], of at least `times` measurements of `count` calls, after one call."""

    def several(nothing: None) -> None:
        for _ in range(count):
            run()

    return shortest_after(lambda: None, several, times) / count


def shortest_after(prepare: Callable[[], Any], run: Callable[[Any], object], times: int = 5) -> float:
    """The same of a call with something that is prepared anew for each, outside of the time."""
    run(prepare())
    best, done, spent = float("inf"), 0, 0.0
    while done < times or spent < LEAST:
        given = prepare()
        begun = process_time()
        run(given)
        taken = process_time() - begun
        best, done, spent = min(best, taken), done + 1, spent + taken
    return best


def per_step(run: Callable[[int], object], short: int, long: int) -> float:
    """Processor time of one step [s]: what a longer run takes beyond a shorter one, so that no set-up counts."""
    return (shortest(lambda: run(long)) - shortest(lambda: run(short))) / (long - short)


def serve(package: str, tasks: Mapping[str, Callable[[dict[str, Any]], Found]]) -> None:
    """Does the task that the command line names and writes the answer."""
    task, problem, answer = sys.argv[1:]
    times, values = tasks[task](read_problem(problem))
    found = {"version": version(package), "times": times, "values": values}
    Path(answer).write_text(json.dumps(found, default=np.ndarray.tolist), encoding="utf-8")
