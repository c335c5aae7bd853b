"""The one loop: each window once, in order, none lost without a word."""

from __future__ import annotations

import dataclasses
import json
from types import SimpleNamespace

import numpy as np
import pytest
from service_streams import Sink, go_on
from streams import ACCEL, ASSET, CHANNELS, TORQUE, bursts

from service.contract.answer import assemble
from service.contract.base import iso_time, not_available
from service.contract.window import REQUIRED as RECORD_FIELDS
from service.contract.window import refused_record
from service.errors import FrameError
from service.runtime.pipeline import Pipeline
from service.runtime.twin_port import Twin
from twin.errors import NotConverged, WindowError
from twin.rig import Rig


class Count:
    """A twin that refuses the windows of given numbers."""

    def __init__(self, *refused, error=WindowError):
        self.calls, self.refused, self.error = 0, refused, error

    def __call__(self, rig, state, window, options):
        number, self.calls = self.calls, self.calls + 1
        if number in self.refused:
            raise self.error("speed = 0 Hz: the shaft stood still")
        record = {"kind": "measurement"}
        estimate = SimpleNamespace(record=record, report={"wear": state["n"]}, events=(("window", record),))
        return {"n": state["n"] + 1}, estimate


def counting(step):
    return Twin(step=step, new_state=lambda: {"n": 0}, load_state=dict)


def run(frames, step, rig=None, flush=True):
    outcomes, published = [], []
    sink = Sink(outcomes, published)
    pipeline = Pipeline(lambda asset: Rig.from_mapping(rig or {}), counting(step), sink)
    for frame in frames:
        pipeline.feed(frame)
    if flush:
        pipeline.flush()
    assert published == outcomes
    return outcomes, pipeline


def test_windows_are_numbered_and_dated_in_order():
    outcomes, _ = run(bursts(3), Count())
    assert [o.record["index"] for o in outcomes] == [0, 1, 2]
    assert outcomes[1].record["start_time"] == "2023-11-14T22:13:26.500000000Z"
    assert [o.report for o in outcomes] == [{"wear": 0}, {"wear": 1}, {"wear": 2}]


@pytest.mark.parametrize("error", [WindowError, NotConverged])
def test_a_window_the_twin_refuses_is_kept_with_its_reason_and_leaves_the_state_alone(error):
    outcomes, pipeline = run(bursts(4), Count(1, error=error))
    refused = outcomes[1]
    assert refused.record["quality"] == "refused"
    assert refused.record["reason"] == "speed = 0 Hz: the shaft stood still"
    assert set(RECORD_FIELDS) <= set(refused.record)
    assert refused.state is outcomes[0].state and refused.report is outcomes[0].report
    assert [o.record["index"] for o in outcomes] == [0, 1, 2, 3]
    assert pipeline.quality(ASSET)["windows"] == {"good": 3, "repaired": 0, "degraded": 0, "refused": 1}


def test_a_window_without_usable_channels_never_reaches_the_twin():
    step = Count()
    outcomes, _ = run(bursts(2, channels=(TORQUE,)), step)
    assert step.calls == 0
    assert outcomes[0].record["reason"] == "neither an accelerometer nor an encoder is left"


def test_a_fault_of_the_program_is_not_taken_for_bad_data():
    def broken(*_):
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        run(bursts(2), broken)


def test_faults_of_the_data_become_events_and_counts():
    frames = [f for f in bursts(2) if not (f.channel == ACCEL and f.sequence == 9)]
    outcomes, pipeline = run(frames, Count())
    kinds = [kind for kind, _ in outcomes[0].events]
    assert kinds == ["window", "data_fault"]
    assert outcomes[0].events[0][1] is outcomes[0].record
    fault = outcomes[0].record["faults"][0]
    assert (fault["window"], fault["kind"], fault["channel"], fault["action"]) == (0, "gap", "accel/y6", "repaired")
    assert pipeline.quality(ASSET)["channels"]["accel/y6"] == {"frames": 11, "lost": 1}


def test_a_refused_frame_is_counted_with_its_reason():
    _, pipeline = run(bursts(1), Count())
    pipeline.reject(ACCEL, FrameError("values = nothing must hold at least one value"))
    quality = pipeline.quality(ASSET)
    assert quality["channels"]["accel/y6"]["invalid"] == 1
    assert quality["faults"][-1]["detail"] == "values = nothing must hold at least one value"


