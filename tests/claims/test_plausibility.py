"""Likely mistakes in a recording: each is named with its sentence, and a clean recording has none."""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from service.stream.sources.mcap import read_windows
from tests.rules import shared_folder
from twin.plausibility import mistakes_of
from twin.rig import Rig
from twin.windows import Edges, Samples, Window

TEETH = (23, 57)
RATE = 12800.0
SPEED = 24.6
SECONDS = 12.0
G = 9.80665
RIG = Rig.from_mapping(
    {
        "gears": {"pinion": {"teeth": 23}, "gear": {"teeth": 57}},
        "operating": {"pinion_speed_hz": SPEED, "input_torque": 12.0},
    }
)


def angle_of(t, wander):
    """Pinion angle of a speed that wanders by a share, once in seven seconds."""
    return 2 * np.pi * (SPEED * t + wander * SPEED * 7 / (2 * np.pi) * np.sin(2 * np.pi * t / 7) + 0.4)


@lru_cache(maxsize=8)
def vibration(rate=RATE, wander=0.003, shift=0.0, factor=1.0, teeth=TEETH[0], highest=None, seed=1):
    """Mesh harmonics, weaker shaft lines and noise [m/s²]; `highest` lets mesh lines fold, `shift` comes late."""
    t = np.arange(int(SECONDS * rate)) / rate
    θ = angle_of(t - shift, wander) * factor
    x = 0.3 * np.random.default_rng(seed).normal(size=t.size)
    for k in range(1, 60):
        if k * teeth * SPEED * factor < (highest or 0.45 * rate):
            x += 8 / k**0.7 * np.cos(k * teeth * θ + 2.1 * k)
    for n in range(1, 40):
        x += 0.05 * np.cos(n * θ + n * n)
    return x


def edges(per_rev, ratio=1.0, wander=0.003, factor=1.0):
    t = np.linspace(0, SECONDS, 40000)
    turns = angle_of(t, wander) / (2 * np.pi) * ratio * factor
    number = np.arange(np.ceil(turns[0] * per_rev), turns[-1] * per_rev)
    return Edges(per_rev=per_rev, first_index=0, times=np.interp(number / per_rev, turns, t))


def window(sensors=None, pinion=None, gear=None, torque=None, rate=RATE):
    accelerations = {
        name: Samples(rate=rate, start=0.0, values=values) for name, values in (sensors or {"a1": vibration()}).items()
    }
    encoders = {"pinion": pinion or edges(1)}
    if gear is not None:
        encoders["gear"] = gear
    torques = {} if torque is None else {"pinion": Samples(rate=1000.0, start=0.0, values=np.full(12000, torque))}
    return Window(start_time_ns=0, accelerations=accelerations, encoders=encoders, torques=torques)


def found(w, rig=RIG):
    return mistakes_of(rig, w)


def only(w, kind, *words, rig=RIG):
    """The one mistake of a window, which must be of this kind and say these words."""
    (one,) = found(w, rig)
    assert one.kind == kind, one.text
    for word in words:
        assert word in one.text, one.text
    return one


@pytest.mark.slow
@pytest.mark.parametrize("wander", [0.0, 0.003])
def test_clean_window_has_no_mistake(wander):
    sensors = {"a1": vibration(wander=wander), "a2": 0.2 * vibration(wander=wander, seed=2) + G}
    pinion, gear = edges(1024, wander=wander), edges(512, 23 / 57, wander=wander)
    assert found(window(sensors, pinion, gear, torque=12.0)) == ()


@pytest.mark.parametrize(
    ("mean", "words"),
    [
        (1.0, ("gravity in g that was read as m/s²?", 'the unit "g"')),
        (-0.995, ("gravity in g that was read as m/s²?",)),
        (G * G, ("gravity in m/s² that was read as g?", 'the unit "m/s2"')),
        (1000 * G, ("gravity in mg that was read as g?", "scale = 0.001")),
    ],
)
def test_gravity_betrays_a_unit_that_is_off_by_9_81_or_1000(mean, words):
    only(window({"a1": vibration() + mean}), "unit", *words)


