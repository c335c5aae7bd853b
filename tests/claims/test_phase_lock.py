"""Impacts belong to the teeth where they keep their phase to the shaft's angle, whatever their order is near to."""

from functools import cache

import numpy as np
import pytest

from twin.features.impact_turns import leading_tooth, locked_lines
from twin.features.non_gear import NonGearFeatures, non_gear_features
from twin.features.shaft_orders import fractions
from twin.rig import Rig
from twin.tracing.detectors.non_gear import find_non_gear_content
from twin.tracing.phase_lock import locked_to
from twin.windows import Edges, Samples, Window

TEETH = (19, 53)  # 9.5 is no order of the gear
RATE, SECONDS, SPEED, PER_REV = 12800.0, 4.0, 10.0, 1024


RIG = Rig.from_mapping({"gears": {"pinion": {"teeth": TEETH[0]}, "gear": {"teeth": TEETH[1]}}})


def rang(struck, strength, rng, t):
    """Acceleration [m/s²] at times (n,) of blows at times `struck` [s], which ring at 2.1 kHz."""
    pulses = np.zeros(t.size)
    at = np.rint(struck * RATE).astype(int).clip(0, t.size - 1)
    np.add.at(pulses, at, strength * np.exp(0.1 * rng.normal(size=struck.size)))
    after = np.arange(int(0.006 * RATE)) / RATE
    return np.convolve(pulses, np.exp(-900 * after) * np.sin(2 * np.pi * 2100 * after))[: t.size]


def window(number, order, slip, locked, strength=6.0):
    """A window of a gear pair whose blows come at an order of the pinion: locked to its angle, or of a bearing."""
    rng = np.random.default_rng([number, int(1000 * order), locked])
    first = 1000.0 * number + rng.uniform(0, 50)  # revolutions at its start
    t = np.arange(int(RATE * SECONDS)) / RATE
    turned = first + SPEED * t * (1 + 0.002 * np.sin(2 * np.pi * 0.3 * t + number))
    edge = np.arange(int(np.ceil(first * PER_REV)), int(turned[-1] * PER_REV))
    blows = order * turned + (0.0 if locked else rng.uniform())
    n = np.arange(np.ceil(blows[0]), np.floor(blows[-1]))
    if slip:
        n = n + slip * np.cumsum(rng.normal(size=n.size))
        n = n[(n > blows[0]) & (n < blows[-1])]
    mesh = sum(np.cos(2 * np.pi * k * TEETH[0] * turned + k) / k for k in (1, 2, 3))
    x = mesh + rang(np.interp(n, blows, t), strength, rng, t) + 0.05 * rng.normal(size=t.size)
    times = np.interp(edge / PER_REV, turned, t)
    return Window(
        start_time_ns=number * 10**12,
        accelerations={"y6": Samples(rate=RATE, start=0.0, values=x)},
        encoders={"pinion": Edges(per_rev=PER_REV, first_index=int(edge[0]), times=times)},
    )


@cache
def content(order, slip, locked, strength=6.0):
    seen = [(1000.0 * n, non_gear_features(RIG, window(n, order, slip, locked, strength))) for n in range(1, 6)]
    return find_non_gear_content(seen, False, teeth=TEETH)


@pytest.mark.parametrize(("order", "strength"), [(9.5, 6.0), (9.5, 1.0), (19 / 3, 0.3)])
def test_impacts_with_every_second_or_third_tooth_are_no_bearing_and_are_told_with_their_order(order, strength):
    found = content(order, 0.0, True, strength)
    assert found.defect is None
    assert found.locked == pytest.approx(order, abs=1e-6) and found.unknown
    assert f"order {order:.3f}" in found.sentence() and "not of a bearing" in found.sentence()


@pytest.mark.parametrize("order", [9.502, 6.335])
def test_a_bearing_whose_order_lies_beside_a_fraction_of_the_mesh_is_still_found(order):
    found = content(order, 0.008, False)
    assert found.locked is None and found.defect is not None
    assert found.defect.effect.order == pytest.approx(order, rel=0.01)


@pytest.mark.parametrize("order", [3.58, 5.42])
def test_a_bearing_at_an_order_of_its_own_is_found(order):
    assert content(order, 0.01, False).defect.effect.order == pytest.approx(order, rel=0.01)


