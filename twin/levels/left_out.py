"""Errors on cases left out: the twin's relation compared with curves that know nothing of gears.

Each worn case is left out in turn, the rest fitted, the case predicted: of its ln(level) under all conditions, a mean
and a covariance S. The evidence is the logarithm of the density of what was measured, once a case, in all [nat]:

    one condition by itself        ln N(x; μ, diag S), μ the prediction of each
    assembly                       ln N(x; μ, S);      prediction of one: μ_1 + S_12/S_22·(x_2 − μ_2), from the others

so that what the second adds is the density of all conditions together over that of each by itself, and nothing twice.
S of a relation is its own; that of a line or spline is the mean square of its residuals on the other cases, each of
them left out in turn.

Source   leave-one-out predictive density: A. Gelman, J. Hwang, A. Vehtari, Stat. Comput. 24 (2014) 997–1016;
         spline, its parameter by generalised cross-validation: P. Craven, G. Wahba, Numer. Math. 31 (1978) 377–403;
         monotone cubic: monotone.py
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_smoothing_spline

from twin.levels.monotone import by_depth, monotone
from twin.levels.relation import LEAST_VARIANCE, Cases, Relation

Predict = Callable[[np.ndarray, np.ndarray, float], float]  # depths, levels of the others, depth → level
SPLINE_DEPTHS = 5  # that a smoothing spline needs
LOWEST = 0.01  # of the lowest level that was fitted: a line may fall to nothing


@dataclass(frozen=True, eq=False, kw_only=True)
class Errors:
    """Errors on cases left out."""

    relative: Mapping[str, np.ndarray]  # predicted/measured − 1, by condition (n,) of the worn cases
    log_density: float  # [nat], all conditions together

    def mean(self, label: str) -> float:
        """Mean absolute relative error."""
        return float(np.abs(self.relative[label]).mean())

    def worst(self, label: str) -> float:
        return float(np.abs(self.relative[label]).max())


@dataclass(frozen=True, eq=False, kw_only=True)
class ExpectedLevel:
    """Prediction of one case, conditions in the order of the cases' levels."""

    log_level: np.ndarray  # μ (m,)
    covariance: np.ndarray  # S (m, m)


def by_relation(relation: Relation, depth: float) -> ExpectedLevel:
    """Prediction by a relation of a case at a depth [m]."""
    labels = list(relation.curves)
    return ExpectedLevel(
        log_level=np.log([float(relation.level(k, depth)) for k in labels]),
        covariance=relation.covariance(labels),
    )


def by_curve(cases: Cases, predict: Predict) -> Callable[[float], ExpectedLevel]:
    """Prediction of other cases by a curve through the worn cases of every condition, by depth [m]."""
    worn = cases.only(cases.worn)

    def log_level(known: np.ndarray, at: float) -> np.ndarray:
        return np.log(
            [max(predict(worn.depth[known], v[known], at), LOWEST * v[known].min()) for v in worn.level.values()]
        )

    index = np.arange(worn.depth.size)
    measured = np.log(list(worn.level.values()))
    off = [measured[:, i] - log_level(index != i, float(worn.depth[i])) for i in index]
    covariance = np.transpose(off) @ off / worn.depth.size + LEAST_VARIANCE * np.eye(len(measured))
    return lambda depth: ExpectedLevel(log_level=log_level(index >= 0, depth), covariance=covariance)


def score(cases: Cases, expected: Sequence[ExpectedLevel], assembly: bool | Sequence[bool] = False) -> Errors:
    """Errors and density of predictions of cases, one each.

    assembly  whether a condition is predicted from the case's levels under the others, too; of all cases or of each
    """
    known = [assembly] * len(expected) if isinstance(assembly, bool) else assembly
    relative: dict[str, list[float]] = {k: [] for k in cases.level}
    density = 0.0
    for i, (predicted, all_known) in enumerate(zip(expected, known, strict=True)):
        off = np.array([np.log(v[i]) for v in cases.level.values()]) - predicted.log_level
        S = predicted.covariance if all_known else np.diag(np.diag(predicted.covariance))
        density -= 0.5 * float(off @ np.linalg.solve(S, off) + np.linalg.slogdet(2 * np.pi * S)[1])
        for a, k in enumerate(relative):
            b = np.arange(off.size) != a
            shift = S[a, b] @ np.linalg.solve(S[np.ix_(b, b)], off[b])
            relative[k].append(float(np.exp(shift - off[a])) - 1)
    return Errors(relative={k: np.array(v) for k, v in relative.items()}, log_density=density)


def each_without(cases: Cases) -> list[tuple[float, Cases]]:
    """Every worn case's depth [m] with all the other cases."""
    index = np.arange(cases.depth.size)
    return [(float(cases.depth[i]), cases.only(index != i)) for i in np.flatnonzero(cases.worn)]


def leave_out(cases: Cases, choose: Callable[[Cases], Relation], *, assembly: bool = False) -> Errors:
    """Every worn case left out in turn; choose from the other cases to the relation, assembly as in `score`."""
    expected = [by_relation(choose(others), depth) for depth, others in each_without(cases)]
    return score(cases.only(cases.worn), expected, assembly)


def of_curve(cases: Cases, predict: Predict) -> tuple[Errors, Errors]:
    """Errors of a curve that is fitted to the worn cases of every condition: without and with the others known."""
    expected = [by_curve(others, predict)(depth) for depth, others in each_without(cases)]
    worn = cases.only(cases.worn)
    return score(worn, expected), score(worn, expected, True)


def straight_line(depth: np.ndarray, level: np.ndarray, at: float) -> float:
    """Least squares of the relative error."""
    return float(np.polyval(np.polyfit(depth, level, 1, w=1 / level), at))


def spline(depth: np.ndarray, level: np.ndarray, at: float) -> float:
    """Cubic smoothing spline of ln(level), cases of one depth as one; of fewer than five depths their straight line."""
    known, mean, count = by_depth(depth, level)
    if known.size < SPLINE_DEPTHS:
        return float(np.exp(np.polyval(np.polyfit(known, mean, 1, w=np.sqrt(count)), at)))
    unit = float(np.ptp(known)) / known.size  # of the order of the distance between cases: the search for the parameter
    return float(np.exp(make_smoothing_spline(known / unit, mean, w=count)(at / unit)))


def monotone_cubic(depth: np.ndarray, level: np.ndarray, at: float) -> float:
    """Monotone cubic through the isotonic regression of ln(level); beyond the outermost depths their level."""
    return float(monotone(depth, level, at))
