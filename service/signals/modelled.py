"""How the twin's lines of a window are made from its state."""

from __future__ import annotations

from collections.abc import Callable

from service.signals.subject import Modelling
from twin.errors import NotAvailable
from twin.features.window_features import WindowFeatures
from twin.rig import Rig
from twin.state import State
from twin.tracing.modelled_lines import ModelledLines, depth_at, modelled_lines

MICROMETRE = 1e-6


def modelling(rig: Rig, state: State, recorded_um: Callable[[], float | None]) -> Modelling:
    """The lines by the twin's present state.

    recorded_um  depth in the window's record [µm], for a window that the twin's history no longer holds
    """

    def lines(features: WindowFeatures) -> ModelledLines:
        depth = depth_at(state, features.start_time_ns)
        if depth is None:
            micrometres = recorded_um()
            if micrometres is None:
                raise NotAvailable("this window has no wear depth")
            depth = micrometres * MICROMETRE
        return modelled_lines(rig, state, features, depth)

    return lines
