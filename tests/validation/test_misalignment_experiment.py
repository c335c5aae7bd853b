"""A pair with one gear out by 1°: what the authors' model and experiment did, and what comes out here.

Source     D. Dąbrowski, J. Adamczyk, H. Plascencia Mora, Diagnostyka 2(62) (2012) 15–22, chapters 2 and 3: mesh lines
           at z·f·n (eq. 4); in every case the second mesh harmonic rises; RMS in the bands "about 20 %" up at 400 rpm
           and "about 30 %" at 800 rpm, "especially for GMF2, GMF3 and GMF4"; in the model more; sidebands at the
           shafts' speed
Tolerance  the paper's numbers are round and its bars have no figures beside them: order and sign are tested, a case is
           met within 10 %-points. What the paper does not give decides much, so that a claim is made of sets of
           estimates drawn from their ranges: it holds where it does in 16 of 20, which a coin does in 0.6 % of trials;
           with a share of nine in ten behind it, as the sure ones have, 20 sets find it in 96 %. What is missed, and
           what is not sure, is stated by tests, too. What holds at the nominal estimates alone: tests/golden
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from studies.misalignment.bands import shaft_lines
from studies.misalignment.dabrowski_2012 import MOST_AT, TEETH, drawn, system
from studies.misalignment.study import COARSE, SIGNALS, SPEEDS_RPM, mean_miss, rises_of, run

SUPPORTS = ("rigid", "bearings", "shafts", "both")
SETS, SURE = 20, 16
MET = 10  # from "about 20 %" and "about 30 %" [%-points]


@cache
def rises(variant, tilt="normal"):
    return rises_of(system(), variant, tilt, *COARSE)


@cache
def over_draws():
    """The rises of every set, by variant, at the four operating points."""
    return {v: [rises_of(s, v, "normal", *COARSE) for s in drawn(seed=1, number=SETS)] for v in SUPPORTS}


def misses(variant, of):
    return np.array([mean_miss(found, of) for found in over_draws()[variant]])


def sets_with(variant, claim, fast_alone=False):
    """Number of sets in which a claim holds of all rises, or of those at the higher speed."""
    return sum(
        all(claim(r) for r in found if not fast_alone or r.speed_rpm == SPEEDS_RPM[1])
        for found in over_draws()[variant]
    )


@cache
def crooked(variant, tilt):
    return run(system(), variant, tilt, 800.0, 200.0, *COARSE)


@pytest.mark.slow
@pytest.mark.parametrize("variant", ["rigid", "both"])
@pytest.mark.parametrize("tilt", ["aligned", "normal"])
def test_lines_lie_at_teeth_times_rotation_times_harmonic(variant, tilt):
    force = run(system(), variant, tilt, 800.0, 200.0, *COARSE).force
    power = np.abs(shaft_lines(force)[1:]) ** 2
    assert power[TEETH - 1 :: TEETH].sum() == pytest.approx(power.sum(), rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("variant", [*SUPPORTS, "all"])
def test_every_case_raises_the_second_mesh_harmonic(variant):
    assert all(r.bands[1] > 0 for r in rises(variant))


@pytest.mark.slow
@pytest.mark.parametrize("of", SIGNALS)
def test_the_rigid_model_rises_more_than_the_experiment_in_every_case_as_the_authors_did(of):
    assert all(getattr(r, of) > r.experiment for r in rises("rigid"))


@pytest.mark.parametrize("variant", ["rigid", "both"])
def test_harmonics_2_to_4_do_not_rise_most_as_they_did_in_the_experiment_missed(variant):
    """In per cent: harmonic 1 rises by more."""
    fast = [r for r in rises(variant) if r.speed_rpm == SPEEDS_RPM[1]]
    assert not any(all(r.most_at) for r in fast) and not any(r.most_at[0] for r in fast)


@pytest.mark.parametrize("variant", ["rigid", "both"])
def test_sidebands_come_of_a_gear_that_turns_crookedly_and_of_no_axis_out_of_line(variant):
    for tilt in ("normal", "in_plane"):
        assert crooked(variant, tilt).sidebands.max() < 1e-3
    assert np.median(crooked(variant, "turning").sidebands[1]) > 0.2
    assert np.median(crooked(variant, "turning").sidebands[0]) < 0.01
    assert np.median(crooked(variant, "turning_end").sidebands[0]) > 0.2


def test_along_the_line_of_centres_the_rigid_model_does_not_rise_as_the_authors_did():
    """So that, had "vertical" been along it, neither its excess nor what lowers it would be there."""
    assert not any(r.force_along > r.experiment or r.acceleration_along > r.experiment for r in rises("rigid"))


@pytest.mark.slow
@pytest.mark.parametrize("variant", SUPPORTS)
def test_over_the_estimates_every_case_raises_the_second_mesh_harmonic(variant):
    assert sets_with(variant, lambda r: r.bands[1] > 0) >= SURE


@pytest.mark.slow
@pytest.mark.parametrize("of", SIGNALS)
def test_over_the_estimates_the_rigid_model_rises_more_than_the_experiment_in_every_case(of):
    assert sets_with("rigid", lambda r: getattr(r, of) > r.experiment) >= SURE


@pytest.mark.slow
def test_over_the_estimates_bearings_bring_either_signal_nearer_to_the_experiment():
    assert all((misses("bearings", of) < misses("rigid", of)).sum() >= SURE for of in SIGNALS)


@pytest.mark.slow
def test_over_the_estimates_bearings_with_shafts_bring_the_acceleration_nearer_to_the_experiment():
    assert (misses("both", "acceleration") < misses("rigid", "acceleration")).sum() >= SURE


@pytest.mark.slow
def test_over_the_estimates_neither_shafts_alone_nor_beside_bearings_are_a_sure_gain():
    for of in SIGNALS:
        assert (misses("shafts", of) < misses("rigid", of)).sum() < SURE
        assert (misses("both", of) < misses("bearings", of)).sum() < SURE


@pytest.mark.slow
@pytest.mark.parametrize("variant", SUPPORTS)
@pytest.mark.parametrize("of", SIGNALS)
def test_over_the_estimates_no_set_meets_the_experiment_in_all_four_cases_missed(variant, of):
    assert sets_with(variant, lambda r: abs(getattr(r, of) - r.experiment) <= MET) == 0


@pytest.mark.slow
def test_over_the_estimates_it_is_by_friction_that_supports_change_the_rise_of_the_bands():
    """What rings on them, aligned or not, is friction as it reverses; without it they leave the bands' rises closer."""

    def apart(rigid, held):
        return np.array([np.abs(a.bands - b.bands).max() for a, b in zip(rigid, held, strict=True)])

    found = over_draws()
    closer = 0
    for s, rigid, held in zip(drawn(seed=1, number=SETS), found["rigid"], found["both"], strict=True):
        smooth = replace(s, law=s.law.without_friction())
        dry = apart(*(rises_of(smooth, v, "normal", *COARSE) for v in ("rigid", "both")))
        closer += (dry < apart(rigid, held)).all()
    assert closer >= SURE


@pytest.mark.slow
def test_over_the_estimates_harmonics_2_to_4_rise_most_in_no_sure_way_missed():
    counts = {v: sets_with(v, lambda r: all(r.most_at), fast_alone=True) for v in SUPPORTS}
    assert max(counts.values()) < SURE and counts["both"] <= SETS - SURE


@pytest.mark.slow
def test_over_the_estimates_one_of_harmonics_2_to_4_adds_most_to_the_acceleration_with_bearings_and_shafts():
    counts = {v: sets_with(v, lambda r: np.argmax(r.gains) + 1 in MOST_AT, fast_alone=True) for v in SUPPORTS}
    assert counts["both"] >= SURE > counts["rigid"]
