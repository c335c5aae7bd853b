"""An empirical excitation answers as the loaded mesh does, and lines of one cause are told by what they follow."""

import numpy as np
import pytest

from tests.dynamics_cases import TEN, model
from tests.effects_cases import solved
from twin.effects.addition import Addition
from twin.effects.unknown_effect import CHANNELS, UNITS, UnknownEffect, transfers
from twin.errors import ParameterError
from twin.features.channel_lines import ChannelRecord, LineReading, Wanted, read_channels
from twin.features.window_features import MeasuredLines
from twin.model import Condition
from twin.scales import Scales
from twin.serial import from_plain, to_plain
from twin.tracing.detectors.unknown import Unknown, attributed, cause_of
from twin.tracing.unknown_entry import entry_of, law_of
from twin.tracing.unknown_lines import SeenWindow, families, followed_lines, modulation_of

SIZES = {"mesh": 1e-8, "y6": 0.05, "x9": 0.05, "th1": 1e-3, "th13": 1e-3}  # small: the mesh answers linearly


def unknown(entry, size, order=0.0, frequency=0.0, **laws):
    one = {name: (laws.get(name, 0.0),) for name in ("drift", "torque_exponent", "speed_exponent", "growth", "since")}
    return UnknownEffect(
        amplitude=(size,), frequency=(frequency,), order=(order,), entry=(entry,), torque=TEN.torque,
        speed=TEN.speed_hz, **one,
    )  # fmt: skip


@pytest.mark.parametrize("entry", SIZES)
@pytest.mark.parametrize("order", [3.5, 13.5, 70.5])
def test_transfers_are_those_of_the_steady_state_of_the_nonlinear_mesh(entry, order):
    """Harmonic balance over the hunting tooth's period; a stiffness that varies over a mesh period moves it."""
    healthy = solved(period="hunting")
    found = solved(unknown(entry, SIZES[entry], order=order))
    made = transfers(model(), entry, [order * TEN.speed_hz])
    for channel, name in zip(CHANNELS, ("acceleration", "transmission_error", "torque"), strict=True):
        answer = (getattr(found, name)([order]) - getattr(healthy, name)([order]))[0] / SIZES[entry]
        assert answer == pytest.approx(made[channel][0], rel=0.01)


def test_an_excitation_of_the_mesh_is_followed_by_the_transmission_error_at_low_frequency():
    """Far below all modes the stiff mesh closes whatever lies between the flanks: the limit is one."""
    assert abs(transfers(model(), "mesh", [2.0])["encoder"][0]) == pytest.approx(1.0, rel=0.02)


def test_levels_follow_their_laws():
    effect = unknown("mesh", 2.0, frequency=50.0, torque_exponent=1.0, speed_exponent=2.0, growth=1e-3, since=100.0)
    condition = Condition(speed_hz=2 * TEN.speed_hz, torque=3 * TEN.torque)
    assert effect.amplitudes(condition, 1000.0)[0] == pytest.approx(2.0 * 3 * 4 * 2)
    assert effect.amplitudes(condition, 50.0)[0] == 0.0
    assert effect.frequencies(99.0)[0] == 50.0
    assert unknown("mesh", 1.0, order=2.5).frequencies(10.0)[0] == 25.0


def test_an_effect_survives_its_translation_and_refuses_an_entry_that_there_is_not():
    effect = Addition(effect=unknown("y6", 1.0, order=3.5), onset_revolutions=10.0)
    assert from_plain(Addition, to_plain(effect)) == effect
    with pytest.raises(ParameterError, match="is none of"):
        unknown("housing", 1.0)
    assert set(UNITS) >= set(CHANNELS)


def test_a_polarity_turns_all_lines_and_a_delay_turns_them_in_proportion_to_frequency():
    f = np.array([100.0, 300.0])
    assert UnknownEffect(polarity=-1.0).sensor_gain(f) == pytest.approx(-np.ones(2))
    late = UnknownEffect(delay=1e-4, delay_rate=1e-6, start_ns=0)
    assert np.angle(late.sensor_gain(f)) == pytest.approx(-2 * np.pi * f * 1e-4)
    assert np.angle(late.sensor_gain(f, 100 * 10**9)) == pytest.approx(-2 * np.pi * f * 2e-4)


# ------------------------------------------------------------------------------------------ lines of one window

TEETH, SPEED, SECONDS, RATE = (19, 52), 10.4, 2.5, 12800


