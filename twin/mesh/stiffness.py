"""Stiffness of one pair of teeth along the path of contact.

    1/k(s) = Σ over both gears (1/k_b + 1/k_s + 1/k_a + 1/k_f) + 1/k_h

s  signed distance of the contact from the pitch point along the line of action [m]

Outside the nominal path a tip corner still touches: the contact stays at that tip, so the stiffness
levels off. s is replaced there by s_end ± l·tanh((s − s_end)/l), which joins with two derivatives.

A curve from another source, such as finite elements, may be given instead: `PairStiffness.given`.

Source   mesh/tooth_compliance, mesh/foundation, mesh/hertz
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import CubicSpline

from twin.geometry.gear_pair import GearPair
from twin.mesh.foundation import DEFAULT_ROOT_SECTION, foundation_compliance
from twin.mesh.given_stiffness import LEVELLING, knots, refuse_unless_positive
from twin.mesh.hertz import hertz_compliance
from twin.mesh.tooth_compliance import tooth_compliance


def levelled_position(pair: GearPair, s):
    """s [m] inside the path of contact, levelling off smoothly outside; (n,) → (n,)."""
    s = np.asarray(s, float)
    length = LEVELLING * pair.base_pitch
    start, end = pair.path_start, pair.path_end
    inside = np.clip(s, start, end)
    return inside + length * np.tanh((s - inside) / length)


def pair_compliance(pair: GearPair, s, root_section: str = DEFAULT_ROOT_SECTION) -> dict[str, np.ndarray]:
    """Compliance of one tooth pair by cause; path positions s (n,) [m] → arrays (n,) [m/N].

    Keys: bending, shear, axial, foundation, each with _pinion or _gear, and hertz.
    """
    return _compliance(pair, np.atleast_1d(levelled_position(pair, s)), root_section)


def _compliance(pair: GearPair, s: np.ndarray, root_section: str) -> dict[str, np.ndarray]:
    steel = {"youngs_modulus": pair.youngs_modulus, "face_width": pair.face_width}
    out: dict[str, np.ndarray] = {}
    for i, (wheel, ρ) in enumerate(zip(("pinion", "gear"), pair.curvature_radius(s), strict=True)):
        tooth, ξ = pair.tooth(i), ρ / pair.base_radius[i]
        beam = tooth_compliance(tooth, ξ, poisson_ratio=pair.poisson_ratio, **steel)
        out[f"bending_{wheel}"], out[f"shear_{wheel}"], out[f"axial_{wheel}"] = (
            beam.bending,
            beam.shear,
            beam.axial,
        )
        out[f"foundation_{wheel}"] = foundation_compliance(
            tooth, ξ, bore_radius=pair.bore_radius[i], root_section=root_section, **steel
        )
    out["hertz"] = np.full(s.shape, hertz_compliance(poisson_ratio=pair.poisson_ratio, **steel))
    return out


def pair_stiffness(pair: GearPair, s, root_section: str = DEFAULT_ROOT_SECTION) -> np.ndarray:
    """k [N/m] of one tooth pair at path positions s [m]; any shape → the same."""
    compliance = _total(pair_compliance(pair, np.ravel(s), root_section))
    return (1 / compliance).reshape(np.shape(s))


def _total(compliance: dict[str, np.ndarray]) -> np.ndarray:
    return np.sum(list(compliance.values()), axis=0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PairStiffness:
    """k(s) of one tooth pair as a spline with two continuous derivatives: fast to evaluate."""

    pair: GearPair
    s: np.ndarray  # (m,) knots, the path of contact and a little beyond [m]
    values: np.ndarray  # (m,) [N/m]
    _spline: CubicSpline = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_spline", CubicSpline(self.s, self.values))

    @classmethod
    def of(cls, pair: GearPair, *, scale: float = 1.0, root_section: str = DEFAULT_ROOT_SECTION) -> PairStiffness:
        """The spline of a gear pair; `scale` multiplies it (the rig's or a calibrated stiffness_scale)."""
        levels = knots(pair)
        compliance = _total(_compliance(pair, levels, root_section))
        return cls(pair=pair, s=levels, values=scale / compliance)

    @classmethod
    def given(cls, pair: GearPair, s, values) -> PairStiffness:
        """The spline through given stiffness (m,) [N/m] at path positions s (m,) [m], from finite elements for example.

        Beyond the table, as far as a tip corner touches, the spline's last piece goes on. Raises ParameterError where
        that is not positive.
        """
        levels = knots(pair)
        k = CubicSpline(np.asarray(s, float), np.asarray(values, float))(levels)
        refuse_unless_positive(pair, k)
        return cls(pair=pair, s=levels, values=k)

    def __call__(self, s):
        """k [N/m] at path positions s [m]; any shape → the same."""
        return self._spline(levelled_position(self.pair, s))

    def slope(self, s):
        """dk/ds [N/m²] at path positions s [m]; any shape → the same."""
        inside = np.clip(s, self.pair.path_start, self.pair.path_end)
        chain = 1 / np.cosh((s - inside) / (LEVELLING * self.pair.base_pitch)) ** 2
        return self._spline(levelled_position(self.pair, s), 1) * chain

    def scaled(self, factor: float) -> PairStiffness:
        """The same pair, `factor` times as stiff."""
        return PairStiffness(pair=self.pair, s=self.s, values=factor * self.values)

    @property
    def mesh_mean(self) -> float:
        """Mean over a mesh period of all pairs inside the nominal path: ∫k ds/p_b [N/m]."""
        return float(self._spline.integrate(self.pair.path_start, self.pair.path_end)) / self.pair.base_pitch
