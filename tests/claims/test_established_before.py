"""A machine whose depth was established, and that then passes its limit while its figure is only preliminary.

The bundled short campaign with an end of life between its last two depths, so that the last window passes it; what
speaks against the figure is put into the state before that window.
"""

from __future__ import annotations

import json
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import pytest

from benchmarks.scoring import read_truth, truth_beside, windows_of
from service.contract.answer import report_of
from service.contract.status import status_of
from twin.assessment import HealthyErrors, HeldOutErrors
from twin.established import LIMITS
from twin.machine_change import MachineChange
from twin.options import Options
from twin.rig import Rig
from twin.state import State
from twin.step import change, step

RECORDING = Path(__file__).parents[2] / "recordings" / "short-campaign.mcap"
PLAIN = Options(trace=False)
UNPREDICTED = HeldOutErrors(
    rms=0.1,
    waveform=0.5,
    transmission_error=0.05,
    windows=(2, 5),
    healthy=HealthyErrors(rms=0.2, waveform=0.3, transmission_error=0.3),
)


@lru_cache(maxsize=1)
def worn() -> tuple[Rig, State, tuple]:
    """The rig with its end of life just below the last depth, the state before the last window, and the windows."""
    rig, windows = windows_of(RECORDING)
    depths = [w["depth"]["combined_um"] for w in read_truth(truth_beside(RECORDING))["windows"]]
    limit = 0.5e-6 * (depths[-2] + depths[-1])
    rig = Rig.from_mapping({**rig.values, "end_of_life": {**rig.values["end_of_life"], "max_depth": limit}})
    state = State()
    for window in windows[:-1]:
        state, _ = step(rig, state, window, PLAIN)
    return rig, state, tuple(windows)


def unpredicted(state: State) -> State:
    """The state of a machine whose held-out windows have not been predicted."""
    return replace(state, tracing=replace(state.tracing, error=UNPREDICTED))


def last(rig: Rig, state: State):
    """Report of the last window."""
    _, found = step(rig, state, worn()[2][-1], PLAIN)
    return report_of(found, status_of(found))


@pytest.mark.slow
def test_depth_that_was_established_keeps_its_alarm_where_the_model_comes_to_its_end():
    rig, state, _ = worn()
    report = last(rig, unpredicted(state))
    preliminary, status = report["wear"]["preliminary"], report["status"]
    assert preliminary["established_before"]["windows"] == state.history.windows >= LIMITS.history_windows
    assert status["level"] == "alarm" and status["action"].startswith("Stop the machine, measure the wear depth")
    assert "is preliminary: the error of the acceleration on held-out windows is 50 %" in status["reasons"][0]
    assert f"{state.history.windows} earlier windows had established the depth" in status["reasons"][0]
    assert last(rig, state)["status"]["level"] == "end_of_life"  # the figure is established


def test_what_was_established_survives_a_restart():
    rig, state, _ = worn()
    again = State.from_dict(json.loads(json.dumps(unpredicted(state).to_dict())))
    assert again.history == state.history
    assert last(rig, again) == last(rig, unpredicted(state))


@pytest.mark.parametrize("kind, kept", [("gears_replaced", False), ("reassembled", False), ("oil_changed", True)])
def test_other_gears_begin_a_history_of_their_own(kind, kept):
    rig, state, _ = worn()
    after, _ = change(rig, state, MachineChange(kind=kind), PLAIN)
    assert bool(after.history.windows) == kept


def test_another_rig_file_begins_a_new_history():
    rig, state, _ = worn()
    values = {
        **rig.values,
        "end_of_life": {**rig.values["end_of_life"], "max_depth": 0.999 * rig.get("end_of_life.max_depth")},
    }
    report = last(Rig.from_mapping(values), unpredicted(state))
    assert report["wear"]["preliminary"]["established_before"] is None
    assert report["status"]["level"] == "watch" and report["status"]["action"].startswith("Record more windows")


def test_too_few_established_windows_support_nothing():
    rig, state, _ = worn()
    few = replace(state, history=replace(state.history, windows=LIMITS.history_windows - 1))
    assert last(rig, unpredicted(few))["status"]["level"] == "watch"


def test_depth_that_has_grown_unlike_before_is_not_supported():
    """As the depth of a misalignment that is not in the model does, from one window to the next."""
    rig, state, _ = worn()
    shallow = replace(state.history, depth=0.4 * state.history.depth, depth_high=0.4 * state.history.depth_high)
    assert last(rig, unpredicted(replace(state, history=shallow)))["status"]["level"] == "watch"