@pytest.mark.parametrize(
    ("factor", "words"),
    [(1000.0, ("mV or mg that were read as V or g?",)), (1e-6, ("V that were read as m/s²?",))],
)
def test_level_that_no_gearbox_has_is_a_wrong_unit(factor, words):
    only(window({"a1": factor * vibration()}), "unit", *words)


@pytest.mark.slow
def test_one_sensor_a_thousand_times_the_others_is_a_wrong_unit():
    sensors = {"a1": vibration(), "a2": 0.5 * vibration(seed=2), "a3": 1e-3 * vibration(seed=3)}
    one = only(window(sensors), "unit", "mV or mg against V or g?")
    assert one.channels == ("accel/a3",)


def test_offset_of_a_bias_voltage_is_named():
    only(window({"a1": vibration() + 1200.0}), "offset", "its mean is 1200 m/s²", "bias voltage", "AC-couple")


def test_torque_of_the_wrong_sign_is_its_polarity():
    only(window(torque=-12.0), "polarity", "its mean is -12 N·m, and the rig file states 12 N·m", "scale = -1")


ENCODERS = [
    (edges(1024, 23 / 57), edges(1024), "the encoders of pinion and gear are exchanged?"),
    (edges(1024), edges(1024, 2 * 23 / 57), "the gear's encoder counts twice as many edges"),
    (edges(1024, 4.0), edges(1024, 23 / 57), "the pinion's encoder counts four times as many edges"),
    (
        replace(edges(1024), per_rev=748), replace(edges(748, 23 / 57), per_rev=1024),
        "the edges per turn of the two encoders are exchanged?",
    ),
    (
        replace(edges(748, 23 / 57), per_rev=1024), replace(edges(1024), per_rev=748),
        "the columns of the two encoders are exchanged?",
    ),
]  # fmt: skip


@pytest.mark.parametrize(("pinion", "gear", "words"), ENCODERS)
def test_exchanged_encoders_are_told_by_their_ratio(pinion, gear, words):
    w = replace(window(pinion=pinion, gear=gear), accelerations={})
    only(w, "swapped", "the teeth 23/57 give 0.4035", words)


MESH = [
    (vibration(teeth=25), edges(1), "25 teeth, or a speed of 26.7"),
    (vibration(), edges(1, 23 / 57), "the gear's 57 teeth: the tachometer is on the gear, not on the pinion?"),
    (vibration(), replace(edges(2), per_rev=1), "1/2 of the speed: 2 times as many pulses a turn?"),
    (
        vibration(),
        replace(edges(1), per_rev=2),
        "2 times the speed: pulses_per_rev (edges_per_rev) is 2 times",
    ),
    (vibration(), edges(1, 1.0373), "no mesh line at 23 teeth × 25.5"),
]


@pytest.mark.parametrize(("values", "pinion", "words"), MESH)
def test_mesh_lines_that_are_not_at_teeth_times_speed_say_what_they_are(values, pinion, words):
    rig = Rig.from_mapping({"gears": RIG.values["gears"]})
    only(window({"a1": values}, pinion), "mesh", "no mesh line at 23 teeth × ", words, rig=rig)


def test_mesh_lines_above_half_the_sampling_rate_are_found_below_it():
    folded = vibration(rate=2700.0, highest=8000.0)
    only(
        window({"a1": folded}, rate=2700.0),
        "aliasing",
        "above half the sampling rate (1350 Hz)",
        "anti-aliasing filter",
    )
    assert found(window({"a1": vibration(rate=2700.0)}, rate=2700.0)) == ()


@pytest.mark.parametrize("shift", [0.25, -0.1])
def test_channel_that_comes_late_or_early_is_found_by_the_speed_that_it_follows(shift):
    late = vibration(wander=0.01, shift=shift)
    size, when = f"{abs(shift):.2g}", "later" if shift > 0 else "earlier"
    one = only(window({"a1": late}, edges(1, wander=0.01)), "shifted", when, "encoder/pinion", "trigger times")
    assert float(one.evidence.split(" s ")[0].split()[-1]) == pytest.approx(float(size), rel=0.1)


