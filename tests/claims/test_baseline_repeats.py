"""Against a baseline, only what the healthy recordings repeat: each of them left out in turn."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from service.contract.parts import Baseline as Contract
from service.files.baseline import Loaded, answer, load, modulation_of, read_baseline, save
from service.report.baseline import comparison_text, learned_text
from service.stream.sources.mcap import read_windows
from tests.claims.healthy_machines import Machine
from tests.instrument_faults import clock
from twin.baseline.comparison import (
    TrackedWindow,
    compare_levels,
    compare_with_baseline,
    described,
    pair_shafts,
    read_lines,
    tracked,
)
from twin.baseline.known_spacings import new_spacings
from twin.baseline.learned import Baseline
from twin.baseline.leaving_out import is_repeated, learn
from twin.baseline.modulation import least_new
from twin.baseline.off_line_changes import student_limit
from twin.baseline.reading import SpacingSeen
from twin.baseline.recordings import counted
from twin.baseline.repeats import LINES, PATTERN, RAW, SPACINGS, factor_of
from twin.baseline.shaft_names import belonging
from twin.baseline.sufficiency import thin_for_teeth
from twin.baseline.transfer_path import over_usual
from twin.errors import ParameterError
from twin.windows import Samples

RECORDINGS = 7
PLAIN = Machine(seed=1)
NO_PATTERN = (
    Machine(seed=0, repeats=False),
    Machine(seed=2, repeats=False),
    Machine(seed=8, repeats=False, rate=10000.0, axes=3),
)
# spacings of the healthy machine in hertz, which are no shaft's
FOREIGN = (Machine(seed=0, foreign_hz=6.47), Machine(seed=3, foreign_hz=137.7), Machine(seed=5, foreign_hz=3.31))


def window(machine: Machine, recording: int, name: str | None = None, **what) -> TrackedWindow:
    given = machine.window(recording, **what)
    return tracked(machine.rig, given, name or f"h{recording}#{what.get('part', 0)}", pair_shafts(machine.rig))


@lru_cache(maxsize=12)
def readings(machine: Machine, count: int = RECORDINGS):
    shafts = pair_shafts(machine.rig)
    return tuple(read_lines(machine.rig, window(machine, i), shafts) for i in range(count))


@lru_cache(maxsize=12)
def baseline(machine: Machine) -> Baseline:
    return learn(machine.rig, readings(machine), pair_shafts(machine.rig))


def compared(machine: Machine, recording: int = 100, **what):
    return compare_with_baseline(baseline(machine), machine.rig, [window(machine, recording, "new#0", **what)])


def is_changed(found) -> bool:
    return bool(found.effects) or found.unexplained.verdict == "unknown_effect"


@pytest.mark.slow
@pytest.mark.parametrize("machine", NO_PATTERN)
@pytest.mark.parametrize("recording", [100, 101])
def test_a_healthy_recording_is_not_of_other_gears_where_healthy_recordings_do_not_repeat_their_teeth(
    machine, recording
):
    """Every healthy recording was "other gears, another assembly", in the words used for every faulty one."""
    assert not baseline(machine).repeats.pattern_compared
    found = compared(machine, recording)
    assert not is_changed(found), found.unexplained.reason
    assert not found.windows[0].pattern_compared


@pytest.mark.parametrize("machine", NO_PATTERN)
def test_what_is_not_compared_is_said_with_its_reason(machine):
    said = learned_text(Contract.of(described(baseline(machine))).as_json())
    assert "Not compared: tooth pattern, lines of shafts" in said and "do not repeat their tooth pattern" in said
    assert "healthy recordings left out in turn are called changed" in said


@pytest.mark.slow
@pytest.mark.parametrize("machine", FOREIGN)
def test_lines_of_no_shaft_that_healthy_recordings_show_are_not_new(machine):
    """Lines spaced by 137.7 Hz were an unknown effect, even of a recording that was learned from."""
    assert all(r.spacings for r in readings(machine))
    found = compared(machine)
    assert found.unattributed_lines and not any(lines.new for lines in found.unattributed_lines)
    assert len(found.unattributed_lines[0].healthy) == RECORDINGS
    assert not is_changed(found), found.unexplained.reason
    given = Loaded(machine.rig, "bench", [], [], [])
    said = comparison_text(answer(given, baseline(machine), found))
    assert "Unknown effect" not in said and "not new" in said


@pytest.mark.slow
def test_lines_of_no_shaft_that_no_healthy_recording_shows_are_new():
    found = compared(PLAIN, fault="foreign")
    assert found.unattributed_lines[0].new and found.unattributed_lines[0].healthy == ()
    assert (
        found.unexplained.verdict == "unknown_effect" and "no healthy recording shows them" in found.unexplained.reason
    )


def test_new_lines_of_another_geared_shaft_are_a_change_too():
    """The panel said "new" while the status was normal."""
    first, *others = readings(PLAIN)
    seen = (SpacingSeen(order=10 / 3, clearness=40.0),)
    known = learn(PLAIN.rig, others, pair_shafts(PLAIN.rig))
    assert "belong to no known shaft" in new_spacings(known, [replace(first, spacings=seen)])


@pytest.mark.parametrize(("order", "said"), [
    (9.5, "belong to a fraction of the mesh order"), (1 / 53 * 2, "belong to the tooth-hunting period"),
    (3.0, "belong to the pinion"), (3.57, "belong to no known shaft"),
])  # fmt: skip
def test_sentences_of_a_baseline_say_of_an_order_what_all_others_do(order, said):
    assert belonging(order, (19, 53), 0.002) == said


def test_recordings_of_a_baseline_pass_the_examination_of_their_instruments(monkeypatch):
    path = Path(__file__).parents[2] / "recordings" / "short-campaign.mcap"
    rig, first, windows = read_windows(path)
    spoiled = [clock(300.0)(windows[5], np.random.default_rng(0))]
    monkeypatch.setattr("service.files.baseline.read_windows", lambda *given: (rig, first, spoiled))
    (found,) = load(path).windows
    assert {f.kind for f in found.window.faults} == {"clock_rate"}


@pytest.mark.slow
def test_a_spacing_is_compared_with_what_healthy_recordings_have_of_their_own():
    """Where every healthy recording has a spacing that no other has, one more is nothing new."""
    own = [replace(r, spacings=tuple(replace(s, order=s.order * (1 + 0.13 * i)) for s in r.spacings))
           for i, r in enumerate(readings(FOREIGN[0]))]  # fmt: skip
    differing = learn(FOREIGN[0].rig, own, pair_shafts(FOREIGN[0].rig))
    assert differing.repeats.factor(SPACINGS) == np.inf


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.09, 0.02, 0.004])
def test_a_rail_is_a_rail_however_often_healthy_recordings_reach_it(share):
    """Windows with 8 to 10 % of the samples at the rail were learned from in silence."""
    values = np.abs(PLAIN.window(0).accelerations["a1"].values)
    machine = replace(PLAIN, rail=float(np.quantile(values, 1 - share)))
    known = baseline(machine)
    assert sum("a1" in r.channels for r in known.readings) <= 1 + (share < 0.005) * 3
    assert any("a1 was not learned from in" in said and "rail" in said for said in described(known).not_learned)
    found = compared(machine)
    assert not is_changed(found), found.unexplained.reason  # healthy recordings are at the rail, too
    assert "as in healthy recordings" in found.unexplained.reason


@pytest.mark.slow
def test_a_sensor_at_its_rail_far_more_than_in_healthy_recordings_is_named():
    values = np.abs(PLAIN.window(0).accelerations["a1"].values)
    machine = replace(PLAIN, rail=float(np.quantile(values, 0.97)))
    assert "sensor_clipping" in {e.name for e in compared(machine, fault="level", size=2.0).effects}


@pytest.mark.slow
def test_dead_time_of_healthy_recordings_is_not_learned_from():
    def interrupted(w):
        a1 = w.accelerations["a1"]
        lost = a1.values.copy()
        lost[1000:1900] = lost[1000]
        return replace(w, accelerations={**w.accelerations, "a1": Samples(start=0.0, rate=a1.rate, values=lost)})

    shafts = pair_shafts(PLAIN.rig)
    own = [
        read_lines(PLAIN.rig, tracked(PLAIN.rig, interrupted(PLAIN.window(i)), f"h{i}#0", shafts), shafts)
        for i in (0, 1)
    ]
    known = learn(PLAIN.rig, [*readings(PLAIN)[2:], *own], shafts)
    assert [one.windows for one in known.not_learned] == [("h0#0", "h1#0")]
    assert known.not_learned[0].name == "sensor_dead_time"


@pytest.mark.parametrize("of", [(0, 0, 0, 0, 0), (1, 1, 1), (2, 2, 2, 2, 2, 2, 2)])
def test_copies_of_one_recording_count_once(of):
    """One file copied five times counted as five recordings."""
    copies = [replace(readings(PLAIN)[n], name=f"copy{i}#0", start_time_ns=i * 10**15) for i, n in enumerate(of)]
    with pytest.raises(ParameterError, match="has the same samples as copy0#0 and counts once"):
        learn(PLAIN.rig, copies, pair_shafts(PLAIN.rig))
    known = learn(PLAIN.rig, [*readings(PLAIN)[:3], *copies], pair_shafts(PLAIN.rig))
    assert known.counted.recordings == 3 and len(known.copies) == len(of)
    assert "counts once" in learned_text(Contract.of(described(known)).as_json())


@pytest.mark.slow
@pytest.mark.parametrize("windows", [5, 6, 12])
def test_windows_of_one_file_of_two_minutes_are_one_recording(windows):
    """Twelve windows of one file were twelve recordings, enough to judge teeth."""
    shafts = pair_shafts(PLAIN.rig)
    parts = [read_lines(PLAIN.rig, window(PLAIN, 0, f"long#{i}", part=i), shafts) for i in range(windows)]
    assert counted(parts).recordings == 1 and counted(readings(PLAIN)).recordings == RECORDINGS
    known = learn(PLAIN.rig, parts, shafts)
    assert f"1 of at least 5 recordings ({windows} windows" in thin_for_teeth(known)
    found = compare_with_baseline(known, PLAIN.rig, [window(PLAIN, 9, "new#0")])
    assert found.unexplained.verdict != "explained"
    assert found.raw_limit.not_compared  # one recording shows no scatter from one to the next
    said = comparison_text(answer(Loaded(PLAIN.rig, "bench", [], [], []), known, found))
    assert "Nothing is known to differ" not in said


def test_windows_of_one_file_on_two_days_are_two_recordings():
    one, other = readings(PLAIN)[:2]
    assert counted([replace(one, name="week#0"), replace(other, name="week#1")]).recordings == 2


@pytest.mark.parametrize("machine", [PLAIN, NO_PATTERN[0], FOREIGN[0]])
@pytest.mark.parametrize("fault", ["level", "noise", "impact"])
def test_every_fault_that_the_raw_limit_finds_is_found(machine, fault):
    found = compared(machine, fault=fault)
    assert found.raw_limit.exceeded and is_changed(found)


def test_where_the_raw_limit_alone_decides_the_answer_says_so():
    found = compared(NO_PATTERN[0], fault="level")
    assert found.raw_limit.decides_alone and not found.effects
    assert found.unexplained.reason.startswith("the limit on raw levels alone decides: RMS of a0")
    said = Contract.of(described(baseline(NO_PATTERN[0]), raw=found.raw_limit)).as_json()["raw_limit"]
    assert said["exceeded"] and said["decides_alone"] and said["false_alarms_percent"] == pytest.approx(0.5)
    healthy = compared(NO_PATTERN[0]).raw_limit
    assert not healthy.exceeded and not healthy.decides_alone and len(healthy.measures) == 4


def test_a_recording_without_an_angle_is_judged_by_its_raw_levels_alone():
    loud = PLAIN.window(100, fault="level", size=3.0)
    found = compare_levels(baseline(PLAIN), PLAIN.rig, [loud], "the speed is not available")
    assert found.unexplained.verdict == "unknown_effect" and "alone decides" in found.unexplained.reason
    quiet = compare_levels(baseline(PLAIN), PLAIN.rig, [PLAIN.window(100)], "the speed is not available")
    assert quiet.unexplained.verdict == "insufficient_data"


def test_a_limit_is_raised_by_what_recordings_left_out_show():
    assert factor_of([0.2, 0.5, 0.9, 0.3], 0.01) == 1.0
    assert 1.5 < factor_of([0.3, 0.5, 0.6, 1.2, 0.4, 0.5], 0.01) < factor_of([0.3, 0.5, 0.6, 1.2, 0.4, 0.5], 1e-3) < 20
    assert factor_of([1.2, 3.0, 0.5, 1.1], 0.01) == np.inf  # most are beyond: it is not compared


def test_few_recordings_and_many_measures_ask_for_a_larger_change():
    assert student_limit(9, 142) > student_limit(18, 142) > student_limit(18, 71) > 4
    assert over_usual(6, 5, 2) > over_usual(6, 7, 2) > over_usual(6, 7, 1) > 1.5
    known = np.full((5, 6), 0.06) + 0.01 * np.random.default_rng(1).normal(size=(5, 6))
    assert np.all(least_new(known, 2) > known.max(axis=0) + 0.04)


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "recording"), [(3, 4), (7, 6), (0, 4), (15, 0)])
def test_the_limits_of_six_recordings_hold_for_a_seventh(seed, recording):
    """White noise, a sensor's path and modulations that noise had hidden were changes of healthy machines."""
    machine = Machine(seed=seed, repeats=seed != 0)
    others = [r for i, r in enumerate(readings(machine)) if i != recording]
    known, new = learn(machine.rig, others, pair_shafts(machine.rig)), window(machine, recording, "new#0")
    found = compare_with_baseline(known, machine.rig, [new])
    assert not is_changed(found), found.unexplained.reason
    assert not any(m.new for m in modulation_of(Loaded(machine.rig, "bench", [new], [], []), known))


