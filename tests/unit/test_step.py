"""One window in, one estimate out: what is given, what is missing, and that nothing is hidden."""

import json
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from service.contract.answer import Asset, assemble
from service.contract.estimate import step
from service.files.rig import rig_of
from service.report.content import WINDOW_COLUMNS, window_rows
from service.stream.sources.mcap import Recording, read_windows
from twin.assessment import Unexplained
from twin.capabilities import CAPABILITIES
from twin.effects import EFFECTS
from twin.effects.addition import Addition
from twin.errors import ParameterError, WindowError
from twin.options import Options
from twin.rig import Rig
from twin.state import State
from twin.tracing.attribution import AttributedEffect
from twin.windows import Fault, Samples, Window

SHORT = Path(__file__).resolve().parents[2] / "recordings" / "short-campaign.mcap"
CALIBRATIONS, FIRST_WORN = 2, 3


@lru_cache(maxsize=1)
def recorded() -> tuple[Rig, tuple[Window, ...]]:
    with Recording(SHORT) as recording:
        rig = rig_of(recording, None)
    return rig, tuple(read_windows(SHORT)[2])


@lru_cache(maxsize=1)
def uninterrupted():
    """States and estimates of the first five windows."""
    rig, windows = recorded()
    state, out = State(), []
    for window in windows[:5]:
        state, estimate = step(rig, state, window)
        out.append((state, estimate))
    return out


def strict(data):
    return json.dumps(data, allow_nan=False, sort_keys=True)


def minimal_rig() -> Rig:
    teeth = recorded()[0].get("gears")
    wheels = {wheel: {"teeth": teeth[wheel]["teeth"]} for wheel in ("pinion", "gear")}
    return Rig.from_mapping({"gears": wheels, "sensors": {"accelerometer": "y6"}})


@pytest.mark.slow
def test_same_rig_state_and_window_give_the_same_answer():
    rig, windows = recorded()
    state = uninterrupted()[FIRST_WORN - 1][0]
    first, again = (step(rig, state, windows[FIRST_WORN]) for _ in range(2))
    assert strict(first[0].to_dict()) == strict(again[0].to_dict())
    assert strict(first[1].record) == strict(again[1].record)
    assert strict(first[1].report) == strict(again[1].report)


def test_state_survives_json_to_the_bit():
    for state, _ in uninterrupted():
        text = strict(state.to_dict())
        assert strict(State.from_dict(json.loads(text)).to_dict()) == text


@pytest.mark.slow
def test_run_resumed_from_a_json_state_equals_the_uninterrupted_one_to_the_bit():
    rig, windows = recorded()
    state = State()
    for window, (whole, estimate) in zip(windows, uninterrupted(), strict=False):
        state, resumed = step(rig, State.from_dict(json.loads(strict(state.to_dict()))), window)
        assert strict(resumed.record) == strict(estimate.record)
        assert strict(resumed.report) == strict(estimate.report)
        assert strict(state.to_dict()) == strict(whole.to_dict())


def test_every_key_of_the_answer_is_one_that_the_contract_declares():
    for _, estimate in uninterrupted():
        record = {**estimate.record, "start_time": "2024-01-01T00:00:00.000000000Z", "quality": "good", "faults": []}
        answer = assemble("unsw", [record], estimate.report, {})
        assert Asset.model_validate(answer).as_json() == answer


def test_windows_at_the_rigs_calibration_points_are_calibration_and_the_rest_measurement():
    kinds = [estimate.record["kind"] for _, estimate in uninterrupted()]
    assert kinds == ["calibration"] * CALIBRATIONS + ["measurement"] * 3


def test_calibration_windows_calibrate_and_wear_nothing():
    _, estimate = uninterrupted()[CALIBRATIONS - 1]
    assert estimate.report["calibration"]["from"] == "windows"
    assert estimate.report["calibration"]["windows"] == CALIBRATIONS
    assert estimate.record["wear_depth_um"] == 0.0
    assert not estimate.record["updated"]
    assert estimate.report["rul"]["status"] == "not available"


def test_record_has_the_names_of_the_contract():
    _, estimate = uninterrupted()[FIRST_WORN]
    names = {
        "index", "kind", "revolutions", "speed_hz", "torque_nm", "rms_measured", "rms_predicted", "error_percent",
        "updated", "rms_after", "k_wear_per_n", "wear_depth_um",
    }  # fmt: skip
    assert names <= estimate.record.keys()
    record = estimate.record
    assert record["error_percent"] == pytest.approx(100 * (record["rms_predicted"] / record["rms_measured"] - 1))
    assert record["updated"] == (abs(record["error_percent"]) > 5)
    assert record["wear_depth_p05_um"] <= record["wear_depth_um"] <= record["wear_depth_p95_um"]


