"""A sensor that settles or warms up is said to, and the level is that of the vibration without it."""

import numpy as np
import pytest
from streams import ACCEL, T0

from service.stream.channels import kind_of
from service.stream.frames import SampleFrame
from service.stream.pieces import Piece
from service.stream.samples import Span, lay_samples
from twin.features.baseline_drift import baseline_drift
from twin.features.level import band_rms
from twin.windows import Fault, Samples

RATE, SECONDS = 5120.0, 10.0
TIMES = np.arange(int(RATE * SECONDS)) / RATE


def vibration(seed: int = 0) -> np.ndarray:
    """Mesh lines and noise; RMS 8 m/s^2."""
    chance = np.random.default_rng(seed)
    x = sum(a * np.cos(2 * np.pi * f * TIMES + f) for f, a in ((563.5, 9.8), (1127.0, 4.9), (24.5, 0.5)))
    x = x + chance.normal(size=TIMES.size)
    return 8.0 * x / x.std()


DRIFTS = {
    "settling in 1.5 s": 49.0 * np.exp(-TIMES / 1.5),
    "settling in 5 s": -20.0 * np.exp(-TIMES / 5.0),
    "warming up": 0.6 * TIMES,
    "cable touched": 15.0 * np.exp(-(((TIMES - 4.0) / 1.0) ** 2)),
}


@pytest.mark.parametrize("drift", DRIFTS.values(), ids=DRIFTS.keys())
def test_the_level_beside_a_drift_is_that_of_the_vibration(drift):
    values = vibration() + drift
    taken = baseline_drift(values, RATE)
    assert taken is not None
    level = band_rms(Samples(rate=RATE, start=0.0, values=values - taken), (0.0, 2000.0))
    assert level == pytest.approx(band_rms(Samples(rate=RATE, start=0.0, values=vibration()), (0.0, 2000.0)), rel=0.02)


@pytest.mark.parametrize("frequency", [0.6, 1.0, 2.0, 4.0])
def test_a_slow_vibration_is_no_drift(frequency):
    assert baseline_drift(vibration() + 6.0 * np.cos(2 * np.pi * frequency * TIMES), RATE) is None


def test_a_steady_offset_and_lost_samples_are_no_drift():
    values = vibration() + 30.0
    values[2000:9000] = np.nan
    assert baseline_drift(values, RATE) is None


def test_a_window_says_that_its_sensor_drifts_and_is_repaired():
    values, label = vibration() + DRIFTS["warming up"], ACCEL.label
    sent = SampleFrame(channel=ACCEL, start_time_ns=T0, sequence=0, sample_rate=RATE, values=values)
    faults: list[Fault] = []
    piece, span = Piece(sent, 0, values.size), Span(T0, T0 + round(SECONDS * 1e9))
    samples = lay_samples(label, kind_of(label), [piece], span, faults)
    assert [(f.kind, f.action) for f in faults] == [("drift", "repaired")]
    assert samples is not None and np.std(samples.values) == pytest.approx(8.0, rel=0.02)
