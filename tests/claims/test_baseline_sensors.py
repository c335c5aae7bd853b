"""Sensors compete with faults: what a sensor does is never a fault of the gears; what no sensor does stays one."""

from dataclasses import replace

import numpy as np
import pytest

from tests.claims.test_baseline import RATE, RIG, SHAFTS, SPEED, healthy, machine, parts
from twin.baseline.diagnosis import diagnose
from twin.baseline.findings import compare
from twin.baseline.low_frequency import low_frequency_rival
from twin.baseline.off_line_changes import DEFAULT, OffLineChange, added_noise, off_line_changes, student_evidence
from twin.baseline.off_line_findings import _of_mains
from twin.baseline.off_lines import TONE_BLOCK, OffLines, off_lines
from twin.baseline.reading import angle_of
from twin.baseline.sensor_timing import timing_changes
from twin.windows import Samples

GEARS = {"tooth_crack", "mesh_change", "pitch_error", "gear_eccentricity", "pinion_eccentricity"}


def spoiled(change, sensor="b", seed=99):
    window = machine(0.42, seed)
    x = window.accelerations[sensor]
    values = np.asarray(change(x.values.copy()))
    return replace(window, accelerations={**window.accelerations, sensor: replace(x, values=values)})


def cut(x):
    x[1000:1800] = x[1000]
    return x


@pytest.mark.slow
@pytest.mark.parametrize(("change", "name"), [
    (lambda x: -x, "sensor_polarity"),
    (lambda x: np.clip(x, -1.5 * x.std(), 1.5 * x.std()), "sensor_clipping"),
    (lambda x: 1e-4 * np.random.default_rng(1).normal(size=x.size), "sensor_dead"),
    (cut, "sensor_dead_time"),
    (lambda x: x + 1.5 * x.std() * np.random.default_rng(1).normal(size=x.size), "sensor_noise"),
    (lambda x: x + 0.5 * np.cos(2 * np.pi * 50 * np.arange(x.size) / RATE), "hum"),
])  # fmt: skip
def test_what_a_sensor_does_is_named_and_is_no_fault_of_the_gears(change, name):
    diagnosis = diagnose(healthy(), [parts(spoiled(change))])
    names = {e.name for e in diagnosis.effects}
    assert not names & GEARS
    assert name in names
    assert all(e.channels == ("b",) for e in diagnosis.effects if e.name == name)


@pytest.mark.slow
def test_healthy_window_has_no_changed_timing():
    for seed, load in ((50, 0.3), (51, 0.7)):
        assert timing_changes(healthy(), parts(machine(load, seed)).whole) == ()


def test_impacts_that_ring_are_seen_in_the_envelope_of_their_band_and_by_their_order():
    rng = np.random.default_rng(4)
    window = machine(0.42, 99)
    track = angle_of(RIG, window)
    t = np.arange(int(8.0 * RATE)) / RATE
    order, speed = 3.57, SPEED * (1 - 0.0042)
    phase = (order * speed * t) % 1 / (order * speed)
    ring = 3 * np.exp(-400 * phase) * np.sin(2 * np.pi * 1200 * phase)
    quiet = Samples(start=0.0, rate=RATE, values=0.2 * rng.normal(size=t.size))
    struck = replace(quiet, values=quiet.values + ring)
    before, after = (off_lines(x, track, SHAFTS, RIG.teeth[0]) for x in (quiet, struck))
    rise = dict(zip(after.names, after.values - before.values, strict=True))
    assert max(rise[name] for name in rise if name.startswith("impacts of no shaft")) > 3
    assert after.free_order == pytest.approx(order, rel=0.01)


