"""Wear paths by what they are made from, kept within a budget of memory.

Pure functions of their arguments: a path that was dropped is computed again, with the same points. Which path is
dropped is drawn at random (with a fixed seed). Machines that take turns would otherwise each find their path dropped a
moment before they need it as soon as one machine more is there than fits: with a random choice the time of a window
rises gradually instead.

Source   L. A. Belady, IBM Systems Journal 5 (1966) 78–101 (random replacement; patterns that defeat recency)
"""

from __future__ import annotations

from collections.abc import Callable, Hashable

import numpy as np

from twin.wear.path import WearPath

BUDGET = 512 * 2**20  # of all paths together [bytes]


class PathCache:
    """Paths by key, at most `budget` bytes of them."""

    def __init__(self, budget: int = BUDGET, seed: int = 1) -> None:
        self.budget = budget
        self.built = 0  # paths that were computed, kept or not
        self._paths: dict[Hashable, WearPath] = {}
        self._random = np.random.default_rng(seed)

    def __len__(self) -> int:
        return len(self._paths)

    @property
    def nbytes(self) -> int:
        """Memory of all paths [bytes]; they grow after they were put here."""
        return sum(path.nbytes for path in self._paths.values())

    def get(self, key: Hashable, make: Callable[[], WearPath]) -> WearPath:
        """The path of a key, made where it is not here."""
        path = self._paths.get(key)
        if path is None:
            path = make()
            self.built += 1
            self._paths[key] = path
        excess = self.nbytes - self.budget
        while excess > 0 and len(self._paths) > 1:
            others = [k for k in self._paths if k != key]
            dropped = others[self._random.integers(len(others))]
            excess -= self._paths.pop(dropped).nbytes
        return path

    def clear(self) -> None:
        self._paths.clear()
