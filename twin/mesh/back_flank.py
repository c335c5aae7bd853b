"""Contact on the back flanks, when the driven gear runs ahead through the backlash.

Mirrored in the line of centres, a pinion turning forward becomes one turning back, its back flank a
drive flank. So the back flanks obey the same geometry with a path position s_b of their own:

    s_b = t·cos α − s         ρ1 = r_b1·tan α + s_b
    d_b = −(r_b1·θ1 − r_b2·θ2) + (y1 − y2)·cos α + (x1 − x2)·sin α − j

s    path position of the drive-flank contact, from the pinion's angle, r_b1·θ1       [m]
s_b  path position of the back-flank contact of the same pinion tooth; moves against s     [m]
t    tooth thickness of the pinion on its pitch circle                                     [m]
j    backlash along the line of action                                                     [m]
d_b  deflection along the back flanks' line of action, positive when they press together   [m]
x, y displacement of pinion (1) and gear (2); the line of centres is x (see NOMENCLATURE)  [m]

A tooth is symmetric, so k(s_b), corner_gap(s_b) and the radii of curvature are those of the drive
flank at that position. For standard teeth and little backlash t·cos α = p_b/2: the back flanks are
half a mesh period out of step with the mirrored drive flanks.

Source   ISO 21771-1:2024, clauses 4 and 5; the mirror argument is exact for symmetric teeth
"""

from __future__ import annotations

from math import cos

import numpy as np

from twin.geometry.gear_pair import GearPair


def back_flank_position(pair: GearPair, s):
    """s_b [m] of the back flank of the pinion tooth whose drive flank is at s [m]; (n,) → (n,)."""
    return pair.tooth_thickness * cos(pair.pressure_angle) - np.asarray(s, float)
