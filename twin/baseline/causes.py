"""Known causes of a spacing of lines, each tried on its order: which fail, and which the data cannot rule out.

    cage 0.35 … 0.45,   outer race N·(0.35 … 0.45),   inner race N·(0.55 … 0.65),   ball 1.5 … 4.5       of its shaft

for N = 6 … 20 rolling elements: pitch to element diameter 3.3 to 10, contact angle 0 to 40°.

Source   bearing kinematics: T. A. Harris, Rolling Bearing Analysis, 4th ed., Wiley 2001, ch. 8
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from twin.thresholds import deciding

MAINS = (50.0, 60.0)  # nominal frequencies of public grids [Hz]


@dataclass(frozen=True, slots=True, kw_only=True)
class CauseThresholds:
    """When a known cause of a spacing is ruled out."""

    far: float = deciding(
        5.0, unit="standard deviations", meaning="distance beyond which an order or a frequency is another one",
        source="convention: five standard deviations, so that a true cause is hardly ever ruled out",
    )  # fmt: skip
    mains_std: float = deciding(
        0.01, unit="Hz", meaning="standard deviation of the mains frequency",
        source="not derived: of the order of the continental European grid's usual deviations",
    )  # fmt: skip
    whole_count: float = deciding(
        0.01, of="spacing", meaning="standard deviation up to which a ratio of two spacings is a whole number",
        source="derivation: five of these deviations to either side leave a ratio whole by chance once in ten",
    )  # fmt: skip


DEFAULT = CauseThresholds()
ELEMENTS = range(6, 21)
CAGE, INNER, BALL = (0.35, 0.45), (0.55, 0.65), (1.5, 4.5)


@dataclass(frozen=True, slots=True, kw_only=True)
class Cause:
    """One cause tried."""

    name: str
    possible: bool
    detail: str


def causes_of(
    order: float,
    std: float,
    speed_hz: float,
    shafts: Sequence[Fraction],
    names: Sequence[str],
    limits: CauseThresholds = DEFAULT,
) -> list[Cause]:
    """Causes of lines spaced by an order of the pinion, with its standard deviation.

    shafts, names  orders of all shafts and what they are called
    """
    out = []
    for shaft, name in zip(shafts, names, strict=True):
        ratio = order / float(shaft)
        nearest = max(1, round(ratio))
        off = abs(ratio - nearest) * float(shaft)
        out.append(
            Cause(
                name=f"a multiple of the {name}'s rotation",
                possible=off < limits.far * std,
                detail=f"{ratio:.4f} times it; {off / max(std, 1e-12):.0f} deviations from {nearest}",
            )
        )
    for frequency in MAINS:
        at = order * speed_hz
        nearest = max(1, round(at / frequency))
        off = abs(at - nearest * frequency)
        limit = limits.far * ((std * speed_hz) ** 2 + (limits.mains_std * nearest) ** 2) ** 0.5
        out.append(
            Cause(
                name=f"mains of {frequency:g} Hz",
                possible=off < limit,
                detail=f"{at:.3f} Hz, {off:.2f} Hz from {nearest * frequency:g} Hz",
            )
        )
    for shaft, name in zip(shafts, names, strict=True):
        ratio = order / float(shaft)
        fit = [n for n in ELEMENTS if CAGE[0] * n <= ratio <= CAGE[1] * n]
        inner = [n for n in ELEMENTS if INNER[0] * n <= ratio <= INNER[1] * n]
        described = f"{ratio:.4f} times the {name}'s rotation"
        out += [
            Cause(name=f"cage of a bearing on the {name}", possible=CAGE[0] <= ratio <= CAGE[1], detail=described),
            Cause(name=f"outer race of a bearing on the {name}", possible=bool(fit), detail=_elements(described, fit)),
            Cause(
                name=f"inner race of a bearing on the {name}", possible=bool(inner), detail=_elements(described, inner)
            ),
            Cause(name=f"rolling element on the {name}", possible=BALL[0] <= ratio <= BALL[1], detail=described),
        ]
    return out


def one_bearing(
    order: float, std: float, others: Sequence[tuple[float, float]], limits: CauseThresholds = DEFAULT
) -> list[Cause]:
    """Another spacing that, with this one, is cage and outer race of one bearing: their ratio is its element count.

    others  orders of other spacings with their standard deviations
    """
    out, counts = [], set(ELEMENTS)
    for other, other_std in others:
        (cage, cage_std), (race, race_std) = sorted([(order, std), (other, other_std)])
        count = round(race / cage)
        off, spread = abs(race - count * cage), (race_std**2 + (count * cage_std) ** 2) ** 0.5
        if count in counts and off < limits.far * spread and spread < limits.whole_count * cage:
            out.append(
                Cause(
                    name=f"cage and outer race of one bearing of {count} elements",
                    possible=True,
                    detail=f"lines are spaced by orders {cage:.4f} and {race:.4f}, too: {race / cage:.3f} times it",
                )
            )
    return out


def _elements(described: str, counts: Sequence[int]) -> str:
    if not counts:
        return f"{described}: no bearing of {ELEMENTS[0]} to {ELEMENTS[-1]} elements"
    return f"{described}: {', '.join(map(str, counts))} elements"
