"""Machines that send in turn cost no more than each by itself."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from service_streams import Sink

from service.runtime.pipeline import Pipeline
from service.runtime.twin_port import gear_twin
from service.stream.sources.mcap import Recording, read_windows
from twin.options import Options
from twin.rig import Rig
from twin.updating.model_cache import PATHS

SHORT = Path(__file__).parents[2] / "recordings" / "short-campaign.mcap"
FIRST_WINDOWS = 3


@pytest.fixture(scope="module")
def recorded():
    """The frames of the first windows of the short campaign, and its rig file."""
    *_, windows = read_windows(SHORT)
    until = windows[FIRST_WINDOWS].start_time_ns
    with Recording(SHORT) as recording:
        frames = [f for f in recording.frames(lambda channel, error: None) if f.start_time_ns < until]
        return frames, recording.rig()


def paths_and_depths(recorded, assets):
    """How many wear paths are computed where machines send in turn, and the depths that are found of each."""
    frames, rig = recorded
    PATHS.clear()
    outcomes, before = [], PATHS.built
    twin = gear_twin(Options(trace=False))
    pipeline = Pipeline(lambda asset: Rig.from_mapping({**rig, "name": asset}), twin, Sink(outcomes))
    for frame in frames:
        for asset in assets:
            pipeline.feed(replace(frame, channel=frame.channel._replace(asset=asset)))
    pipeline.flush()
    depths = [[o.record["wear_depth_um"] for o in outcomes if o.asset == asset] for asset in assets]
    return PATHS.built - before, depths


@pytest.mark.slow
def test_twelve_machines_in_turn_compute_twelve_times_the_wear_paths_of_one(recorded):
    one, (alone,) = paths_and_depths(recorded, ["machine-00"])
    twelve, depths = paths_and_depths(recorded, [f"machine-{n:02d}" for n in range(12)])
    assert twelve == 12 * one > 0
    assert depths == [alone] * 12 and len(alone) == FIRST_WINDOWS
