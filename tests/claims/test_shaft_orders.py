"""An order is said to be of no shaft where all that the shafts make is excluded, and no other is."""

from dataclasses import replace

import numpy as np
import pytest

from tests.claims.test_tracing_detectors import healthy
from tests.claims.test_unnamed_content import FLOOR, TEETH, spectrum
from tests.unit.test_tracing_parts import beside
from twin.effects import EFFECTS
from twin.features.channel_lines import LineReading
from twin.features.off_orders import lines_of
from twin.features.shaft_orders import FRACTION, GEAR, HUNTED, MIXED, PINION, distance_from_turns, owner_of
from twin.features.window_features import MeasuredLines
from twin.tracing.attribution import AttributedEffect
from twin.tracing.detectors.non_gear import find_non_gear_content
from twin.tracing.detectors.unknown import find_unknown
from twin.tracing.findings import Findings
from twin.tracing.unknown_lines import SeenWindow, families, followed_lines, modulation_of

GEAR_ORDER = TEETH[0] / TEETH[1]


@pytest.mark.parametrize(
    ("order", "owner"),
    [
        (1.0, PINION), (7.003, PINION), (57.0, PINION), (GEAR_ORDER, GEAR), (5 * GEAR_ORDER, GEAR),
        (19 + GEAR_ORDER, GEAR), (2 / 52, HUNTED), (19 / 3, FRACTION), (19 / 3 * 2, FRACTION), (3.58, None),
        (25.15, None), (0.625, None),
    ],
)  # fmt: skip
def test_an_order_belongs_to_a_turn_its_multiples_the_hunting_period_or_part_of_the_mesh(order, owner):
    assert owner_of(order, TEETH, 0.005) == owner


def test_sums_and_differences_belong_to_lines_that_are_known_and_to_none_that_are_not():
    ripple, run_out = 4.0, GEAR_ORDER
    for order in (19 + ripple + run_out, 38 - ripple + run_out, 4 - run_out, 57 + 0.625 + 4):
        known = (ripple, run_out, 0.625)
        assert owner_of(order, TEETH, 0.005, known) == MIXED
        assert owner_of(order, TEETH, 0.005) is None
    assert owner_of(25.15, TEETH, 0.005, known) is None


def test_few_orders_are_excluded_by_chance():
    """Within a hundredth of an order; of the gear's 19/52, the pinion's turns and those of two known lines."""
    orders = np.random.default_rng(2).uniform(0.5, 100.0, 2000)
    taken = [owner_of(o, TEETH, 0.01, (1.0, GEAR_ORDER)) is not None for o in orders]
    assert np.mean(taken) < 0.15
    assert (distance_from_turns(orders, TEETH) <= 0.01).mean() < np.mean(taken)


def test_orders_of_effects_that_make_one_line_are_known():
    found = Findings().adding(
        AttributedEffect.of(EFFECTS["torque_ripple"](amplitude=0.1, order=4.0), parameters={}, log_evidence=50.0),
        AttributedEffect.of(EFFECTS["gear_eccentricity"](eccentricity=1e-5), parameters={}, log_evidence=50.0),
        AttributedEffect.of(EFFECTS["sensor_gain"](gain=1.1), parameters={}, log_evidence=50.0),
    )
    assert found.known_orders(TEETH) == (pytest.approx(GEAR_ORDER), 4.0)


# ------------------------------------------------------------------------------------------ lines over windows


def reading(order, speed, size=0.5, channel="acceleration"):
    return LineReading(
        order=order, frequency=order * speed, std=1e-3, follows_angle=5.0, channels={channel: (size, 0.0, size / 200)}
    )


def seen(made, speeds=(10.0, 10.4, 9.8, 10.1, 10.6, 9.7)):
    """Windows with readings: `made` gives (order, channel) at a speed [Hz]."""
    return [
        SeenWindow(
            index=i, revolutions=1000.0 * i, speed_hz=v, torque=10.0, duration=2.5, fitted=True,
            readings=tuple(reading(o, v, channel=c) for o, c in made(v)),
        )
        for i, v in enumerate(speeds)
    ]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("ripple", [3, 2, 5])
