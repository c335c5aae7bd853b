"""Which law the sizes of an effect in several windows follow: constant since an onset, growing evenly, changed twice.

    x = X·b + level + noise        b ~ N(0, s²), noise ~ N(0, C)
    ln p(x | law) = ln mean over its onsets and times of N(x; 0, C + s²·X·Xᵀ + L²·1·1ᵀ)

x  size in each window (W,), with covariance C
X  what the law makes of a unit size: steps at the onset and at the second change, or a ramp from the onset on (W, p)
L  standard deviation of a level that all windows share, where the size before the onset is unknown

Every onset and every time of a second change between the windows is as likely as any other beforehand, so that a law
with more of them, or with more sizes, must predict the windows better (the Occam factor).

Source   D. J. C. MacKay, Information Theory, Inference, and Learning Algorithms, 2003, ch. 28; broken lines:
         G. A. F. Seber, C. J. Wild, Nonlinear Regression, 1989, ch. 9
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.special import logsumexp

from twin.thresholds import deciding

UNIFORM = float(1 / np.sqrt(12))  # standard deviation of a uniform distribution over its width


@dataclass(frozen=True, slots=True, kw_only=True)
class SizeLawThresholds:
    """How many windows, and how much evidence, a law needs."""

    least_growing: int = deciding(
        4,
        unit="windows",
        meaning="windows after the onset that growth is judged by",
        source="derivation: onset and rate leave two windows of four to contradict them; three would be met by a step",
    )
    least_stage: int = deciding(
        2,
        unit="windows",
        meaning="windows of each stage of an effect that changes a second time",
        source="derivation: what one window shows may be that window's",
    )
    over_constant: float = deciding(
        float(np.log(100)),
        unit="nat",
        meaning="evidence of a law over a constant size, by the sizes of the windows",
        source="derivation: where the size is constant, chance reaches a likelihood ratio of 100 in at most 1 of 100 "
        "cases (Markov's inequality)",
    )


THRESHOLDS = SizeLawThresholds()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LawFit:
    """The most likely onset, times and sizes of one law."""

    kind: str  # "constant", "linear" or "stepped"
    onset: float  # [revolutions]; 0 where it was there from the start
    onset_std: float  # over all onsets, and the interval between the windows about this one included [revolutions]
    second: float | None  # revolutions of the second change
    second_std: float | None
    sizes: np.ndarray  # b: at the latest window of a growing law, of each stage of the others (p,)
    std: np.ndarray  # (p,)
    log_evidence: float  # ln p(x | law) − ln p(x | no effect) [nat]


Shape = tuple[float, float, float | None, float | None, np.ndarray]  # onset, interval, second, interval, X (W, p)


def law_fits(
    turns: np.ndarray,
    sizes: np.ndarray,
    covariance: np.ndarray,
    prior: float,
    level: float = 0.0,
    kinds: Sequence[str] = ("constant", "linear", "stepped"),
    limits: SizeLawThresholds = THRESHOLDS,
) -> dict[str, LawFit]:
    """Each law that so many windows can tell, by its name.

    turns       of the pinion, of each window, rising (W,)
    sizes       of the effect in each (W,), with their covariance (W, W)
    prior       standard deviation of a size beforehand
    level       standard deviation of what the size was before the onset; 0 where it was nothing
    """
    base = covariance + level**2
    none = _log_density(sizes, base)
    out = {}
    for kind in kinds:
        shapes = _shapes(kind, turns, limits, level > 0)
        if shapes:
            out[kind] = _fitted(kind, shapes, sizes, base, prior, none)
    return out


def interval_std(turns: Sequence[float], onset: float) -> float:
    """Standard deviation of an onset that lies anywhere between the windows about it [revolutions]."""
    before = max((n for n in turns if n < onset), default=0.0)
    after = min((n for n in turns if n >= onset), default=onset)
    return (after - before) * UNIFORM


def _fitted(
    kind: str, shapes: Sequence[Shape], sizes: np.ndarray, base: np.ndarray, prior: float, none: float
) -> LawFit:
    logs = np.array([_log_density(sizes, base + prior**2 * X @ X.T) for *_, X in shapes])
    onset, gap, second, second_gap, _ = shapes[int(np.argmax(logs))]
    weight = np.exp(logs - logs.max())
    weight /= weight.sum()
    solved = [_sizes(s[-1], sizes, base, prior) for s in shapes]
    b, variance = solved[int(np.argmax(logs))]
    apart_sizes = np.array([each - b for each, _ in solved])  # of other onsets, as far as they are as likely
    spread = float(np.sqrt(weight @ np.array([s[0] - onset for s in shapes]) ** 2))
    second_std = None
    if second is not None and second_gap is not None:
        apart = np.array([(s[2] or 0.0) - second for s in shapes])
        second_std = float(np.hypot(np.sqrt(weight @ apart**2), second_gap * UNIFORM))
    return LawFit(
        kind=kind,
        onset=onset,
        onset_std=float(np.hypot(spread, gap * UNIFORM)),
        second=second,
        second_std=second_std,
        sizes=b,
        std=np.sqrt(variance + weight @ apart_sizes**2),
        log_evidence=float(logsumexp(logs) - np.log(len(shapes)) - none),
    )


def _sizes(X: np.ndarray, sizes: np.ndarray, base: np.ndarray, prior: float) -> tuple[np.ndarray, np.ndarray]:
    """b for one shape X (W, p), and its variance (p,)."""
    H = X.T @ np.linalg.solve(base, X) + np.eye(X.shape[1]) / prior**2
    return np.linalg.solve(H, X.T @ np.linalg.solve(base, sizes)), np.linalg.inv(H).diagonal()


def _log_density(x: np.ndarray, C: np.ndarray) -> float:
    """ln N(x; 0, C)."""
    L = np.linalg.cholesky(C)
    z = np.linalg.solve(L, x)
    return float(-0.5 * z @ z - np.log(L.diagonal()).sum() - 0.5 * x.size * np.log(2 * np.pi))


def _shapes(kind: str, turns: np.ndarray, limits: SizeLawThresholds, relative: bool) -> list[Shape]:
    """What a law makes of a unit size, for each onset and second change between the windows.

    relative  whether only changes count: what has been there from the start is the level then
    """
    gaps = [(0.5 * (a + b), b - a) for a, b in pairwise(turns.tolist())]
    starts = gaps if relative else [(0.0, 0.0), *gaps]
    if kind == "constant":
        return [(n, gap, None, None, (turns >= n)[:, None].astype(float)) for n, gap in starts]
    if kind == "linear":
        widest = max((gap for _, gap in gaps), default=0.0)
        return [
            (n, widest, None, None, (np.maximum(turns - n, 0.0) / (turns[-1] - n))[:, None])
            for n in (0.0, *turns.tolist())
            if (turns > n).sum() >= limits.least_growing
        ]
    out: list[Shape] = []
    for n, gap in starts:
        for second, other in gaps:
            between, after = (turns >= n) & (turns < second), turns >= second
            if second > n and min(between.sum(), after.sum()) >= limits.least_stage:
                out.append((n, gap, second, other, np.stack((between, after), axis=1).astype(float)))
    return out
