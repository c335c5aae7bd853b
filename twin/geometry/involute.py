"""The involute of a circle.

    inv α = tan α − α        cos α_r = r_b / r        ξ = tan α_r

r    radius of a point of the flank           [m]
r_b  base radius                              [m]
α_r  pressure angle at that point             [rad]
ξ    roll angle: the string unwound, over r_b [rad]

Source   ISO 21771-1:2024, clause 4
"""

from __future__ import annotations

import numpy as np


def involute(pressure_angle):
    """inv α = tan α − α [rad] at each pressure angle [rad]; (n,) → (n,)."""
    return np.tan(pressure_angle) - pressure_angle


def roll_angle(radius, base_radius):
    """ξ = sqrt((r/r_b)² − 1) [rad] at each radius [m], zero on and below the base circle; (n,) → (n,)."""
    return np.sqrt(np.maximum((np.asarray(radius) / base_radius) ** 2 - 1, 0.0))


def pressure_angle_at(radius, base_radius):
    """α_r = arctan ξ [rad] at each radius [m]; (n,) → (n,)."""
    return np.arctan(roll_angle(radius, base_radius))
