"""Machines without a model through a running service: import, replay over Zenoh, REST; nothing is invented."""

import json

import numpy as np
import pytest

from service.files.baseline import learned, save
from service.files.import_recording import import_recording
from service.runtime.replay import replay
from tests.claims.test_baseline import machine
from tests.claims.test_encoder_pair import counts
from tests.service.test_baselines import recording as accelerations
from tests.service.test_pair import imported
from tests.service.test_relate import relation_to
from tests.service.test_whole import ROOT, answer_of, fetch, service

MAPPINGS = ROOT / "recordings" / "mappings"
IDLE = "0.7"  # silence that ends a window [s]


@pytest.fixture(scope="module")
def brought(shared, tmp_path_factory):
    """A file of a measured set as a recording."""
    folder = tmp_path_factory.mktemp("brought")

    def one(name, source):
        out = folder / f"{source.split('.')[0]}.mcap"
        file = shared / "measured" / name / source
        import_recording(MAPPINGS / f"{name}.toml", out, source=file, started="2020-10-28T00:00:00Z")
        return out

    return one


def answered(address, endpoint, recording, asset):
    """What the service answers once it has taken a recording of one window; every part of it by REST."""
    replay(recording, [endpoint], 0.0)
    answer = answer_of(address, asset, 1)
    for part in ("wear", "rul", "residual", "effects", "tracing"):
        assert fetch(f"{address}/v1/assets/{asset}/{part}") == answer[part]
    assert fetch(f"{address}/v1/assets/{asset}/windows") == answer["windows"]
    return answer


def assert_no_wear_is_invented(answer):
    for part in ("wear", "rul"):
        assert answer[part]["status"] == "not available"
        assert "the rig file" in answer[part]["reason"]
    for window in answer["windows"]:
        assert window["wear_depth_um"] is window["k_wear_per_n"] is window["rms_predicted"] is None
        assert window["updated"] is False


@pytest.mark.slow
def test_two_encoders_alone_are_answered_by_a_running_service(tmp_path):
    recording, _ = imported(tmp_path, *counts(1))
    with service(tmp_path / "data", idle_timeout=IDLE) as (endpoint, address, _):
        answer = answered(address, endpoint, recording, "two-encoders")
        assert_no_wear_is_invented(answer)
        assert "31/16" in answer["pair"]["teeth_that_fit"] and answer["effects"] == []
        assert fetch(f"{address}/v1/assets")[0]["status"]["level"] == "no_verdict"


@pytest.mark.slow
def test_measured_pair_and_measured_rig_are_answered_by_one_service(brought, tmp_path):
    pair = brought("spur-pair-dual-encoder", "encoders.npz")
    rig = brought("spur-rig-28ch-2000rpm", "channels.npz")
    with service(tmp_path, idle_timeout=IDLE) as (endpoint, address, _):
        answer = answered(address, endpoint, pair, "spur-pair")
        assert_no_wear_is_invented(answer)
        found = answer["pair"]
        assert found["ratio"]["value"] == pytest.approx(1.941, abs=0.004)
        assert found["ratio"]["std"] < 0.0025 * found["ratio"]["value"]
        assert {"31/16", "33/17"} <= set(found["teeth_that_fit"]) and "2/1" not in found["teeth_that_fit"]
        assert found["rest_urad"]["before"] == pytest.approx(23200, rel=0.02)
        assert found["rest_urad"]["after"] == pytest.approx(7600, rel=0.02)
        once = {(t["shaft"], t["multiple"]): t for t in found["run_out"]}["gear", 1]
        assert once["amplitude_urad"] == pytest.approx(32050, rel=0.02) and once["std_urad"] < 0.15 * 32050
        assert once["amplitude_um"] is None and once["indistinguishable_from"] == ["its encoder's disc"]
        (sharp,) = found["sharp_steps"]
        assert (sharp["shaft"], sharp["times"]) == ("gear", 2) and sharp["turn"] == pytest.approx(0.416, abs=0.003)
        assert found["missed_counts"] == []
        assert answer["residual"]["status"] == "not available" and answer["effects"] == []

        answer = answered(address, endpoint, rig, "spur-rig-28ch")
        assert_no_wear_is_invented(answer)
        assert "pair" not in answer and answer["effects"] == []
        lines = {round(line["frequency_hz"], 1): line for line in answer["unattributed_lines"]}
        line, race, shared = lines[39.6], lines[171.6], "cage and outer race of one bearing of 13 elements"
        assert line["frequency_hz"] == pytest.approx(39.597, abs=0.005) and line["geared"] is None
        assert [c["name"] for c in line["causes"] if c["possible"]] == ["cage of a bearing on the pinion", shared]
        assert shared in [c["name"] for c in race["causes"] if c["possible"]]
        assert answer["unexplained"]["verdict"] == "unknown_effect"
        assert answer["residual"]["bands"][0]["measured"] > 0 and answer["residual"]["bands"][0]["predicted"] is None


@pytest.mark.slow
def test_measured_broken_tooth_is_told_from_its_baseline_by_a_running_service(brought, tmp_path):
    def file(state, percent):
        return brought("spectraquest-broken-tooth", f"{state}30hz{percent}.csv.gz")

    healthy = tmp_path / "healthy.baseline"
    save(learned([file("h", percent) for percent in (0, 20, 30, 60, 70)]), healthy)
    with service(tmp_path / "data", idle_timeout=IDLE, baseline=str(healthy)) as (endpoint, address, _):
        answer = answered(address, endpoint, file("b", 40), "spectraquest-gfd")
    assert_no_wear_is_invented(answer)
    (local,) = [e for e in answer["effects"] if "shaft_order" in e["parameters"]]
    assert local["name"] == "unknown_effect" and local["channels"] == ["a4"]
    assert local["parameters"]["shaft_order"]["value"] == pytest.approx(0.15)
    alike = local["evidence"]["indistinguishable_from"]
    assert "tooth_crack" in alike and any("low-frequency response of a4" in said for said in alike)
    assert "pair" not in answer and answer["baseline"]["window"]["same_teeth"] is True


@pytest.mark.slow
def test_depth_by_a_relation_of_levels_is_given_by_a_running_service(tmp_path):
    recording = accelerations(tmp_path, "some", load=0.3, seed=1)
    level = float(np.std(machine(0.3, 1).accelerations["a"].values))
    relation = tmp_path / "relation.json"
    relation.write_text(json.dumps({"schema": "gear-relation/1", "relation": relation_to(level).to_dict()}))
    with service(tmp_path / "data", idle_timeout=IDLE, relation=str(relation)) as (endpoint, address, _):
        answer = answered(address, endpoint, recording, "bench")
    depth = answer["wear"]["max_depth_um"]
    assert depth["combined"]["median"] == pytest.approx(100, abs=10)
    assert depth["combined"]["p05"] < depth["combined"]["median"] < depth["combined"]["p95"]
    assert depth["pinion"]["status"] == depth["gear"]["status"] == answer["rul"]["status"] == "not available"
    assert answer["windows"][0]["wear_depth_um"] == depth["combined"]["median"]