@pytest.mark.parametrize("mains", [50.0, 60.0])
def test_mains_hum_is_named_with_its_frequency(mains):
    t = np.arange(int(SECONDS * RATE)) / RATE
    tones = 3 * np.cos(2 * np.pi * mains * 1.0003 * t) + np.cos(2 * np.pi * 3 * mains * 1.0003 * t)
    only(window({"a1": vibration() + tones}), "hum", f"tones at multiples of {mains:.0f} Hz: 2.9", "ground loop")


def motor_lines(speed, orders=range(1, 13)):
    """Lines at multiples of a motor's speed, some of them strong, in noise."""
    t = np.arange(int(SECONDS * RATE)) / RATE
    rng = np.random.default_rng(3)
    strong = {2: 3.0, 4: 1.5, 8: 1.0}
    tones = sum(strong.get(n, 0.3) * np.cos(2 * np.pi * n * speed * t + rng.uniform(0, 6)) for n in orders)
    return tones + 0.2 * rng.normal(size=t.size)


def untimed(values):
    return Window(start_time_ns=0, accelerations={"a1": Samples(start=0.0, rate=RATE, values=values)})


def without_teeth(stated=None):
    return Rig.from_mapping({"operating": {"pinion_speed_hz": stated}} if stated else {})


@pytest.mark.parametrize("speed", [29.94, 24.95, 16.65, 12.48])
@pytest.mark.parametrize("stated", [False, True])
def test_harmonics_of_a_motor_are_no_mains_hum(speed, stated):
    """Harmonics 2, 4 and 8 of a motor at 29.94 Hz were "mains hum", with all of 1 to 12 there."""
    given = untimed(motor_lines(speed))
    assert [m for m in mistakes_of(without_teeth(speed if stated else None), given) if m.kind == "hum"] == []


def test_a_single_line_at_twice_a_stated_speed_is_no_mains_hum():
    given = untimed(motor_lines(29.94, (2, 4)))
    assert [m for m in mistakes_of(without_teeth(29.9), given) if m.kind == "hum"] == []
    assert [m.kind for m in mistakes_of(without_teeth(17.3), given) if m.kind == "hum"] == ["hum"]


def test_a_tone_that_no_grid_has_is_no_mains_hum():
    given = untimed(motor_lines(29.85, (2,)))
    assert [m for m in mistakes_of(without_teeth(), given) if m.kind == "hum"] == []


def test_mains_hum_beside_a_turning_motor_is_still_named():
    t = np.arange(int(SECONDS * RATE)) / RATE
    given = untimed(motor_lines(23.4) + 4 * np.cos(2 * np.pi * 50.01 * t))
    assert [m.kind for m in mistakes_of(without_teeth(23.4), given) if m.kind == "hum"] == ["hum"]


@pytest.mark.parametrize("seed", range(5))
def test_noise_alone_says_nothing(seed):
    noise = np.random.default_rng(seed).normal(size=int(SECONDS * RATE))
    assert found(window({"a1": noise})) == ()


@pytest.mark.parametrize("name", ["short-campaign", "faulty-campaign", "paper-campaign"])
def test_bundled_recordings_have_no_mistake(name):
    rig, _, windows = read_windows(Path(f"recordings/{name}.mcap"))
    said = [m.text for w in windows for m in mistakes_of(Rig.from_mapping(rig), w)]
    assert said == []


@pytest.mark.shared
@pytest.mark.slow
@pytest.mark.parametrize("name", [f"D{i:02d}" for i in range(14)])
def test_reference_campaigns_have_no_mistake(name):
    rig, _, windows = read_windows(shared_folder() / "campaigns" / f"{name}.mcap")
    said = [m.text for w in windows for m in mistakes_of(Rig.from_mapping(rig), w)]
    assert said == []
