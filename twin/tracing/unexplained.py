"""What is left beyond the model and its effects, and whether the twin may call the machine explained.

    share = Σ max(left − noise, 0) / Σ measured                      energies of the lines over the latest windows

A machine is explained only where the twin predicts windows that took no part in any fit: transmission error and
acceleration alike within the limit, with nothing that speaks against the calibrated model. Too few windows, a missing
channel or a doubt give `insufficient_data`; content that no effect of the table makes gives `unknown_effect`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin.assessment import HeldOutErrors, SpectralLine, Unexplained
from twin.rig import Rig
from twin.thresholds import deciding
from twin.tracing.state import Tracing
from twin.updating.calibration import outliers
from twin.updating.residual import STRONGEST, WindowResidual
from twin.updating.update import UpdateOutcome


@dataclass(frozen=True, slots=True, kw_only=True)
class VerdictLimits:
    """What `explained` demands."""

    held_out_error: float = deciding(
        0.3,
        meaning="largest waveform error of held-out windows, of transmission error and of acceleration alike, at which "
        "a machine is explained",
        source="between observed values of D00-D13: the twins in use leave up to 0.29; without its effect a machine "
        "leaves 0.34 to 1.5 in six cases of eight (a crack and a sensor gain leave 0.25 and 0.16, and would pass)",
    )
    left_share: float = deciding(
        0.1,
        of="energy of the measured lines",
        meaning="share of the energy left above the noise below which a residual counts as explained",
        source="not derived: chosen so that healthy reference campaigns (at most 0.006) pass with a margin",
    )
    doubtful_misfit: float = deciding(
        4.0,
        meaning="misfit of the encoders' mesh lines (chi-square per line) from which the model is in doubt",
        source="derivation: the lines are then twice as far off as their standard deviation",
    )


VERDICT_LIMITS = VerdictLimits()


def doubts_of(rig: Rig, outcome: UpdateOutcome, limits: VerdictLimits = VERDICT_LIMITS) -> list[str]:
    """What speaks against the calibrated model of the machine, a sentence each."""
    out = [] if outcome.memory.fit is None else outliers(rig, outcome.memory.fit)
    estimate = outcome.estimate
    if estimate is not None and estimate.misfit > limits.doubtful_misfit:
        out.append(
            f"the encoders' mesh lines differ from the model by {np.sqrt(estimate.misfit):.1f} times what the rig "
            "file's tolerances allow: another structure, or an effect that is not in the model"
        )
    return out


def unexplained_of(
    recent: Sequence[WindowResidual],
    doubts: Sequence[str],
    errors: HeldOutErrors | None,
    limits: VerdictLimits = VERDICT_LIMITS,
) -> Unexplained:
    """What the twin of a machine leaves over the latest windows.

    errors  of the twin in use on held-out windows; None where there were none
    """
    if not recent or not recent[-1].phase_known:
        return Unexplained(
            verdict="insufficient_data",
            reason="no window with the mesh phase known has been compared yet",
            limit=limits.held_out_error,
        )
    measured = sum(r.measured for r in recent)
    share = max(0.0, sum(r.left - r.noise for r in recent)) / measured
    reasons = list(doubts)
    if share >= limits.left_share:
        reasons.append("the remaining lines have not been attributed to an effect")
    reasons += _not_confirmed(errors, limits.held_out_error)
    return Unexplained(
        verdict="insufficient_data" if reasons else "explained",
        share=share,
        lines=recent[-1].lines,
        reason="; ".join(reasons),
        limit=limits.held_out_error,
    )


def _not_confirmed(errors: HeldOutErrors | None, limit: float) -> list[str]:
    """Why held-out windows do not confirm the twin, a sentence each; none where they do."""
    if errors is None or not errors.windows:
        return ["no held-out window has been compared with the twin yet"]
    return held_out_faults(errors, limit)


def held_out_faults(errors: HeldOutErrors, limit: float, missing: bool = True) -> list[str]:
    """What held-out windows say against the twin, a sentence each.

    missing  whether a channel that was not measured counts as well
    """
    out = []
    for what, error in (("transmission error", errors.transmission_error), ("acceleration", errors.waveform)):
        if error is None and missing:
            out.append(f"the {what} of held-out windows is not available, so the twin is not confirmed by it")
        elif error is not None and error > limit:
            out.append(
                f"the error of the {what} on held-out windows is {100 * error:.0f} % (limit {100 * limit:.0f} %)"
            )
    return out


def with_unknown_content(tracing: Tracing, plain: Unexplained) -> Unexplained:
    """`plain`, with the content of the vibration that no effect of the table makes."""
    if not tracing.unknown:
        return _with_small(tracing, plain)
    own = tracing.unattributed
    share = sum(line.share or 0.0 for line in own)
    return replace(
        plain,
        verdict="unknown_effect",
        share=max(share, plain.share or 0.0),
        lines=_lines(own, plain),
        reason="; ".join(part for part in (tracing.unknown, tracing.small, plain.reason) if part),
    )


def _with_small(tracing: Tracing, plain: Unexplained) -> Unexplained:
    """`plain`, with what has no name and is small: it is said, and the verdict stays."""
    reason = "; ".join(part for part in (plain.reason, tracing.small) if part)
    return replace(plain, lines=_lines(tracing.unattributed, plain), reason=reason)


def _lines(own: Sequence[SpectralLine], plain: Unexplained) -> tuple[SpectralLine, ...]:
    """Lines that no gear makes, then those that the model leaves."""
    return (*own, *plain.lines)[: max(len(own), STRONGEST)]
