"""How the size of an effect goes on after its onset: constant, growing evenly, or changed a second time.

    size(n) = f(n)·size          constant  f = 1
                                 linear    f = (n − n_0)/(n_1 − n_0)
                                 stepped   f = 1 up to the first knot, then the factor of the last knot passed

n    revolutions of the pinion                                               [rev]
n_0  onset of the effect                                                     [rev]
n_1  knot at which a growing effect has the size that its parameters say     [rev]

A size is the distance of a parameter from the value that does nothing; of parameters that multiply (a gain, a damping
factor) it is the logarithm, so that f takes a gain g to g^f. A parameter never leaves its bounds.

Source  the laws are those by which a fault is usually entered in prognostics: abrupt, incipient (a ramp) and
        intermittent: R. Isermann, Fault-Diagnosis Systems, Springer 2006, section 2.3 (time dependency of faults)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import log

from twin.effects.parameter import Parameter
from twin.effects.response import Effect
from twin.errors import ParameterError

KINDS = ("constant", "linear", "stepped")


@dataclass(frozen=True, slots=True, kw_only=True)
class SizeLaw:
    """The factor f(n) on the size of an effect."""

    kind: str = "constant"  # one of KINDS
    revolutions: tuple[float, ...] = ()  # knots, rising: the only one of a linear law, every later change of a stepped
    factors: tuple[float, ...] = ()  # of a stepped law: from each knot on

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ParameterError(f"kind = {self.kind!r} must be one of {', '.join(KINDS)}")
        if self.kind == "linear" and len(self.revolutions) != 1:
            raise ParameterError("a linear law needs one knot: the revolutions at which the effect has its size")
        if self.kind == "stepped" and len(self.revolutions) != len(self.factors):
            raise ParameterError("a stepped law needs one factor for each of its knots")

    def factor(self, revolutions: float, onset: float) -> float:
        """f at a number of revolutions, of an effect since `onset`; 0 before it."""
        if revolutions < onset:
            return 0.0
        if self.kind == "linear":
            (full,) = self.revolutions
            return (revolutions - onset) / (full - onset) if full > onset else 1.0
        return self.stage_factor(revolutions)

    def stage_factor(self, revolutions: float) -> float:
        """f of a stepped law; 1 of the others."""
        factor = 1.0
        if self.kind == "stepped":
            for knot, after in zip(self.revolutions, self.factors, strict=True):
                factor = after if revolutions >= knot else factor
        return factor

    @property
    def changes(self) -> tuple[float, ...]:
        """Revolutions after the onset at which the size changes abruptly."""
        return self.revolutions if self.kind == "stepped" else ()


CONSTANT = SizeLaw()


def size_parameters(effect: Effect) -> tuple[Parameter, ...]:
    """The parameters that give an effect its size."""
    return tuple(p for p in effect.parameters if not p.shape and not p.many)


def factor_between(effect: Effect, other: Effect) -> float:
    """f by which another effect of the same kind is larger, by its first parameter of size; 0 where there is none."""
    p = size_parameters(effect)[0]
    a, b = float(getattr(effect, p.name)), float(getattr(other, p.name))
    multiplies = p.neutral > 0 and min(a, b) > 0
    here, there = (log(v / p.neutral) if multiplies else v - p.neutral for v in (a, b))
    return there / here if here else 0.0


def scaled(effect: Effect, factor: float) -> Effect:
    """The effect with f times its size, within the bounds of its parameters."""
    if factor == 1.0:
        return effect
    values = {}
    for p in size_parameters(effect):
        value = getattr(effect, p.name)
        new = p.neutral * (value / p.neutral) ** factor if p.neutral > 0 else p.neutral + factor * (value - p.neutral)
        values[p.name] = float(min(max(new, p.low), p.high))
    return replace(effect, **values)  # type: ignore[type-var]