def window_of(signal, rng, noise=0.05, wander=0.005):
    """Time [s], angle [rad] and a signal of both with noise, at a speed that wanders."""
    t = np.arange(int(RATE * SECONDS)) / RATE
    angle = 2 * np.pi * np.cumsum(SPEED * (1 + wander * np.sin(2 * np.pi * t / 1.7 + 1))) / RATE
    return t, angle, signal(t, angle) + noise * rng.normal(size=t.size)


def record_of(t, angle, values):
    return ChannelRecord.of(values, 0.0, 1 / RATE, t[::16], angle[::16], False)


def test_lines_are_read_with_frequency_phase_and_what_they_follow():
    rng = np.random.default_rng(1)
    t, angle, heard = window_of(
        lambda t, θ: 1.8 * np.cos(7.377 * θ + 0.3) + 0.4 * np.cos(2 * np.pi * 60 * t + 1) + 5 * np.cos(19 * θ), rng
    )
    speed = (angle[-1] - angle[0]) / (2 * np.pi * t[-1])
    wanted = [Wanted(frequency=7.4 * speed, channel="acceleration"), Wanted(frequency=60.2, channel="acceleration")]
    by_angle, by_clock = read_channels({"acceleration": record_of(t, angle, heard)}, wanted, TEETH, speed, SECONDS, 8)
    assert by_angle.order == pytest.approx(7.377, abs=1e-3) and by_angle.follows_angle > 100
    assert by_clock.frequency == pytest.approx(60.0, abs=0.01) and by_clock.follows_angle < -100
    y = by_angle.amplitude("acceleration")
    assert abs(y) == pytest.approx(1.8, abs=5 * by_angle.noise("acceleration") + 0.01)
    assert np.angle(y) == pytest.approx(0.3, abs=0.05)
    assert abs(by_clock.amplitude("acceleration")) == pytest.approx(0.4, abs=0.01)


def test_the_standard_deviation_of_a_line_is_that_of_repeated_records():
    found = []
    for seed in range(40):
        t, angle, heard = window_of(lambda t, θ: np.cos(2 * np.pi * 61.3 * t), np.random.default_rng(seed), noise=0.5)
        wanted = [Wanted(frequency=61.3, channel="acceleration", tone=True)]
        (line,) = read_channels({"acceleration": record_of(t, angle, heard)}, wanted, TEETH, SPEED, SECONDS, 1)
        found.append((line.amplitude("acceleration"), line.noise("acceleration")))
    scatter = np.std([abs(y) for y, _ in found])  # the phase scatters by the frequency, too, in all channels alike
    assert scatter == pytest.approx(np.mean([s for _, s in found]), rel=0.4)


# ------------------------------------------------------------------------------------------ lines of several windows


def reading(frequency, speed, channels, follows=0.0):
    return LineReading(
        order=frequency / speed, frequency=frequency, std=1e-3, follows_angle=follows,
        channels={name: (complex(y).real, complex(y).imag, std) for name, (y, std) in channels.items()},
    )  # fmt: skip


def seen(readings, speed=10.0, torque=10.0, index=0, fitted=True, revolutions=None, acceleration=None):
    return SeenWindow(
        index=index, revolutions=1000.0 * index if revolutions is None else revolutions, speed_hz=speed,
        torque=torque, duration=SECONDS, fitted=fitted, readings=tuple(readings), acceleration=acceleration,
    )  # fmt: skip


HEARD = {"acceleration": (1.0, 0.01)}


def test_lines_follow_the_clock_the_angle_or_neither():
    speeds = (9.8, 10.1, 10.4, 10.0)
    clock = [seen([reading(60.0, n, HEARD)], n, index=i) for i, n in enumerate(speeds)]
    angle = [seen([reading(7.4 * n, n, HEARD)], n, index=i) for i, n in enumerate(speeds)]
    wander = [
        seen([reading(f, n, HEARD), reading(2 * f, n, HEARD)], n, index=i)
        for i, (n, f) in enumerate(zip(speeds, (240.0, 247.0, 236.0, 243.0), strict=True))
    ]
    assert [line.follows for line in followed_lines(clock)] == ["clock"]
    assert [line.follows for line in followed_lines(angle)] == ["angle"]
    both = followed_lines(wander)
    assert [line.follows for line in both] == ["neither", "neither"]
    assert len(families(both)) == 1


def test_a_cause_that_begins_late_predicts_nothing_before_the_first_window_that_shows_it():
    """A window held out between the last fitted one without it and the first with it may have none of it."""
    heard = [seen([reading(60.0, 10.0, HEARD)] * (i > 3), index=i, fitted=i != 3) for i in range(7)]
    (line,) = followed_lines(heard)
    cause = cause_of(None, [line], heard, Scales.of(model().rig))
    assert cause.onset == 3000.0 and cause.first == 4000.0
    effect = attributed(Unknown(causes=(cause,)), heard).addition.effect
    assert effect.amplitudes(TEN, 3000.0)[0] == 0.0 and effect.amplitudes(TEN, 4000.0)[0] > 0.9