def test_channels_that_the_rig_file_names_and_nobody_sends_are_listed():
    rig = {"sensors": {"accelerometer": "y6"}, "encoders": {"gear_edges_per_rev": 128}}
    frames = bursts(2, channels=CHANNELS[:3])
    assert run(frames, Count(), rig)[1].quality(ASSET)["missing_channels"] == ["encoder/gear"]


def test_what_the_twin_cannot_put_in_figures_reaches_store_and_board_as_null():
    def vague(rig, state, window, options):
        report = {"rul": {"hours": {"p95": float("inf")}}, "profile": np.array([1.0, np.nan])}
        events = (("rul", {"hours": float("nan")}),)
        return state, SimpleNamespace(record={"error_percent": np.float64("nan")}, report=report, events=events)

    outcome = run(bursts(1), vague)[0][0]
    assert outcome.record["error_percent"] is None
    assert outcome.report == {"rul": {"hours": {"p95": None}}, "profile": [1.0, None]}
    assert outcome.events[1] == ("rul", {"hours": None})
    json.dumps([outcome.record, outcome.report, outcome.events, outcome.making], allow_nan=False)


def test_two_assets_go_their_own_ways():
    other = [dataclasses.replace(f, channel=f.channel._replace(asset="rig-2")) for f in bursts(3)]
    mixed = [f for pair in zip(bursts(3), other, strict=True) for f in pair]
    outcomes, pipeline = run(mixed, Count())
    assert pipeline.assets == ["rig-1", "rig-2"]
    for asset in pipeline.assets:
        own = [o for o in outcomes if o.asset == asset]
        assert [o.index for o in own] == [0, 1, 2]
        assert [o.report["wear"] for o in own] == [0, 1, 2]


def test_a_run_goes_on_from_its_checkpoint_as_if_never_stopped():
    frames = [f for f in bursts(8) if not (f.channel == ACCEL and f.sequence == 9)]
    whole, whole_pipeline = run(frames, Count())
    first, stopped = run(frames[:130], Count(), flush=False)
    last = first[-1]
    outcomes = list(first)
    second = Pipeline(lambda asset: Rig.from_mapping({}), counting(Count()), Sink(outcomes))
    go_on(second, last, stopped.assemblies[ASSET])
    for frame in frames:
        second.feed(frame)
    second.flush()
    assert 0 < len(first) < len(whole)
    assert [o.record for o in outcomes] == [o.record for o in whole]
    assert [o.report for o in outcomes] == [o.report for o in whole]
    assert second.quality(ASSET)["windows"] == whole_pipeline.quality(ASSET)["windows"]


def test_a_window_that_was_committed_before_leaves_state_number_and_quality_alone():
    first, _ = run(bursts(1), Count())
    outcomes, published = [], []
    sink = Sink(outcomes, published, known=(first[0].window.start_time_ns,))
    pipeline = Pipeline(lambda asset: Rig.from_mapping({}), counting(Count()), sink)
    for frame in bursts(3):
        pipeline.feed(frame)
    pipeline.flush()
    assert [o.state for o in outcomes] == [{"n": 1}, {"n": 2}]
    assert [o.index for o in outcomes] == [0, 1] and published == outcomes
    assert pipeline.quality(ASSET)["windows"]["good"] == 2


def test_a_window_that_cannot_be_committed_leaves_the_state_alone():
    class Full(Sink):
        def commit(self, outcome):
            raise OSError("no space left on device")

    pipeline = Pipeline(lambda asset: Rig.from_mapping({}), counting(Count()), Full([]))
    with pytest.raises(OSError):
        for frame in bursts(8):
            pipeline.feed(frame)
    assert pipeline.quality(ASSET)["windows"]["good"] == 0


def test_the_answer_has_every_part_even_before_the_first_window():
    answer = assemble("a", [], None, {})
    assert answer["windows"] == [] and answer["effects"] == []
    for part in ("wear", "rul", "residual", "unexplained", "calibration"):
        assert answer[part] == not_available("no window has been assessed by the twin yet")
    assert assemble("a", [refused_record("x")], {"wear": 1}, {})["wear"] == 1


def test_times_are_told_to_the_nanosecond():
    assert iso_time(1_700_000_000_123_456_789) == "2023-11-14T22:13:20.123456789Z"