def test_modulation_of_the_mesh_once_a_turn_is_no_impact_once_a_turn_and_a_struck_turn_is():
    """Half of the mesh's amplitude comes and goes with the turn; an impact of the same RMS rings once a turn."""
    rng = np.random.default_rng(5)
    window = machine(0.42, 99)
    track = angle_of(RIG, window)
    t = np.arange(int(8.0 * RATE)) / RATE
    turn, mesh = 2 * np.pi * SPEED * (1 - 0.0042) * t, RIG.teeth[0]
    tone = sum(np.cos(k * mesh * turn) / k for k in (1, 2, 3))
    sound = Samples(start=0.0, rate=RATE, values=tone + 0.1 * rng.normal(size=t.size))
    modulated = replace(sound, values=sound.values + 0.5 * np.cos(turn) * tone)
    since = (turn / (2 * np.pi)) % 1 / (SPEED * (1 - 0.0042))
    ring = np.exp(-400 * since) * np.sin(2 * np.pi * 1200 * since)
    ring *= np.std(0.5 * np.cos(turn) * tone) / np.std(ring)
    struck = replace(sound, values=sound.values + ring)
    before, with_modulation, with_impacts = (
        off_lines(x, track, SHAFTS, RIG.teeth[0]) for x in (sound, modulated, struck)
    )
    once = [i for i, name in enumerate(before.names) if name.startswith("impacts once a turn of order 1 ")]
    assert once, before.names
    rises = [np.max((x.values - before.values)[once]) for x in (with_modulation, with_impacts)]
    assert rises[1] > 3 > 1 > rises[0]


def test_smooth_gain_of_low_frequencies_is_a_rival_only_where_the_healthy_machine_has_these_lines():
    compared = compare(healthy(), parts(machine(0.42, 99)).whole)
    change = next(c for c in compared.changes if float(c.shaft) < 1)
    at = np.rint(change.multiples * float(change.shaft) * compared.reading.period).astype(int) - 1

    def with_lines(values):
        channel = compared.reading.channels[change.channel]
        lines = channel.lines.copy()
        lines[at] = values
        reading = replace(compared.reading, channels={change.channel: replace(channel, lines=lines)})
        return replace(compared, reading=reading)

    x = compared.expected.lines[change.channel][at]
    f = change.multiples.astype(float)
    rival = low_frequency_rival(with_lines(x * (0.6 + 2.0 / f)), change)
    assert rival is not None and rival.left < 0.1 and rival.gain[0] > rival.gain[2]
    pulse = 5 * np.abs(x).max() * np.exp(2j * np.pi * 0.3 * f)
    assert low_frequency_rival(with_lines(x + pulse), change) is None


def test_evidence_of_a_reversed_sensor_is_that_of_its_lines_and_a_dead_one_has_none():
    found = diagnose(healthy(), [parts(spoiled(lambda x: -x))])
    (turned,) = [e for e in found.effects if e.name == "sensor_polarity"]
    x, σ = found.compared[0].expected.lines["b"], found.compared[0].expected.std["b"]
    assert turned.log_evidence == pytest.approx(np.sum(np.abs(2 * x) ** 2 / σ**2), rel=0.1)  # −x instead of x
    dead = diagnose(healthy(), [parts(spoiled(lambda x: 0 * x))])
    (named,) = [e for e in dead.effects if e.name == "sensor_dead"]
    assert named.log_evidence is None


def test_white_noise_is_told_from_noise_of_one_band():
    """Floors of six bands, ŷ from −4 to 1; white noise of RMS r adds r²·ln 2 to the median of every band's power."""
    y, rms, std = np.linspace(-4.0, 1.0, 6), 0.5, 0.05
    risen = 0.5 * np.log1p(rms**2 * np.log(2) * np.exp(-2 * y))
    found = added_noise([floor(i, y[i], change, std) for i, change in enumerate(risen)], 1)
    assert found is not None and found.rms == pytest.approx(rms, rel=0.02)
    assert found.deviation == pytest.approx(np.sqrt(np.sum((risen / std) ** 2)), rel=0.01)
    assert added_noise([floor(i, y[i], change, std) for i, change in enumerate(risen[::-1])], 1) is None


def floor(i, expected, change, std):
    return OffLineChange(
        channel="b", measure=f"noise floor {i}", expected=expected, change=float(change),
        deviation=float(change / std), freedom=16, tried=80,
    )  # fmt: skip


@pytest.mark.parametrize(("frequency", "duration", "hum"), [
    (50.1, 8.0, True), (200.7, 8.0, True), (299.0, 8.0, True), (49.2, 1.0, True), (49.2, 8.0, False),
    (57.3, 1.0, False),
])  # fmt: skip
def test_a_tone_is_hum_within_what_its_spectrum_and_the_grid_leave_open(frequency, duration, hum):
    tone = OffLineChange(
        channel="b", measure="tone 0 to 20 Hz", expected=0.0, change=1.0, deviation=9.0, freedom=12, tried=80
    )
    off = OffLines(names=("tone 0 to 20 Hz",), values=np.zeros(1), tones=(frequency,), free_order=0.0, clipped=0.0,
                   constant=0.0)  # fmt: skip
    assert bool(_of_mains([tone], [tone], off, 1 / min(TONE_BLOCK, duration), DEFAULT)) is hum


