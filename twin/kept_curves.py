"""The wear curves that a machine's next window needs: what another process would have to compute again.

A curve takes as long as many windows do. It is a pure function of what its key names, so that its points can be kept
beside a state, and given to the process that goes on (`twin.updating.path_cache.PathCache.known`).
"""

from __future__ import annotations

from twin.rig import Rig
from twin.state import State
from twin.updating.model_cache import PathKey, path_at_hand
from twin.wear.path import WearPath


def curves_of(rig: Rig, state: State) -> dict[PathKey, WearPath]:
    """The present wear curves of the twin, and of the twins with fewer effects, as far as this process has them."""
    memories = [state.memory, *(stage.memory for stage in state.tracing.stages)]
    return dict(found for memory in memories if (found := path_at_hand(rig, memory)) is not None)
