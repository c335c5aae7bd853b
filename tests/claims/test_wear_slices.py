"""Wear across the face: every slice by its own load, none where the face is loaded evenly."""

import numpy as np
import pytest

from tests.dynamics_cases import TEN, model
from twin.effects import EFFECTS
from twin.effects.extended import extend
from twin.wear.archard import wear_per_revolution
from twin.wear.curve import MasterCurve
from twin.wear.profile import WornProfile

DEPTH = 12e-6


def misaligned(gap):
    return extend(model(), (EFFECTS["misalignment"](lead_gap=gap),))


def curve(gap, until=DEPTH):
    twin = misaligned(gap)
    return MasterCurve.build(twin, TEN, twin.unworn, until)


def test_model_without_effects_is_the_very_model():
    assert extend(model(), ()) is model()
    beside = (EFFECTS["bearing_defect"](blow=1.0, order=3.5), EFFECTS["mass_unbalance"](pinion=1e-3))
    assert extend(model(), beside) is model()


def test_aligned_shafts_wear_every_slice_as_the_whole_face_wears():
    """Fewer samples a mesh period where the face is sliced: lines within 2.5 nm (extended.py)."""
    sliced, whole = curve(0.0), MasterCurve.build(model(), TEN, model().unworn, DEPTH)
    profile, plain = sliced.profile(10e-6), whole.profile(10e-6)
    assert len(profile.slices) == 13
    for part in profile.slices:
        np.testing.assert_allclose(part.depth, plain.depth, atol=5e-9)
    np.testing.assert_allclose(
        sliced.lines_at(10e-6).transmission_error[:5], whole.lines_at(10e-6).transmission_error[:5], atol=5e-9
    )


def test_gap_to_the_other_side_mirrors_the_wear():
    one, other = curve(20e-6).profile(10e-6), curve(-20e-6).profile(10e-6)
    np.testing.assert_allclose(one.depth, other.depth[::-1], atol=1e-12)


def test_end_that_touches_first_wears_first_until_the_gap_is_worn_away():
    """A gap of 6 µm: at 3 µm mean depth the ends differ by much of it, at 30 µm by all of it, and never by more."""
    gap = 6e-6
    worn = curve(gap, 30e-6)

    def difference(depth):
        profile = worn.profile(depth)
        at = int(np.argmax(profile.mean))
        return abs(profile.depth[0, at] - profile.depth[-1, at]) * 13 / 12  # middles of the outer slices lie inside

    assert difference(1e-6) < difference(3e-6) < difference(30e-6)
    assert difference(30e-6) == pytest.approx(gap, rel=0.1)


def test_slices_lose_together_what_the_whole_load_takes_away():
    """Archard is linear in the force: the mean over slices is the wear by the mean force per width."""
    twin = misaligned(20e-6)
    response = twin.response(twin.unworn, TEN)
    forces = response.steady.contact_forces
    half_width = twin.calibration.contact_half_width
    rates = wear_per_revolution(twin.mesh, forces, half_width, 13)
    rows = forces.shape[0] // 13 if forces.shape[0] % 13 == 0 else 3
    together = sum(forces[i * rows : (i + 1) * rows] for i in range(13)) if rows == 3 else None
    assert together is not None
    np.testing.assert_allclose(rates.mean(axis=0), wear_per_revolution(twin.mesh, together, half_width), rtol=1e-12)


def test_mean_over_the_face_is_what_a_depth_means():
    profile = curve(20e-6).profile(10e-6)
    assert profile.max_depth == pytest.approx(10e-6, rel=1e-3)
    assert isinstance(profile, WornProfile) and profile.depth.shape[0] == 13
