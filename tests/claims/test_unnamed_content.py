"""What stands clear of its neighbourhood is said with its orders and its place, though no effect names it."""

from dataclasses import replace

import numpy as np
import pytest

from tests.claims.test_tracing_detectors import healthy
from tests.dynamics_cases import RIG, model
from twin.assessment import SpectralLine, Unexplained
from twin.effects.unknown_effect import transfers
from twin.features.off_orders import OffOrders, lines_of, wandering_tones
from twin.features.resample import AngleSignal
from twin.features.window_features import MeasuredLines, WindowFeatures
from twin.scales import Scales
from twin.tracing.detectors import unknown
from twin.tracing.detectors.non_gear import find_non_gear_content
from twin.tracing.mean_step import mean_step
from twin.tracing.shaft_remainder import ORDERS_READ, ShaftLine, one_order_only, orders_of_force, shaft_lines
from twin.tracing.state import TraceSummary, Tracing
from twin.tracing.unexplained import with_unknown_content
from twin.tracing.unknown_words import OTHER_PATH

TEETH, SPEED, TOP, FLOOR = (19, 52), 10.0, 2000.0, 2e-3
SCALES = Scales.of(RIG)

# ------------------------------------------------------------------------------------------ one window's spectrum


def spectrum(signal, seed=0, turns=25, noise=0.05, per_turn=1024):
    """Off-order spectrum of a signal of time [s] at a steady speed, with noise [m/s²] and a mesh line."""
    angle = 2 * np.pi * np.arange(turns * per_turn) / per_turn
    rng = np.random.default_rng(seed)
    values = signal(angle / (2 * np.pi * SPEED)) + 2 * np.cos(19 * angle) + noise * rng.normal(size=angle.size)
    on = AngleSignal(start=0.0, step=2 * np.pi / per_turn, values=values, usable=np.ones(angle.size, dtype=bool))
    return OffOrders.of(on, TEETH, SPEED, TOP)


def sweep(frequency, drift, amplitude=0.8, seconds=2.5):
    return lambda t: amplitude * np.sin(2 * np.pi * frequency * ((1 - drift / 2) * t + drift * t**2 / (2 * seconds)))


@pytest.mark.parametrize(("frequency", "drift"), [(334.5, 0.02), (334.5, -0.03), (721.0, 0.012), (869.0, 0.03)])
def test_a_tone_that_runs_through_many_steps_of_resolution_is_one_tone_with_its_amplitude(frequency, drift):
    (tone,) = wandering_tones(spectrum(sweep(frequency, drift)), FLOOR)
    assert tone.order * SPEED == pytest.approx(frequency, rel=0.2 * abs(drift))
    assert tone.amplitude == pytest.approx(0.8, rel=0.25)
    assert tone.width * SPEED == pytest.approx(0.14 * abs(drift) * frequency, rel=0.4)
    reading = tone.reading(SPEED)
    assert abs(reading.amplitude("acceleration")) > 20 * reading.noise("acceleration")


def test_a_steady_tone_is_a_line_and_does_not_wander():
    seen = spectrum(sweep(334.5, 0.0))
    assert wandering_tones(seen, FLOOR) == []
    assert lines_of(seen, FLOOR)[0] == (pytest.approx(33.45, abs=0.02), pytest.approx(0.8, rel=0.1))


def test_the_skirt_of_a_mesh_line_is_no_tone_and_a_tone_on_one_side_of_it_is():
    skirt = [sweep(760.0 + side * 12.0, 0.02, 0.3) for side in (-1, 1)]
    assert wandering_tones(spectrum(lambda t: sum(s(t) for s in skirt)), FLOOR) == []
    (tone,) = wandering_tones(spectrum(skirt[1]), FLOOR)
    assert tone.order * SPEED == pytest.approx(772.0, rel=0.01)


