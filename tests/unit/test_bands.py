"""Bands against the truth, the diagram of their ranks, and the tables of what must hold beyond names."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.bands import binomial_interval, depth_bands, diagram, gear_bands, life_bands
from benchmarks.evaluate_claims import claim_tables, false_alarm_table, gain_table
from benchmarks.tracing_score import Gain, no_answer, score_tracing
from tests.unit.test_tracing_score import ANSWER, FOUND, TRUTH, changed

WINDOWS = [
    {"kind": "measurement", "revolutions": 1000.0 * i, "speed_hz": 10.0, "depth": {"combined_um": 10.0 * i}}
    for i in range(10)
]
LONG = changed(TRUTH, windows=WINDOWS, end_of_life={"revolutions": 10000.0}, kind="clean", expected_names=[])


def records(depth, half_width=2.0):
    return [
        {
            "kind": "measurement", "revolutions": w["revolutions"], "wear_depth_um": depth(w),
            "wear_depth_p05_um": depth(w) - half_width, "wear_depth_p95_um": depth(w) + half_width,
        }
        for w in WINDOWS
    ]  # fmt: skip


def test_a_depth_ranks_by_where_the_truth_lies_in_its_band():
    bands = depth_bands(LONG, records(lambda w: w["depth"]["combined_um"] + 2.0))
    assert len(bands) == 9  # nothing is worn at first
    assert all(b.rank == pytest.approx(0.05) and b.inside and b.met for b in bands)
    far = depth_bands(LONG, records(lambda w: w["depth"]["combined_um"] - 5.0))
    assert not any(b.inside for b in far) and all(b.rank > 0.99 for b in far)
    assert [b.met for b in far] == [False] * 9


def test_a_window_without_a_depth_counts_as_not_stated():
    nothing = [{**r, "wear_depth_um": None, "wear_depth_p05_um": None} for r in records(lambda w: 0.0)]
    assert all(b.rank is None and b.inside is None and b.met is None for b in depth_bands(LONG, nothing))


def test_life_is_scored_at_half_life_and_at_the_end():
    def said(at):
        left = 10000.0 - at
        rul = {"revolutions": {"median": left, "p05": 0.5 * left, "p95": 2 * left}}
        rul["distribution"] = {"probability": [0.05, 0.5, 0.95], "revolutions": [0.5 * left, left, 2 * left]}
        return {"kind": "measurement", "revolutions": at, "rul": rul}

    bands = life_bands(LONG, [said(w["revolutions"]) for w in WINDOWS])
    assert [(b.when, b.true, b.rank) for b in bands] == [("half", 5000.0, 0.5), ("end", 1000.0, 0.5)]
    assert life_bands(changed(LONG, end_of_life={}), [said(0.0)] * 5) == ()


def test_ranks_of_honest_bands_are_spread_evenly_in_the_diagram():
    rng = np.random.default_rng(1)
    true = 50 + 3 * rng.normal(size=4000)
    windows = [{**WINDOWS[1], "revolutions": float(i), "depth": {"combined_um": t}} for i, t in enumerate(true)]
    rows = [{**records(lambda w: 50.0, 3 * 1.645)[1], "revolutions": float(i)} for i in range(4000)]
    line = diagram({"all kinds": depth_bands(changed(LONG, windows=windows), rows)}, "depth", "window")[1]
    shares = [int(cell) for cell in line.split("%")[1].split()[:6]]
    assert shares == pytest.approx([5, 20, 25, 25, 20, 5], abs=2)


@pytest.mark.parametrize(
    ("hits", "of", "low", "high"), [(0, 200, 0.0, 0.0183), (2, 200, 0.0012, 0.0357), (5, 5, 0.4782, 1)]
)
def test_the_interval_of_a_rate_is_clopper_and_pearsons(hits, of, low, high):
    assert binomial_interval(hits, of) == pytest.approx((low, high), abs=1e-4)


def test_a_false_alarm_is_counted_with_its_interval_and_named():
    sound = score_tracing(LONG, changed(ANSWER, effects=[]), name="Z1-clean")
    alarmed = replace(sound, named=("misalignment",), name="Z2-clean-no-torque")
    table = "\n".join(false_alarm_table([sound, alarmed]))
    assert "1 of 2" in table and "Z2 misalignment" in table


def test_an_effect_that_makes_an_error_rise_is_marked():
    errors = {"rms_percent": 1.0, "transmission_error_percent": 10.0}
    effect = {
        **FOUND,
        "error_before": {**errors, "waveform_percent": 20.0},
        "error_after": {**errors, "waveform_percent": 15.0, "transmission_error_percent": 12.0},
    }
    r = score_tracing(TRUTH, changed(ANSWER, effects=[effect]), name="N1-x")
    assert [g.rises for g in r.gains] == [True]
    assert "RISES" in gain_table([r])[2] and gain_table([r])[-2].startswith("1 of 1")
    better = Gain(
        effect="x", waveform_before=20.0, waveform_after=15.0, transmission_before=None, transmission_after=3.0
    )
    assert not better.rises


def test_explained_is_marked_where_a_held_out_error_exceeds_the_limit_or_something_is_missing():
    limit = {"verdict": "explained", "orders": [], "limit_percent": 30.0}
    tracing = {"errors": {"waveform_percent": 12.0, "transmission_error_percent": 87.0}}
    r = score_tracing(TRUTH, changed(ANSWER, unexplained=limit, tracing=tracing), name="N1-x")
    assert r.explained_beyond_limit and not r.explained_wrongly
    missing = score_tracing(TRUTH, changed(ANSWER, unexplained=limit, effects=[]), name="N1-x")
    assert missing.explained_wrongly and not missing.explained_beyond_limit


def test_a_fault_of_an_instrument_may_be_unknown_named_or_refused_but_not_explained():
    truth = changed(TRUTH, kind="instrument", expected_names=["unknown_effect"], tolerated_names=["sensor_gain"])
    for answer, right in (
        (changed(ANSWER, effects=[]), False),  # explained
        (changed(ANSWER, effects=[], unexplained={"verdict": "unknown_effect", "orders": []}), True),
        (changed(ANSWER, effects=[], windows=[{"kind": "calibration", "quality": "refused"}]), True),
        (changed(ANSWER, effects=[{**FOUND, "name": "sensor_gain"}]), True),
        (ANSWER, False),
    ):
        assert score_tracing(truth, answer, name="N1-x").right == right


def test_a_refused_recording_is_a_right_answer_to_a_faulty_instrument_and_to_nothing_else():
    for kind, right in (("instrument", True), ("single", False)):
        r = replace(no_answer(changed(TRUTH, kind=kind), "the count of edges fell", name="N1-x"), refused=True)
        assert r.right == right


def test_the_depth_of_either_gear_is_scored_at_the_end():
    truth = changed(LONG, windows=[{**WINDOWS[-1], "depth": {"combined_um": 90.0, "pinion_um": 80.0, "gear_um": 10.0}}])
    said = {"pinion": {"p05": 62.0, "median": 66.0, "p95": 70.0}, "gear": {"p05": 8.0, "median": 11.0, "p95": 14.0}}
    pinion, gear = gear_bands(truth, {"wear": {"max_depth_um": said}})
    assert not pinion.inside and pinion.rank > 0.99 and gear.inside and gear.met


def test_what_is_unknown_is_located_by_its_frequency_or_its_place():
    tone = {"name": "drifting_tone", "onset_revolutions": 0.0}
    tone["parameters"] = {"frequency_hz": 300.0, "between": 0.02, "within": 0.0}
    truth = changed(TRUTH, kind="unknown", expected_names=["unknown_effect"], effects=[tone], place="drift")
    lines = [{"order": 25.4, "frequency_hz": 305.0}]
    found = score_tracing(truth, changed(ANSWER, unexplained={"verdict": "x", "orders": lines}), name="N1-x")
    assert found.located and found.lines_found == 1 and found.place_named is False
    said = changed(ANSWER, unexplained={"verdict": "x", "orders": [], "reason": "a tone that drifts"})
    assert score_tracing(truth, said, name="N1-x").located


def test_every_table_has_its_lines():
    r = score_tracing(TRUTH, ANSWER, name="N1-x")
    on_another = replace(r, bench="pump", kind="unknown", name="N2-unknown-x")
    tables = claim_tables([r, on_another, replace(r, kind="clean", name="Z1-clean")])
    assert [table[0].split()[0] for table in tables] == [
        "right,",
        "clean",
        "waveform",
        "verdicts",
        "unknown,",
        "onset,",
    ]
