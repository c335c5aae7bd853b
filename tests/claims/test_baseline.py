"""A machine without a rig model: what is new is found by its orders and its angle, and what is not new is left alone.

The machine here is made of lines at the orders of its shafts, every tooth its own; the code under test knows the tooth
counts and the nominal speed.
"""

import json
from dataclasses import replace
from fractions import Fraction
from functools import lru_cache

import numpy as np
import pytest

from service.contract.estimate import step
from twin.assessment import Unavailable
from twin.baseline.alignment import align
from twin.baseline.causes import causes_of
from twin.baseline.diagnosis import WindowParts, diagnose
from twin.baseline.leaving_out import learn
from twin.baseline.reading import angle_of, read
from twin.baseline.spacing import SpacingThresholds, simple_ratio, unattributed_spacings
from twin.baseline.transfer_path import Path, band_gains, common_level, name_of_path
from twin.effects import EFFECTS
from twin.errors import NotAvailable, ParameterError, WindowError
from twin.options import Options
from twin.rig import Rig
from twin.state import LatestParts, State
from twin.windows import Edges, Samples, Window

TEETH = (20, 30)
RATE = 4096.0
SPEED = 16.0  # [Hz]
THIRD = Fraction(1, 4)
RIG = Rig.from_mapping({
    "gears": {"pinion": {"teeth": TEETH[0]}, "gear": {"teeth": TEETH[1]}},
    "operating": {"pinion_speed_hz": SPEED},
})  # fmt: skip
SHAFTS = (Fraction(1), Fraction(*TEETH))


def machine(
    load: float, seed: int, *, nominal=SPEED, metered=False, teeth_seed=7, gain=None, pulse=0.0, third=False,
    seconds=8.0, foreign=None, mesh=1.0,
):  # fmt: skip
    """One window: speed falls a little with load, lines grow with it, the zero of the angle is anywhere.

    nominal  speed without load [Hz]
    metered  whether there are a torque meter, 20 N·m at full load, and a tachometer of one edge a turn
    gain   of the way to sensor b, a function of frequency
    pulse  height of a blow once a turn of the gear [m/s²]
    third  whether another shaft is geared to the pinion
    mesh     factor on the mesh lines
    foreign  order of a modulation of the mesh lines that no shaft makes
    """
    rng, pattern = np.random.default_rng(seed), np.random.default_rng(teeth_seed)
    speed = nominal * (1 - 0.01 * load)
    t = np.arange(int(seconds * RATE)) / RATE
    θ = 2 * np.pi * (speed * t + rng.uniform(0, 12))
    orders = np.arange(1, 80 * 3) / 3  # hunting lines: pinion 1, gear 2/3
    shafts = np.array([k % 3 == 0 or k % 2 == 0 for k in range(1, 80 * 3)])
    size = np.where(shafts, 0.05, 0.004) * np.abs(
        pattern.normal(size=orders.size) + 1j * pattern.normal(size=orders.size)
    )
    phase = pattern.uniform(0, 2 * np.pi, orders.size)
    meshing = np.abs(orders % TEETH[0]) < 1e-9
    size = np.where(meshing, mesh * 2.0 / (orders / TEETH[0]), size) * (0.6 + 0.8 * load)
    phase = phase + 0.4 * load * pattern.normal(size=orders.size)
    out = {}
    lines = {}
    for sensor, seed_of_way in (("a", 1), ("b", 2)):
        turn = np.random.default_rng(seed_of_way).uniform(-1, 1, orders.size)
        way = np.ones(orders.size) if gain is None or sensor == "a" else np.asarray(gain(orders * speed))
        lines[sensor] = size * way * np.exp(1j * (phase + turn))
    modulated = meshing if foreign is not None else np.zeros(orders.size, bool)
    summed = _waves(θ, lines, ~modulated), _waves(θ, lines, modulated)
    for sensor in lines:
        x = summed[0][sensor]
        if foreign is not None:
            x = x + (1 + 0.2 * np.cos(foreign * θ)) * summed[1][sensor]
        if third:
            for n in (1, 2, 3, 5):
                x += 0.15 * np.cos(n * float(THIRD) * θ + n)
            for h in (1, 2, 3):
                x += 0.3 * np.cos(h * TEETH[0] * θ) * (np.cos(float(THIRD) * θ) + np.cos(2 * float(THIRD) * θ + 1))
        if pulse and sensor == "a":
            turns = θ * TEETH[0] / TEETH[1] / (2 * np.pi)
            x += pulse * np.exp(-0.5 * (((turns + 0.3) % 1 - 0.5) / 0.02) ** 2)
        out[sensor] = Samples(start=0.0, rate=RATE, values=x + 0.2 * rng.normal(size=t.size))
    if not metered:
        return Window(start_time_ns=seed, accelerations=out)
    turns = np.arange(np.ceil(θ[0] / (2 * np.pi)), np.floor(θ[-1] / (2 * np.pi)) + 1)
    edges = Edges(per_rev=1, first_index=int(turns[0]), times=(2 * np.pi * turns - θ[0]) / (2 * np.pi * speed))
    torque = Samples(start=0.0, rate=100.0, values=np.full(int(100 * seconds), 20 * load))
    return Window(start_time_ns=seed, accelerations=out, torques={"pinion": torque}, encoders={"pinion": edges})


