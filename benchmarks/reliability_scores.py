"""Scores of stated distributions: where the truth lay in them, how often a band held it, how sharp they were."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

NOMINAL = (0.05, 0.10, 0.25, 0.50, 0.75, 0.90, 0.95)
GRID = np.arange(0.025, 1.0, 0.05)  # probabilities of the quantiles that the CRPS is taken over
BINOMIAL = 1.96  # standard errors of a share: 95 %
Quantile = Callable[[float], float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Scored:
    """One stated distribution against the truth."""

    group: str  # whose campaigns: J, L, D, or drawn histories
    kind: str  # class of the machine
    what: str  # depth, half-life, end
    campaign: str
    by: str  # who states it
    quantile: float  # of the distribution, at which the truth lay
    error: float  # median over truth, less 1
    crps: float  # over the truth
    near: bool | None = None  # depth within 5 % or 2 µm
    preliminary: bool = False
    seconds: float = 0.0  # of processor time


def scored(quantile: Quantile, true: float, at: float, **named: Any) -> Scored:
    """The score of a distribution by its quantile function; `at` is the probability at which the truth lies."""
    values = np.array([quantile(float(p)) for p in GRID])
    pinball = np.where(true < values, (1 - GRID) * (values - true), GRID * (true - values))
    return Scored(
        quantile=at, error=quantile(0.5) / true - 1, crps=float(2 * pinball.mean()) / true, **named
    )  # fmt: skip


def reached(quantiles: Sequence[float], probabilities: Sequence[float], true: float) -> float:
    """The probability at which a truth lies between stated quantiles, 0 or 1 beyond them."""
    if true < quantiles[0]:
        return 0.0
    if true > quantiles[-1]:
        return 1.0
    return float(np.interp(true, quantiles, probabilities))


def table(rows: Iterable[Scored], label: Callable[[Scored], str], *, wide: int = 34) -> list[str]:
    """One line a label: share of truths below each nominal quantile, coverage with its binomial error, error, CRPS."""
    groups: dict[str, list[Scored]] = {}
    for row in rows:
        groups.setdefault(label(row), []).append(row)
    out = [
        f"{'':{wide}}     n  truth below the stated quantile of [%]      5–95 %      error  CRPS  within 5 %",
        f"{'':{wide}}           5   10   25   50   75   90   95   band holds   median     %   or 2 µm",
    ]
    for name, here in groups.items():
        u = np.array([r.quantile for r in here])
        below = "".join(f"{100 * float(np.mean(u <= p)):5.0f}" for p in NOMINAL)
        held = float(np.mean((u >= NOMINAL[0]) & (u <= NOMINAL[-1])))
        error = 100 * float(np.median([abs(r.error) for r in here]))
        crps = 100 * float(np.mean([r.crps for r in here]))
        near = [r.near for r in here if r.near is not None]
        close = f"{100 * float(np.mean(near)):7.0f} %" if near else ""
        doubt = 100 * BINOMIAL * float(np.sqrt(max(held * (1 - held), 0.25 / len(here)) / len(here)))
        out.append(
            f"{name:{wide}}{len(here):6d}  {below}{100 * held:6.0f} ± {doubt:2.0f} %{error:7.1f} %{crps:6.1f}{close}"
        )
    return out
