"""Sharp steps in the transmission error of a pair: counts that were missed, or what a wheel brings round every turn.

    D(θ) = mean of the rest over δ behind θ − mean over δ before it           δ = 0.01 turn of wheel 1

A step stands out where |D| is above the largest of 99 in 100 rests that are drawn with the same spectrum, and above a
count. One that comes again whenever a wheel stands at the same angle is that wheel's: a tooth, or a mark or joint of
its encoder's disc. One that neither wheel repeats, though both pass its angle again, is a miscount. What a wheel passes
once only is not told.

Holds    steps sharper than δ, at places more than 2·δ apart
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

SHARP = 0.01  # δ [turns of wheel 1]
FEWEST = 4  # edges in δ
LEVEL = 0.99  # share of drawn rests whose sharpest step is smaller
SAME_PLACE = 0.012  # [turns of the wheel] within which a step comes again
AS_LARGE = 0.5  # of a step's size, from which another one is the same again
MOST = 12


@dataclass(frozen=True, slots=True, kw_only=True)
class Jump:
    """One sharp step."""

    index: int  # of the edge behind it
    size: float  # [rad of wheel 1]
    wheel: int | None  # 1 or 2, of the wheel that repeats it
    turn: float | None  # where that wheel stands then [turns, 0 … 1]
    seen: int  # times that it came at that angle
    missed: bool  # neither wheel repeats it, though both pass its angle again


def jumps_of(
    rest: np.ndarray, rests: np.ndarray, angles: tuple[np.ndarray, np.ndarray], turns: float, count: float
) -> list[Jump]:
    """Sharp steps of a rest (n,) that stand out of drawn ones (m, n), the largest first; a wheel's once for all turns.

    angles  of either wheel at the edges (n,) [rad]
    turns   of wheel 1
    count   of the coarser encoder [rad of wheel 1]
    """
    n = rest.size
    width = max(FEWEST, round(SHARP * n / turns))
    if n < 8 * width:
        return []
    size = _differences(rest, width)
    limit = max(count, float(np.quantile(np.abs(_differences(rests, width)).max(axis=1), LEVEL)))
    left = np.abs(size)
    out: list[Jump] = []
    for _ in range(MOST):
        i = int(np.argmax(left))
        if left[i] <= limit:
            break
        jump, places = _placed(size, i, width, angles)
        out.append(jump)
        for at in places:
            left[max(0, at - 2 * width) : at + 2 * width + 1] = 0.0
    return out


def _differences(rest: np.ndarray, width: int) -> np.ndarray:
    """D at every edge but the first and last `width` (…, n) → (…, n − 2·width + 1)."""
    before = np.concatenate((np.zeros((*rest.shape[:-1], 1)), np.cumsum(rest, axis=-1)), axis=-1)
    return (before[..., 2 * width :] - 2 * before[..., width:-width] + before[..., : -2 * width]) / width


def _placed(size: np.ndarray, i: int, width: int, angles: tuple[np.ndarray, np.ndarray]) -> tuple[Jump, list[int]]:
    """The step at a place of D, told by the other places where either wheel stands as there; with its own places."""
    again = []
    for wheel, angle in enumerate(angles, start=1):
        θ = angle[width : width + size.size]
        reach = SAME_PLACE * 2 * np.pi
        passed, same = 0, [i]
        turn = 2 * np.pi
        for number in range(int(np.ceil((θ[0] - θ[i]) / turn)), int(np.floor((θ[-1] - θ[i]) / turn)) + 1):
            if number == 0:
                continue
            passed += 1
            at = θ[i] + number * turn
            low, high = np.searchsorted(θ, (at - reach, at + reach))
            near = np.sign(size[i]) * size[low : max(high, low + 1)]
            if near.max(initial=0.0) >= AS_LARGE * abs(size[i]):
                same.append(int(low + np.argmax(near)))
        again.append(passed)
        if passed and len(same) == passed + 1:
            turned = float(θ[i] / turn % 1)
            mean = float(np.mean(size[same]))
            return Jump(index=i + width, size=mean, wheel=wheel, turn=turned, seen=len(same), missed=False), same
    once = Jump(index=i + width, size=float(size[i]), wheel=None, turn=None, seen=1, missed=min(again) > 0)
    return once, [i]