def _waves(θ, lines, chosen):
    """Of each sensor the real part of Σ a_k e^{ikθ/3} over the lines a_k, k = 1, 2, …, that are chosen."""
    out = {sensor: np.zeros(θ.size) for sensor in lines}
    step = np.exp(1j * θ / 3)
    wave = np.ones(θ.size, complex)
    for k in range(np.flatnonzero(chosen).max(initial=-1) + 1):
        wave *= step
        if chosen[k]:
            for sensor, a in lines.items():
                out[sensor] += a[k].real * wave.real - a[k].imag * wave.imag
    return out


def parts(window, shafts=SHAFTS, name="w"):
    track = angle_of(RIG, window)
    whole = read(RIG, window, shafts, name, track)
    halves = [read(RIG, window, shafts, name, track, p) for p in ((0.0, 0.5), (0.5, 1.0))]
    return WindowParts(whole=whole, first=halves[0], second=halves[1])


@lru_cache(maxsize=1)
def healthy():
    loads = np.linspace(0.1, 0.9, 6)
    return learn(RIG, [parts(machine(load, i), name=f"h{i}").whole for i, load in enumerate(loads)], SHAFTS)


def found(**what):
    return diagnose(healthy(), [parts(machine(0.42, 99, **what))])


def test_pattern_of_the_teeth_tells_the_angle_between_two_windows():
    rng = np.random.default_rng(2)
    lines = {"a": rng.normal(size=300) + 1j * rng.normal(size=300)}
    turned = {"a": lines["a"] * np.exp(1j * np.arange(1, 301) / 3 * 5.1)}
    at = align(lines, turned, 3, 20)
    assert at.correlation > 0.99
    assert at.angle == pytest.approx(5.1, abs=2e-3)
    back = at.turned(turned["a"], 3)
    assert np.abs(back - lines["a"]).max() < 0.05 * np.abs(lines["a"]).max()
    assert align(lines, {"b": lines["a"]}, 3, 20) is None


@pytest.mark.slow
@pytest.mark.parametrize("load", [0.3, 0.42, 0.7])
def test_healthy_machine_at_a_load_not_learned_has_nothing_added(load):
    diagnosis = diagnose(healthy(), [parts(machine(load, 50))])
    assert diagnosis.effects == () and diagnosis.verdict == "explained"
    for errors in diagnosis.errors.values():
        assert abs(errors.rms_before) < 0.1
        assert errors.waveform_after == errors.waveform_before


def test_blow_once_a_turn_of_the_gear_is_a_local_fault_of_a_tooth_of_that_shaft():
    diagnosis = found(pulse=2.0)
    (effect,) = diagnosis.effects
    assert effect.name == "tooth_crack" and effect.channels == ("a",)
    assert effect.parameters["shaft_order"].value == pytest.approx(2 / 3)
    assert effect.parameters["width"].value < 0.3
    assert effect.over_runner_up > 100
    errors = diagnosis.errors["a"]
    assert errors.waveform_after < errors.waveform_before


def test_fault_stays_at_its_angle_of_the_shaft_wherever_the_zero_of_a_window_lies():
    angles = []
    for seed in (99, 7, 23):
        diagnosis = diagnose(healthy(), [parts(machine(0.42, seed, pulse=2.0))])
        (effect,) = diagnosis.effects
        angles.append(effect.parameters["angle"].value)
        curve = effect.curves
        highest = curve["turn"][int(np.argmax(curve["added"]))]
        assert abs((highest - angles[-1] + 0.5) % 1 - 0.5) < 0.02
    assert np.abs((np.array(angles) - angles[0] + 0.5) % 1 - 0.5).max() < 0.01