@pytest.mark.parametrize(("mesh", "drift"), [(2005.0, 0.006), (2010.0, 0.008), (2014.0, 0.01)])
def test_the_skirt_of_a_mesh_line_beyond_the_band_is_no_tone_and_nothing_beyond_it_is_read(mesh, drift):
    """Mesh order 10 at just over 2 kHz, to which the band is declared: half of its skirt lies within."""
    speed, per_turn, turns = mesh / 190, 1024, 26
    angle = 2 * np.pi * np.arange(turns * per_turn) / per_turn
    t = angle / (2 * np.pi * speed)
    rng = np.random.default_rng(3)
    skirt = sum(sweep(mesh + side * 9.0, drift, 0.3)(t) for side in (-1, 1))
    values = skirt + 5 * np.cos(190 * angle) + 2 * np.cos(19 * angle) + 0.05 * rng.normal(size=angle.size)
    on = AngleSignal(start=0.0, step=2 * np.pi / per_turn, values=values, usable=np.ones(angle.size, dtype=bool))
    seen = OffOrders.of(on, TEETH, speed, TOP)
    assert wandering_tones(seen, FLOOR) == [] and lines_of(seen, FLOOR) == []
    assert all(order * speed <= TOP for order, _ in seen.of_shafts(TEETH, 2.5, 60))


@pytest.mark.parametrize("seed", range(20))
def test_noise_and_the_lines_of_the_shafts_make_no_tone(seed):
    rng = np.random.default_rng(seed)
    phases = rng.uniform(0, 2 * np.pi, 60)
    made = [
        (lambda t, o=o, φ=φ: 0.5 * np.sin(2 * np.pi * o * SPEED * t + φ))
        for o, φ in zip([*range(1, 31), *(19 / 52 * g for g in range(1, 31))], phases, strict=True)
    ]
    seen = spectrum(lambda t: sum(m(t) for m in made), seed=seed)
    assert wandering_tones(seen, FLOOR) == [] and lines_of(seen, FLOOR) == []


# ------------------------------------------------------------------------------------------ forces on the shaft

NOISE = {"acceleration": 1e-3, "encoder": 3e-9, "torque": 1.5e-3}
NAMES = {"acceleration": "acceleration", "encoder": "transmission_error", "torque": "torque"}


def windows(made, count=4, seed=0, first=0, disc=0.0):
    """Windows with lines at the pinion's orders 1 … 10: what entries make of their amplitudes, discs and noise.

    made   by entry and order: amplitude
    first  window that shows it first
    disc   error of the discs at every order, in standard deviations of their tolerance
    """
    rng = np.random.default_rng(seed)
    out = []
    turned = {key: np.exp(1j * rng.uniform(0, 6)) for key in made}
    graduation = disc * SCALES.graduation[0] * np.exp(1j * rng.uniform(0, 6, 11))
    for i in range(count):
        speed = SPEED * (1 + 0.01 * i)
        features = {}
        for channel, name in NAMES.items():
            orders = range(1, 11) if channel == "encoder" else ORDERS_READ[channel]
            lines = []
            for p in orders:
                y = NOISE[channel] * (rng.normal() + 1j * rng.normal()) + (graduation[p] if channel == "encoder" else 0)
                for (entry, order), size in made.items():
                    if order == p and i >= first:
                        y += size * turned[entry, order] * transfers(model(), entry, [p * speed])[channel][0]
                lines.append(y)
            features[name] = MeasuredLines(
                unit={"acceleration": "m/s²", "encoder": "m", "torque": "N·m"}[channel],
                keys=tuple((0, p, 0) for p in orders),
                orders=tuple(float(p) for p in orders),
                amplitudes=tuple(complex(y) for y in lines),
                std=(NOISE[channel],) * len(lines),
            )
        out.append(WindowFeatures(start_time_ns=i, duration=2.5, quality="good", speed_hz=speed, **features))
    return out


def found(made, **how):
    return shaft_lines(model(), windows(made, **how), SCALES)


def test_a_force_at_a_bearing_moves_the_housing_as_no_displacement_of_the_teeth_does():
    lines = found({("y6", 2): 30.0, ("y6", 3): 30.0})
    assert {line.order for line in lines if line.channel == "acceleration"} == {2, 3}
    expected = 30.0 * abs(transfers(model(), "y6", [2.03 * SPEED])["acceleration"][0])
    level = next(line.level for line in lines if line.channel == "acceleration" and line.order == 2)
    assert level == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize("seed", range(10))
def test_teeth_that_differ_and_discs_with_errors_make_no_force(seed):
    """Displacements in the mesh of ten times the pitch errors that are common, and discs at their tolerance."""
    rng = np.random.default_rng(seed)
    made = {("mesh", p): 2e-5 * rng.uniform() for p in range(1, 11)}
    assert found(made, seed=seed, disc=1.0) == ()


@pytest.mark.slow
def test_noise_alone_makes_no_force():
    assert [found({}, seed=seed, count=5) for seed in range(100)] == [()] * 100


