"""A peer's program asked for its times and values on a problem."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from benchmarks.peers.environments import Unavailable, python_of

PROGRAMS = Path(__file__).parent / "programs"
ONE_THREAD = dict.fromkeys((f"{name}_NUM_THREADS" for name in ("OPENBLAS", "OMP", "MKL", "NUMBA")), "1")
LONGEST = 900.0  # a program may take [s]


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """What a peer's program found, or why there is nothing."""

    peer: str  # name and version
    times: Mapping[str, float] = field(default_factory=dict)  # [s]
    values: Mapping[str, Any] = field(default_factory=dict)
    missing: str = ""


Ask = Callable[[str, str, Path], Answer]  # peer, task, problem


def ask_in(folder: Path) -> Ask:
    """Asks peers whose environments are in a folder; one that cannot be had is tried once."""

    @cache
    def python(name: str) -> Path | str:
        try:
            return python_of(name, folder)
        except Unavailable as why:
            return str(why)

    def ask(name: str, task: str, problem: Path) -> Answer:
        found = python(name)
        if isinstance(found, str):
            return Answer(peer=name, missing=found)
        try:
            return answered(name, found, task, problem)
        except Unavailable as why:
            return Answer(peer=name, missing=str(why))

    return ask


def answered(name: str, python: Path, task: str, problem: Path) -> Answer:
    """What the program of a peer finds; Unavailable where it fails."""
    found_in = problem.with_suffix(".answer.json")
    environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")} | ONE_THREAD
    try:
        done = subprocess.run(
            [str(python), str(PROGRAMS / f"{name}_peer.py"), task, str(problem), str(found_in)],
            cwd=problem.parent, env=environment, capture_output=True, text=True, timeout=LONGEST, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise Unavailable(f"its program took more than {LONGEST:g} s") from None
    if done.returncode:
        said = done.stderr.strip().splitlines()
        raise Unavailable(f"its program failed: {said[-1] if said else f'status {done.returncode}'}")
    found = json.loads(found_in.read_text(encoding="utf-8"))
    return Answer(peer=f"{name} {found['version']}", times=found["times"], values=found["values"])
