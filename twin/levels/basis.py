"""What gives the level by depth: the model of the gears, or a monotone cubic through the cases.

Whichever predicts worn cases better, each left out in turn, by the logarithm of its density on them (left_out.py). The
cubic can use indicators that the model does not predict; one joins where depths left out become more probable by a
least gain, the one that gains most first.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from twin.levels.left_out import Errors, each_without, leave_out
from twin.levels.monotone import fit_monotone
from twin.levels.relation import Cases, Relation
from twin.model import Condition


@dataclass(frozen=True, eq=False, kw_only=True)
class ByCases:
    """The monotone cubic of a series of cases."""

    errors: Errors  # of the quantities that the model predicts, on worn cases left out
    indicators: Mapping[str, float]  # that joined, and what each added to the density of depths left out [nat]
    relation: Relation  # of all cases
    relations: tuple[Relation, ...]  # without each worn case


def by_cases(
    cases: Cases,
    conditions: Mapping[str, Condition],
    modelled: Collection[str],
    teeth: tuple[int, int],
    least_gain: float,
) -> ByCases:
    """The monotone cubic through a series of cases; ParameterError where they have too few depths.

    conditions  of every label of the cases' levels
    modelled    labels that the model predicts
    teeth       of the pair
    least_gain  of the logarithm of the density of depths left out, from which an indicator joins [nat]
    """
    levels_only = {k: c for k, c in conditions.items() if k in modelled}
    errors = leave_out(
        cases.under(levels_only),
        lambda others: fit_monotone(others, levels_only, teeth, until=float(cases.depth.max())),
        assembly=len(levels_only) > 1,
    )
    joined = _indicators(cases, conditions, levels_only, teeth, least_gain)
    used = {k: c for k, c in conditions.items() if k in modelled or k in joined}
    return ByCases(
        errors=errors,
        indicators=joined,
        relation=fit_monotone(cases.under(used), used, teeth),
        relations=tuple(fit_monotone(others.under(used), used, teeth) for _, others in each_without(cases)),
    )


def _indicators(
    cases: Cases,
    conditions: Mapping[str, Condition],
    modelled: Collection[str],
    teeth: tuple[int, int],
    least_gain: float,
) -> dict[str, float]:
    """Indicators that join, and what each adds [nat]; the deepest case is beyond the relation of the others."""
    worn = np.flatnonzero(cases.worn).tolist()
    inner = [(i, d, rest) for i, (d, rest) in zip(worn, each_without(cases), strict=True) if d <= rest.depth.max()]

    def density(labels: Collection[str]) -> float:
        used = {k: c for k, c in conditions.items() if k in labels}
        return sum(
            fit_monotone(rest.under(used), used, teeth).log_density({k: float(cases.level[k][i]) for k in used}, d)
            for i, d, rest in inner
        )

    joined: dict[str, float] = {}
    left = [k for k in conditions if k not in modelled]
    now = density(modelled) if left else 0.0
    while left:
        gain, best = max((density([*modelled, *joined, k]) - now, k) for k in left)
        if gain < least_gain:
            break
        joined[best], now = gain, now + gain
        left.remove(best)
    return joined
