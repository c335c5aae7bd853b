"""How the size of an effect on the mesh goes on: constant, growing evenly, or changed a second time.

First the windows are fitted with a size of their own each, by the joint fit and from the flanks of the constant size.
Which law these sizes follow is then decided in closed form (size_laws.py). A law that beats the constant size is fitted
to the lines themselves, with the wear it causes, and replaces it only where the evidence of the lines gains enough.

Source   twin/tracing/size_laws.py; D. J. C. MacKay, Information Theory, Inference, and Learning Algorithms, 2003,
         ch. 28
Limits   effects with one number that gives their size
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from twin.effects.size_law import CONSTANT, SizeLaw
from twin.errors import TwinError
from twin.thresholds import deciding
from twin.tracing.joint_fit import JointFit
from twin.tracing.joint_problem import EffectTrial
from twin.tracing.mesh_fits import Fits
from twin.tracing.mesh_trials import with_law
from twin.tracing.mesh_windows import Fitted, restarted
from twin.tracing.scatter import MODELLED
from twin.tracing.size_laws import THRESHOLDS as SIZE_LAWS
from twin.tracing.size_laws import LawFit, law_fits


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshLawThresholds:
    """When a size that changes is believed."""

    over_constant_lines: float = deciding(
        25.0,
        unit="nat",
        meaning="evidence of a law over a constant size, by the lines of all windows",
        source="tuned on wide draw 1: 39, 82 and 257 in the three campaigns whose size changes, 16 and 9 in two cases "
        "where the law was wrong",
    )
    least_windows: int = deciding(
        5,
        unit="windows",
        meaning="windows from which a law is searched for",
        source="derivation: four of a growing size (SizeLawThresholds) and one before it",
    )


THRESHOLDS = MeshLawThresholds()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LawFound:
    """An effect whose size changes."""

    fitted: Fitted
    trial: EffectTrial
    law: LawFit
    gain: float  # ln evidence over a constant size [nat]

    @property
    def numbers(self) -> np.ndarray:
        return self.fitted.fit.numbers(self.trial)[0]


def law_found(
    fits: Fits, present: Fitted, trial: EffectTrial, limits: MeshLawThresholds = THRESHOLDS
) -> LawFound | None:
    """The law of one effect of a fit; None where a constant size explains the lines as well.

    trial  one of the fit's
    """
    windows = fits.windows.windows
    if len(trial.free) != 1 or trial.law != CONSTANT or len(windows) < limits.least_windows:
        return None
    sizes = sizes_by_window(fits, present, trial)
    if sizes is None:
        return None
    laws = law_fits(*sizes, prior=1.0)
    constant = laws["constant"].log_evidence
    best = max(laws.values(), key=lambda f: f.log_evidence)
    if best.kind == "constant" or best.log_evidence - constant < SIZE_LAWS.over_constant:
        return None
    turns = sizes[0]
    tried = [_fitted(fits, present, trial, best, law) for law in _laws(best, turns)]
    fitted = max((f for f in tried if f is not None), key=lambda f: f.fit.log_evidence, default=None)
    if fitted is None or fitted.fit.log_evidence - present.fit.log_evidence < limits.over_constant_lines:
        return None
    found = next(t for t in fitted.fit.trials if t.name == trial.name)
    second = found.law.revolutions[0] if found.law.kind == "stepped" else None
    gain = fitted.fit.log_evidence - present.fit.log_evidence
    return LawFound(fitted=fitted, trial=found, law=replace(best, second=second), gain=gain)


def _laws(best: LawFit, turns: np.ndarray) -> list[SizeLaw]:
    """The law of the sizes; of a second change also one window earlier and later.

    The flanks that wore under the size of before pull the first window after a change towards it.
    """
    if best.kind == "linear" or best.second is None:
        return [SizeLaw(kind="linear", revolutions=(float(turns[-1]),))]
    gaps = [float(0.5 * (a + b)) for a, b in pairwise(turns)]
    at = int(np.argmin([abs(n - best.second) for n in gaps]))
    near = [n for n in gaps[max(at - 1, 0) : at + 2] if n > best.onset]
    return [SizeLaw(kind="stepped", revolutions=(n,), factors=(1.0,)) for n in near]


def _fitted(fits: Fits, present: Fitted, trial: EffectTrial, best: LawFit, law: SizeLaw) -> Fitted | None:
    """The lines fitted with a law from the sizes of the windows; None where there is no steady state."""
    (number,) = trial.free
    starts = [np.clip([b], number.low, number.high) for b in best.sizes]
    rest = [t for t in restarted(present.fit) if t.name != trial.name]
    try:
        return fits.together((*rest, with_law(trial, law, best.onset, starts)), present)
    except TwinError:
        return None


def changed_twice(
    fits: Fits, present: Fitted, fixed: Collection[str], limits: MeshLawThresholds = THRESHOLDS
) -> tuple[LawFound, str] | None:
    """One effect that changes a second time in place of another one that has set in later, and the other one's name.

    What sets in beside an effect may be a second change of its size: with one window of it the two look alike. None
    where the fit with both effects is the likelier one.

    fixed  names that stay, whatever they add
    """
    best: tuple[LawFound, str] | None = None
    for later in present.fit.trials:
        earlier = [t.name for t in present.fit.trials if t.onset < later.onset and t.law == CONSTANT]
        if not earlier or later.name in fixed:
            continue
        try:
            rest = fits.together([t for t in restarted(present.fit) if t.name != later.name], present)
        except TwinError:
            continue
        for trial in rest.fit.trials:
            found = law_found(fits, rest, trial, limits) if trial.name in earlier else None
            least = present.fit.log_evidence if best is None else best[0].fitted.fit.log_evidence
            if found is not None and found.fitted.fit.log_evidence > least:
                best = found, later.name
    return best


def sizes_by_window(
    fits: Fits, present: Fitted, trial: EffectTrial
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Revolutions of the windows (W,), the effect's number in each (W,) and its covariance (W, W).

    Numbers are in units of their prior; None where there is no steady state. The covariance is widened to what the fit
    leaves and to what the structure of the twin is off.
    """
    turns = np.array([w.revolutions for w in fits.windows.windows])
    order = np.argsort(turns)
    knots = [float(0.5 * (a + b)) for a, b in pairwise(turns[order])]
    constant = present.fit.numbers(trial)[0]
    law = SizeLaw(kind="stepped", revolutions=tuple(knots), factors=(1.0,) * len(knots))
    starts = [constant if n >= trial.onset else 0.0 * constant for n in turns[order]]
    each = with_law(trial, law, 0.0, starts)
    others = [t for t in present.fit.trials if t is not trial]
    try:
        fitted = fits.windows.fitted((*others, each), _without(present.fit, trial), 1, present.wear).fit
    except TwinError:
        return None
    sizes, covariance = fitted.numbers(each)[0], fitted.covariance_of(each)
    model = np.diag((MODELLED * np.abs(sizes)) ** 2)
    return turns[order], sizes, covariance * max(1.0, fitted.misfit) + model


def _without(fit: JointFit, trial: EffectTrial) -> JointFit:
    """A start for the other trials: calibration, phase, depths and predictions of a fit, and their numbers."""
    at, kept = fit.shared.size - sum(len(t.free) for t in fit.trials), []
    index = np.arange(fit.shared.size)
    keep: Sequence[int] = index[:at].tolist()
    for t in fit.trials:
        if t is not trial:
            kept.append(t)
            keep = [*keep, *index[at : at + len(t.free)].tolist()]
        at += len(t.free)
    return replace(fit, trials=tuple(kept), shared=fit.shared[list(keep)])