def test_both_methods_of_updating_are_reported_side_by_side():
    methods = uninterrupted()[FIRST_WORN][1].report["wear"]["methods"]
    assert methods.keys() == {"fused", "rms"}
    assert methods["fused"]["k_wear_per_n"] != methods["rms"]["k_wear_per_n"]


def test_depth_is_shared_between_the_flanks_as_the_tooth_ratio_says():
    depth = uninterrupted()[FIRST_WORN][1].report["wear"]["max_depth_um"]
    for figure in ("median", "p05", "p95"):
        assert depth["pinion"][figure] + depth["gear"][figure] == pytest.approx(depth["combined"][figure])
        assert depth["pinion"][figure] == pytest.approx(depth["combined"][figure] / (1 + 19 / 52), abs=1e-12)


def test_profile_of_both_flanks_is_as_deep_as_the_depth():
    wear = uninterrupted()[4][1].report["wear"]
    for flank in ("pinion", "gear"):
        deepest = max(wear["profile"][flank]["depth_um"])
        assert deepest == pytest.approx(wear["max_depth_um"][flank]["median"], rel=0.02)


def test_update_and_remaining_life_are_told_as_events():
    kinds = [kind for kind, _ in uninterrupted()[FIRST_WORN][1].events]
    assert kinds[0] == "window" and "rul" in kinds
    assert ("update" in kinds) == uninterrupted()[FIRST_WORN][1].record["updated"]


def test_rms_update_sets_the_depth_from_the_rms_with_a_wide_band():
    rig, windows = recorded()
    _, estimate = step(rig, uninterrupted()[FIRST_WORN - 1][0], windows[FIRST_WORN], Options(update="rms"))
    record = estimate.record
    assert record["method"] == "rms"
    assert record["wear_depth_um"] == record["methods"]["rms"]["wear_depth_um"]
    assert record["wear_depth_p95_um"] > 1.7 * record["wear_depth_um"]


@pytest.mark.slow
def test_no_update_after_the_last_that_is_allowed():
    rig, windows = recorded()
    state = uninterrupted()[FIRST_WORN][0]
    after, estimate = step(rig, state, windows[FIRST_WORN + 1], Options(update_until=500.0))
    assert estimate.record["method"] == "projection"
    assert not estimate.record["updated"]
    assert after.memory.track.rate == state.memory.track.rate
    assert after.memory.path == state.memory.path


def without(window: Window, **kinds: str) -> Window:
    """The window without one channel of each kind named."""
    return replace(
        window, **{kind: {k: v for k, v in getattr(window, kind).items() if k != key} for kind, key in kinds.items()}
    )


def test_missing_torque_is_said_and_the_rigs_nominal_torque_used():
    rig, windows = recorded()
    window = without(windows[FIRST_WORN], torques="pinion")
    _, estimate = step(rig, uninterrupted()[FIRST_WORN - 1][0], window)
    assert estimate.record["torque_nm"] is None
    assert "torque" in estimate.record["not_available"]["torque_nm"]
    true = uninterrupted()[FIRST_WORN][1].record["wear_depth_um"]
    assert estimate.record["wear_depth_um"] == pytest.approx(true, rel=0.03)


@pytest.mark.slow
def test_missing_gear_encoder_leaves_the_pinions_with_a_wider_band():
    rig, windows = recorded()
    state, band = State(), {}
    for window in windows[: FIRST_WORN + 1]:
        state, estimate = step(rig, state, without(window, encoders="gear"))
    band["pinion"] = estimate.record
    band["both"] = uninterrupted()[FIRST_WORN][1].record
    assert band["pinion"]["method"] == "pinion encoder"
    assert band["both"]["method"] == "transmission error"
    width = {k: r["wear_depth_p95_um"] - r["wear_depth_p05_um"] for k, r in band.items()}
    assert width["pinion"] > 1.5 * width["both"]
    assert "transmission_error" in estimate.record["not_available"]


