"""A healthy baseline that is too thin says what cannot be judged with it, and calls nothing explained."""

from functools import lru_cache

import numpy as np
import pytest

from service.contract.parts import Baseline
from service.report.baseline import learned_text
from tests.claims.test_baseline import RIG, SHAFTS, machine, parts
from twin.baseline.comparison import described
from twin.baseline.diagnosis import diagnose
from twin.baseline.leaving_out import learn
from twin.baseline.sufficiency import load_range, sufficiency_of, thin_for_teeth
from twin.rig import Rig

RATED = Rig.from_mapping({**RIG.values, "operating": {"pinion_speed_hz": 16.0, "input_torque": 40.0}})


@lru_cache(maxsize=4)
def baseline(count, spread=0.4, metered=False):
    loads = 0.3 + np.linspace(-spread / 2, spread / 2, count)
    windows = [machine(load, i, metered=metered) for i, load in enumerate(loads)]
    return learn(RATED, [parts(w, name=f"h{i}").whole for i, w in enumerate(windows)], SHAFTS)


@pytest.mark.slow
def test_baseline_of_four_recordings_says_how_many_are_needed_and_over_which_loads():
    thin = baseline(4, metered=True)
    low, high = load_range(thin)
    assert (low, high) == pytest.approx((0.05, 0.25), abs=0.02)  # 20 N·m at full load, rated at 40 N·m
    said = thin_for_teeth(thin)
    assert said == "4 of at least 5 recordings, load 5–25 %: teeth cannot be judged yet"
    assert thin_for_teeth(baseline(5)) is None
    assert "Hz: teeth cannot be judged yet" in thin_for_teeth(baseline(4))


@pytest.mark.slow
@pytest.mark.parametrize("gain", [None, lambda f: np.full(f.size, 0.5 + 0j)])
def test_verdict_of_a_thin_baseline_is_never_explained_and_no_sensor_is_named(gain):
    window = parts(machine(0.3, 99, gain=gain, pulse=0.0))
    enough, thin = (diagnose(baseline(count), [window]) for count in (6, 4))
    named = {e.name for e in enough.effects}
    assert named == ({"sensor_gain"} if gain else set())
    assert thin.verdict == "insufficient_data" and "teeth cannot be judged yet" in thin.reason
    assert not {e.name for e in thin.effects} & {"sensor_gain", "sensor_resonance"}
    assert ("which cannot be distinguished yet" in thin.reason) is bool(gain)


@pytest.mark.slow
def test_recordings_at_one_load_are_no_baseline_for_another():
    same = sufficiency_of(baseline(6, spread=0.0, metered=True))
    (kind,) = same.not_judged
    assert kind.what == "recordings at another load or speed" and "one operating point" in kind.reason
    assert sufficiency_of(baseline(6, metered=True)).not_judged == ()


@pytest.mark.slow
def test_sufficiency_is_in_the_contract_and_said_when_a_baseline_is_learned():
    said = Baseline.of(described(baseline(4, metered=True))).as_json()
    assert said["sufficiency"]["recordings"] == 4 and said["sufficiency"]["recordings_needed"] == 5
    assert said["sufficiency"]["load_percent"] == pytest.approx([5.0, 25.0], abs=2.0)
    assert "Not judged with this baseline: single teeth (4 of at least 5 recordings" in learned_text(said)
    well = Baseline.of(described(baseline(6))).as_json()
    assert well["sufficiency"]["load_percent"] is None and well["sufficiency"]["not_judged"] == []
    assert "Not judged" not in learned_text(well)
