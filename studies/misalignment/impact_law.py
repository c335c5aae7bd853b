"""Contact force of the impact law and its Coulomb friction, as functions of penetration, approach and slip.

    F = max(0, K·x^e + C·S(x)·ẋ)   for x > 0, else 0        S(x) = Δ²·(3 − 2Δ),  Δ = min(x/d, 1)
    μ(v) = μ_s·(2·σ((v + v_s)/(2v_s)) − 1)                    for |v| < v_s
         = sgn v·(μ_s + (μ_d − μ_s)·σ((|v| − v_s)/(v_d − v_s)))  for v_s ≤ |v| < v_d
         = sgn v·μ_d                                          beyond;            σ(u) = u²·(3 − 2u)

x         penetration, positive where the bodies overlap  [m]
K, e      stiffness [N/m^e] and exponent
C, d      full damping [N·s/m] and the penetration at which it is reached [m]
μ_s, v_s  static coefficient and the slip at which it is reached [m/s]
μ_d, v_d  dynamic coefficient and the slip from which it holds [m/s]

Source   D. Dąbrowski, J. Adamczyk, H. Plascencia Mora, Diagnostyka 2(62) (2012) 15–22, eqs. (1) and (2), Table 2; the
         clipping at zero and the steps of μ as MSC ADAMS documents IMPACT and its contact friction
Holds    one contact with one normal; the functions are scalar, so that they can be compiled
Ignores  sticking: at v = 0 there is no friction, so that a loaded contact creeps
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from twin.errors import ParameterError


def impact(x: float, rate: float, K: float, e: float, C: float, d: float) -> tuple[float, float, float]:
    """F [N], ∂F/∂x [N/m] and ∂F/∂ẋ [N·s/m] at a penetration [m] and its rate [m/s]."""
    if x <= 0.0:
        return 0.0, 0.0, 0.0
    slope = K * x ** (e - 1.0)
    if x < d:
        u = x / d
        S, dS = u * u * (3.0 - 2.0 * u), 6.0 * u * (1.0 - u) / d
    else:
        S, dS = 1.0, 0.0
    F = slope * x + C * S * rate
    if F <= 0.0:
        return 0.0, 0.0, 0.0
    return F, e * slope + C * dS * rate, C * S


def friction(v: float, static: float, dynamic: float, v_s: float, v_d: float) -> tuple[float, float]:
    """μ, with the sign of the slip v [m/s], and dμ/dv [s/m]."""
    speed = abs(v)
    if speed >= v_d:
        return (dynamic, 0.0) if v > 0.0 else (-dynamic, 0.0)
    if speed >= v_s:
        u = (speed - v_s) / (v_d - v_s)
        μ = static + (dynamic - static) * u * u * (3.0 - 2.0 * u)
        dμ = (dynamic - static) * 6.0 * u * (1.0 - u) / (v_d - v_s)
        return (μ, dμ) if v > 0.0 else (-μ, dμ)
    u = (v + v_s) / (2.0 * v_s)
    return static * (2.0 * u * u * (3.0 - 2.0 * u) - 1.0), static * 6.0 * u * (1.0 - u) / v_s


@dataclass(frozen=True, slots=True, kw_only=True)
class ImpactLaw:
    """The parameters of one tooth contact over the whole face."""

    stiffness: float  # K [N/m^e]
    exponent: float  # e
    damping: float  # C [N·s/m]
    full_damping_depth: float  # d [m]
    static_friction: float  # μ_s
    dynamic_friction: float  # μ_d
    static_speed: float  # v_s [m/s]
    dynamic_speed: float  # v_d [m/s]

    def __post_init__(self) -> None:
        for name in ("stiffness", "exponent", "full_damping_depth", "static_speed"):
            if not getattr(self, name) > 0:
                raise ParameterError(f"{name} = {getattr(self, name):g} must be above 0")
        for name in ("damping", "static_friction", "dynamic_friction"):
            if not getattr(self, name) >= 0:
                raise ParameterError(f"{name} = {getattr(self, name):g} must not be negative")
        if not self.dynamic_speed > self.static_speed:
            raise ParameterError(
                f"dynamic_speed = {self.dynamic_speed:g} m/s must be above static_speed = {self.static_speed:g} m/s"
            )

    @property
    def normal(self) -> tuple[float, float, float, float]:
        """K, e, C, d: what `impact` takes after x and ẋ."""
        return self.stiffness, self.exponent, self.damping, self.full_damping_depth

    @property
    def tangential(self) -> tuple[float, float, float, float]:
        """μ_s, μ_d, v_s, v_d: what `friction` takes after v."""
        return self.static_friction, self.dynamic_friction, self.static_speed, self.dynamic_speed

    def without_friction(self) -> ImpactLaw:
        return replace(self, static_friction=0.0, dynamic_friction=0.0)

    def penetration(self, force: float) -> float:
        """x [m] at rest under a normal force [N] over the whole face: (F/K)^(1/e)."""
        return (force / self.stiffness) ** (1 / self.exponent)
