"""Claims about the stiffness of a tooth pair."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from tests.mesh_pairs import EQUAL, PAIRS, UNSW
from twin.errors import ParameterError
from twin.mesh.foundation import foundation_compliance, root_half_angle
from twin.mesh.given_stiffness import not_a_knot
from twin.mesh.hertz import hertz_compliance
from twin.mesh.stiffness import PairStiffness, pair_compliance, pair_stiffness
from twin.mesh.tooth_compliance import tooth_compliance


def positions(pair, n=201, beyond=0.0):
    return np.linspace(pair.path_start - beyond, pair.path_end + beyond, n)


def test_equal_gears_are_as_stiff_in_approach_as_in_recess():
    s = positions(EQUAL)
    assert pair_stiffness(EQUAL, s) == pytest.approx(pair_stiffness(EQUAL, -s), rel=1e-12)


def test_exchanging_the_gears_mirrors_the_stiffness():
    swapped = replace(UNSW, teeth=UNSW.teeth[::-1], bore_radius=UNSW.bore_radius[::-1])
    s = positions(UNSW)
    assert pair_stiffness(swapped, -s) == pytest.approx(pair_stiffness(UNSW, s), rel=1e-12)


@pytest.mark.parametrize("factor", [0.5, 3.0])
def test_stiffness_is_proportional_to_face_width_and_to_modulus(factor):
    s, k = positions(UNSW), pair_stiffness(UNSW, positions(UNSW))
    wider = replace(UNSW, face_width=factor * UNSW.face_width)
    harder = replace(UNSW, youngs_modulus=factor * UNSW.youngs_modulus)
    assert pair_stiffness(wider, s) == pytest.approx(factor * k, rel=1e-12)
    assert pair_stiffness(harder, s) == pytest.approx(factor * k, rel=1e-12)


def test_stiffness_does_not_depend_on_the_size_of_similar_gears():
    """Plane elasticity has no length of its own: k/(E·W) is a function of shape alone."""
    c = 7.0
    large = replace(
        UNSW, module=c * UNSW.module, addendum=c * UNSW.addendum, dedendum=c * UNSW.dedendum,
        bore_radius=tuple(c * r for r in UNSW.bore_radius), backlash=c * UNSW.backlash,
    )  # fmt: skip
    s = positions(UNSW)
    assert pair_stiffness(large, c * s) == pytest.approx(pair_stiffness(UNSW, s), rel=1e-11)


def test_a_tooth_gives_way_more_the_nearer_to_its_tip_it_is_loaded():
    tooth = UNSW.tooth(0)
    ξ = UNSW.curvature_radius(positions(UNSW))[0] / UNSW.base_radius[0]
    steel = {"youngs_modulus": 205e9, "face_width": 0.02}
    beam = tooth_compliance(tooth, ξ, poisson_ratio=0.29, **steel)
    body = foundation_compliance(tooth, ξ, bore_radius=0.007, **steel)
    assert np.all(np.diff(beam.total + body) > 0)


@pytest.mark.parametrize("pair", PAIRS.values(), ids=PAIRS)
def test_every_cause_of_compliance_is_positive(pair):
    for cause, compliance in pair_compliance(pair, positions(pair)).items():
        assert np.all(compliance >= 0), cause


def test_compliances_of_all_causes_add_to_that_of_the_pair():
    s = positions(UNSW)
    total = sum(pair_compliance(UNSW, s).values())
    assert 1 / pair_stiffness(UNSW, s) == pytest.approx(total, rel=1e-14)


def test_a_slender_tooth_bends_like_the_integral_of_its_sections():
    """Bending, shear and thrust against the same integrals by the trapezium rule on the drawn profile."""
    tooth, E, ν, W = UNSW.tooth(0), 205e9, 0.29, 0.02
    ξ = 0.42
    β = ξ - tooth.base_half_angle
    τ_form, γ_form = tooth.form_point
    fillet = tooth.fillet_point(np.linspace(pi / 2, γ_form, 20001))
    flank = tooth.flank_point(np.linspace(τ_form, β, 20001))
    x, y = (np.concatenate(v) for v in zip(fillet, flank, strict=True))
    x_c, y_c = x[-1], y[-1]
    moment = np.cos(β) * (y_c - y) - x_c * np.sin(β)
    beam = tooth_compliance(tooth, ξ, youngs_modulus=E, poisson_ratio=ν, face_width=W)
    assert beam.bending[0] == pytest.approx(np.trapezoid(moment**2 / (E * W * x**3 * 2 / 3), y), rel=1e-7)
    shear = np.trapezoid(1.2 * np.cos(β) ** 2 * 2 * (1 + ν) / (E * 2 * x * W), y)
    assert beam.shear[0] == pytest.approx(shear, rel=1e-7)
    assert beam.axial[0] == pytest.approx(np.trapezoid(np.sin(β) ** 2 / (E * 2 * x * W), y), rel=1e-7)


def test_hertz_term_is_the_closed_form_and_the_same_everywhere():
    expected = 4 * (1 - 0.29**2) / (pi * 205e9 * 0.02)
    assert hertz_compliance(youngs_modulus=205e9, poisson_ratio=0.29, face_width=0.02) == expected
    assert pair_compliance(UNSW, positions(UNSW))["hertz"] == pytest.approx(expected, rel=1e-15)


def test_a_smaller_bore_leaves_a_softer_body():
    """The load's moment turns the ring about the bore: Sainsot's factor grows with h = r_f/r_bore."""
    s = positions(UNSW)
    tight, loose = (replace(UNSW, bore_radius=(r, 0.01)) for r in (0.011, 0.006))
    assert np.all(pair_stiffness(tight, s) > pair_stiffness(loose, s))


def test_pinion_root_lies_inside_the_range_of_the_foundation_formula_only_by_its_flank():
    pinion = UNSW.tooth(0)
    assert 0.01 <= root_half_angle(pinion) <= 0.12 < root_half_angle(pinion, "fillet")
    s = positions(UNSW)
    assert np.all(pair_stiffness(UNSW, s, "fillet") > pair_stiffness(UNSW, s))


@pytest.mark.parametrize("pair", PAIRS.values(), ids=PAIRS)
def test_spline_is_the_stiffness_inside_and_outside_the_path(pair):
    k, s = PairStiffness.of(pair), positions(pair, 4001, beyond=pair.base_pitch)
    assert k(s) == pytest.approx(pair_stiffness(pair, s), rel=3e-9)


def test_stiffness_has_two_continuous_derivatives_across_the_ends_of_the_path():
    """The second derivative's step from one side to the other vanishes with the distance between them."""
    k = PairStiffness.of(UNSW)

    def step(end, h):
        before, after = ((k(s + h) - 2 * k(s) + k(s - h)) / h**2 for s in (end - h, end + h))
        return after - before

    for end in (UNSW.path_start, UNSW.path_end):
        assert step(end, 1e-6) == pytest.approx(step(end, 4e-6) / 4, rel=0.05)
        assert k.slope(end - 1e-9) == pytest.approx(k.slope(end + 1e-9), rel=1e-4)


