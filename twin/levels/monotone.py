"""A relation of level and depth from the cases alone: a monotone cubic through them, which knows nothing of gears.

    ln level(depth)   piecewise cubic through the isotonic regression of the worn cases, level beyond the outermost

It can use any quantity that rises with depth, also indicators that the model of the gears does not predict. Its scatter
is that of its errors on worn cases, each of them left out in turn; their correlations are shrunk towards zero by as
much as their own uncertainty asks for.

Source   shrinkage: J. Schäfer, K. Strimmer, Stat. Appl. Genet. Mol. Biol. 4 (2005) 32, target D;
         isotonic regression: R. E. Barlow et al., Statistical Inference under Order Restrictions, 1972;
         monotone cubic: F. N. Fritsch, J. Butland, SIAM J. Sci. Stat. Comput. 5 (1984) 300–304
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.optimize import isotonic_regression

from twin.errors import ParameterError
from twin.levels.curve import LevelCurve
from twin.levels.relation import LEAST_VARIANCE, LIMITS, Cases, Relation, unworn_of
from twin.model import Condition

LEAST_DEPTHS = LIMITS.least_cases  # that differ


def by_depth(depth: np.ndarray, level: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Depths that differ, rising, with the mean of ln(level) and the number of the cases at each; (m,) each."""
    known, which, count = np.unique(depth, return_inverse=True, return_counts=True)
    return known, np.bincount(which, np.log(level)) / count, count.astype(float)


def monotone(depth: np.ndarray, level: np.ndarray, at) -> np.ndarray:
    """Level [m/s²] at other depths [m], any shape, from that at some (n,)."""
    known, mean, count = by_depth(depth, level)
    rising = isotonic_regression(mean, weights=count).x
    if known.size == 1:
        return np.full(np.shape(at), np.exp(rising[0]))
    return np.exp(PchipInterpolator(known, rising)(np.clip(at, known[0], known[-1])))


def fit_monotone(
    cases: Cases, conditions: Mapping[str, Condition], teeth: tuple[int, int], until: float = 0.0
) -> Relation:
    """The relation through the worn cases; ParameterError where they have too few depths.

    conditions  of every label of the cases' levels
    teeth       of the pair
    until       depth to which its curves reach at least, with the level of the deepest case beyond that [m]
    """
    worn = cases.only(cases.worn)
    known = np.unique(worn.depth)
    if known.size < LEAST_DEPTHS:
        raise ParameterError(f"{known.size} worn depths are too few for a relation: at least {LEAST_DEPTHS}")
    labels = list(conditions)
    index = np.arange(worn.depth.size)
    off = np.array(
        [
            [
                np.log(level[i] / monotone(worn.depth[index != i], level[index != i], worn.depth[i]))
                for i in index.tolist()
            ]
            for level in (worn.level[k] for k in labels)
        ]
    )
    std = np.sqrt(np.maximum(np.mean(off**2, axis=1), LEAST_VARIANCE))
    at = np.concatenate(([0.0], known, [until] if until > known[-1] else []))
    curves = {
        k: LevelCurve(
            teeth=teeth,
            condition=c,
            depth=at,
            level=monotone(worn.depth, worn.level[k], at),
            scatter=np.zeros(at.size),
            apart=np.zeros(at.size),
        )
        for k, c in conditions.items()
    }
    relation = Relation(
        curves=curves,
        background=dict.fromkeys(labels, 0.0),
        gain=dict.fromkeys(labels, 1.0),
        assembly_std=0.0,
        rest_std=dict(zip(labels, std.tolist(), strict=True)),
        correlation=_correlation(off / std[:, None]),
        deepest=float(known[-1]),
    )
    return unworn_of(relation, cases)


def _correlation(standard: np.ndarray) -> np.ndarray:
    """Correlations of residuals of mean square 1 (m, n), those of different quantities times 1 − λ; (m, m)."""
    m, n = standard.shape
    products = standard[:, None] * standard[None]
    r, apart = products.mean(axis=2), ~np.eye(m, dtype=bool)
    uncertain, size = products.var(axis=2)[apart].sum() / (n - 1), np.square(r[apart]).sum()
    kept = 1 - min(uncertain / size, 1.0) if size > 0 else 0.0
    return np.where(apart, kept * r, 1.0)
