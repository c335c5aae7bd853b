"""Flanks that wear differently because the teeth differ, as an error of the contacts of a setup.

    e_p = … − departure1[tooth of the pinion](s_p) − departure2[tooth of the gear](s_p)

departure  what a flank has lost more than flanks of teeth that are alike, at the depth of the mean flank
           (twin/wear/differing_teeth.py)

Effects that set teeth apart say how (`ToothEffect.differences`); the depth of the mean flank is that of the worn
profile which the response is asked for. So nothing but the profile and the effects is needed to know every flank.

Ignores  what shaft errors, friction and a load that differs across the face do to single teeth; wear under other
         torques before, beyond the steps of TORQUE_STEP
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import exp, log
from typing import Protocol, runtime_checkable

import numpy as np

from twin.compiled import spline
from twin.dynamics.mesh import ROWS
from twin.effects.setup import Setup
from twin.model import Model
from twin.wear.differing_teeth import POINTS, Sharing, ToothDifferences, departures
from twin.wear.law_of_rig import law_of
from twin.wear.profile import WornProfile

TORQUE_STEP = 0.1  # relative: flanks of one history are those of one torque, as in a segment (updating/segments.py)


@runtime_checkable
class ToothEffect(Protocol):
    """An effect that sets teeth apart."""

    def differences(self, teeth: tuple[int, int]) -> ToothDifferences: ...


def with_tooth_wear(setup: Setup, model: Model, effects: Iterable[object], profiles: Sequence[WornProfile]) -> Setup:
    """The setup with what its teeth have worn differently at the depth of the profiles; itself where they are alike."""
    differences = tuple(e.differences(setup.pair.teeth) for e in effects if isinstance(e, ToothEffect))
    depth = float(np.mean([p.mean for p in profiles], axis=0)[profiles[0].on_active].max())
    acting = tuple(d for d in differences if depth > d.onset_depth and (d.on(0) or d.on(1)))
    if not acting:
        return setup
    torque = exp(TORQUE_STEP * round(log(setup.condition.torque) / TORQUE_STEP))
    calibration = model.calibration
    sharing = Sharing(
        mesh=model.mesh,
        stiffness_scale=calibration.stiffness_scale,
        force=torque / setup.pair.base_radius[0],
        half_width=calibration.contact_half_width,
        law=law_of(model.rig),
    )
    added, slope = _at_contacts(setup, departures(sharing, acting, depth))
    return setup.with_error(-added, -setup.pair.base_radius[0] * slope)


def _at_contacts(setup: Setup, flanks: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """What is missing at every contact (p, n) [m] and its slope along the path, of flanks (teeth, 3·POINTS) each."""
    passages, mesh, drive = setup.passages, setup.mesh, len(ROWS)
    n, spacing = mesh.samples, setup.pair.base_pitch / POINTS
    at = mesh.positions.ravel()
    place = np.arange(drive)[:, None] * n + np.arange(setup.samples) % n
    out = np.zeros((2, *passages.position.shape))
    for flank, tooth in zip(flanks, (passages.pinion_tooth, passages.gear_tooth), strict=True):
        which = (tooth[:drive] % len(flank)) * (drive * n) + place
        for total, values in zip(out, spline(-1.5 * setup.pair.base_pitch, spacing, flank, at), strict=True):
            total[:drive] += values.ravel()[which]
    return out[0], out[1]
