"""The depth by wear alone, where effects that were found may be the structure instead.

Mesh lines of a machine whose structure is an estimate differ from those of the model by factors that nobody knows
(twin/updating/joint_gauge.py). An effect on the mesh changes the same lines, so that the search may take one for the
other: the depth with the effects and the depth without them are then both possible.
"""

from __future__ import annotations

from twin.quantiles import Z95
from twin.rig import Rig
from twin.structure_spread import is_estimated
from twin.tracing.state import Tracing


def band_of_wear_alone(rig: Rig, tracing: Tracing) -> tuple[float, float] | None:
    """5 and 95 % of the depth without any effect [m]; None where the structure is known or no effect changes it."""
    if not is_estimated(rig) or len(tracing.stages) < 2:
        return None
    alone = tracing.stages[0]
    factors = alone.memory.line_factors
    if factors is None:
        return None
    return max(alone.depth - Z95 * factors.depth_std, 0.0), alone.depth + Z95 * factors.depth_std
