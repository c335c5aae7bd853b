"""The stiffness of the 19/52 pair and its corner gaps against the reference rig's own figures.

Source   recordings/rigs/unsw.toml, tables [mesh] pair_s, pair_stiffness, mean_stiffness, corner_gap_*:
         an independent computation by the same method, "estimated from geometry"

The table is met within 2.5 % at every point (+0.3 % at the path's start to +2.4 % in recess), its mean
within 2 %. What remains is the tooth's root: the fillet that a rounded tool leaves is stiffer than a
straight foot from the base circle to the root circle; with such a foot and the same foundation the table
is met within 1 %. Were the tooth not thinned by the backlash, k would be 1.5 % higher. The gap's
polynomials are fits: the one at the end is met to 1e-4, the one at the start, which has to follow a
stronger curve with three terms, within 6 %.
"""

import numpy as np
import pytest

from benchmarks.quasi_static import nominal_mesh_stiffness
from tests.mesh_pairs import UNSW, UNSW_RIG
from twin.mesh.corner_contact import corner_gap
from twin.mesh.stiffness import PairStiffness, pair_stiffness

MESH = UNSW_RIG["mesh"]


def test_stiffness_of_a_pair_is_that_of_the_table():
    k = pair_stiffness(UNSW, np.array(MESH["pair_s"]))
    assert k == pytest.approx(np.array(MESH["pair_stiffness"]), rel=0.025)


def test_mean_single_and_double_contact_are_those_of_the_rig():
    stiffness = PairStiffness.of(UNSW)
    k = nominal_mesh_stiffness(stiffness, 8192)
    single, double = k[k < 2.5e8], k[k > 2.5e8]
    assert stiffness.mesh_mean == pytest.approx(MESH["mean_stiffness"], rel=0.02)
    assert (single.min(), single.max()) == pytest.approx((1.80e8, 1.84e8), rel=0.025)
    assert (double.min(), double.max()) == pytest.approx((3.06e8, 3.25e8), rel=0.025)


def polynomial(coefficients, x):
    c0, c1, c2 = coefficients
    return x**2 * (c0 + c1 * x + c2 * x**2)


def test_gap_after_the_end_is_the_rigs_polynomial():
    x = np.linspace(1e-5, 1.9e-3, 50)
    gap = corner_gap(UNSW, UNSW.path_end + x)
    assert gap == pytest.approx(polynomial(MESH["corner_gap_end"], x), rel=1e-4)


def test_gap_before_the_start_is_the_rigs_polynomial_as_far_as_that_can_follow():
    x = np.linspace(1e-5, 1.9e-3, 50)
    gap = corner_gap(UNSW, UNSW.path_start - x)
    assert gap == pytest.approx(polynomial(MESH["corner_gap_start"], x), rel=0.06)
