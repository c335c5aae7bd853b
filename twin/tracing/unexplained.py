"""What is left beyond the model and its effects, and whether the twin may call the machine explained.

    share = Σ (max(left − noise, 0) + 2·b²)/Σ (measured + 2·b²)      energies over the latest windows

b  RMS of the vibration between the lines of the shafts, which nothing in the model makes

A machine is explained only where the twin predicts windows that took no part in any fit: level, acceleration and
transmission error within what a healthy machine of this rig file has at most there (healthy_lines.py), with nothing
that speaks against the calibrated model. Beyond it, three held-out windows say `unknown_effect`: the vibration has
content that no effect of the table makes. Fewer windows, a missing channel, a doubt, or a healthy machine that may
leave as much as predicting nothing would, give `insufficient_data`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin.assessment import HealthyErrors, HeldOutErrors, SpectralLine, Unexplained
from twin.rig import Rig
from twin.thresholds import deciding
from twin.tracing.state import Tracing
from twin.tracing.unknown_words import OTHER_PATH
from twin.updating.calibration import outliers
from twin.updating.residual import STRONGEST, WindowResidual
from twin.updating.update import UpdateOutcome


@dataclass(frozen=True, slots=True, kw_only=True)
class VerdictLimits:
    """What `explained` demands."""

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
    least_windows: int = deciding(
        3,
        unit="windows",
        meaning="held-out windows from which an error beyond a healthy machine's is content of its own",
        source="derivation: as for an effect (EarnedLimits.least_windows)",
    )
    does_not_fit: float = deciding(
        1.0,
        of="measured",
        meaning="error of the acceleration or of the level on held-out windows from which the model does not fit",
        source="derivation: predicting nothing at all leaves 1",
    )


VERDICT_LIMITS = VerdictLimits()
CHANNELS = {"rms": "level", "waveform": "acceleration", "transmission_error": "transmission error"}
"""What people call the figures of `HeldOutErrors`."""


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
    healthy = HealthyErrors() if errors is None or errors.healthy is None else errors.healthy
    if not recent or not recent[-1].phase_known:
        reason = "no window with the mesh phase known has been compared yet"
        return Unexplained(verdict="insufficient_data", reason=reason, limits=healthy)
    measured = sum(r.measured + r.between for r in recent)
    share = max(0.0, sum(max(r.left - r.noise, 0.0) + r.between for r in recent)) / measured
    content = _beyond(errors)
    if share >= limits.left_share:
        content.append(_left(recent, share))
    enough = errors is not None and len(errors.windows) >= limits.least_windows
    reasons = [*content, *doubts, *_not_confirmed(errors)]
    verdict = "unknown_effect" if content and enough else "insufficient_data" if reasons else "explained"
    return Unexplained(verdict=verdict, share=share, lines=recent[-1].lines, reason="; ".join(reasons), limits=healthy)


def _left(recent: Sequence[WindowResidual], share: float) -> str:
    """What makes the share that is left, in words."""
    if share > VERDICT_LIMITS.does_not_fit:
        return f"the model does not fit: the lines that it leaves are {np.sqrt(share):.1f} × the measured level"
    between, whole = sum(r.between for r in recent), sum(r.measured + r.between for r in recent)
    if between >= 0.5 * share * whole:
        return f"the vibration between the lines of the shafts is {100 * np.sqrt(between / whole):.0f} % of the level"
    return f"lines that no effect explains hold {100 * share:.0f} % of the energy"


def _not_confirmed(errors: HeldOutErrors | None, limits: VerdictLimits = VERDICT_LIMITS) -> list[str]:
    """What is missing for held-out windows to confirm the twin, a sentence each."""
    if errors is None or not errors.windows:
        return ["no held-out window has been compared with the twin yet"]
    missing = [
        f"the {what} of held-out windows is not available, so the twin is not confirmed by it"
        for name, what in CHANNELS.items()
        if name != "rms" and getattr(errors, name) is None
    ]
    healthy = HealthyErrors() if errors.healthy is None else errors.healthy
    wide = {what: getattr(healthy, name) or 0.0 for name, what in CHANNELS.items()}
    return missing + [
        f"a machine without a fault may leave {100 * most:.0f} % of the {what} here, so the twin is not confirmed by it"
        for what, most in wide.items()
        if most >= limits.does_not_fit
    ]


def excess(errors: HeldOutErrors | None, channel: str) -> float | None:
    """A held-out error over the most that a healthy machine has; None where either is not known.

    channel  "rms", "waveform" or "transmission_error"
    """
    if errors is None or errors.healthy is None:
        return None
    error, most = getattr(errors, channel), getattr(errors.healthy, channel)
    return None if error is None or not most else float(error / most)


def _beyond(errors: HeldOutErrors | None) -> list[str]:
    """Every figure in which held-out windows lie beyond a healthy machine, a clause each."""
    return [
        figure_of(errors, channel)
        for channel in CHANNELS
        if errors is not None and (excess(errors, channel) or 0.0) > 1.0
    ]


def figure_of(errors: HeldOutErrors, channel: str, limits: VerdictLimits = VERDICT_LIMITS) -> str:
    """The error of a channel on held-out windows beside a healthy machine's, as a clause."""
    error, most = getattr(errors, channel), getattr(errors.healthy, channel)
    if channel != "transmission_error" and error > limits.does_not_fit:
        return f"the model does not fit: it misses the {CHANNELS[channel]} of held-out windows by {error:.1f} ×"
    return (
        f"the error of the {CHANNELS[channel]} on held-out windows is {100 * error:.0f} %, that of a healthy machine "
        f"of this rig file {100 * most:.0f} % at most"
    )


def does_not_fit(errors: HeldOutErrors | None, limits: VerdictLimits = VERDICT_LIMITS) -> str | None:
    """Why neither a depth by level nor a life is given: the model predicts worse than nothing; None where it fits."""
    for channel in ("waveform", "rms"):
        error = None if errors is None else getattr(errors, channel)
        if errors is not None and errors.healthy is not None and error is not None and error > limits.does_not_fit:
            return figure_of(errors, channel)
    return None


def with_unknown_content(tracing: Tracing, plain: Unexplained) -> Unexplained:
    """`plain`, with the content of the vibration that no effect of the table makes; another path is said."""
    own = tracing.unattributed
    if not tracing.unknown:
        other = OTHER_PATH if tracing.latest.other_structure and not tracing.found else ""
        return replace(
            plain, lines=_lines(own, plain), reason="; ".join(part for part in (plain.reason, other) if part)
        )
    share = sum(line.share or 0.0 for line in own)
    return replace(
        plain,
        verdict="unknown_effect",
        share=max(share, plain.share or 0.0),
        lines=_lines(own, plain),
        reason="; ".join(part for part in (tracing.unknown, plain.reason) if part),
    )


def _lines(own: Sequence[SpectralLine], plain: Unexplained) -> tuple[SpectralLine, ...]:
    """Lines that no gear makes, then those that the model leaves."""
    return (*own, *plain.lines)[: max(len(own), STRONGEST)]