def test_a_line_that_one_window_shows_is_no_cause():
    windows = [seen([], index=i) for i in range(4)]
    assert followed_lines([*windows, seen([reading(60.0, 10.0, HEARD)], index=4), seen([], index=5)]) == ()


@pytest.mark.parametrize("entry", ["mesh", "y6", "th1", "acceleration"])
def test_the_entry_is_the_one_whose_channels_were_made(entry):
    """Channels made by the transfers of a gearbox 3 % softer throughout than the one that explains them."""
    rng = np.random.default_rng(3)
    size = {"mesh": 2e-5, "y6": 50.0, "th1": 30.0, "acceleration": 1.0}[entry]
    noise = {"acceleration": 2e-3, "encoder": 2e-9, "torque": 2e-3}
    windows = []
    for i in range(4):
        f = 137.0
        made = transfers(model(), entry, [f * 1.015])
        turn = np.exp(1j * rng.uniform(0, 6))
        drawn = {c: noise[c] * (rng.normal() + 1j * rng.normal()) for c in CHANNELS}
        channels = {c: (size * turn * made[c][0] + drawn[c], noise[c]) for c in CHANNELS}
        windows.append(seen([reading(f, 10.0 + 0.1 * i, channels)], 10.0 + 0.1 * i, index=i))
    lines = followed_lines(windows)
    found = entry_of(model(), lines, windows, Scales.of(model().rig))
    assert found.kind == {"y6": "bearing", "th1": "shaft"}.get(entry, entry)


@pytest.mark.parametrize(("entry", "size"), [("th1", 2000.0), ("th13", 5000.0), ("y6", 1e6), ("mesh", 0.1)])
def test_no_place_is_named_that_would_need_a_tooths_displacement_or_far_more_than_the_load(entry, size):
    """10 N·m of load, 0.25 kN in the mesh: what looks like 2 kN·m of the motor enters by a way of its own."""
    windows = []
    for i in range(4):
        f = 61.3
        made = transfers(model(), entry, [f])
        channels = {c: (size * made[c][0] * np.exp(1j * i), 1e-4 * size * abs(made[c][0])) for c in CHANNELS}
        windows.append(seen([reading(f, 10.0 + 0.1 * i, channels)], 10.0 + 0.1 * i, index=i))
    found = entry_of(model(), followed_lines(windows), windows, Scales.of(model().rig))
    assert found.kind != {"y6": "bearing", "mesh": "mesh"}.get(entry, "shaft")


@pytest.mark.parametrize(("name", "power"), [("torque", (1, 0)), ("speed", (0, 2)), ("constant", (0, 0))])
def test_the_law_is_told_where_speed_and_load_differ(name, power):
    conditions = [(10.0, 10.0), (13.0, 7.0), (10.0, 10.2), (13.1, 7.1), (9.9, 9.9)]
    windows = []
    for i, (speed, torque) in enumerate(conditions):
        level = 2.0 * (torque / 10) ** power[0] * (speed / 10) ** power[1]
        windows.append(seen([reading(60.0, speed, {"acceleration": (level, 0.01)})], speed, torque, index=i))
    lines = followed_lines(windows)
    law = law_of(None, "acceleration", lines, windows)
    assert law.name == name and law.scatter < 0.01


def test_sidebands_of_all_mesh_lines_are_one_modulation():
    windows = []
    for i, n in enumerate((10.0, 10.3, 9.9)):
        sides = [reading(19 * n * k + s * 36.4, n, {"acceleration": (0.2, 0.01)}) for k in (1, 2, 3) for s in (-1, 1)]
        windows.append(seen([*sides, reading(60.0, n, HEARD)], n, index=i, acceleration=mesh_lines(1.0)))
    found, left = modulation_of(windows, 19)
    assert found is not None and found.follows == "clock"
    assert found.frequency == pytest.approx(36.4, abs=1e-6) and found.depth == pytest.approx(0.4)
    assert [len(w.readings) for w in left] == [1, 1, 1]


def mesh_lines(size):
    keys = tuple((k, 0, 0) for k in (1, 2, 3))
    return MeasuredLines(
        unit="m/s²", keys=keys, orders=(19.0, 38.0, 57.0), amplitudes=(complex(size),) * 3, std=(0.01,) * 3
    )
