"""A clock that is set, as the pipeline tells it."""

from __future__ import annotations

import dataclasses

from streams import T0, unbroken
from test_pipeline import Count, run

from service.stream.frames import NS


def test_a_clock_that_is_set_back_is_an_event_and_a_counted_fault():
    frames = unbroken(80.0)
    back = [dataclasses.replace(f, start_time_ns=f.start_time_ns - 3600 * NS) for f in frames[640:]]
    outcomes, pipeline = run(frames[:640] + back, Count())
    events = [data for o in outcomes for kind, data in o.events if kind == "data_fault"]
    told = [data for data in events if data["kind"] == "clock"]
    assert told and all("the stream's clock was set from" in data["detail"] for data in told)
    channels = pipeline.quality("rig-1")["channels"]
    assert all(kinds["clock"] == 1 for kinds in channels.values())
    assert [o.index for o in outcomes] == list(range(len(outcomes)))
    assert pipeline.last_arrival_ns("rig-1") is None and pipeline.ended_ns("rig-1") < T0
