"""Faults of instruments are found before any of gears and bearings, named, and put right.

Truth  recorded windows of the simulator, spoiled afterwards by tests/instrument_faults.py
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.scoring import windows_of
from service.stream.window import by_sound_instruments
from tests.instrument_faults import KINDS, bursts, clock, loose_cable, lost
from twin.features.extract import extract
from twin.windows import Samples, Window

RECORDINGS = Path(__file__).parents[2] / "recordings"
NAMED = {"clock": "clock_rate", "lost samples": "lost_samples", "bursts": "interference", "loose cable": "lost_contact"}


@pytest.fixture(scope="module")
def campaign():
    return windows_of(RECORDINGS / "short-campaign.mcap")


@pytest.mark.parametrize("name", ["short", "faulty", "paper"])
def test_sound_instruments_are_left_alone(name):
    rig, windows = windows_of(RECORDINGS / f"{name}-campaign.mcap")
    assert [f for w in windows[:12] for f in by_sound_instruments(rig, w).faults] == []


@pytest.mark.parametrize("kind, i", [(kind, i) for kind in NAMED for i in range(1, 4)])
def test_a_fault_of_an_instrument_is_named_and_nothing_else_is(campaign, kind, i):
    rig, windows = campaign
    for number in (3, 5, 7):
        found = by_sound_instruments(rig, KINDS[kind][i](windows[number], np.random.default_rng(number)))
        assert {f.kind for f in found.faults} == {NAMED[kind]}
        assert found.quality in ("repaired", "degraded")


@pytest.mark.parametrize("ppm", [60.0, 300.0, -800.0])
def test_the_rate_of_a_clock_is_told_and_its_lines_are_put_right(campaign, ppm):
    rig, windows = campaign
    spoiled = clock(ppm)(windows[5], np.random.default_rng(0))
    found = by_sound_instruments(rig, spoiled)
    (sensor,) = found.accelerations.values()
    assert sensor.rate / 12800.0 - 1 == pytest.approx(ppm * 1e-6, abs=12e-6)
    right, wrong = (_distance(rig, windows[5], w) for w in (found, spoiled))
    assert right < 0.05 and right < 0.5 * wrong


@pytest.mark.parametrize("blocks", [(40,), (100,), (256,)])
def test_lines_beside_lost_samples_are_those_of_the_whole_record(campaign, blocks):
    rig, windows = campaign
    spoiled = lost(*blocks)(windows[5], np.random.default_rng(2))
    right, wrong = (_distance(rig, windows[5], w) for w in (by_sound_instruments(rig, spoiled), spoiled))
    assert right < 0.05 and right < 0.2 * wrong


def test_several_losses_in_one_window_leave_its_lines_nearly_whole(campaign):
    rig, windows = campaign
    spoiled = lost(64, 300)(windows[5], np.random.default_rng(3))
    right, wrong = (_distance(rig, windows[5], w) for w in (by_sound_instruments(rig, spoiled), spoiled))
    assert right < 0.3 * wrong


def test_the_level_beside_bursts_is_that_without_them(campaign):
    rig, windows = campaign
    spoiled = bursts(9, 20.0)(windows[5], np.random.default_rng(4))
    sound, found, wrong = (extract(rig, w).rms for w in (windows[5], by_sound_instruments(rig, spoiled), spoiled))
    assert found == pytest.approx(sound, rel=0.03) and wrong > 1.5 * sound


@pytest.mark.parametrize("digit", [0.0, 1e-3])
def test_the_level_beside_a_loose_cable_is_that_without_it(campaign, digit):
    rig, windows = campaign
    spoiled = loose_cable(30, 2e-3, 6e-3, digit)(windows[5], np.random.default_rng(4))
    sound, found, wrong = (extract(rig, w).rms for w in (windows[5], by_sound_instruments(rig, spoiled), spoiled))
    assert found == pytest.approx(sound, rel=0.03) and wrong < 0.96 * sound


@pytest.mark.parametrize(("digit", "period", "decay"), [(1e-3, 0.05, 400.0), (1e-3, 0.2, 200.0), (1e-4, 0.1, 300.0)])
def test_blows_that_die_away_below_the_last_digit_have_not_lost_contact(campaign, digit, period, decay):
    rig, windows = campaign
    w = windows[5]

    def blows(s: Samples) -> Samples:
        t = s.times - s.start
        late = np.mod(t, period)
        q = digit * np.std(s.values)
        return replace(s, values=q * np.rint(np.std(s.values) / q * np.exp(-decay * late) * np.sin(7000 * late)))

    quiet = replace(w, accelerations={n: blows(s) for n, s in w.accelerations.items()})
    assert "lost_contact" not in {f.kind for f in by_sound_instruments(rig, quiet).faults}


def test_impacts_once_a_turn_that_reach_the_torque_meter_are_the_machines(campaign):
    rig, windows = campaign
    w = windows[5]
    edges = w.encoders["pinion"]
    at = edges.times[:: edges.per_rev][1:-1]

    def struck(s: Samples) -> Samples:
        values, n = s.values.copy(), max(2, round(0.004 * s.rate))
        for t in at:
            i = round((t - s.start) * s.rate)
            values[i : i + n] += 15 * np.std(s.values) * np.random.default_rng(1).normal(size=values[i : i + n].size)
        return replace(s, values=values)

    impacts = Window(
        start_time_ns=w.start_time_ns,
        accelerations={n: struck(s) for n, s in w.accelerations.items()},
        torques={n: struck(s) for n, s in w.torques.items()},
        encoders=w.encoders,
    )
    assert "interference" not in {f.kind for f in by_sound_instruments(rig, impacts).faults}


def _distance(rig, window: Window, other: Window) -> float:
    """How far the mesh lines of a window are from those of another, of their size."""
    a, b = (extract(rig, w).acceleration for w in (window, other))
    keys = [key for key in a.keys if key[0] and not key[1] and not key[2]]
    one, two = (np.array([lines.at(*key) for key in keys]) for lines in (a, b))
    return float(np.linalg.norm(one - two) / np.linalg.norm(one))
