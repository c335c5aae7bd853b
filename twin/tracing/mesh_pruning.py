"""Backward pruning: of the effects that were found together, those that the rest explain as well go again.

    loss_i = ln evidence(all) − ln evidence(all but i, fitted anew)

A search that adds one effect after the other may take one for want of two others that come later. When all are there,
each is left out in turn and the rest fitted anew: the one whose loss falls shortest of what an effect must add goes, or
the one whose size the joint fit cannot tell from nothing, and so on until every effect is needed. So it does not matter
in which order they were found.

Source   A. Miller, Subset Selection in Regression, 2nd ed., 2002, ch. 3 (backward elimination)
Limits   pairs that lose nothing only together are not tried
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from twin.errors import TwinError
from twin.thresholds import deciding
from twin.tracing.joint_fit import JointFit
from twin.tracing.joint_problem import EffectTrial
from twin.tracing.mesh_fits import Fits, least_gain
from twin.tracing.mesh_trials import sized
from twin.tracing.mesh_windows import Fitted, restarted


@dataclass(frozen=True, slots=True, kw_only=True)
class PruningThresholds:
    """When an effect is told from nothing."""

    interval: float = deciding(
        1.96,
        of="standard deviation of the fitted number",
        meaning="half-width of the interval of an effect's size that must not include zero",
        source="derivation: 95 % of a Gaussian",
    )
    beyond_doubt: float = deciding(
        100.0,
        unit="nat",
        meaning="loss beyond what an effect must add from which the rest is not fitted from a second start",
        source="not derived: chosen",
    )


DEFAULT = PruningThresholds()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Removal:
    """One effect left out."""

    name: str
    without: Fitted
    loss: float  # of ln evidence
    margin: float  # loss beyond what an effect must add [nat]
    needed: bool


def pruned(
    fits: Fits, base: Fitted, best: Fitted, fixed: Collection[str] = (), limits: PruningThresholds = DEFAULT
) -> tuple[Fitted, dict[str, float], tuple[str, ...]]:
    """The fit with the effects that are needed, what leaving out each would lose [nat], and the names that went.

    base   the fit with wear alone
    best   the fit with all effects that were found
    fixed  names that stay, whatever they add
    """
    gone: list[str] = []
    best = _refitted(fits, best)
    while True:
        removals = [_removal(fits, base, best, trial, limits) for trial in best.fit.trials]
        free = [r for r in removals if not r.needed and r.name not in fixed]
        if not free:
            return best, {r.name: r.loss for r in removals}, tuple(gone)
        least = min(free, key=lambda r: r.margin)
        gone.append(least.name)
        best = least.without


def _refitted(fits: Fits, best: Fitted) -> Fitted:
    """Several effects fitted together once more, with the wear that all of them cause."""
    if len(best.fit.trials) < 2:
        return best
    again = _together(fits, restarted(best.fit), best)
    return again if again is not None and again.fit.log_evidence > best.fit.log_evidence else best


def _removal(fits: Fits, base: Fitted, best: Fitted, trial: EffectTrial, limits: PruningThresholds) -> _Removal:
    without = _without(fits, base, best, trial, limits)
    loss = best.fit.log_evidence - without.fit.log_evidence
    explained = without.fit.log_evidence - base.fit.log_evidence
    margin = loss - least_gain(fits, trial.name, explained)
    needed = margin > 0 and told_from_nothing(best.fit, trial, limits)
    return _Removal(name=trial.name, without=without, loss=loss, margin=margin, needed=needed)


def _without(fits: Fits, base: Fitted, best: Fitted, trial: EffectTrial, limits: PruningThresholds) -> Fitted:
    """The best fit of all other effects: from where they are and, unless they lose far too much so, from wear alone."""
    rest = tuple(t for t in restarted(best.fit) if t.name != trial.name)
    if not rest:
        return base
    first = _together(fits, rest, best)
    if first is not None:
        loss = best.fit.log_evidence - first.fit.log_evidence
        explained = first.fit.log_evidence - base.fit.log_evidence
        if loss > least_gain(fits, trial.name, explained) + limits.beyond_doubt:
            return first
    tried = [f for f in (first, _together(fits, rest, base)) if f is not None]
    return max(tried, key=lambda f: f.fit.log_evidence, default=base)


def _together(fits: Fits, trials: tuple[EffectTrial, ...], start: Fitted) -> Fitted | None:
    try:
        return fits.together(trials, start)
    except TwinError:
        return None


def told_from_nothing(fit: JointFit, trial: EffectTrial, limits: PruningThresholds = DEFAULT) -> bool:
    """Whether the interval of at least one number that gives an effect its size leaves out zero."""
    numbers, std = fit.numbers(trial)
    width = limits.interval * std * max(1.0, float(np.sqrt(fit.misfit)))
    return bool((np.abs(numbers) > width)[sized(trial.name, numbers.size)].any())
