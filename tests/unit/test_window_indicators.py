"""Condition indicators on their way through a window: step, state, contract and text."""

import json

import numpy as np
import pytest

from service.contract.window import WindowRecord
from service.report.text import indicator_lines
from twin.rig import Rig
from twin.state import State
from twin.step import Options, step
from twin.windows import Edges, Samples, Window

RIG = Rig.from_mapping({"name": "bare", "gears": {"pinion": {"teeth": 19}, "gear": {"teeth": 52}}})
SPEED = 10.0


def window(index: int, scatter: float) -> Window:
    """Three seconds of a mesh tone with sidebands at every order of the pinion, `scatter` their size."""
    t = np.arange(3 * 12800) / 12800
    angle = 2 * np.pi * SPEED * t
    rng = np.random.default_rng(7)
    lines = sum(np.cos(k * angle + rng.uniform(0, 2 * np.pi)) for k in range(3, 17))
    edges = int(3 * SPEED * 256)
    return Window(
        start_time_ns=index * 10**12,
        accelerations={"a": Samples(rate=12800.0, start=0.0, values=np.cos(19 * angle) + scatter * lines)},
        encoders={"pinion": Edges(per_rev=256, first_index=0, times=np.arange(edges) / (256 * SPEED))},
    )


@pytest.fixture(scope="module")
def two_windows():
    """The assessments of a quiet window and of one whose residual is three times as large, and the last state."""
    state, first = step(RIG, State(), window(0, 0.01), Options(trace=False))
    state = State.from_dict(json.loads(json.dumps(state.to_dict())))
    state, second = step(RIG, state, window(1, 0.03), Options(trace=False))
    return state, first, second


def test_a_machine_without_a_model_has_indicators_in_each_window(two_windows):
    _, first, _ = two_windows
    found = first.window.indicators["a"]
    assert found.crest_factor == pytest.approx(np.sqrt(2), rel=0.1)
    pinion = found.gears["pinion"]
    assert pinion.energy_ratio == pytest.approx(0.01 * np.sqrt(14), rel=0.02)
    assert pinion.na4 == pytest.approx(pinion.fm4, rel=0.02)  # sidebands of order 1 are absent: both see the same lines


def test_na4_compares_with_the_windows_before_and_the_record_survives_the_state(two_windows):
    state, first, second = two_windows
    # the residual's variance is 1 before and 9 now: mean 5, so the kurtosis times 81/25
    assert second.window.indicators["a"].gears["pinion"].na4 == pytest.approx(
        first.window.indicators["a"].gears["pinion"].na4 * 81 / 25, rel=1e-3
    )
    pinion = next(r for r in state.residual_records if r.gear == "pinion")
    assert pinion.windows == 2
    assert State.from_dict(json.loads(json.dumps(state.to_dict()))) == state


def test_the_contract_gives_them_by_sensor_and_gear(two_windows):
    record = WindowRecord.of(two_windows[2].window).as_json()
    own = json.loads(json.dumps(record, allow_nan=False))["indicators"]["a"]
    assert set(own) == {"rms", "kurtosis", "crest_factor", "gears"}
    names = {"turns", "fm0", "fm4", "na4", "m6a", "m8a", "energy_ratio", "sideband_level_factor"}
    assert set(own["gears"]) == {"pinion", "gear"} and set(own["gears"]["gear"]) == names


def test_the_text_shows_the_latest_window_that_has_them(two_windows):
    record = WindowRecord.of(two_windows[1].window).as_json()
    lines = indicator_lines([record, {"index": 1, "reason": "refused"}])
    assert lines[0] == "Condition indicators, window 0"
    assert lines[1].split()[:2] == ["sensor", "RMS"]
    assert [line.split()[0] for line in lines[2:]] == ["a", "a"]
    assert indicator_lines([{"index": 1}]) == []