def test_slope_is_the_derivative_of_the_stiffness():
    k, h = PairStiffness.of(UNSW), 1e-8
    s = positions(UNSW, 101, beyond=0.5e-3)
    numeric = (k(s + h) - k(s - h)) / (2 * h)
    assert k.slope(s) == pytest.approx(numeric, abs=1e-5 * np.abs(numeric).max())


def test_stiffness_levels_off_outside_the_path_and_stays_positive():
    k = PairStiffness.of(UNSW)
    far = UNSW.path_start - np.array([2e-3, 4e-3, 9e-3])
    assert k(far) == pytest.approx(np.full(3, k(far[0])), rel=1e-4)
    assert k(far[0]) == pytest.approx(k(UNSW.path_start), rel=0.05)


def test_scale_multiplies_the_stiffness():
    s = positions(UNSW, 11)
    k = PairStiffness.of(UNSW)
    assert PairStiffness.of(UNSW, scale=1.1)(s) == pytest.approx(1.1 * k(s), rel=1e-13)
    assert k.scaled(1.1)(s) == pytest.approx(1.1 * k(s), rel=1e-13)


@pytest.mark.parametrize("points", [4, 5, 6, 41])
def test_spline_of_the_check_of_a_given_table_is_that_of_the_model(points):
    """Against scipy's not-a-knot spline, at uneven points, and beyond both ends."""
    random = np.random.default_rng(points)
    x, y = np.cumsum(random.uniform(0.2, 1.0, points)), random.normal(size=points)
    at = np.concatenate((np.linspace(x[0] - 0.3, x[-1] + 0.3, 201), x))
    expected = CubicSpline(x, y)(at)
    np.testing.assert_allclose(not_a_knot(x, y, at), expected, rtol=0, atol=1e-11 * np.abs(expected).max())


def test_shape_of_the_positions_is_kept():
    k = PairStiffness.of(UNSW)
    for s in (np.float64(0.0), np.zeros(3), np.zeros((2, 3))):
        assert np.shape(k(s)) == np.shape(pair_stiffness(UNSW, s)) == np.shape(s)


def test_wrong_bore_and_unknown_root_section_are_refused():
    with pytest.raises(ParameterError, match=r"bore_radius = 0\.02 m is outside \(0, 0\.0165\) m; a diameter"):
        pair_stiffness(replace(UNSW, bore_radius=(0.02, 0.01)), 0.0)
    with pytest.raises(ParameterError, match=r"root_section = 'bore' must be one of flank, fillet"):
        pair_stiffness(UNSW, 0.0, "bore")
