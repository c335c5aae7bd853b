"""Wear of teeth that differ, against the project's own generator: other slices, another contact law, other numerics.

The generator wears every tooth of both gears by itself, with a contact that hardens as δ^(10/9); the twin is given the
displacements or the loss of stiffness, and the depth of the mean flank. A soft pair of the generator's yields
(1 − q)^(−9/10) times as much as a sound one, so that its loss is given as 1 − (1 − q)^(9/10). Tolerance: the stiffness
of a pair that hardens changes by a tenth from no load to twice the rated one, and the load of a pair with it.
"""

import numpy as np
import pytest

from recordings.generator.wear import Wearing, depths
from tests.dynamics_cases import model
from tests.generator_instances import RATED, knobs, machine
from twin.wear.differing_teeth import Sharing, ToothDifferences, departures
from twin.wear.laws.archard import Archard

WIDTH = 40e-6
WITHIN = 0.1  # of the departures' rms
SEED = np.random.default_rng(3)
SHIFTS = tuple(std * SEED.normal(size=z) for std, z in ((3e-6, 19), (2e-6, 52)))
SHIFTS = tuple(f - f.mean() for f in SHIFTS)


def simulated(effect, revolutions):
    law = {
        "k_m2_per_n": 6e-12,
        "contact_half_width_um": WIDTH * 1e6,
        "step_um": 0.5,
        "tooth_scatter": 0.0,
        "running_in_factor": 1.0,
        "running_in_revolutions": 2000.0,
        "dynamic_forces": False,
    }
    m = machine()
    Wearing(m, law, np.random.default_rng(2)).advance(0.0, revolutions, RATED, effect)
    return m


def sharing():
    twin = model()
    force = 10.0 / twin.mesh.pair.base_radius[0]
    return Sharing(mesh=twin.mesh, stiffness_scale=1.0, force=force, half_width=WIDTH, law=Archard())


def own_and_theirs(m, differences):
    """Departures from the mean flank on the active path, of both gears: by the twin and in the machine."""
    s, pair = sharing().positions, m.pair
    found = departures(sharing(), (differences,), depths(m)["combined_um"] * 1e-6)
    active = (s >= pair.start) & (s <= pair.end)
    out = []
    for flank, worn in zip(found, (m.pinion_worn, m.gear_worn), strict=True):
        theirs = np.array([np.interp(s[active], pair.points, tooth) for tooth in worn.mean(axis=2)])
        own = np.broadcast_to(flank[:, active], theirs.shape) if len(flank) == 1 else flank[:, active]
        out.append((own - own.mean(axis=0), theirs - theirs.mean(axis=0)))
    return out


@pytest.mark.slow
@pytest.mark.parametrize("revolutions", [300, 1500])  # few of the mates have met before
def test_flanks_of_gears_with_pitch_errors(revolutions):
    effect = knobs()
    effect.pinion_form, effect.gear_form = (-f[:, None] * np.ones((1, 1)) for f in SHIFTS)
    worn = simulated(effect, revolutions)
    given = ToothDifferences(displacement=tuple(tuple(f.tolist()) for f in SHIFTS))
    for own, theirs in own_and_theirs(worn, given):
        assert np.sqrt(np.mean((own - theirs) ** 2)) < WITHIN * np.sqrt(np.mean(theirs**2))
        assert np.vdot(own, theirs) == pytest.approx(np.vdot(theirs, theirs), rel=WITHIN)


@pytest.mark.slow
@pytest.mark.parametrize("revolutions", [300, 1500])
def test_flanks_of_a_gear_with_a_soft_tooth(revolutions):
    effect = knobs("tooth_crack", tooth=7, remaining_stiffness=0.35)
    worn = simulated(effect, revolutions)
    loss = tuple(1 - 0.35**0.9 if k == 7 else 0.0 for k in range(19))
    (own, theirs), _ = own_and_theirs(worn, ToothDifferences(stiffness_loss=(loss, ())))
    assert np.sqrt(np.mean((own - theirs) ** 2)) < WITHIN * np.sqrt(np.mean(theirs**2))
