"""Errors on cases left out: the twin's relation beside a straight line and a spline that know nothing of gears.

Each worn case is left out in turn, the rest fitted, the case predicted. The evidence is the logarithm of the density
that the relation gave to ln(level) of the case, summed over cases and conditions [nat].

Source   leave-one-out predictive density: A. Gelman, J. Hwang, A. Vehtari, Stat. Comput. 24 (2014) 997–1016;
         spline, its parameter by generalised cross-validation: P. Craven, G. Wahba, Numer. Math. 31 (1978) 377–403
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_smoothing_spline
from scipy.stats import norm

from twin.levels.curve import LevelCurve
from twin.levels.relation import Cases, Form, Relation, fit

Predict = Callable[[np.ndarray, np.ndarray, float], float]  # depths, levels of the others, depth → level


@dataclass(frozen=True, eq=False, kw_only=True)
class Errors:
    """What was missed on cases left out."""

    relative: Mapping[str, np.ndarray]  # predicted/measured − 1, by condition (n,) of the worn cases
    log_density: float = 0.0  # [nat], all conditions together

    def mean(self, label: str) -> float:
        """Mean absolute relative error."""
        return float(np.abs(self.relative[label]).mean())

    def worst(self, label: str) -> float:
        return float(np.abs(self.relative[label]).max())


def leave_out(
    cases: Cases,
    choose: Callable[[Cases], Relation],
    *,
    assembly: bool = False,
) -> Errors:
    """Every worn case left out in turn.

    choose    from the other cases to the relation
    assembly  whether a of the case is taken from its levels under the other conditions
    """
    labels = list(cases.level)
    relative: dict[str, list[float]] = {k: [] for k in labels}
    density = 0.0
    for i in np.flatnonzero(cases.worn):
        others = np.arange(cases.depth.size) != i
        relation = choose(cases.only(others))
        depth = float(cases.depth[i])
        for k in labels:
            std, a = relation.std(k), 0.0
            if assembly:
                a = relation.assembly(depth, {j: float(cases.level[j][i]) for j in labels if j != k})
                std = _conditional_std(relation, k, len(labels) - 1)
            predicted = float(relation.level(k, depth)) * float(np.exp(a))
            measured = float(cases.level[k][i])
            relative[k].append(predicted / measured - 1)
            density += float(norm.logpdf(np.log(measured / predicted), scale=std))
    return Errors(relative={k: np.array(v) for k, v in relative.items()}, log_density=density)


def _conditional_std(relation: Relation, label: str, seen: int) -> float:
    """Of ln(level) when the other conditions of the same assembly are known."""
    if relation.assembly_std == 0 or seen == 0:
        return relation.std(label)
    precision = 1 / relation.assembly_std**2 + sum(1 / s**2 for k, s in relation.rest_std.items() if k != label)
    return float(np.sqrt(1 / precision + relation.rest_std[label] ** 2))


def of_twin(
    cases: Cases, curves: Mapping[str, LevelCurve], form: Form | None = None, *, assembly: bool = False
) -> Errors:
    """Errors of the twin's relation."""
    return leave_out(cases, lambda others: fit(others, curves, form), assembly=assembly)


def straight_line(depth: np.ndarray, level: np.ndarray, at: float) -> float:
    """Least squares of the relative error."""
    return float(np.polyval(np.polyfit(depth, level, 1, w=1 / level), at))


def spline(depth: np.ndarray, level: np.ndarray, at: float) -> float:
    """Cubic smoothing spline of ln(level); depths that cases share are parted by a hair."""
    order = np.argsort(depth)
    unit = float(np.ptp(depth)) / depth.size  # of the order of the distance between cases: the search for the parameter
    x = np.maximum.accumulate(depth[order] / unit + 1e-6 * np.arange(depth.size))
    return float(np.exp(make_smoothing_spline(x, np.log(level[order]))(at / unit)))


def of_curve(cases: Cases, predict: Predict) -> Errors:
    """Errors of a curve that is fitted to the worn cases of every condition by itself."""
    worn = cases.only(cases.worn)
    relative: dict[str, np.ndarray] = {}
    for k, level in worn.level.items():
        off = []
        for i in range(worn.depth.size):
            others = np.arange(worn.depth.size) != i
            off.append(predict(worn.depth[others], level[others], float(worn.depth[i])) / level[i] - 1)
        relative[k] = np.array(off)
    return Errors(relative=relative)
