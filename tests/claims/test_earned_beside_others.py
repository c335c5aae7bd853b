"""An effect beside another one is judged by what each makes of the channels, by windows since it is there, and by size.

Truth  lines made up in numpy: what each effect makes of the lines of the channels, and noise
"""

from dataclasses import replace

import numpy as np
import pytest

from tests.claims.test_earned import RIG, Numbered, effect, errors
from tests.held_out_windows import MESH, lines, window
from tests.mesh_pairs import UNSW_RIG
from tests.stored_states import stored_state
from twin.rig import Rig
from twin.tracing.earned import _windows, asked_again, implausible, judged, refusal_of
from twin.tracing.joining import with_rivals
from twin.tracing.state import EffectErrors, Tracing

ORDERS_TURN = np.array([1.0, 0.0, 0.0, 0.0])  # once a turn of the pinion, in tests.held_out_windows.ORDERS
TWICE = np.array([0.0, 1.0, 0.0, 0.0])  # where a crack shows here
WORN = np.array([0.0, 0.0, 0.9, -0.7])  # what a misalignment changes of the mesh lines


def pairs_of(without, present, measured, count=3, noise=5e-3, seed=1):
    """Windows predicted without and with an effect; each argument gives the lines of every channel."""
    rng, out = np.random.default_rng(seed), []
    for index in range(count):
        seen = {c: y + noise * (rng.normal(size=4) + 1j * rng.normal(size=4)) for c, y in measured.items()}
        out.append(
            tuple(
                replace(
                    window(MESH, MESH, index=index),
                    channels={c: lines(predicted[c], seen[c]) for c in measured},
                )
                for predicted in (without, present)
            )
        )
    return out


def verdict(name, size, without, present, measured, **how):
    return judged(effect(name, size, 0.01 * size), errors(pairs_of(without, present, measured, **how), False))


# -- pairs ------------------------------------------------------------------------------------------------------------

CRACK = {"transmission_error": MESH + 0.3 * TWICE, "acceleration": MESH + 0.4 * TWICE}
UNBALANCED = {
    "transmission_error": CRACK["transmission_error"] + 0.02 * ORDERS_TURN,
    "acceleration": CRACK["acceleration"] + 0.6 * ORDERS_TURN,
}


def test_unbalance_beside_a_crack_earns_its_name_by_the_housing_and_leaves_the_crack_its_own():
    sound = {c: y - 0.3 * TWICE if "error" in c else y - 0.4 * TWICE for c, y in UNBALANCED.items()}
    assert verdict("mass_unbalance", 0.02, CRACK, UNBALANCED, UNBALANCED).kind == "earned"
    assert verdict("tooth_crack", 0.3, sound, UNBALANCED, UNBALANCED).kind == "earned"


@pytest.mark.parametrize("run_out", [0.2, 0.4, 0.8])
def test_eccentricity_in_place_of_an_unbalance_beside_a_crack_is_refused_where_the_encoders_deny_it(run_out):
    """An unbalance and a crack were called pinion eccentricity and crack."""
    wrong = {
        "transmission_error": CRACK["transmission_error"] + run_out * ORDERS_TURN,
        "acceleration": CRACK["acceleration"] + 0.1 * ORDERS_TURN,
    }
    refused = verdict("pinion_eccentricity", 3e-5, CRACK, wrong, UNBALANCED)
    assert refused.kind == "refused" and "transmission error" in refused.reason


@pytest.mark.parametrize("gain", [0.7, 0.85, 1.3])
def test_gain_of_a_sensor_and_a_misalignment_beside_each_other_both_earn_their_names(gain):
    """A gain scales one channel, a misalignment changes the mesh lines of both."""
    skewed = {"transmission_error": MESH + WORN, "acceleration": MESH + WORN}
    both = {**skewed, "acceleration": gain * skewed["acceleration"]}
    scaled = {"transmission_error": MESH, "acceleration": gain * MESH}
    assert verdict("sensor_gain", gain, skewed, both, both).kind == "earned"
    assert verdict("misalignment", 3e-5, scaled, both, both).kind == "earned"