def test_sidebands_of_two_known_lines_are_not_content_and_are_where_nothing_is_known(ripple):
    mixed = (19 + ripple + GEAR_ORDER, 38 + ripple - GEAR_ORDER)
    windows = seen(lambda v: [(order, "acceleration") for order in mixed])
    effects = (
        AttributedEffect.of(
            EFFECTS["torque_ripple"](amplitude=0.1, order=float(ripple)), parameters={}, log_evidence=50.0
        ),
        AttributedEffect.of(EFFECTS["gear_eccentricity"](eccentricity=1e-5), parameters={}, log_evidence=50.0),
    )
    plain = healthy()
    known = plain.with_findings(plain.findings.adding(*effects))
    assert find_unknown(plain, windows, None).causes and not find_unknown(known, windows, None).causes


def test_orders_heard_in_half_of_the_windows_are_said_only_where_no_shaft_and_no_known_lines_make_them():
    windows = [(1000.0 * n, beside(lines=((22 + GEAR_ORDER, 0.4), (9.21, 0.4)))) for n in range(5)]
    known = (3.0, GEAR_ORDER)
    assert [o for o, _ in find_non_gear_content(windows, False, teeth=TEETH, known=known).orders] == [9.21]
    assert len(find_non_gear_content(windows, False, teeth=TEETH).orders) == 2


@pytest.mark.parametrize("hertz", [21.5, 27.3, 2.7, 14.2])
def test_what_modulates_the_mesh_from_outside_is_told_by_its_own_frequency(hertz):
    """Three sidebands a window, not the same in every window."""

    def made(v):
        k = int(10 * v) % 3
        return [(19 * n + side * hertz / v, "acceleration") for n, side in ((2 + k, 1), (2 + k, -1), (5 + k, -1))]

    found, left = modulation_of([*_with_mesh(seen(made))], TEETH[0])
    assert found is not None and found.follows == "clock"
    assert found.frequency == pytest.approx(hertz, abs=0.01)
    assert not any(w.readings for w in left)


def _with_mesh(windows):
    lines = MeasuredLines(
        unit="m/s²", keys=tuple((k, 0, 0) for k in range(1, 12)), orders=tuple(19.0 * k for k in range(1, 12)),
        amplitudes=(3 + 0j,) * 11, std=(0.01,) * 11,
    )  # fmt: skip
    return [replace(w, acceleration=lines) for w in windows]


def test_a_source_and_the_sidebands_that_it_makes_of_the_mesh_are_one_cause_and_the_source_comes_first():
    def made(v):
        return [(19 + 0.625, "acceleration"), (0.625, "torque"), (57 - 0.625, "acceleration"), (12.4, "acceleration")]

    windows = seen(made)
    groups = families(followed_lines(windows), windows, TEETH[0])
    orders = sorted([round(line.order[0], 3) for line in group] for group in groups)
    assert [len(group) for group in orders] == [3, 1]
    assert orders[0][0] == 0.625 and orders[1] == [12.4]


def test_a_half_of_the_mesh_is_no_modulation_of_it():
    windows = _with_mesh(seen(lambda v: [(19 * (n - 0.5), "acceleration") for n in range(1, 7)]))
    assert modulation_of(windows, TEETH[0])[0] is None


# ------------------------------------------------------------------------------------------ one window's spectrum


def test_what_the_window_leaves_beside_a_strong_line_of_a_shaft_is_no_line_of_its_own():
    strong = spectrum(lambda t: 10 * np.sin(2 * np.pi * 26 * GEAR_ORDER * 10.0 * t + 1.0), noise=0.001)
    assert lines_of(strong, FLOOR) == []
    beside = spectrum(
        lambda t: 10 * np.sin(2 * np.pi * 26 * GEAR_ORDER * 10.0 * t) + np.sin(2 * np.pi * 96.6 * t), noise=0.001
    )
    assert lines_of(beside, FLOOR)[0][0] == pytest.approx(9.66, abs=0.01)


def test_a_line_at_the_low_end_of_the_spectrum_is_seen():
    low = spectrum(lambda t: 0.8 * np.sin(2 * np.pi * 6.25 * t))
    assert lines_of(low, FLOOR)[0] == (pytest.approx(0.625, abs=0.03), pytest.approx(0.8, rel=0.2))