def test_evidence_of_a_deviation_is_students_and_pays_for_what_was_tried():
    """With many degrees of freedom it is that of a normal density: z²/2 less ln of the number tried."""
    assert student_evidence(36.0, 10**6, 100) == pytest.approx(18 - np.log(100), rel=1e-3)
    assert student_evidence(36.0, 16, 1) < 18


def test_distance_from_the_recordings_widens_a_prediction_once():
    """By the interval of the line through them or by what lies between them, whichever is more; never by both."""
    base, reading = healthy(), parts(machine(1.0, 60)).whole
    u, at = np.array([r.speed_hz for r in base.readings]), reading.speed_hz
    interval = np.sqrt(1 + 1 / u.size + (at - u.mean()) ** 2 / np.sum((u - u.mean()) ** 2))
    plain, less, more = (
        {(c.channel, c.measure): c.deviation for c in off_line_changes(base, reading, wider)}
        for wider in (1.0, 0.99 * interval, 2 * interval)
    )
    assert less == plain
    assert all(more[key] == pytest.approx(z / 2) for key, z in plain.items())


def test_recording_of_a_quarter_of_the_length_must_deviate_twice_as_far_but_for_the_level():
    """Its measures come from a quarter of the blocks; one that is longer is no more certain than the healthy ones."""
    base, reading = healthy(), parts(machine(0.42, 60)).whole
    usual = np.median([r.duration for r in base.readings])
    whole, quarter, longer = (
        {(c.channel, c.measure): c.deviation for c in off_line_changes(base, replace(reading, duration=share * usual))}
        for share in (1.0, 0.25, 4.0)
    )
    assert longer == whole
    for (channel, measure), z in whole.items():
        factor = 1.0 if measure.startswith("level") else 2.0
        assert quarter[channel, measure] == pytest.approx(z / factor)


def test_sensor_of_which_nothing_is_left_does_not_hide_the_speed_of_the_others():
    window = spoiled(lambda x: 1e-4 * np.random.default_rng(1).normal(size=x.size))
    assert angle_of(RIG, window).speed == pytest.approx(angle_of(RIG, machine(0.42, 99)).speed, rel=1e-4)


def test_sensor_is_not_called_late_where_the_others_have_changed():
    """Their resonances turn the angle that they tell; then nothing is said of the timing of any."""
    window = machine(0.42, 99)
    rng = np.random.default_rng(3)
    a = window.accelerations["a"]
    scrambled = np.fft.rfft(a.values) * np.exp(2j * np.pi * rng.uniform(size=a.values.size // 2 + 1))
    other = replace(a, values=np.fft.irfft(scrambled, a.values.size))
    late = replace(window, accelerations={**window.accelerations, "a": other})
    assert [t.channel for t in timing_changes(healthy(), parts(late).whole)] == []


@pytest.mark.parametrize("factor", [0.001, 0.002, 0.0102])
def test_all_sensors_that_fall_by_one_factor_have_a_wrong_unit_and_are_not_dead(factor):
    window = machine(0.42, 99)
    less = {name: replace(x, values=factor * x.values) for name, x in window.accelerations.items()}
    diagnosis = diagnose(healthy(), [parts(replace(window, accelerations=less))])
    (named,) = [e for e in diagnosis.effects if e.name.startswith("sensor_")]
    assert named.name == "sensor_unit" and set(named.channels) == set(window.accelerations)
    assert "unit, sensitivity or scale" in named.detail


@pytest.mark.slow
def test_sensors_that_fall_by_different_factors_are_dead_each():
    window = machine(0.42, 99)
    less = {
        name: replace(x, values=factor * x.values)
        for factor, (name, x) in zip((0.01, 0.0001), window.accelerations.items(), strict=True)
    }
    names = [e.name for e in diagnose(healthy(), [parts(replace(window, accelerations=less))]).effects]
    assert "sensor_unit" not in names and names.count("sensor_dead") == 2