def test_a_force_that_begins_late_is_seen_from_its_first_window_on():
    lines = found({("y6", 3): 60.0}, count=6, first=3)
    assert {(line.order, line.since) for line in lines if line.channel == "acceleration"} == {(3, 3)}
    assert found({("y6", 3): 60.0}, count=4, first=3) == ()  # one window may be chance


def line(order, level, channel="acceleration"):
    return ShaftLine(order=order, channel=channel, level=level, since=0)


def test_harmonics_of_a_force_are_at_multiples_of_its_strongest_order():
    jaws = [line(1, 0.01), line(2, 0.02), line(3, 0.3), line(6, 0.06, "torque")]
    assert orders_of_force(jaws, 12) == {1, 2, 3, 6, 9, 12}
    assert orders_of_force([line(1, 0.3)], 12) == frozenset()  # an unbalance
    assert orders_of_force([line(2, 0.3, "torque")], 12) == frozenset()  # a torque ripple


def test_an_unbalance_and_a_torque_ripple_have_one_order_each():
    assert one_order_only([line(1, 0.3), line(2, 0.05)], 1, ())
    assert not one_order_only([line(1, 0.1), line(2, 0.05)], 1, ())
    assert one_order_only([line(1, 0.1), line(2, 0.1)], 1, {2})  # an unbalance beside a ripple that moves the housing
    assert not one_order_only([line(1, 0.01), line(3, 0.3), line(6, 0.06, "torque")], 6, ())


def test_a_line_that_begins_is_told_from_the_discs_by_its_change():
    """A torque line below what the discs' errors may be: only its change shows it."""
    made = {("th1", 2): 0.03}
    assert found(made, count=6, first=3, disc=1.0, seed=3) != () and found(made, count=6, disc=1.0, seed=3) == ()


def beside_teeth(teeth, order, sizes, seed=0):
    """Windows of teeth that differ by `teeth` [m], with a torque of the pinion of these sizes [N·m] beside them."""
    rng, count = np.random.default_rng(seed), len(sizes)
    sound = windows({("mesh", p): teeth * rng.uniform(0.3, 1) for p in range(1, 11)}, count=count, seed=seed)
    out = []
    for i, (window, size) in enumerate(zip(sound, sizes, strict=True)):
        driven = windows({("th1", order): size}, count=count, seed=seed + 50)[i]
        both = {}
        for name in NAMES.values():
            one, other = getattr(window, name), getattr(driven, name)
            summed = tuple(a + b for a, b in zip(one.amplitudes, other.amplitudes, strict=True))
            both[name] = replace(one, amplitudes=summed)
        out.append(replace(window, **both))
    return out


@pytest.mark.parametrize("teeth", [3e-6, 1e-5])
@pytest.mark.parametrize(("order", "sizes", "since"), [
    (3, (0, 0, 0, 0.5, 0.5, 0.5), 3), (2, (0, 0, 1, 1, 1, 1), 2), (3, (0, 0.1, 0.2, 0.3, 0.4, 0.5), 0),
])  # fmt: skip
def test_a_ripple_that_begins_late_or_grows_is_a_torque_line_beside_teeth_that_differ(teeth, order, sizes, since):
    lines = shaft_lines(model(), beside_teeth(teeth, order, sizes), SCALES)
    (torque,) = (line for line in lines if line.channel == "torque")
    assert {line.order for line in lines} == {order} and since - 1 <= torque.since <= since
    assert shaft_lines(model(), beside_teeth(teeth, order, [0.0] * 6), SCALES) == ()


# ------------------------------------------------------------------------------------------ steps of the mean


def shifted(step=0.0, drift=0.0, since=5):
    """The healthy context with a mean transmission error that steps, or settles [m]."""
    context = healthy()
    moved = []
    for i, w in enumerate(context.windows):
        e = w.features.transmission_error
        at = e.keys.index((0, 0, 0))
        values = list(e.amplitudes)
        values[at] += step * (i >= since) + drift * (1 - np.exp(2 - i))
        features = replace(w.features, transmission_error=replace(e, amplitudes=tuple(values)))
        moved.append(replace(w, given=replace(w.given, features=features)))
    windows = tuple(moved)
    return replace(context, windows=windows, worn=replace(context.worn, windows=windows))


