"""Does the crack of a tooth grow? Its loss of stiffness in each window, and the law that these follow.

    q_w = argmin Σ_m |X_mw − X_m0 − R_m(q)|²/σ_mw²        of each window w against the first windows

Source   the response R of the gear's lines to a softer tooth: twin/tracing/detectors/crack.py; the laws: size_laws.py
Limits   R is that of the flanks of the windows in which the crack was found
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from twin.effects.tooth_crack import ToothCrack
from twin.thresholds import deciding
from twin.tracing.scatter import MODELLED
from twin.tracing.size_laws import THRESHOLDS as SIZE_LAWS
from twin.tracing.size_laws import LawFit, law_fits


@dataclass(frozen=True, slots=True, kw_only=True)
class CrackGrowthThresholds:
    """How well the loss of one window is known."""

    least_std: float = deciding(
        0.05,
        meaning="of a window's loss of stiffness",
        source="derivation: the step of the losses that are tried where they are finest",
    )


THRESHOLDS = CrackGrowthThresholds()
PRIOR = next(p.prior for p in ToothCrack.parameters if p.name == "stiffness_loss")


def losses_by_window(
    changes: np.ndarray,
    responses: Mapping[float, np.ndarray],
    noise: float,
    scatter: float,
    limits: CrackGrowthThresholds = THRESHOLDS,
) -> tuple[np.ndarray, np.ndarray]:
    """The loss that meets each window's change best (W,), and its standard deviation (W,).

    The loss between those tried is linear in the response: R(q) = R_1 + t·(R_2 − R_1).

    changes    of one gear's lines against the first windows (W, n) complex [m]
    responses  to the cracked tooth, by its loss: (n,) complex [m]
    noise      of a line [m]; scatter: relative, of what the response may be off
    """
    known = sorted(responses)
    q = np.array([0.0, *known])
    R = np.array([np.zeros(changes.shape[1], dtype=complex), *(responses[loss] for loss in known)])
    losses, stds = [], []
    for change in changes:
        weight = 1 / (noise**2 + (scatter * np.abs(change)) ** 2)
        tried = []
        for a, b, one, two in zip(q, q[1:], R, R[1:], strict=False):
            step = two - one
            information = float(weight @ np.abs(step) ** 2)
            t = float(np.clip((weight * (np.conj(step) * (change - one)).real).sum() / information, 0.0, 1.0))
            misfit = float(weight @ np.abs(change - one - t * step) ** 2)
            widen = max(misfit / change.size, 1.0)
            tried.append((misfit, a + t * (b - a), (b - a) * np.sqrt(widen / (2 * information))))
        _, loss, std = min(tried)
        losses.append(loss)
        stds.append(max(std, limits.least_std))
    return np.array(losses), np.array(stds)


def growing(turns: np.ndarray, losses: np.ndarray, std: np.ndarray) -> LawFit | None:
    """The growth of a crack; None where a loss that is constant since its onset explains the windows as well.

    turns  of the pinion, of each window, rising (W,); losses and their standard deviations (W,)
    """
    covariance = np.diag(std**2 + (MODELLED * losses) ** 2)
    fits = law_fits(turns, losses, covariance, PRIOR, kinds=("constant", "linear"))
    ramp = fits.get("linear")
    if ramp is None or ramp.log_evidence - fits["constant"].log_evidence < SIZE_LAWS.over_constant:
        return None
    return ramp