@pytest.mark.slow
@pytest.mark.parametrize(("gain", "name"), [
    (lambda f: np.full(f.size, 0.6 + 0j), "sensor_gain"),
    (EFFECTS["sensor_resonance"](frequency=700.0, damping_ratio=0.2).response, "sensor_resonance"),
])  # fmt: skip
def test_changed_way_to_one_sensor_is_no_fault_of_the_gears(gain, name):
    diagnosis = found(gain=gain)
    (effect,) = diagnosis.effects
    assert effect.name == name and effect.channels == ("b",)
    if name == "sensor_gain":
        assert effect.parameters["gain"].value == pytest.approx(0.6, rel=0.05)
    else:
        assert effect.parameters["frequency"].value == pytest.approx(700.0, rel=0.05)
        assert effect.parameters["damping_ratio"].value == pytest.approx(0.2, rel=0.3)
    errors = diagnosis.errors["b"]
    assert errors.waveform_after < 0.5 * errors.waveform_before
    assert abs(errors.rms_after) < 0.5 * abs(errors.rms_before)


def test_mesh_that_does_otherwise_on_every_tooth_alike_is_one_class_that_wear_belongs_to():
    diagnosis = found(mesh=1.3)
    (effect,) = diagnosis.effects
    assert effect.name == "mesh_change"
    assert set(effect.indistinguishable_from) >= {"wear", "misalignment", "tooth_friction", "mesh_stiffness_loss"}


def test_other_gears_in_the_same_machine_are_said_to_be_other_gears():
    diagnosis = found(teeth_seed=11)
    assert diagnosis.verdict == "unknown_effect" and "other gears" in diagnosis.reason
    assert not [e for e in diagnosis.effects if e.name == "tooth_crack"]


def test_exchanged_channels_are_said_to_be_exchanged_before_a_diagnosis():
    window = machine(0.42, 99)
    exchanged = {"a": window.accelerations["b"], "b": window.accelerations["a"]}
    with pytest.raises(NotAvailable, match="a and b seem exchanged"):
        diagnose(healthy(), [parts(replace(window, accelerations=exchanged))])
    assert healthy().swapped(parts(window).whole) is None


def test_load_beyond_the_baseline_is_said_to_be_beyond_and_finds_nothing():
    diagnosis = diagnose(healthy(), [parts(machine(1.1, 51))])
    assert diagnosis.effects == ()
    assert not diagnosis.compared[0].expected.interpolated and "beyond" in diagnosis.reason


@pytest.mark.parametrize("seed", [51, 52, 53])
def test_far_beyond_the_baseline_no_sensor_is_blamed_for_what_both_show_and_nothing_is_called_explained(seed):
    diagnosis = diagnose(healthy(), [parts(machine(1.6, seed))])
    assert diagnosis.effects == () and diagnosis.verdict == "insufficient_data"
    assert "times the baseline's level" in diagnosis.reason and "beyond" in diagnosis.reason


@pytest.mark.slow
def test_one_sensor_that_has_changed_is_no_common_level_and_one_sensor_alone_is_indistinguishable_from_the_machine():
    changed = np.full(12, 0.5 + 0j)
    assert common_level([changed, np.ones(12)]) == 0.0
    assert common_level([changed, 0.55 * np.ones(12)]) == pytest.approx(np.log(0.55))
    loads = (0.3, 0.35, 0.4, 0.45, 0.5)
    alone = learn(RIG, [of_a(parts(machine(load, i), name=f"h{i}").whole) for i, load in enumerate(loads)], SHAFTS)
    window = machine(0.42, 99)
    halved = {"a": replace(window.accelerations["a"], values=0.5 * window.accelerations["a"].values)}
    diagnosis = diagnose(alone, [WindowParts(whole=of_a(parts(replace(window, accelerations=halved)).whole))])
    (effect,) = diagnosis.effects
    assert effect.name == "sensor_gain" and any("machine as a whole" in said for said in effect.indistinguishable_from)


def of_a(reading):
    return replace(reading, channels={"a": reading.channels["a"]})


