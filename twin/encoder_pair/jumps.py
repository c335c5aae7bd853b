"""Sharp steps in the transmission error of a pair: missed counts, or features that a wheel repeats every turn.

    D(θ) = mean of the remainder over δ behind θ − mean over δ before it      δ = 0.01 turn of wheel 1

A step is significant where |D| is above the largest of 99 in 100 remainders that are drawn with the same spectrum, and
above one count. A step that recurs whenever a wheel is at the same angle belongs to that wheel: a tooth, or a mark or
joint of its encoder's disc. A step that neither wheel repeats, although both pass its angle again, is a miscount. A
step at an angle that a wheel passes only once remains unassigned.

Holds    steps sharper than δ, at places more than 2·δ apart
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.thresholds import deciding

SHARP = 0.01  # δ [turns of wheel 1]
FEWEST = 4  # edges in δ
MOST = 12  # steps that are reported


@dataclass(frozen=True, slots=True, kw_only=True)
class JumpThresholds:
    """When a sharp step is significant, and when it recurs."""

    level: float = deciding(
        0.99, meaning="share of drawn remainders whose sharpest step is smaller", source="convention: one in a hundred",
    )  # fmt: skip
    same_place: float = deciding(
        0.012, unit="turns of the wheel", meaning="distance within which a step recurs",
        source="derivation: the width of δ on either side, 0.01 turn, and a count",
    )  # fmt: skip
    as_large: float = deciding(
        0.5, of="step", meaning="size from which another step is the same one", source="not derived",
    )  # fmt: skip


DEFAULT = JumpThresholds()


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
    rest: np.ndarray,
    rests: np.ndarray,
    angles: tuple[np.ndarray, np.ndarray],
    turns: float,
    count: float,
    limits: JumpThresholds = DEFAULT,
) -> list[Jump]:
    """Significant steps of a remainder (n,) against drawn ones (m, n), largest first; those of a wheel once.

    angles  of either wheel at the edges (n,) [rad]
    turns   of wheel 1
    count   of the coarser encoder [rad of wheel 1]
    """
    n = rest.size
    width = max(FEWEST, round(SHARP * n / turns))
    if n < 8 * width:
        return []
    size = _differences(rest, width)
    limit = max(count, float(np.quantile(np.abs(_differences(rests, width)).max(axis=1), limits.level)))
    left = np.abs(size)
    out: list[Jump] = []
    for _ in range(MOST):
        i = int(np.argmax(left))
        if left[i] <= limit:
            break
        jump, places = _placed(size, i, width, angles, limits)
        out.append(jump)
        for at in places:
            left[max(0, at - 2 * width) : at + 2 * width + 1] = 0.0
    return out


def _differences(rest: np.ndarray, width: int) -> np.ndarray:
    """D at every edge but the first and last `width` (…, n) → (…, n − 2·width + 1)."""
    before = np.concatenate((np.zeros((*rest.shape[:-1], 1)), np.cumsum(rest, axis=-1)), axis=-1)
    return (before[..., 2 * width :] - 2 * before[..., width:-width] + before[..., : -2 * width]) / width


def _placed(
    size: np.ndarray, i: int, width: int, angles: tuple[np.ndarray, np.ndarray], limits: JumpThresholds
) -> tuple[Jump, list[int]]:
    """The step at a place of D with all of its places, by what follows where either wheel is at the same angle."""
    again = []
    for wheel, angle in enumerate(angles, start=1):
        θ = angle[width : width + size.size]
        reach = limits.same_place * 2 * np.pi
        passed, same = 0, [i]
        turn = 2 * np.pi
        for number in range(int(np.ceil((θ[0] - θ[i]) / turn)), int(np.floor((θ[-1] - θ[i]) / turn)) + 1):
            if number == 0:
                continue
            passed += 1
            at = θ[i] + number * turn
            low, high = np.searchsorted(θ, (at - reach, at + reach))
            near = np.sign(size[i]) * size[low : max(high, low + 1)]
            if near.max(initial=0.0) >= limits.as_large * abs(size[i]):
                same.append(int(low + np.argmax(near)))
        again.append(passed)
        if passed and len(same) == passed + 1:
            turned = float(θ[i] / turn % 1)
            mean = float(np.mean(size[same]))
            return Jump(index=i + width, size=mean, wheel=wheel, turn=turned, seen=len(same), missed=False), same
    once = Jump(index=i + width, size=float(size[i]), wheel=None, turn=None, seen=1, missed=min(again) > 0)
    return once, [i]
