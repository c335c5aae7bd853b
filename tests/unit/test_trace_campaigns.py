"""The campaigns that the tracing is judged by: whole tables, disjoint, and kept under what they depend on."""

from __future__ import annotations

import json
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks import evaluate
from benchmarks.channels import SETS, once_a_turn, only
from benchmarks.trace_campaigns import generate, judge, tune, wide
from benchmarks.trace_campaigns.benches import BENCHES
from benchmarks.trace_campaigns.levels import SIZES, SPREAD
from benchmarks.trace_campaigns.pair_stiffness import table as stiffness_table
from benchmarks.trace_campaigns.table import SPREADS, Put, Row, alternating, merged, spec_of
from recordings.generator.effects import EFFECTS
from recordings.generator.spec import read
from service.files.rig import checked_rig
from service.runtime import assess
from service.stream.sources.mcap import Recording
from tests.generator_instances import SPEC

ROOT = Path(__file__).parents[2]
EVERY = (*tune.ROWS, *judge.ROWS)
WIDE = wide.rows(1)


@pytest.mark.slow
def test_every_row_is_a_spec_that_the_generator_takes():
    for row in (*EVERY, *WIDE, *wide.clean(1)[:36]):
        spec = read(spec_of(row))
        assert len(spec["windows"]["at_revolutions"]) == row.windows and len(spec["effects"]) == len(row.effects)
        assert spec["asset"] == BENCHES[row.bench].asset


def test_judge_and_tune_share_no_seed_no_name_and_no_operating_condition():
    for what in (lambda r: {r.seed}, lambda r: {r.name}, conditions):
        mine, yours = (set().union(*map(what, rows)) for rows in (judge.ROWS, tune.ROWS))
        assert not mine & yours
    assert len({row.seed for row in EVERY}) == len({row.name for row in EVERY}) == len(EVERY)


def conditions(row):
    return {(c["speed_hz"], c["torque_nm"]) for c in spec_of(row)["conditions"]}


def test_no_two_campaigns_to_judge_by_run_at_the_same_condition():
    """Those of two conditions have a first one of their own."""
    first = [(c["speed_hz"], c["torque_nm"]) for c in (spec_of(row)["conditions"][0] for row in judge.ROWS)]
    assert len(set(first)) == len(first)
    assert all(9 <= speed <= 16 and 8 <= torque <= 15 for speed, torque in first)


def test_what_sets_in_does_so_between_two_windows_with_windows_on_both_sides():
    for spec in (spec_of(row) for row in EVERY if any(p.onset for p in row.effects)):
        at = spec["windows"]["at_revolutions"]
        for onset in (effect["onset_revolutions"] for effect in spec["effects"]):
            if onset:
                assert sum(r < onset for r in at) >= 2 and sum(r > onset for r in at) >= 2
                assert min(abs(r - onset) for r in at) > 60  # no window straddles it: a window lasts 25 to 43 turns


def test_the_size_of_a_level_is_drawn_anew_for_every_seed_within_its_spread():
    drawn = [
        spec_of(Row("x", seed, "single", (Put("tooth_friction", "large"),)))["effects"][0]["mu"] for seed in range(8)
    ]
    nominal = SIZES["tooth_friction"][2]["mu"]
    assert len(set(drawn)) > 4
    assert all(0.99 * SPREAD[0] <= mu / nominal <= 1.01 * SPREAD[1] for mu in drawn)


def test_a_spec_depends_on_its_row_alone():
    row = judge.ROWS[5]
    assert spec_of(row) == spec_of(replace(row, kind="pair"))
    assert spec_of(row) != spec_of(replace(row, seed=row.seed + 1))


def test_two_conditions_change_from_window_to_window():
    at = [0.0, 1000.0, 2000.0, 3000.0]
    rows = alternating(10.0, 12.0, at)
    assert [r.get("until_revolutions") for r in rows] == [500.0, 1500.0, 2500.0, None]
    assert [r["speed_hz"] for r in rows] == [10.0, 12.7, 10.0, 12.7]
    one, two = (spec_of(judge.ROWS[0], two_conditions=both) for both in (False, True))
    assert len(one["conditions"]) == 1 and len(two["conditions"]) == judge.ROWS[0].windows
    assert one["effects"] == two["effects"] and one["machine"] == two["machine"]


