"""Involute flanks of the pair, their corner contact, and what is missing from each tooth.

A contact is told by its roll position s on a flank: the signed distance from the pitch point at which the
unworn involute crosses the line of action, negative in approach. Either flank is read at its own s: the
pinion's at s₁, the gear's at s₂ = s₁ − d, which differ by the transmission error.

Before the path starts (and after it ends) the corner of a tip touches the other flank beside the line of
action. How far the tip is still away is found exactly, by turning the tip's gear until its corner lies on
the other's involute; the angle times the base radius is the gap.

Surfaces hold the material that is missing, positive, normal to the flank: (teeth, points, slices).

Ignores  the tilt of worn flanks' normals; a tip's corner wears as if the flank went on behind it
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import atan2, cos, radians, sin, sqrt, tan

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

MARGIN = (2.2e-3, 3.2e-3)  # how far flanks and corner contact reach before and behind the nominal path [m]
SPACING = 25e-6  # of the points of a flank along s [m]
CORNER_SPACING = 5e-6  # of the table of corner gaps [m]


@dataclass(frozen=True, slots=True, kw_only=True)
class Pair:
    """The unworn pair of gears; index 1 the pinion."""

    teeth: tuple[int, int]
    base_radius: tuple[float, float]  # [m]
    pressure_angle: float  # [rad]
    face_width: float  # [m]
    backlash: float  # along the line of action [m]
    base_pitch: float  # [m]
    start: float  # of the path, s at the gear's tip [m]
    end: float  # of the path, s at the pinion's tip [m]
    points: np.ndarray  # s of the flank points (n_points,) [m]
    pair_stiffness: np.ndarray  # of one tooth pair over the whole face, at the points (n_points,) [N/m]
    gap_start: np.ndarray  # corner gap against the overshoot in steps of CORNER_SPACING [m]
    gap_end: np.ndarray  # the same behind the path's end [m]


def pair_of(rig: Mapping) -> Pair:
    """The pair of a rig file; its pair stiffness is splined through the file's table."""
    g = rig["gears"]
    α = radians(g["pressure_angle_deg"])
    m, z = float(g["module"]), (int(g["pinion"]["teeth"]), int(g["gear"]["teeth"]))
    r, ha = (m * z[0] / 2, m * z[1] / 2), float(g["addendum"])
    rb, ra = (r[0] * cos(α), r[1] * cos(α)), (r[0] + ha, r[1] + ha)
    start = -(sqrt(ra[1] ** 2 - rb[1] ** 2) - rb[1] * tan(α))
    end = sqrt(ra[0] ** 2 - rb[0] ** 2) - rb[0] * tan(α)
    n = int(np.ceil((end - start + sum(MARGIN)) / SPACING)) + 1
    s = start - MARGIN[0] + SPACING * np.arange(n)
    table = CubicSpline(rig["mesh"]["pair_s"], rig["mesh"]["pair_stiffness"])
    x = np.arange(0.0, max(MARGIN) + 2 * CORNER_SPACING, CORNER_SPACING)
    return Pair(
        teeth=z,
        base_radius=rb,
        pressure_angle=α,
        face_width=float(g["face_width"]),
        backlash=float(g.get("backlash", 0.0)),
        base_pitch=np.pi * m * cos(α),
        start=start,
        end=end,
        points=s,
        pair_stiffness=table(np.clip(s, table.x[0], table.x[-1])) * float(rig["mesh"].get("stiffness_scale", 1)),
        gap_start=corner_gap(x, flank_base=rb[0], tip_base=rb[1], tip_radius=ra[1], pressure_angle=α),
        gap_end=corner_gap(x, flank_base=rb[1], tip_base=rb[0], tip_radius=ra[0], pressure_angle=α),
    )


def corner_gap(overshoot, *, flank_base, tip_base, tip_radius, pressure_angle) -> np.ndarray:
    """Gap along the line of action [m] of a tip corner to the mating involute, (n,) overshoots → (n,).

    The overshoot x [m] is how far the roll position lies outside the path, on the tip's side.
    Where the corner no longer reaches the involute, below the base circle, the gap grows on as it did.
    """
    α, rb, rt = pressure_angle, flank_base, tip_base
    ρ_tip = sqrt(tip_radius**2 - rt**2)
    a = (rb + rt) / cos(α)

    def axes(φ):  # unit vectors to the tangent point and along the line of action, turned clockwise by φ
        return np.array([cos(α - φ), sin(α - φ)]), np.array([sin(α - φ), -cos(α - φ)])

    def one(x):
        ρ = (rb + rt) * tan(α) - ρ_tip - x  # on the flank

        def flank(φ):  # the mating involute, told by the unwinding angle −φ beyond the line of action
            e, n = axes(φ)
            return rb * e + (ρ - rb * φ) * n

        def outside(φ):
            return np.hypot(*(flank(φ) - (a, 0.0))) - tip_radius

        first = min(0.0, ρ / rb)  # the involute starts where ρ − rb·φ = 0
        angles = np.linspace(first, first - 0.35, 60)
        signs = np.array([outside(φ) for φ in angles])
        inside = np.flatnonzero(signs <= 0)
        if inside.size == 0:
            return np.nan
        k = inside[0]
        φ = angles[0] if k == 0 else brentq(outside, angles[k], angles[k - 1], xtol=1e-15)
        px, py = flank(φ) - (a, 0.0)
        e, n = axes(x / rt)  # where the tip is when the involutes touch at this s
        qx, qy = -(rt * e + ρ_tip * n)
        turn = atan2(qy, qx) - atan2(py, px)
        return rt * ((turn + np.pi) % (2 * np.pi) - np.pi)

    x = np.atleast_1d(np.asarray(overshoot, float))
    gap = np.array([0.0 if xi <= 0 else one(xi) for xi in x])
    known = np.flatnonzero(np.isfinite(gap))
    if known.size < gap.size:
        last = known[-20:]
        gap[known[-1] + 1 :] = np.polyval(np.polyfit(x[last], gap[last], 2), x[known[-1] + 1 :])
    return gap