@pytest.mark.parametrize(("order", "struck"), [(1.0, "pinion"), (19 / 53, "gear"), (4.01, "none"), (1.37, "none")])
def test_impacts_are_a_tooths_where_one_leads_in_all_windows_and_no_shafts_where_none_does(order, struck):
    """Blows at 4.01 of a turn lead at one tooth within a window, at another in the next."""
    found = content(order, 0.0 if struck != "none" else 0.004, struck != "none", 20.0)
    if found.defect is None:
        assert found.impacts and found.struck == struck
        assert found.struck_shaft == ("" if struck == "none" else struck)


# ------------------------------------------------------------------------------------------ phases and turns alone


def features(locks):
    return NonGearFeatures(duration=5.0, speed_hz=10.0, tones=(), lines=(), kurtosis=5.0, rates=(), locks=tuple(locks))


def test_phases_of_a_bearing_beside_a_fraction_agree_by_chance_in_one_case_of_twenty():
    rng = np.random.default_rng(1)
    taken = 0
    for _ in range(400):
        phases = rng.uniform(0, 2 * np.pi, 5)
        windows = [features([(9.5, np.cos(φ), np.sin(φ))]) for φ in phases]
        taken += locked_to(9.503, 0.01, windows, TEETH) is not None
    assert taken / 400 == pytest.approx(0.05, abs=0.03)


def test_a_window_may_begin_with_any_of_the_teeth_that_strike_in_turn():
    windows = [features([(9.5, *sign)]) for sign in ((1.0, 0.1), (-1.0, -0.1), (-0.9, 0.1), (1.0, 0.0))]
    assert locked_to(9.498, 0.01, windows, TEETH) == 9.5


def test_a_fraction_is_not_excluded_before_three_windows_have_a_phase():
    two = [features([(9.5, 1.0, 0.0)]), features([(9.5, 0.0, 1.0)])]
    assert locked_to(9.5, 0.01, two, TEETH) == 9.5
    assert locked_to(3.58, 0.01, two, TEETH) is None


def test_fractions_are_those_of_both_turns_and_of_the_mesh():
    found = fractions(TEETH, 0.3, 12.0)
    assert found[9.5] == 2 and found[4.0] == 1 and found[0.5] == 2
    assert any(abs(o - 1.5 * 19 / 53) < 1e-9 for o in found)


def envelope(tooth, turns=17, seed=0, teeth=19, heavy=True):
    """Noise with blows at one tooth of every turn, at random ones where it is None; its angle starts anywhere."""
    rng = np.random.default_rng(seed)
    step = 2 * np.pi / (teeth * 16)
    start = rng.uniform(0, 2 * np.pi)
    θ = start + step * np.arange(int(turns * teeth * 16) + 40)
    s = rng.exponential(size=θ.size)
    for turn in range(int(θ[0] / 2 / np.pi) - 1, int(θ[-1] / 2 / np.pi) + 2):
        at = turn + (rng.uniform() if tooth is None else (tooth + 0.5) / teeth)
        i = int((2 * np.pi * at - start) / step)
        if 0 <= i < s.size - 8:
            s[i : i + 8] += 50 * np.exp(rng.normal())
    return s, start, step


def test_impacts_at_one_tooth_of_every_turn_are_told_from_impacts_anywhere():
    struck = [leading_tooth(*envelope(7, seed=s), 19, 1.0) for s in range(10)]
    anywhere = [leading_tooth(*envelope(None, seed=s), 19, 1.0)[0] for s in range(200)]
    assert max(chance for chance, _ in struck) < 1e-6 and {tooth for _, tooth in struck} == {7}
    assert np.mean(np.array(anywhere) < 1e-2) < 0.03


def test_few_turns_exclude_nothing():
    assert leading_tooth(*envelope(7, turns=4), 19, 1.0)[0] is None


def test_a_line_of_the_envelope_has_its_phase_at_absolute_angle():
    step = 2 * np.pi / 256
    for start in (0.0, 1.3, 2000.0):
        θ = start + step * np.arange(256 * 20)
        ((_, re, im),) = locked_lines(2 + np.cos(9.5 * θ - 0.4), start, step, [9.5])
        assert complex(re, im) == pytest.approx(0.5 * np.exp(-0.4j), abs=0.01)
