"""Wear paths by what they are made from, kept within a budget of memory.

Pure functions of their arguments: a path that was dropped is computed again, with the same points; or its points come
from `known`, where another process has computed and kept them. Which path is
dropped is drawn at random (with a fixed seed). Machines that take turns would otherwise each find their path dropped a
moment before they need it as soon as one machine more is there than fits: with a random choice the time of a window
rises gradually instead.

Source   L. A. Belady, IBM Systems Journal 5 (1966) 78–101 (random replacement; patterns that defeat recency)
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Any

import numpy as np

from twin.wear.kept_points import KeptPoints
from twin.wear.path import WearPath

BUDGET = 512 * 2**20  # of all paths together [bytes]


class PathCache:
    """Paths by key, at most `budget` bytes of them.

    known  the points of a path that are kept elsewhere; None where there are none
    """

    def __init__(self, budget: int = BUDGET, seed: int = 1) -> None:
        self.budget = budget
        self.known: Callable[[Any], KeptPoints | None] = lambda key: None
        self.built = 0  # paths that were computed, kept or not
        self._paths: dict[Hashable, WearPath] = {}
        self._random = np.random.default_rng(seed)

    def __len__(self) -> int:
        return len(self._paths)

    @property
    def nbytes(self) -> int:
        """Memory of all paths [bytes]; they grow after they were put here."""
        return sum(path.nbytes for path in self._paths.values())

    def get(self, key: Hashable, make: Callable[[KeptPoints | None], WearPath]) -> WearPath:
        """The path of a key, made where it is not here, with the points that are kept of it."""
        path = self._paths.get(key)
        if path is None:
            path = make(self.known(key))
            self.built += 1
            self._paths[key] = path
        excess = self.nbytes - self.budget
        while excess > 0 and len(self._paths) > 1:
            others = [k for k in self._paths if k != key]
            dropped = others[self._random.integers(len(others))]
            excess -= self._paths.pop(dropped).nbytes
        return path

    def find(self, key: Hashable) -> WearPath | None:
        """The path of a key where it is here."""
        return self._paths.get(key)

    def clear(self) -> None:
        self._paths.clear()