@pytest.mark.parametrize("gain", [0.7, 1.3])
def test_misalignment_in_place_of_a_gain_alone_is_refused_where_the_encoders_deny_it(gain):
    measured = {"transmission_error": MESH, "acceleration": gain * MESH}
    without = {"transmission_error": MESH, "acceleration": MESH}
    bent = {"transmission_error": MESH + 0.5 * WORN, "acceleration": MESH + 0.5 * WORN}
    assert verdict("misalignment", 3e-5, without, bent, measured).kind == "refused"


# -- as likely as another ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "size", "runner_up", "over"),
    [
        ("misalignment", 10.8e-6, "profile_error", -0.9),
        ("mesh_stiffness_loss", 0.2, "misalignment", 0.4),
        ("tooth_friction", 0.1, "mesh_stiffness_loss", -3.0),
    ],
)
def test_any_effect_of_the_mesh_says_the_rival_that_is_as_likely_beside_those_it_has(name, size, runner_up, over):
    item = effect(name, size, 0.1 * size, runner_up=runner_up, over_runner_up=over, alike=("as_made",))
    assert with_rivals(item).alike == tuple(sorted(("as_made", runner_up)))
    assert with_rivals(with_rivals(item)) == with_rivals(item)


# -- sizes that this rig does not allow -------------------------------------------------------------------------------


def with_backlash(size):
    return Rig.from_mapping({**UNSW_RIG, "gears": {**UNSW_RIG["gears"], "backlash": size}})


@pytest.mark.parametrize(("backlash", "gap", "can_be"), [
    (30e-6, 40e-6, False), (60e-6, 117e-6, False), (60e-6, 40e-6, True), (160e-6, 117e-6, True),
])  # fmt: skip
def test_largest_misalignment_follows_the_backlash_of_the_machine(backlash, gap, can_be):
    said = implausible(with_backlash(backlash), effect("misalignment", gap, 1e-6))
    assert said is None if can_be else "possible" in said


@pytest.mark.parametrize("spread", [0.4, 0.5, 1.0])
def test_misalignment_as_wide_as_the_spread_of_a_coarse_class_is_no_finding_however_large(spread):
    """40 µm on unworn gears, whose profiles scatter by as much."""
    assert "by chance" in implausible(with_backlash(160e-6), effect("misalignment", 40e-6, spread * 40e-6))


# -- asked again, by windows since it is there ------------------------------------------------------------------------


SIZES = {"torque_ripple": 0.2, "profile_error": 1e-5, "pinion_eccentricity": 3e-5, "gear_eccentricity": 3e-5}


def sized(name, **fields):
    return effect(name, SIZES[name], 0.01 * SIZES[name], **fields)


@pytest.mark.parametrize("name", ["torque_ripple", "profile_error", "pinion_eccentricity"])
def test_effect_refused_from_the_start_is_asked_again_where_it_begins_late(name, monkeypatch):
    """A torque ripple from one window on was dropped with 60,036 nat; an eccentricity that begins late stayed out."""
    monkeypatch.setattr("twin.tracing.earned._windows", lambda rig, tracing, item: ([Numbered(2), Numbered(5)], set()))
    item, late = sized(name), sized(name, onset=4000.0)
    judging = EffectErrors(before=None, after=None, windows=(2, 5))
    refusal = refusal_of(Tracing(found=(item,), errors=(judging,), measured=8), item, "no fall")
    tracing = Tracing(refuted={name: refusal}, measured=9)
    assert not asked_again(RIG, tracing, item)
    assert asked_again(RIG, tracing, late)
    refused_late = refusal_of(Tracing(found=(late,), errors=(judging,), measured=8), late, "no fall")
    assert asked_again(RIG, Tracing(refuted={name: refused_late}, measured=9), item)


@pytest.mark.parametrize("name", ["torque_ripple", "profile_error", "gear_eccentricity"])
@pytest.mark.parametrize("fitted", [(), (0, 1, 3, 4)])
def test_only_windows_since_its_onset_judge_an_effect(name, fitted):
    tracing = stored_state("unsw-rig").tracing
    turns = {w.index: w.features.revolutions for w in tracing.history}
    onset = sorted(turns.values())[len(turns) // 2]
    late, always = (
        {w.index for w in _windows(RIG, tracing, sized(name, onset=n, fitted=fitted))[0]} for n in (onset, 0.0)
    )
    assert late and all(turns[i] >= onset for i in late) and not late & set(fitted)
    assert any(turns[i] < onset for i in always)