def test_what_is_merged_goes_over_table_by_table():
    assert merged({"a": {"b": 1, "c": 2}, "d": 3}, {"a": {"c": 4}, "e": [5]}) == {
        "a": {"b": 1, "c": 4},
        "d": 3,
        "e": [5],
    }


TINY = merged(SPEC, {"truth": {"to_end_of_life": False}, "windows": {"seconds": 0.5, "at_revolutions": [0, 60, 120]}})


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """A tiny campaign made by the way of the tables, and its row."""
    row = Row("tiny", 5, "clean", tolerated=("mesh_damping",), extra=TINY)
    folder = tmp_path_factory.mktemp("campaigns")
    ((_, path, why),) = generate.make_all([row], folder)
    assert path is not None, why
    return row, folder, path


@pytest.mark.slow
def test_a_recording_is_made_once_and_kept_with_its_truth(kept):
    row, folder, path = kept
    made = path.stat().st_mtime_ns
    assert generate.make(row, path) == path and path.stat().st_mtime_ns == made
    assert generate.recording_of(row, folder) == path
    assert (folder / "truth" / f"{path.stem}.json").is_file()
    assert not list(folder.glob("*.part"))


def test_another_spec_or_another_generator_is_another_recording(kept, monkeypatch):
    row, folder, path = kept
    assert generate.recording_of(replace(row, seed=6), folder) != path
    monkeypatch.setattr(generate, "_edition", lambda rig: b"another")
    assert generate.recording_of(row, folder) != path


def test_a_campaign_that_cannot_be_made_is_named_and_does_not_stop_the_others(tmp_path):
    row = Row("wrong", 5, "clean", extra=merged(TINY, {"faults": [{"kind": "lost", "window": 99}]}))
    ((_, path, why),) = generate.make_all([row], tmp_path)
    assert path is None and "window = 99" in why


def test_channels_left_out_are_not_read(kept):
    *_, path = kept
    for kinds, labels in (
        (SETS["all"], {"accel/y6", "torque/pinion", "encoder/pinion", "encoder/gear"}),
        (SETS["accel+encoders"], {"accel/y6", "encoder/pinion", "encoder/gear"}),
        (SETS["accel"], {"accel/y6", "encoder/pinion"}),
    ):
        with only(kinds), assess.Recording(path) as partial:  # what `assess` reads
            read_from = {frame.channel.label for frame in partial.frames(print)}
        assert read_from == labels
    assert assess.Recording is Recording


def test_a_tachometer_gives_every_whole_turn_of_the_encoder_and_nothing_between(kept):
    *_, path = kept
    with Recording(path) as recording:
        frames = [f for f in recording.frames(print) if f.channel.label == "encoder/pinion"]
    for frame in frames:
        seen = once_a_turn(frame)
        first, size = frame.first_edge_index, frame.edge_offsets_ns.size
        turns = [i // 1024 for i in range(first, first + size) if i % 1024 == 0]
        if seen is None:
            assert not turns
            continue
        assert seen.edges_per_rev == 1 and seen.first_edge_index == turns[0]
        assert seen.edge_offsets_ns.size == len(turns)


@pytest.mark.slow
def test_a_campaign_is_made_assessed_and_printed_beside_the_aims(tmp_path):
    out = tmp_path / "out.json"
    command = ["--set", "tune", "--only", "T16", "--folder", str(tmp_path), "--json", str(out), "--processes", "1"]
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.evaluate", *command], cwd=ROOT, capture_output=True, text=True, timeout=280
    )
    assert done.returncode == 0, done.stderr
    for what in ("T16-clean", "clean campaigns given an effect", "depth within 5 % or 2 µm after"):
        assert what in done.stdout
    (result,) = json.loads(out.read_text(encoding="utf-8"))
    assert result["kind"] == "clean" and result["depth_true"] > 20 and result["depth_after"] is not None


