"""A pair with one gear out by 1°: what the authors' model and experiment did, and what comes out here.

Source     D. Dąbrowski, J. Adamczyk, H. Plascencia Mora, Diagnostyka 2(62) (2012) 15–22, chapters 2 and 3: mesh lines
           at z·f·n (eq. 4); in every case the second mesh harmonic rises; RMS in the bands "about 20 %" up at 400 rpm
           and "about 30 %" at 800 rpm, "especially for GMF2, GMF3 and GMF4"; in the model more; sidebands at the
           shafts' speed
Tolerance  the paper's numbers are round and its bars have no figures beside them: order and sign are tested. What is
           missed is stated by tests, too: with bearings and shafts two of four cases are near, and where supports are
           other than estimated the rise may be anywhere
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from twin.multibody.bands import shaft_lines
from twin.multibody.dabrowski_2012 import TEETH, drawn, system
from twin.multibody.study import COARSE, RESIDUALS, mean_miss, rises_of, run

SIGNALS = ("force", "acceleration")
SUPPORTS = ("rigid", "bearings", "shafts", "both")


@cache
def rises(variant, tilt="normal", against="aligned"):
    return rises_of(system(), variant, tilt, *COARSE, against)


@cache
def crooked(variant, tilt):
    return run(system(), variant, tilt, 800.0, 200.0, *COARSE)


@pytest.mark.parametrize("variant", ["rigid", "both"])
@pytest.mark.parametrize("tilt", ["aligned", "normal"])
def test_lines_lie_at_teeth_times_rotation_times_harmonic(variant, tilt):
    force = run(system(), variant, tilt, 800.0, 200.0, *COARSE).force
    power = np.abs(shaft_lines(force)[1:]) ** 2
    assert power[TEETH - 1 :: TEETH].sum() == pytest.approx(power.sum(), rel=1e-6)


@pytest.mark.parametrize("variant", [*SUPPORTS, "all"])
def test_every_case_raises_the_second_mesh_harmonic(variant):
    assert all(r.bands[1] > 0 for r in rises(variant))


@pytest.mark.parametrize("variant", SUPPORTS)
def test_so_does_a_tilt_in_the_plane_of_the_axes_but_for_the_rigid_model_at_low_speed_and_high_torque(variant):
    raised = [r.bands[1] > 0 for r in rises(variant, "in_plane")]
    assert raised == [True, variant != "rigid", True, True]


@pytest.mark.parametrize("tilt", ["normal", "in_plane"])
def test_the_rigid_model_rises_more_than_the_experiment_in_every_case_as_the_authors_did(tilt):
    assert all(r.force > r.experiment and r.acceleration > r.experiment for r in rises("rigid", tilt))


def test_the_rigid_model_rises_most_at_the_harmonics_that_the_experiment_did():
    for r in rises("rigid")[2:]:
        assert r.bands[[1, 2, 3]].min() > r.bands[4]


@pytest.mark.parametrize("of", SIGNALS)
def test_shafts_bring_the_rise_nearer_to_the_experiment_and_bearings_beside_them_more_so(of):
    miss = {variant: mean_miss(rises(variant), of) for variant in SUPPORTS}
    assert miss["both"] < miss["shafts"] < miss["rigid"]
    assert miss["shafts"] < miss["bearings"]


def test_bearings_alone_hardly_change_the_rise_of_the_force():
    assert mean_miss(rises("bearings")) == pytest.approx(mean_miss(rises("rigid")), rel=0.1)


def test_every_case_is_nearer_to_the_experiment_with_bearings_and_shafts_though_one_falls():
    for one, other in zip(rises("rigid"), rises("both"), strict=True):
        assert abs(other.force - other.experiment) < abs(one.force - one.experiment)
    assert [r.force > 0 for r in rises("both")] == [True, False, True, True]  # missed: 400 rpm with 200 N·m


def test_without_friction_supports_leave_the_rise_of_every_band_as_it_is():
    """What rings on the shafts, aligned or not, is friction as it turns round: that dilutes the rise."""
    smooth = replace(system(), law=system().law.without_friction())
    rigid, both = (rises_of(smooth, variant, "normal", *COARSE) for variant in ("rigid", "both"))
    for one, other in zip(rigid, both, strict=True):
        assert other.bands == pytest.approx(one.bands, abs=15)
    assert mean_miss(both) > 2 * mean_miss(rises("both"))


@pytest.mark.parametrize("variant", ["rigid", "both"])
def test_a_correct_state_that_is_itself_a_little_out_brings_the_rise_down(variant):
    misses = [mean_miss(rises(variant, "normal", state)) for state in ("aligned", *RESIDUALS)]
    assert misses[0] > misses[1] > misses[2]


@pytest.mark.parametrize("variant", ["rigid", "both"])
def test_sidebands_come_of_a_gear_that_turns_crookedly_and_of_no_axis_out_of_line(variant):
    for tilt in ("normal", "in_plane"):
        assert crooked(variant, tilt).sidebands.max() < 1e-3
    assert np.median(crooked(variant, "turning").sidebands[1]) > 0.2
    assert np.median(crooked(variant, "turning").sidebands[0]) < 0.01
    assert np.median(crooked(variant, "turning_end").sidebands[0]) > 0.2


@pytest.mark.slow
def test_over_all_estimates_both_bring_the_rise_nearer_mostly_but_not_always_and_shafts_alone_do_not():
    variants = ("rigid", "shafts", "both")
    misses = np.array(
        [
            [
                [mean_miss(rises, of) for of in SIGNALS]
                for rises in (rises_of(s, v, "normal", *COARSE) for v in variants)
            ]
            for s in drawn(seed=1, number=30)
        ]
    )
    rigid, shafts, both = np.moveaxis(misses, 1, 0)
    assert (np.median(both, axis=0) < 0.8 * np.median(rigid, axis=0)).all()
    force, acceleration = np.mean(both < rigid, axis=0)
    assert 0.5 < force < 1 and acceleration > 0.8
    assert np.mean(shafts < rigid, axis=0)[0] < 0.65
