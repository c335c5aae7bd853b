"""The points of a wear path as arrays: what another process goes on from instead of computing them again.

Points are a pure function of model, condition and start profile, for programs with the same equations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.errors import ParameterError


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class KeptPoints:
    """m points of a path on p places of the path of contact, of the whole face or of every slice across it.

    ParameterError where the arrays are of different numbers of points, or of none.
    """

    depth: np.ndarray  # (m,) [m], strictly rising
    work: np.ndarray  # (m,) [rad/N]
    profiles: np.ndarray  # (m, p) or (m, slices, p) [m]
    rates: np.ndarray  # dh/dx, of the shape of the profiles [m·N/rad]
    lines: np.ndarray  # of `twin.wear.path.MeshLines`: error, pinion's motion, acceleration (m, 3, LINES)
    means: np.ndarray  # mean transmission error (m,) [m]
    lost: np.ndarray  # depths at which the teeth part for some of the mesh [m]
    ended: bool  # whether nothing follows the last point
    converged: bool  # False where the path ended because no steady state was found

    def __post_init__(self) -> None:
        lengths = {len(a) for a in (self.depth, self.work, self.profiles, self.rates, self.lines, self.means)}
        if len(lengths) != 1 or 0 in lengths:
            raise ParameterError(f"points of a wear path have equal numbers of each quantity, not {sorted(lengths)}")