def path_of(orders, gain, change):
    """A path whose response has changed by a factor at each order."""
    level = np.abs(gain)
    by = {"common": 0.0, "common_power": 0.0, "usual": 0.1, "over_usual": 2.0}
    return Path(channel="a", orders=orders, gain=gain, level=level, change=change, **by)


@pytest.mark.slow
def test_two_resonances_that_cancel_are_no_resonance_that_moved():
    f = np.arange(4.0, 200.0, 8.0)
    rng = np.random.default_rng(2)
    gain = 1.39 * np.exp(0.05 * (rng.normal(size=f.size) + 1j * rng.normal(size=f.size)))
    named = name_of_path(
        path_of(f, gain, change=0.3),
        30.0,
    )
    assert named.name == "sensor_gain" and named.parameters["gain"][0] == pytest.approx(1.39, rel=0.05)


@pytest.mark.slow
def test_resonance_that_has_moved_is_told_with_both_places():
    f = np.arange(4.0, 200.0, 8.0)
    now, before = (EFFECTS["sensor_resonance"](frequency=a, damping_ratio=b) for a, b in ((1200.0, 0.3), (2700.0, 0.1)))
    gain = now.response(30 * f) / before.response(30 * f)
    named = name_of_path(
        path_of(f, gain, change=1.0),
        30.0,
    )
    assert named.name == "sensor_resonance" and named.left < 0.01
    assert named.parameters["frequency"][0] == pytest.approx(1200, rel=0.01)
    assert named.parameters["frequency_before"][0] == pytest.approx(2700, rel=0.01)


def test_gain_of_a_path_is_not_moved_by_what_one_shaft_does():
    rng = np.random.default_rng(4)
    x = rng.normal(size=240) + 1j * rng.normal(size=240)
    y, σ = 0.8 * x, np.full(240, 0.1)
    y[::12] += 20.0
    _, gain = band_gains(x, y, σ, np.arange(1, 241) / 3)
    assert np.abs(gain - 0.8).max() < 0.06


def clearest(window, track):
    spacings = unattributed_spacings(window.accelerations, track, TEETH, SHAFTS).spacings
    return spacings[0] if spacings else None


def test_shaft_that_the_rig_file_does_not_name_is_found_by_the_spacing_of_its_lines():
    window = machine(0.5, 3, third=True)
    spacing = clearest(window, angle_of(RIG, window))
    assert spacing.ratio == THIRD and spacing.log_chance < spacing.next_log_chance - 5
    plain = machine(0.5, 3)
    assert clearest(plain, angle_of(RIG, plain)) is None


@pytest.mark.slow
def test_modulation_of_any_order_of_its_own_is_said_with_its_uncertainty_and_is_no_shaft():
    rng, off, geared = np.random.default_rng(11), [], 0
    for seed, order in enumerate(rng.uniform(0.35, 0.95, 16)):
        window = machine(0.5, seed, foreign=order)
        try:
            track = angle_of(RIG, window)
        except NotAvailable:  # the modulated lines make a comb beside the mesh's: refused
            continue
        spacing = clearest(window, track)
        if spacing is not None and abs(spacing.order - order) < 0.02:  # else it has met a multiple
            off.append((spacing.order - order) / spacing.std)
            geared += spacing.ratio is not None
    assert len(off) >= 8 and np.max(np.abs(off)) < 4
    assert geared <= 4  # 16 draws at a chance of 0.05: five or more once in 1000


def test_ratio_of_small_numbers_is_believed_where_chance_would_rarely_lie_as_near():
    assert simple_ratio(0.25002, 1e-4) == Fraction(1, 4)
    assert simple_ratio(0.1501, 2e-5) is None  # five deviations away, and nothing simple near it
    assert simple_ratio(0.15001, 2e-5) == Fraction(3, 20)
    assert simple_ratio(0.15001, 4e-4) is None  # as near to some ratio as simple lies every third order
    orders, std = np.random.default_rng(3).uniform(0, 1, 4000), 3e-5
    assert np.mean([simple_ratio(order, std) is not None for order in orders]) <= SpacingThresholds().chance + 0.01