def test_a_name_that_no_campaign_has_is_said_before_anything_is_made(tmp_path, capsys):
    given = ["--set", "judge", "--only", "no-such-campaign", "--folder", str(tmp_path)]
    assert evaluate.main(given) == 2
    assert "no campaign of judge is named no-such-campaign" in capsys.readouterr().err


def test_wider_spreads_change_the_machine_and_nothing_that_was_drawn():
    row = judge.ROWS[0]
    usual, wide = spec_of(row), spec_of(row, spreads=2)
    assert usual == spec_of(row, spreads=1)
    assert read(wide)["machine"]["stiffness_spread"] == 2 * read(usual)["machine"]["stiffness_spread"] == 0.06
    assert read(wide)["sensors"]["gear_graduation_um"] == pytest.approx((2.8, 1.0, 0.4))
    for table in ("machine", "wear", "sensors"):
        usual_table, wide_table = read(usual)[table], read(wide)[table]
        assert {k for k in wide_table if wide_table[k] != usual_table[k]} == set(SPREADS[table])
    assert usual["effects"] == wide["effects"] and usual["conditions"] == wide["conditions"]
    folder = Path("kept")
    assert generate.recording_of(row, folder) != generate.recording_of(row, folder, spreads=2)


def test_two_draws_share_no_seed_and_no_seed_of_the_other_sets():
    sets = [wide.rows(1), wide.rows(2), wide.clean(1), wide.clean(2), EVERY, judge.fresh(1), judge.fresh(2)]
    seeds = [row.seed for rows in sets for row in rows]
    assert len(set(seeds)) == len(seeds)


def test_a_clean_campaign_has_spreads_of_its_own():
    one = wide.clean(1)[0]
    assert spec_of(one, spreads=2.0) == spec_of(one)


def test_the_limit_of_a_campaign_is_written_into_its_rig_file():
    text = BENCHES["pump"].rig.read_text(encoding="utf-8")
    assert tomllib.loads(generate.with_limit(text, {"limit_um": 57.0}))["end_of_life"]["max_depth"] == 57e-6
    assert generate.with_limit(text, None) == text


def test_a_new_key_of_the_generator_leaves_the_digest_of_other_specs(monkeypatch):
    spec = spec_of(judge.ROWS[0])
    before = generate.digest_of(spec)
    assert generate.digest_of(spec, BENCHES["pump"].rig) != before
    name = judge.ROWS[0].effects[0].name
    monkeypatch.setitem(generate.EFFECTS, name, replace(EFFECTS[name], edition=2))
    assert generate.digest_of(spec) != before


@pytest.mark.parametrize("name", ["pump", "spindle"])
def test_the_rig_files_of_the_other_machines_are_whole_and_their_pairs_those_of_weber_and_banaschek(name):
    bench = BENCHES[name]
    mapping = tomllib.loads(bench.rig.read_text(encoding="utf-8"))
    checked_rig(mapping, name)  # the twin takes it
    assert (mapping["gears"]["pinion"]["teeth"], mapping["gears"]["gear"]["teeth"]) == bench.teeth
    assert mapping["sensors"]["accelerometer"] == bench.accelerometer
    s, stiffness = stiffness_table(mapping)
    given = np.array(mapping["mesh"]["pair_stiffness"])
    assert np.array(mapping["mesh"]["pair_s"]) == pytest.approx(s, abs=1e-9)
    assert given / given.mean() == pytest.approx(stiffness / stiffness.mean(), rel=1e-4)


def test_weber_and_banascheks_stiffest_pair_is_near_that_of_iso_6336():
    """c'th of ISO 6336-1 (2019), 9.3: 1/(0.04723 + 0.15551/z1 + 0.25791/z2) N/(mm·µm), spur gears without shift."""
    mapping = tomllib.loads(BENCHES["pump"].rig.read_text(encoding="utf-8"))
    c = 1e9 / (0.04723 + 0.15551 / 20 + 0.25791 / 40) * 0.025
    assert max(stiffness_table(mapping)[1]) == pytest.approx(c, rel=0.15)
