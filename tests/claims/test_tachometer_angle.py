"""What one pulse per turn, timed to a sample, can and cannot show: lines of the shafts are not tones of another source.

Truth  a machine at constant speed with mesh lines and a line of every order, built here; its tachometer's pulses are
       known to the sample (0.2 ms), as those of an analog column are
"""

import numpy as np
import pytest

from twin.features.non_gear import non_gear_features, timing_error
from twin.rig import Rig
from twin.windows import Edges, Samples, Window

RATE, SPEED, TEETH, SECONDS = 5120.0, 24.4773, (23, 57), 10.0
MESH_1, FOREIGN = TEETH[0] * SPEED, 711.3  # [Hz]


def window(foreign: float = 0.0, jitter: float | None = None) -> Window:
    """A window; `jitter` is the error of the pulses' times [s], None for times to the sample."""
    chance = np.random.default_rng(11)
    t = np.arange(int(RATE * SECONDS)) / RATE
    angle = 2 * np.pi * SPEED * t
    vibration = 0.05 * chance.normal(size=t.size) + foreign * np.cos(2 * np.pi * FOREIGN * t)
    for k, size in ((1, 2.0), (2, 1.0), (3, 0.6)):
        vibration += size * np.cos(k * TEETH[0] * angle + k)
    pulses = np.arange(1, int(SPEED * SECONDS)) / SPEED
    times = np.ceil(pulses * RATE) / RATE if jitter is None else pulses + jitter * chance.normal(size=pulses.size)
    return Window(
        start_time_ns=0,
        accelerations={"a": Samples(values=vibration, rate=RATE, start=0.0)},
        encoders={"pinion": Edges(per_rev=1, first_index=0, times=times)},
    )


@pytest.fixture(scope="module")
def rig():
    return Rig.from_mapping({"gears": {"pinion": {"teeth": TEETH[0]}, "gear": {"teeth": TEETH[1]}}})


def test_the_timing_error_of_pulses_is_that_which_they_were_given():
    assert timing_error(window(jitter=40e-6), "encoder/pinion") == pytest.approx(40e-6, rel=0.2)
    assert timing_error(window(jitter=0.0), "encoder/pinion") < 1e-12
    assert timing_error(window(), "accel/a") == 0.0


def test_a_smooth_change_of_speed_is_no_timing_error():
    speed = SPEED * (1 + 0.002 * np.linspace(0, 1, 240))
    changing = Edges(per_rev=1, first_index=0, times=np.cumsum(1 / speed))
    assert timing_error(Window(start_time_ns=0, encoders={"pinion": changing}), "encoder/pinion") < 1e-7


def test_mesh_lines_are_neither_tones_of_another_source_nor_lines_of_no_shaft(rig):
    found = non_gear_features(rig, window())
    assert found.tones == () and found.lines == ()


def test_a_tone_of_another_source_is_still_found(rig):
    found = non_gear_features(rig, window(foreign=0.5))
    assert [frequency for frequency, *_ in found.tones] == [pytest.approx(FOREIGN, abs=0.01)]
