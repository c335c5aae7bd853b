"""Two flanks pressed together: their approach and the width over which they touch.

    1/k_h = 4·(1 − ν²)/(π·E·W)          (approach proportional to the force)
    b = sqrt(4·F·ρ/(π·W·E*)),  1/ρ = 1/ρ1 + 1/ρ2,  1/E* = 2·(1 − ν²)/E

b        half the contact's width              [m]
ρ1, ρ2   radii of curvature of the two flanks  [m]
F        normal force                          [N]
W        face width                            [m]

Source   D. C. H. Yang, Z. S. Sun, J. Mech. Trans. Autom. 107 (1985) 529-535 (stiffness);
         K. L. Johnson, Contact Mechanics, eq. (4.43) (half-width)
Holds    both gears of one material
"""

from __future__ import annotations

from math import pi


def hertz_compliance(*, youngs_modulus: float, poisson_ratio: float, face_width: float) -> float:
    """1/k_h [m/N]."""
    return 4 * (1 - poisson_ratio**2) / (pi * youngs_modulus * face_width)
