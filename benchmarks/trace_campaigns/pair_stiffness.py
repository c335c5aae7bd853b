"""Stiffness of one tooth pair along the path of contact, by Weber and Banaschek: for the rig files of this folder.

    python -m benchmarks.trace_campaigns.pair_stiffness RIG.toml     prints [mesh] pair_s and pair_stiffness

Another derivation than the energy method of twin and reference rig: closed integrals of the tooth as a short beam, a
half plane under it, and Hertz's contact between the tooth's middle lines.

    w = F/(W·E')·cos²γ·(12·∫(y_c − y)²/(2x)³ dy + (2.4/(1 − ν) + tan²γ)·∫ dy/(2x))        tooth
      + F/(W·E')·cos²γ·(18/π·(y/s)² + 2(1 − 2ν)/(1 − ν)·y/s + 4.8/π·(1 + (1 − ν)/2.4·tan²γ))  body under it
      + F/(W·E')·2/π·(ln(4·t1·t2/b²) − ν/(1 − ν))                                            contact

E' = E/(1 − ν²); γ angle of the force to the tooth's cross-section, y_c where it crosses the middle line, s thickness
of the root, t distances of the contact from the middle lines along the force, b Hertz's half-width.

Source   C. Weber, K. Banaschek, Formänderung und Profilrücknahme bei gerad- und schrägverzahnten Rädern,
         Schriftenreihe Antriebstechnik 11, Vieweg 1953
"""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from math import acos, cos, pi, radians, sin, sqrt, tan
from pathlib import Path

import numpy as np

POINTS = 21  # of the table
FILLET = 0.35  # of the module: how far the root's fillet reaches up a tooth, over which it widens


@dataclass(frozen=True, slots=True)
class Tooth:
    """One gear's tooth; lengths in metres."""

    teeth: int
    module: float
    pressure_angle: float  # [rad]
    dedendum: float

    @property
    def base(self) -> float:
        return self.teeth * self.module / 2 * cos(self.pressure_angle)

    def half_angle(self, radius: float) -> float:
        """Half of the tooth's thickness as an angle at a radius [rad]; below the base circle as on it."""
        at = acos(min(1.0, self.base / radius))
        α = self.pressure_angle
        return pi / (2 * self.teeth) + (tan(α) - α) - (tan(at) - at)

    def half_width(self, y: np.ndarray, root: float) -> np.ndarray:
        """Half of its thickness at heights y over the wheel's centre, with a rounded foot; (n,) → (n,)."""
        plain = np.array([r * sin(self.half_angle(r)) for r in y])
        foot = FILLET * self.module
        up = np.clip((y - root) / foot, 0, 1)
        return plain + foot * (1 - np.sqrt(1 - (1 - up) ** 2))

    def compliance(self, ρ: float, poisson: float) -> tuple[float, float]:
        """W·E'·w/F of tooth and body for a force where the flank's curvature is ρ, and t of the contact [m]."""
        radius = sqrt(self.base**2 + ρ**2)
        γ = acos(self.base / radius) - self.half_angle(radius)
        crossing = self.base / cos(γ)
        root = self.teeth * self.module / 2 - self.dedendum
        y = np.linspace(root, crossing, 400)
        width = 2 * self.half_width(y, root)
        bending = 12 * np.trapezoid((crossing - y) ** 2 / width**3, y)
        shear = (2.4 / (1 - poisson) + tan(γ) ** 2) * np.trapezoid(1 / width, y)
        lever, ν = (crossing - root) / width[0], poisson
        body = 18 / pi * lever**2 + 2 * (1 - 2 * ν) / (1 - ν) * lever
        body += 4.8 / pi * (1 + (1 - ν) / 2.4 * tan(γ) ** 2)
        return cos(γ) ** 2 * (bending + shear + body), radius * sin(self.half_angle(radius)) / cos(γ)


def table(rig: Mapping) -> tuple[np.ndarray, np.ndarray]:
    """Places on the path [m] and the stiffness of one pair there [N/m], at the rated torque; (POINTS,) each."""
    g = rig["gears"]
    α, m, W = radians(g["pressure_angle_deg"]), float(g["module"]), float(g["face_width"])
    ν, E = float(g["poisson_ratio"]), float(g["youngs_modulus"])
    teeth = [Tooth(int(g[w]["teeth"]), m, α, float(g["dedendum"])) for w in ("pinion", "gear")]
    tips = [t.teeth * m / 2 + float(g["addendum"]) for t in teeth]
    reach = [sqrt(tip**2 - t.base**2) - t.base * tan(α) for t, tip in zip(teeth, tips, strict=True)]
    s = np.linspace(-reach[1], reach[0], POINTS)
    line_load = float(rig["operating"]["input_torque"]) / teeth[0].base / W
    stiff = E / (1 - ν**2)
    out = []
    for at in s:
        ρ = (teeth[0].base * tan(α) + at, teeth[1].base * tan(α) - at)
        parts = [t.compliance(r, ν) for t, r in zip(teeth, ρ, strict=True)]
        b2 = 8 * line_load * ρ[0] * ρ[1] / (ρ[0] + ρ[1]) / (pi * stiff)
        contact = 2 / pi * (np.log(4 * parts[0][1] * parts[1][1] / b2) - ν / (1 - ν))
        out.append(W * stiff / (parts[0][0] + parts[1][0] + contact))
    return s, np.array(out)


def main() -> int:
    s, k = table(tomllib.loads(Path(sys.argv[1]).read_text(encoding="utf-8")))
    print("pair_s = [" + ", ".join(f"{v:.6e}" for v in s) + "]")
    print("pair_stiffness = [" + ", ".join(f"{v:.5e}" for v in k) + "]")
    return 0


if __name__ == "__main__":
    sys.exit(main())