def test_wear_and_life_are_not_available_while_the_teeth_rattle():
    rig, windows = recorded()
    state = uninterrupted()[FIRST_WORN - 1][0]
    rattle = AttributedEffect(
        addition=Addition(effect=EFFECTS["backlash_rattle"](extra_backlash=0.0, load_ripple=8.0, order=1.0)),
        parameters={}, log_evidence=100.0, runner_up=None, over_runner_up=0.0, numbers=(),
    )  # fmt: skip
    state = replace(state, tracing=replace(state.tracing, found=(rattle,)))
    _, estimate = step(rig, state, windows[FIRST_WORN], Options(trace=False))
    record = estimate.record
    for name in ("wear_depth_um", "wear_depth_p05_um", "wear_depth_p95_um", "k_wear_per_n"):
        assert record[name] is None
    assert any("tooth separation" in note for note in record["notes"])
    assert record["rms_measured"] > 0 and record["rms_predicted"] > 0
    for part in ("wear", "rul"):
        assert estimate.report[part]["status"] == "not available"
    assert not [kind for kind, _ in estimate.events if kind == "rul"]
    (shown,) = window_rows([record])
    assert shown[[column.key for column in WINDOW_COLUMNS].index("wear_depth_um")] == "–"


def test_missing_accelerometer_leaves_the_depth_to_the_encoders_and_says_why_no_level_is_compared():
    rig, windows = recorded()
    window = without(windows[FIRST_WORN], accelerations="y6")
    _, estimate = step(rig, uninterrupted()[FIRST_WORN - 1][0], window)
    record = estimate.record
    assert record["rms_measured"] is None
    assert record["error_percent"] is None
    assert not record["updated"]
    assert any("no accelerometer" in note for note in record["notes"])
    true = uninterrupted()[FIRST_WORN][1].record["wear_depth_um"]
    assert record["wear_depth_um"] == pytest.approx(true, rel=0.01)
    strict(estimate.record), strict(estimate.report)


def test_neither_accelerometer_nor_encoder_leaves_wear_not_available():
    rig, windows = recorded()
    window = replace(without(windows[FIRST_WORN], accelerations="y6"), encoders={})
    with pytest.raises(WindowError, match="neither a usable vibration level nor a shaft speed"):
        step(rig, State(), window)


def test_rig_of_tooth_counts_alone_gives_level_speed_and_bands_and_says_what_is_missing():
    _, windows = recorded()
    state, estimate = step(minimal_rig(), State(), windows[FIRST_WORN])
    record, report = estimate.record, estimate.report
    assert record["rms_measured"] > 0
    assert record["mesh_frequency_hz"] == pytest.approx(190, rel=0.01)
    assert len(record["mesh_bands"]) == 5
    for part in ("wear", "rul", "calibration"):
        assert report[part]["status"] == "not available"
        assert "gears.module" in report[part]["reason"]
    assert report["effects"] == []
    assert report["unexplained"]["verdict"] == "insufficient_data"
    assert state.windows_seen == 1
    strict(record), strict(report)


def test_window_with_neither_level_nor_speed_is_refused_with_the_reason():
    rig, _ = recorded()
    silent = Window(start_time_ns=0, torques={"pinion": Samples(rate=100.0, start=0.0, values=np.ones(200))})
    with pytest.raises(WindowError, match="neither a usable vibration level nor a shaft speed"):
        step(rig, State(), silent)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"update": "magic"}, "'magic' must be one of fused, rms"),
        ({"error_threshold": 5.0}, r"5\.0 is outside \(0, 1\); percent\?"),
        ({"update_until": -1.0}, "must not be negative"),
    ],
)
def test_options_that_cannot_be_are_refused(wrong, message):
    with pytest.raises(ParameterError, match=message):
        Options(**wrong)


@pytest.mark.slow
def test_window_that_cannot_be_used_leaves_the_answer_of_the_ones_before():
    rig, windows = recorded()
    before, told = uninterrupted()[4]
    after, estimate = step(rig, before, replace(windows[5], encoders={}))
    assert estimate.record["wear_depth_um"] is None
    assert "no absolute revolution count" in estimate.record["notes"][0]
    now, then = ({key: value for key, value in each.report.items() if key != "status"} for each in (estimate, told))
    assert strict(now) == strict(then) and now["detectable"]["effects"]
    assert estimate.report["status"]["verdict"]["not_assessed"] == 1
    assert after.memory == before.memory
    resumed, _ = step(rig, State.from_dict(json.loads(strict(after.to_dict()))), windows[6])
    straight, _ = step(rig, after, windows[6])
    assert strict(resumed.to_dict()) == strict(straight.to_dict())


class SaidLast:
    """A capability that has the last word on what is unexplained, where the window was judged."""

    @staticmethod
    def applies(context, draft):
        return draft.judged

    @staticmethod
    def assess(context, draft):
        return draft.with_parts(unexplained=Unexplained(verdict="insufficient_data", reason="said last"))


