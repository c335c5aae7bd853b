"""What teeth that differ make of the mesh lines: in proportion where it should be, and one gear after the other."""

import numpy as np
import pytest

from tests.dynamics_cases import TEN, model, worn
from twin.effects import EFFECTS
from twin.effects.addition import Addition
from twin.tracing.observed import Observed
from twin.tracing.tooth_factors import factors_of

RNG = np.random.default_rng(7)
PITCH = EFFECTS["pitch_error"](pinion=tuple(2e-6 * RNG.normal(size=19)), gear=tuple(2e-6 * RNG.normal(size=52)))
FRICTION = Addition(effect=EFFECTS["tooth_friction"](coefficient=0.06))
DEPTHS = (0.0, 25e-6)


def window(index: int, depth: float) -> Observed:
    return Observed(
        index=index, condition=TEN, revolutions=1000.0 * index, worn=depth > 0, lines={}, std={}, mean=None,
        torque_known=True, pinion_only=False, mounting=0,
    )  # fmt: skip


WINDOWS = [window(i, d) for i, d in enumerate(DEPTHS)]
PROFILES = {i: worn(TEN, d) for i, d in enumerate(DEPTHS)}


def factors(effect=PITCH, onset=0.0, **how):
    return factors_of(model(), WINDOWS, PROFILES, [Addition(effect=effect, onset_revolutions=onset)], **how)


def test_no_effect_of_longer_period_makes_no_factors():
    assert factors_of(model(), WINDOWS, PROFILES, []) is None


def test_teeth_without_errors_make_nothing_of_the_lines():
    none = EFFECTS["pitch_error"](pinion=(0.0,) * 19)
    for found in factors(none):
        for channel in found.values():
            np.testing.assert_allclose(channel, 1.0, atol=2e-3)  # 64 samples a mesh period against 1024


def test_windows_before_the_onset_have_no_factor():
    before, after = factors(onset=500.0)
    assert before == {} and set(after) == {"encoder", "torque", "acceleration"}


def test_unworn_lines_change_more_than_worn_ones():
    unworn, deep = (np.abs(f["encoder"][:3] - 1).max() for f in factors())
    assert unworn > 3 * deep


@pytest.mark.parametrize("present", [(), (FRICTION,)])
def test_pinion_and_gear_one_after_the_other_are_both_together_within_what_is_granted(present):
    both, apart = factors(mesh_effects=present), factors(mesh_effects=present, together=False)
    for whole, parts in zip(both, apart, strict=True):
        error = np.abs(whole["encoder"] - parts["encoder"])[:3] / np.maximum(np.abs(whole["encoder"])[:3], 1.0)
        assert error.max() < 0.25  # scatter.TEETH


def test_what_else_is_there_changes_what_teeth_make():
    alone, with_friction = factors()[0]["encoder"], factors(mesh_effects=(FRICTION,))[0]["encoder"]
    assert np.abs(alone - with_friction).max() > 0.2
