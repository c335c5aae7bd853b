"""A wear path that takes over kept points is the path that computed them, to the last bit."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from zstandard import ZstdCompressor

from service.errors import InputError
from service.runtime.curves import name_of, packed, unpacked
from tests.dynamics_cases import RIG, model
from twin.effects import EFFECTS
from twin.effects.extended import extend
from twin.errors import ParameterError
from twin.model import Calibration, Condition
from twin.updating.memory import StoredProfile
from twin.updating.model_cache import PathKey, _Key
from twin.wear.kept_points import KeptPoints
from twin.wear.path import WearPath

CONDITION = Condition(speed_hz=10.0, torque=10.0)
EFFECTS_OF_FLANKS = {"plain": (), "sliced": (EFFECTS["misalignment"](lead_gap=30e-6),)}


def path(effects, kept=None) -> WearPath:
    worn = extend(model(), effects)
    return WearPath(worn, CONDITION, worn.unworn, 100e-6, kept=kept)


def same(one: KeptPoints, other: KeptPoints) -> bool:
    return all(np.array_equal(getattr(one, f.name), getattr(other, f.name)) for f in fields(KeptPoints))


@pytest.mark.parametrize("effects", EFFECTS_OF_FLANKS.values(), ids=EFFECTS_OF_FLANKS)
def test_kept_points_survive_as_bytes_and_are_read_as_those_that_were_computed(effects):
    first = path(effects)
    first.reach(6e-6)
    read = unpacked(packed(first.kept))
    assert same(read, first.kept)
    again = path(effects, read)
    assert again.nbytes <= first.nbytes
    assert np.array_equal(again.profile_at(4.2e-6), first.profile_at(4.2e-6))
    for quantity in ("transmission_error", "acceleration", "pinion_motion", "mean"):
        assert np.array_equal(again.table(quantity), first.table(quantity))


@pytest.mark.parametrize("effects", EFFECTS_OF_FLANKS.values(), ids=EFFECTS_OF_FLANKS)
def test_points_behind_the_kept_ones_are_those_of_a_path_that_was_never_interrupted(effects):
    first = path(effects)
    first.reach(3e-6)
    again = path(effects, first.kept)
    first.reach(7e-6)
    again.reach(7e-6)
    assert len(first.points[0]) > 10 and same(again.kept, first.kept)


def test_a_path_that_has_ended_ends_where_its_points_do():
    first = path(())
    first.reach(1.0)
    again = path((), first.kept)
    again.reach(1.0)
    assert first.ended and same(again.kept, first.kept)


def test_what_is_not_points_of_a_path_is_refused():
    good = path(()).kept
    with pytest.raises(ParameterError, match="equal numbers of each quantity"):
        replace(good, work=np.empty(0))
    for data in (b"", b"not an archive", packed(good)[:100], ZstdCompressor().compress(b"no archive")):
        with pytest.raises(InputError, match="no points of a wear path"):
            unpacked(data)


def test_the_name_of_a_curve_differs_with_everything_that_a_path_is_made_from():
    prior = Calibration.prior(RIG)
    key = PathKey(_Key(RIG), prior, (), CONDITION, None, 1e-4)
    start = StoredProfile.of(model().unworn)
    softer = EFFECTS["mesh_stiffness_loss"](**{p.name: 0.1 for p in EFFECTS["mesh_stiffness_loss"].parameters})
    others = [
        key._replace(calibration=replace(prior, stiffness_scale=np.nextafter(prior.stiffness_scale, 2.0))),
        key._replace(effects=(EFFECTS["misalignment"](lead_gap=30e-6),)),
        key._replace(effects=(EFFECTS["misalignment"](lead_gap=31e-6),)),
        key._replace(effects=(softer,)),
        key._replace(condition=replace(CONDITION, torque=10.5)),
        key._replace(start=start),
        key._replace(furthest=2e-4),
    ]
    names = [name_of(one) for one in (key, *others)]
    assert len(set(names)) == len(names)
    assert names[0] == name_of(PathKey(_Key(RIG), prior, (), CONDITION, None, 1e-4))