@pytest.mark.parametrize("found", [
    (0.30, 0.46, 0.46, 0.46, 0.35, 0.39, 0.33), (0.35, 0.39, 0.46, 0.44, 0.37, 0.43, 0.35), (0.5, 0.9, 0.4, 0.8, 0.6),
])  # fmt: skip
def test_a_tooth_pattern_that_a_few_recordings_share_by_chance_is_not_compared(found):
    """Each lies above 0.3, and the next recording of such a machine, at 0.05 or 0.24, was "other gears"."""
    assert not is_repeated(dict(enumerate(found)))


@pytest.mark.parametrize("found", [
    (0.84, 0.85, 0.87, 0.87, 0.88, 0.86, 0.83), (0.87, 0.95, 0.94, 0.87, 0.86, 0.87, 0.81), (0.5, 0.9), (),
])  # fmt: skip
def test_a_tooth_pattern_that_recordings_show_alike_is_compared(found):
    assert is_repeated(dict(enumerate(found)))


def test_tooth_pattern_that_healthy_recordings_repeat_is_compared():
    known = baseline(PLAIN)
    assert known.repeats.pattern_compared and min(known.repeats.pattern) > 0.5
    assert known.repeats.factor(LINES, "a0") == 1.0
    other = compare_with_baseline(known, PLAIN.rig, [window(replace(PLAIN, gears=1), 100, "new#0")])
    assert is_changed(other)
    said = described(known).left_out
    assert {c.what for c in said.compared if c.factor is not None} >= {PATTERN, LINES, RAW, SPACINGS}


def test_baseline_file_keeps_what_leaving_out_has_shown(tmp_path):
    machine = NO_PATTERN[0]
    save(baseline(machine), tmp_path / "healthy.baseline")
    read = read_baseline(tmp_path / "healthy.baseline")
    assert read.repeats == baseline(machine).repeats and read.not_learned == baseline(machine).not_learned
    assert [r.raw for r in read.readings] == [r.raw for r in baseline(machine).readings]
    assert described(read) == described(baseline(machine))