def test_what_the_last_capability_said_of_a_judged_window_holds_for_those_that_are_not(monkeypatch):
    rig, windows = recorded()
    monkeypatch.setattr("twin.step.CAPABILITIES", (*CAPABILITIES, SaidLast))
    state, _ = step(rig, State(), windows[0])
    _, estimate = step(rig, state, replace(windows[1], encoders={}))
    assert estimate.record["wear_depth_um"] is None
    assert estimate.report["unexplained"]["reason"] == "said last"


def test_accelerometer_that_reads_nothing_is_said_not_divided_by():
    rig, windows = recorded()
    window = windows[FIRST_WORN]
    dead = {k: replace(s, values=np.zeros_like(s.values)) for k, s in window.accelerations.items()}
    _, estimate = step(rig, State(), replace(window, accelerations=dead))
    assert any("y6 reads nothing" in note for note in estimate.record["notes"])
    assert estimate.record["error_percent"] is None


def test_calibration_in_mid_campaign_carries_the_depth_on_with_its_uncertainty():
    rig, windows = recorded()
    state = uninterrupted()[4][0]
    turns = 2000  # both encoders count on
    later = {
        shaft: replace(edges, first_index=edges.first_index + round(turns * edges.per_rev * ratio))
        for (shaft, edges), ratio in zip(sorted(windows[0].encoders.items(), reverse=True), (1, 19 / 52), strict=True)
    }
    after, estimate = step(rig, state, replace(windows[0], encoders=later))
    record = estimate.record
    assert record["kind"] == "calibration"
    assert record["wear_depth_um"] == pytest.approx(state.memory.depth * 1e6, rel=0.01)
    assert record["wear_depth_p05_um"] < 0.98 * record["wear_depth_um"] < record["wear_depth_um"]
    assert after.memory.fit == state.memory.fit, "worn teeth do not calibrate"


@pytest.mark.parametrize("kind", ["clipping", "stuck", "out_of_range"])
def test_depth_at_a_torque_that_its_meter_could_not_measure_is_preliminary(kind):
    rig, windows = recorded()
    fault = Fault(kind=kind, channel="torque/pinion", count=9, action="degraded", detail="held at 9 N·m")
    before = uninterrupted()[FIRST_WORN - 1][0]
    assert not uninterrupted()[FIRST_WORN][1].report["wear"]["preliminary"]
    _, estimate = step(rig, before, replace(windows[FIRST_WORN], faults=(fault,), quality="degraded"))
    (reason,) = estimate.report["wear"]["preliminary"]["reasons"]
    assert "at a torque of 10" in reason and f"(torque/pinion: {kind}, held at 9 N·m)" in reason
    assert any("is doubtful: torque/pinion" in note for note in estimate.record["notes"])
    repaired = replace(fault, action="repaired")
    _, sound = step(rig, before, replace(windows[FIRST_WORN], faults=(repaired,)))
    assert not sound.report["wear"]["preliminary"]


def test_doubtful_torque_calibrates_nothing():
    rig, windows = recorded()
    fault = Fault(kind="clipping", channel="torque/pinion", count=9, action="degraded", detail="held at 9 N·m")
    state, _ = step(rig, State(), replace(windows[0], faults=(fault,), quality="degraded"))
    assert state.memory.fit is None and not state.memory.unworn


def test_clipped_accelerometer_neither_updates_nor_teaches_but_leaves_the_depth():
    rig, windows = recorded()
    window = windows[FIRST_WORN]
    samples = window.accelerations["y6"]
    limit = 0.5 * np.abs(samples.values).max()
    fault = Fault(kind="clipping", channel="accel/y6", count=9, action="degraded", detail="held at the end")
    clipped = replace(
        window,
        accelerations={"y6": replace(samples, values=np.clip(samples.values, -limit, limit))},
        faults=(fault,),
        quality="degraded",
    )
    before = uninterrupted()[FIRST_WORN - 1][0]
    state, estimate = step(rig, before, clipped)
    assert not estimate.record["updated"]
    assert any("clipping" in note for note in estimate.record["notes"])
    assert state.memory.path == before.memory.path
    assert state.memory.rms_track.rate == before.memory.rms_track.rate
    true = uninterrupted()[FIRST_WORN][1].record["wear_depth_um"]
    assert estimate.record["wear_depth_um"] == pytest.approx(true, rel=0.01)
