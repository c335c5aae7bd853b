"""Every capability says whether it applies; a window that cannot update a model is not a machine without one."""

from dataclasses import replace

import pytest

from tests.stored_states import stored_state
from tests.unit.test_step import minimal_rig, recorded
from twin.assessment import LevelReading, Residual, Wear
from twin.capabilities import CAPABILITIES, modelled
from twin.capabilities.context import Context, carried_over
from twin.errors import NotConverged
from twin.features.extract import WindowSignals, extract
from twin.options import Options
from twin.state import State
from twin.step import step
from twin.updating.history import WindowInput

STATE = stored_state("unsw-short")


def context(rig, window, state=STATE, **options):
    signals = WindowSignals(rig, window)
    features = extract(rig, window, signals)
    return Context(
        rig=rig, state=state, window=window, options=Options(**options), signals=signals,
        input=WindowInput(index=state.windows_seen, features=features), pair=None,
    )  # fmt: skip


def applying(given):
    draft = carried_over(given, "no model")
    return {c.__name__.rpartition(".")[2] for c in CAPABILITIES if c.applies(given, draft)}


def test_capabilities_that_apply_follow_from_rig_file_channels_and_options():
    rig, windows = recorded()
    assert "modelled" in applying(context(rig, windows[3]))
    alone = context(minimal_rig(), windows[3], State())
    assert applying(alone) == {
        "condition_indicators",
        "learned_level",
        "likely_mistakes",
        "mesh_bands",
        "non_gear_content",
        "shaft_modulation",
        "unattributed_spacing",
    }
    assert applying(context(minimal_rig(), windows[3], State(), trace=False)) == {
        "condition_indicators",
        "learned_level",
        "likely_mistakes",
        "mesh_bands",
        "shaft_modulation",
    }


def test_solver_that_does_not_converge_on_a_modelled_machine_is_not_a_missing_rig_file(monkeypatch):
    def fails(*given):
        raise NotConverged("no steady state at 10 Hz")

    rig, windows = recorded()
    monkeypatch.setattr(modelled, "update_window", fails)
    state, assessment = step(rig, STATE, windows[6], Options(trace=False))
    (note,) = assessment.window.notes
    assert "found no steady state for this window" in note and "rig file" not in note
    assert isinstance(assessment.wear, Wear) and assessment.wear == STATE.latest.wear
    assert assessment.life == STATE.latest.life and not assessment.window.modelled
    assert state.memory == STATE.memory and state.windows_seen == STATE.windows_seen + 1


def test_machine_without_a_model_says_which_keys_are_missing_and_shows_its_bands():
    _, windows = recorded()
    _, assessment = step(minimal_rig(), State(), windows[3])
    assert "gears.module" in assessment.wear.reason and "gears.module" in assessment.window.notes[0]
    assert isinstance(assessment.residual, Residual) and len(assessment.residual.bands) == 5


def test_levels_of_other_conditions_survive_a_window_that_the_relation_says_nothing_of():
    _, windows = recorded()
    levels = {"fast": LevelReading(level=2.0, window=0)}
    state, _ = step(minimal_rig(), replace(State(), levels=levels), windows[3], Options(trace=False))
    assert state.levels == levels


@pytest.mark.parametrize("capability", CAPABILITIES)
def test_every_capability_is_a_module_that_says_when_it_applies(capability):
    assert capability.__doc__ and capability.applies.__doc__.startswith("Where")