@pytest.mark.slow
@pytest.mark.parametrize("size", [24e-6, -6e-6])
def test_a_shaft_that_shifts_steps_the_mean_transmission_error(size):
    step = mean_step(shifted(step=size))
    assert step is not None and step.size == pytest.approx(size, abs=1e-6)
    said = unknown.detect(shifted(step=size)).non_gear
    assert "has shifted in a bearing or its seat" in said.sentence() and said.unknown


def test_a_mean_that_stays_that_settles_or_that_loses_an_edge_has_not_stepped():
    assert mean_step(healthy()) is None
    assert mean_step(shifted(drift=8e-6)) is None
    assert mean_step(shifted(step=170e-6)) is None


# ------------------------------------------------------------------------------------------ what is said


def test_nothing_is_said_of_a_healthy_machine():
    content = unknown.detect(healthy()).non_gear
    assert content.unnamed == "" and content.forces == ()


def test_another_path_is_said_and_leaves_the_verdict_and_what_has_no_name_does_not():
    own = SpectralLine(order=3.0, frequency=30.0, share=1e-4, kind="force that turns with the pinion")
    tracing = Tracing(latest=TraceSummary(other_structure=True), unattributed=(own,))
    said = with_unknown_content(tracing, Unexplained(verdict="explained", share=0.0))
    assert said.verdict == "explained" and said.lines == (own,) and said.reason == OTHER_PATH
    left = with_unknown_content(replace(tracing, unknown="lines at order 3"), Unexplained(verdict="explained"))
    assert left.verdict == "unknown_effect" and "order 3" in left.reason


def test_a_force_on_the_shaft_is_said_with_its_orders_its_place_and_what_is_known_to_make_it():
    context = healthy()
    H = [transfers(context.model, "y6", [p * context.windows[0].condition.speed_hz]) for p in (1, 2, 3)]
    pushed = []
    for w in context.windows:
        a = w.features.acceleration
        amplitudes = list(a.amplitudes)
        for p in (1, 2, 3):
            amplitudes[a.keys.index((0, p, 0))] += 60.0 * p * H[p - 1]["acceleration"][0]
        given = replace(w.given, features=replace(w.features, acceleration=replace(a, amplitudes=tuple(amplitudes))))
        pushed.append(replace(w, given=given))
    content = unknown.detect(replace(context, windows=tuple(pushed))).non_gear
    assert {order for order, _ in content.forces} >= {2.0, 3.0}
    said = content.unnamed
    assert "of the pinion's shaft" in said and "loose" in said and "in the acceleration's own channel" in said


def test_pairs_about_a_mesh_line_are_its_sidebands_and_no_lines_of_their_own():
    from tests.unit.test_tracing_parts import beside

    pair, alone = ((38.4, 0.5), (37.6, 0.45)), ((38.4, 0.5),)
    seen = [[(1000.0 * n, beside(lines=lines)) for n in range(5)] for lines in (pair, alone)]
    assert [find_non_gear_content(w, False, teeth=TEETH).orders for w in seen] == [(), alone]


def with_ripple(size_at, order, since=400.0):
    """The healthy context with a torque of the pinion at an order; its size [N·m] at each count of revolutions."""
    context, driven = healthy(), []
    for w in context.windows:
        lines = w.features.torque
        size = size_at(w.features.revolutions) if w.features.revolutions > since else 0.0
        made = transfers(context.model, "th1", [order * w.condition.speed_hz])["torque"][0]
        at = lines.keys.index((0, order, 0))
        values = tuple(y + size * made * (n == at) for n, y in enumerate(lines.amplitudes))
        features = replace(w.features, torque=replace(lines, amplitudes=values))
        driven.append(replace(w, given=replace(w.given, features=features)))
    return replace(context, windows=tuple(driven))


@pytest.mark.parametrize(("size_at", "order", "moves"), [
    (lambda n: 3e-3 * n, 3, "grows by"),
    (lambda n: 3e-3 * (n - 300), 4, "grows by"),
    (lambda n: 8.0 - 2.5e-3 * n, 5, "falls by"),
    (lambda n: 5.0, 3, "stays the same"),
])  # fmt: skip
def test_of_a_torque_ripple_without_a_name_it_is_said_whether_it_grows(size_at, order, moves):
    said = unknown.detect(with_ripple(size_at, order)).non_gear.unnamed
    assert f"order {order}" in said and "N·m" in said and f"its level {moves}" in said
    assert ("in 1000 revolutions" in said) is (moves != "stays the same")
