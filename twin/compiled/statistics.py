"""Order statistics and moments of records: the kernels of `order.c` and `moments.c` on numpy arrays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from twin.compiled import _at, _given, _kernels


class Middle(NamedTuple):
    """Of the finite ones among some values: how many they are, and their order statistics; NaN where there are none."""

    finite: int
    low: float
    high: float
    median: float
    deviation: float  # median distance from the median


def middle(values: np.ndarray) -> Middle:
    """Extremes, median and median distance from the median of the finite ones among values (n,)."""
    x, out = _given(values, None), np.empty(4)
    finite = _kernels.middle(x.size, _at(x), _at(out))
    if finite < 0:
        raise MemoryError("no memory for the compiled kernels")
    return Middle(finite, *(out.tolist() if finite else 4 * [float("nan")]))


def all_near(values: np.ndarray, times: float) -> bool:
    """Whether none of the finite ones among values (n,) can lie further than so many times their median distance from
    the median from it: proven by counting, in a tenth of the time of `middle`; False where it may be or is not proven.
    """
    x = _given(values, None)
    return bool(_kernels.all_near(x.size, _at(x), times))


class Extremes(NamedTuple):
    """Of the finite ones among some values: how many they are, and how many lie at the lowest and the highest value."""

    finite: int
    low: float
    high: float
    lowest: int
    highest: int


def extremes(values: np.ndarray) -> Extremes:
    """Of the finite ones among values (n,); from infinity to minus infinity where there are none."""
    x, out = _given(values, None), np.empty(4)
    finite = _kernels.at_extremes(x.size, _at(x), _at(out))
    low, high, lowest, highest = out.tolist()
    return Extremes(finite, low, high, int(lowest), int(highest))


class Moments(NamedTuple):
    """Of the finite ones among some values."""

    finite: int
    mean: float
    square: float  # mean square distance from the mean
    most: float  # largest distance from the mean
    kurtosis: float  # mean of the fourth power of these distances over the square of `square`; 0 of a constant


def moments(values: np.ndarray) -> Moments:
    """Of the finite ones among values (n,)."""
    x, out = _given(values, None), np.empty(4)
    finite = _kernels.moments(x.size, _at(x), _at(out))
    return Moments(finite, *out.tolist())
