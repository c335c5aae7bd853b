"""What one pulse per turn, timed to a sample, can and cannot show: lines of the shafts are not tones of another source.

Truth  a machine at constant speed with mesh lines and a line of every order, built here; its tachometer's pulses are
       known to the sample (0.2 ms), as those of an analog column are
"""

from dataclasses import dataclass

import numpy as np
import pytest

from twin.baseline.comparison import lines_without_shaft
from twin.features.edge_timing import edge_timing
from twin.features.non_gear import non_gear_features, timing_error
from twin.features.pulses import PulseSettings, pulses_of
from twin.rig import Rig
from twin.windows import Edges, Samples, Window

RATE, SPEED, TEETH, SECONDS = 5120.0, 24.4773, (23, 57), 10.0
FOREIGN = 711.3  # [Hz]

PAIR = {"gears": {"pinion": {"teeth": TEETH[0]}, "gear": {"teeth": TEETH[1]}}}


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
    return Rig.from_mapping(PAIR)


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


# ---- pulses of a square signal, sampled with the vibration, on machines that turn steadily, ramp and wander


@dataclass(frozen=True, kw_only=True)
class Sampled:
    """A healthy pair with a tachometer whose pulses are read from samples; what no shaft does is `modulation` alone."""

    rate: float = 5120.0  # [Hz]
    speed: float = 24.6  # [Hz]
    ramp: float = 0.0  # [Hz/s]
    wander: float = 0.0  # of the speed, once in 4 s
    pulses: int = 1  # a turn
    flank: float = 0.0  # of a turn; 0: as steep as a sample
    seed: int = 1

    def window(self, modulation: float = 0.0, order: float = 17.5 / 57) -> Window:
        """A window of 480 turns; `order` lies between the orders of the gear."""
        chance = np.random.default_rng(self.seed)
        t = np.arange(int(480 / self.speed * self.rate)) / self.rate
        turns = self.speed * t + 0.5 * self.ramp * t**2
        turns += self.wander * self.speed / (2 * np.pi * 0.25) * np.sin(2 * np.pi * 0.25 * t)
        mesh = 2 * np.pi * TEETH[0] * turns
        vibration = sum(size * np.cos(k * mesh + k) for k, size in ((1, 9.8), (2, 4.9), (3, 2.5)))
        vibration *= 1 + modulation * np.cos(2 * np.pi * order * turns)
        vibration += 0.5 * np.cos(2 * np.pi * turns) + chance.normal(size=t.size)
        from_middle = np.abs((self.pulses * turns + 0.5) % 1 - 0.5)
        pulses = (from_middle < 0.1) * 5.0
        if self.flank:
            pulses = 5 / (1 + np.exp((from_middle - 0.1) / self.flank))
        found = pulses_of(pulses, self.rate, PulseSettings(per_rev=self.pulses))
        return Window(
            start_time_ns=0,
            accelerations={"a": Samples(values=vibration, rate=self.rate, start=0.0)},
            encoders={"pinion": Edges(per_rev=self.pulses, first_index=0, times=found.times)},
        )


FEW = (
    Sampled(),
    Sampled(ramp=0.06),
    Sampled(flank=0.004),
    Sampled(speed=19.37, rate=8192.0, wander=0.002),
    Sampled(speed=14.3, pulses=4, ramp=-0.03),
    Sampled(speed=24.47, pulses=2),
)


def many() -> list[Sampled]:
    """60 machines: rates, speeds, ramps, wander and pulses a turn."""
    chance = np.random.default_rng(34)
    speeds, rates = (9.7, 14.3, 19.37, 24.47, 24.6, 29.9), (4096.0, 5120.0, 8192.0, 10000.0, 12800.0)
    return [
        Sampled(
            rate=max(rates[i % 5], 8 * TEETH[0] * speeds[i % 6]),
            speed=speeds[i % 6] + chance.uniform(0, 0.3),
            ramp=(0.0, 0.0, 0.002, 0.01, -0.006)[i % 5 if i % 2 else i % 3] * speeds[i % 6] / 5,
            wander=(0.0, 0.0, 0.0, 0.001, 0.003)[(i // 3) % 5],
            pulses=(1, 1, 1, 2, 4)[(i // 2) % 5],
            flank=(0.0, 0.0, 0.003)[(i // 4) % 3],
            seed=i,
        )
        for i in range(60)
    ]


def orders_without_shaft(rig: Rig, window: Window) -> list[float]:
    """Spacings of lines that no shaft makes [orders of the pinion]."""
    return [lines.order for lines in lines_without_shaft(rig, window, "a").lines]


@pytest.mark.parametrize("machine", FEW, ids=repr)
def test_pulses_known_to_half_a_sample_make_no_lines_of_no_shaft(rig, machine):
    assert orders_without_shaft(rig, machine.window()) == []


@pytest.mark.parametrize("machine", FEW, ids=repr)
def test_a_modulation_of_three_per_cent_is_found_beside_such_pulses(rig, machine):
    found = orders_without_shaft(rig, machine.window(modulation=0.03))
    assert found and found[0] == pytest.approx(17.5 / 57, abs=1e-3)


@pytest.mark.slow
@pytest.mark.timeout(1200)  # 120 searches for spacings, 100 s on an idle core
def test_of_sixty_machines_with_sampled_pulses_none_has_a_finding_and_nearly_all_show_a_modulation(rig):
    machines, chance = many(), np.random.default_rng(7)
    assert [m for m in machines if orders_without_shaft(rig, m.window())] == []
    orders = (chance.integers(6, 46, size=60) + 0.5) / TEETH[1]
    found = [orders_without_shaft(rig, m.window(0.03, order)) for m, order in zip(machines, orders, strict=True)]
    near = [any(abs(f - order) < 2e-3 for f in places) for places, order in zip(found, orders, strict=True)]
    assert sum(near) >= 55


def test_the_timing_of_edges_is_told_from_their_places_among_the_samples():
    chance = np.random.default_rng(3)
    true = np.cumsum(1 / (24.6 + 0.05 * chance.normal(size=400)))
    none = lambda values: (values * 0, 1)  # noqa: E731
    square = edge_timing(np.ceil(true * RATE) / RATE, [RATE], none)
    assert square is not None and square.std == pytest.approx(1 / RATE / 12**0.5, rel=0.02)
    assert edge_timing(true, [RATE], none) is None
    assert np.abs(square.as_timed(true) - true).max() <= 0.51 / RATE
