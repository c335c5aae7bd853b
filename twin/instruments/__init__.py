"""Faults of the instruments in one window: found before anything is asked of the machine, put right and said.

    window = examined(rig, window)

A gear pair turns as its teeth do: what mesh lines do against the encoder that no teeth can do is a fault of a clock or
of lost samples; what strikes a torque meter and an accelerometer at one moment, and no angle, came by the cables. Every
check answers the window with its data corrected and a fault that names what was found, or the window as it is.
"""

from __future__ import annotations

from collections.abc import Callable

from twin.instruments.bursts import without_bursts
from twin.instruments.delays import with_clocks, with_lost_samples
from twin.instruments.lost_contact import without_lost_contact
from twin.instruments.seen import Seen
from twin.rig import Rig
from twin.windows import Window

CHECKS: tuple[Callable[[Seen], Window], ...] = (without_lost_contact, without_bursts, with_clocks, with_lost_samples)


def examined(rig: Rig, window: Window) -> Window:
    """The window as sound instruments would have shown it, what was found among its faults; else itself."""
    for check in CHECKS:
        window = check(Seen(rig=rig, window=window))
    return window
