"""The real twin traces through the service what it traces in a file, restart in between included."""

from __future__ import annotations

import json
import subprocess

import pytest
from test_whole import COMMAND, ROOT, answer_of, assert_same, differences, fetch, service

from service.runtime.replay import replay
from tests.rules import shared_folder

RECORDING = shared_folder() / "campaigns" / "D07.mcap"  # eccentric gear from the start, misaligned shafts from 4000 on
PATIENCE = 240.0  # for the twin to take the campaign, tracing included [s]

pytestmark = [
    pytest.mark.slow,
    pytest.mark.shared,
    pytest.mark.timeout(900),
]


@pytest.fixture(scope="module")
def answer(tmp_path_factory):
    out = tmp_path_factory.mktemp("assess") / "answer.json"
    subprocess.run(
        [*COMMAND, "assess", str(RECORDING), "--json", str(out)], cwd=ROOT, check=True, stdout=subprocess.DEVNULL
    )
    return json.loads(out.read_text())


def test_effects_appear_online_and_a_kill_in_between_changes_nothing(answer, tmp_path):
    asset, windows = answer["asset"], len(answer["windows"])
    with service(tmp_path) as (endpoint, address, process):
        replay(RECORDING, [endpoint], 0.0)
        answer_of(address, asset, windows - 3, PATIENCE)
        process.kill()
    with service(tmp_path) as (endpoint, address, _):
        replay(RECORDING, [endpoint], 0.0)
        found = answer_of(address, asset, windows, PATIENCE)
        clocks = [fault for window in found["windows"] for fault in window["faults"] if fault["kind"] == "clock"]
        assert {fault["window"] for fault in clocks} == {0}  # the campaign's time lies in the future
        first, *_ = found["windows"]
        assert first["quality"] == "repaired"
        first["quality"], first["faults"] = "good", []
        assert_same(found, answer)
        assert differences(answer["tracing"], found["tracing"], "tracing") == []
        effects = fetch(f"{address}/v1/assets/{asset}/effects")
        by_name = {e["name"]: e for e in effects}
        assert set(by_name) == {"gear_eccentricity", "misalignment"}
        tilted = by_name["misalignment"]
        assert 3000 < tilted["onset_revolutions"] < 5000
        assert tilted["wear_depth_um_after"] < tilted["wear_depth_um_before"]
        assert tilted["error_after"]["waveform_percent"] < tilted["error_before"]["waveform_percent"]
        events = [e["action"] for e in found["tracing"]["log"] if e["name"] == "misalignment"]
        assert events[0] == "found"
