"""An effect is judged by the errors of the lines that it moves; effects found together join in an order that falls."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from tests.claims.test_held_out_gain import MESH, RIPPLE, SCALES, SHAFTS, window
from tests.mesh_pairs import UNSW_RIG
from twin.assessment import HeldOutErrors
from twin.effects import EFFECTS
from twin.effects.addition import Addition
from twin.rig import Rig
from twin.tracing import effect_order
from twin.tracing.attribution import AttributedEffect
from twin.tracing.effect_order import falling_order
from twin.tracing.moved_lines import moved_lines
from twin.tracing.state import EffectErrors, Tracing

RIG = Rig.from_mapping(UNSW_RIG)


def errors_of_ripple(share, model_error=0.0):
    """Of the lines that a ripple moves, fitted `share` times as large as it is."""
    measured = MESH * np.exp(1j * model_error) + RIPPLE
    return moved_lines([(window(MESH, measured), window(MESH + share * RIPPLE, measured))], SHAFTS, SCALES, True)


@pytest.mark.parametrize("share", [0.7, 0.9, 1.0, 1.5])
def test_error_of_the_moved_line_is_what_the_size_is_off(share):
    (moved,) = errors_of_ripple(share)
    assert (moved.channel, moved.lines) == ("torque", 1)
    assert (moved.before, moved.after) == (pytest.approx(1.0), pytest.approx(abs(1 - share), abs=1e-9))


def test_lines_that_an_effect_does_not_move_are_left_out_however_wrong_they_are():
    assert errors_of_ripple(0.9, model_error=0.4) == errors_of_ripple(0.9)


def test_effect_that_moves_nothing_beyond_the_scatter_claims_no_line():
    assert errors_of_ripple(0.01) == () and errors_of_ripple(0.0) == ()


def test_windows_are_taken_together_by_their_energy():
    pairs = [
        (window(MESH, MESH + size * RIPPLE), window(MESH + size * RIPPLE, MESH + size * RIPPLE * 1.1))
        for size in (1.0, 3.0)
    ]
    (moved,) = moved_lines(pairs, SHAFTS, SCALES, True)
    assert moved.lines == 2 and moved.after == pytest.approx(0.1) and moved.before == pytest.approx(1.0)


@pytest.mark.parametrize(("speed_hz", "lines"), [(5.0, 0), (9.0, 0), (11.0, 1)])
def test_torque_that_a_displacement_makes_counts_only_beyond_the_speed_control(speed_hz, lines):
    measured = MESH + RIPPLE  # of order 2
    pair = [replace(window(m, measured), speed_hz=speed_hz) for m in (MESH, MESH + 0.9 * RIPPLE)]
    assert sum(moved.lines for moved in moved_lines([tuple(pair)], SHAFTS, SCALES)) == lines
    assert sum(moved.lines for moved in moved_lines([tuple(pair)], SHAFTS, SCALES, is_torque=True)) == 1


NAMES = ("misalignment", "sensor_gain", "tooth_friction")
EFFECT = {
    "misalignment": EFFECTS["misalignment"](lead_gap=30e-6),
    "sensor_gain": EFFECTS["sensor_gain"](gain=0.5),
    "tooth_friction": EFFECTS["tooth_friction"](coefficient=0.1),
}
WAVEFORM = {  # of the twin with some of three effects: the misalignment alone, or beside friction, makes it worse
    (): 0.7, ("misalignment",): 0.75, ("sensor_gain",): 0.4, ("tooth_friction",): 0.6,
    ("misalignment", "sensor_gain"): 0.2, ("misalignment", "tooth_friction"): 0.65,
    ("sensor_gain", "tooth_friction"): 0.3, NAMES: 0.1,
}  # fmt: skip


def found(name):
    return AttributedEffect(
        addition=Addition(effect=EFFECT[name], onset_revolutions=0.0), parameters={}, log_evidence=100.0
    )


@pytest.fixture
def tracing(monkeypatch):
    """A machine whose twin has three effects, with the errors of every twin between made up."""
    monkeypatch.setattr(
        effect_order,
        "_errors_with",
        lambda rig, tracing, effects: (WAVEFORM[tuple(sorted(f.name for f in effects))], None),
    )
    steps = [WAVEFORM[tuple(sorted(NAMES[:count]))] for count in range(4)]
    errors = [
        EffectErrors(before=HeldOutErrors(waveform=b), after=HeldOutErrors(waveform=a)) for b, a in pairwise(steps)
    ]
    return Tracing(found=tuple(found(name) for name in NAMES), errors=tuple(errors))


def test_effects_found_together_join_so_that_no_error_rises(tracing):
    order = [f.name for f in falling_order(RIG, tracing, known=())]
    errors = [WAVEFORM[tuple(sorted(order[:count]))] for count in range(4)]
    assert order != list(NAMES) and errors == sorted(errors, reverse=True)


def test_effects_that_were_in_the_twin_keep_their_places(tracing):
    assert [f.name for f in falling_order(RIG, tracing, known=NAMES)] == list(NAMES)
    assert next(f.name for f in falling_order(RIG, tracing, known=("misalignment",))) == "misalignment"


def test_order_in_which_nothing_rises_is_kept(tracing):
    falls = EffectErrors(before=HeldOutErrors(waveform=0.5), after=HeldOutErrors(waveform=0.4))
    assert [f.name for f in falling_order(RIG, replace(tracing, errors=(falls,) * 3), known=())] == list(NAMES)