def test_modulation_that_no_shaft_makes_is_named_by_its_frequency_with_depth_and_causes():
    order = 0.3961
    window = machine(0.5, 3, foreign=order, seconds=12.0)
    track = angle_of(RIG, window)
    spacing = clearest(window, track)
    assert abs(spacing.order - order) * track.speed < 0.02
    first = next(s for s in spacing.sidebands if s.harmonic == 1 and s.multiple == 1)
    assert first.depth == pytest.approx(0.2, rel=0.1)
    causes = {c.name: c.possible for c in causes_of(order, 1e-4, track.speed, SHAFTS, ("pinion", "gear"))}
    assert causes["cage of a bearing on the pinion"]
    assert not causes["a multiple of the pinion's rotation"] and not causes["mains of 50 Hz"]


def test_window_too_short_to_tell_lines_apart_and_baseline_of_one_window_are_refused():
    short = machine(0.5, 3, seconds=0.6)
    with pytest.raises(WindowError, match="turns are too few"):
        read(RIG, short, SHAFTS, "short")
    with pytest.raises(ParameterError, match="at least two recordings"):
        learn(RIG, [parts(machine(0.5, 3)).whole], SHAFTS)


@pytest.mark.slow
def test_service_step_says_what_is_new_beside_a_baseline_once_and_leaves_wear_alone():
    state, options = State(), Options(baseline=healthy())
    told = []
    for what in ({}, {"pulse": 2.0}, {"pulse": 2.0}):
        window = replace(machine(0.42, 99, **what), start_time_ns=len(told) * 10**10)
        state, estimate = step(RIG, State.from_dict(json.loads(json.dumps(state.to_dict()))), window, options)
        told.append((estimate.report, [data["name"] for kind, data in estimate.events if kind == "effect"]))
    assert [events for _, events in told] == [[], ["tooth_crack"], []]
    assert [[e["name"] for e in report["effects"]] for report, _ in told] == [[], ["tooth_crack"], ["tooth_crack"]]
    for report, _ in told:
        assert report["wear"]["status"] == report["rul"]["status"] == "not available"
    assert told[1][0]["baseline"]["window"]["same_teeth"]


@pytest.mark.slow
def test_what_is_no_longer_there_is_no_longer_said_and_no_baseline_takes_the_answer_of_a_twin():
    state, options = State(), Options(baseline=healthy(), trace=False)
    names = []
    for i, what in enumerate(({"pulse": 2.0}, {})):
        window = replace(machine(0.42, 99, **what), start_time_ns=i * 10**10)
        state, estimate = step(RIG, state, window, options)
        names.append([e["name"] for e in estimate.report["effects"]])
    assert names == [["tooth_crack"], []]
    latest = LatestParts(wear=Unavailable(reason="said by an earlier window"))
    after, estimate = step(RIG, replace(State(), latest=latest), machine(0.42, 99), options)
    assert estimate.report["wear"]["reason"] == "said by an earlier window"
    assert after.latest.wear == latest.wear


def test_baseline_of_other_tooth_counts_is_said_not_to_fit():
    other = Rig.from_mapping({
        "gears": {"pinion": {"teeth": 20}, "gear": {"teeth": 31}}, "operating": {"pinion_speed_hz": SPEED},
    })  # fmt: skip
    _, estimate = step(other, State(), machine(0.42, 99), Options(baseline=healthy()))
    assert estimate.report["unexplained"]["verdict"] == "insufficient_data"
    assert estimate.report["effects"] == []


@pytest.mark.slow
def test_step_without_a_baseline_names_strange_lines_and_takes_a_further_shaft_for_no_effect():
    _, modulated = step(RIG, State(), machine(0.5, 3, foreign=0.3961, seconds=12.0))
    assert modulated.report["unexplained"]["verdict"] == "unknown_effect"
    assert modulated.report["unattributed_lines"][0]["order"] == pytest.approx(0.3961, abs=1e-3)
    _, geared = step(RIG, State(), machine(0.5, 3, third=True))
    assert geared.report["unattributed_lines"][0]["geared"] == "1/4"
    assert geared.report["unexplained"]["verdict"] != "unknown_effect"


@pytest.mark.parametrize("wrong", [0.985, 1.01, 1.025])
def test_sampling_rate_that_the_tachometer_contradicts_is_caught_before_a_diagnosis(wrong):
    window = machine(0.3, 5, metered=True)
    angle_of(RIG, window)  # the right rate is taken
    channels = {k: replace(s, rate=wrong * s.rate) for k, s in window.accelerations.items()}
    with pytest.raises(NotAvailable, match=r"mesh lines lie at .* Hz, but encoder/pinion turns 20 teeth at .* % "):
        angle_of(RIG, replace(window, accelerations=channels))
