"""Rig files on the stream: used for a new asset where assets are adopted, else a proposal until a person decides."""

from __future__ import annotations

import json

import pytest
from memory_transport import MemoryNetwork
from service_streams import SqliteFile, wait_until, write_recording
from test_asset_life import change, revolutions, waiting
from test_decisions import post
from test_other_parts import serving
from test_unknown_assets import FIRST, WINDOWS, Replaying, unknown_of

from service.cli import run
from service.files.rig_difference import differences, digest_of
from service.runtime.replay import replay
from service.runtime.rig_sources import MOST_OFFERED, RIG_BYTES, OfferedRigs

UNSW = "/v1/assets/unsw"
OTHER_LIFE = (b"max_depth = 5.0e-4", b"max_depth = 3.0e-4")
OTHER_GEARS = (b"face_width = 0.020", b"face_width = 0.025")


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return write_recording(tmp_path_factory.mktemp("recording") / "unsw.mcap", WINDOWS)


@pytest.fixture(scope="module")
def rig(recording):
    from service.stream.sources.mcap import Recording

    with Recording(recording) as source:
        return source.rig_text


@pytest.fixture
def network():
    return MemoryNetwork()


@pytest.fixture
def adopting(tmp_path, network):
    with serving(tmp_path / "data", network, SqliteFile(tmp_path / "data")) as running:
        yield running


@pytest.fixture
def asking(tmp_path, network):
    """A service that asks, and knows the asset unsw with its rig file."""
    with serving(tmp_path / "data", network, SqliteFile(tmp_path / "data"), new_assets="ask") as running:
        yield running


def begun(running, network, recording):
    """The asset adopted with its rig file, and its windows processed."""
    Replaying(network, recording, wait=0.5).end()
    network.on_rig("unsw", network.rigs["unsw"])
    wait_until(lambda: unknown_of(running).get("unsw", {}).get("rig_digest"))
    digest = unknown_of(running)["unsw"]["rig_digest"]
    assert post(running, "/v1/unknown-assets/unsw/adopt", {"rig": digest})[0] == 201
    replay(recording, (), 0, publish_to=network.open_publisher)
    assert revolutions(running.wait_for_windows(WINDOWS)) == FIRST
    return running.get(f"{UNSW}/rig")


def proposed(running):
    return running.get("/v1/rig-proposals")


def decide(running, decision, digest, **given):
    return post(running, f"{UNSW}/rig-proposal", {"decision": decision, "digest": digest, **given})


def test_differences_are_named_by_key_with_both_values():
    found = differences({"a": {"b": 1.0}, "c": 2}, {"a": {"b": 1.5}, "d": "x"})
    assert [(d.key, d.before, d.now) for d in found] == [("a.b", "1", "1.5"), ("c", "2", None), ("d", None, "x")]
    assert digest_of({"a": 1, "b": 2}) == digest_of({"b": 2, "a": 1}) != digest_of({"a": 1})


def test_rig_files_that_are_offered_are_bounded_in_size_and_number(caplog):
    offered = OfferedRigs(MemoryNetwork())
    for number in range(2 * MOST_OFFERED):
        offered._received(f"a{number}", b'name = "x"')
    assert len(offered.fresh()) == MOST_OFFERED and offered.find("a0") is None
    offered._received("large", b'description = "' + b"x" * RIG_BYTES + b'"')
    assert "at most 131072 are accepted" in caplog.text and offered.find("large") is None


# -- where people are asked ------------------------------------------------------------------------------


@pytest.mark.slow
def test_an_asset_that_is_adopted_without_the_offered_rig_file_has_it_as_a_proposal(asking, network, recording, rig):
    Replaying(network, recording, wait=0.5).end()
    network.on_rig("unsw", rig)
    wait_until(lambda: unknown_of(asking).get("unsw", {}).get("rig_name") == "unsw")
    status, answer = post(asking, "/v1/unknown-assets/unsw/adopt", {"rig": "0" * 16})
    assert status == 409 and "is not offered for unsw" in answer["detail"]
    assert post(asking, "/v1/unknown-assets/unsw/adopt", {})[0] == 201
    replay(recording, (), 0, publish_to=network.open_publisher)
    asking.wait_for_windows(WINDOWS)
    assert asking.get(f"{UNSW}/rig")["status"] == "not available"
    wait_until(lambda: proposed(asking))
    (proposal,) = proposed(asking)
    assert {d["key"]: d["proposed"] for d in proposal["differences"]}["gears.pinion.teeth"] == "19"
    assert decide(asking, "accept", proposal["digest"])[0] == 201
    assert asking.get(f"{UNSW}/rig")["name"] == "unsw" and proposed(asking) == []


@pytest.mark.slow
def test_a_forged_rig_file_leaves_a_known_asset_untouched(asking, network, recording, rig, tmp_path):
    """It paused the asset: its windows waited for an answer."""
    before = begun(asking, network, recording)
    network.on_rig("unsw", rig.replace(*OTHER_GEARS))
    wait_until(lambda: proposed(asking))
    longer = write_recording(tmp_path / "longer.mcap", WINDOWS + 2, seed=7)
    replay(longer, (), 0, publish_to=network.open_publisher)
    assert len(asking.wait_for_windows(WINDOWS + 2)) == WINDOWS + 2
    state = asking.get(UNSW)
    assert state["question"] is None and asking.get(f"{UNSW}/rig") == before and waiting(asking) is None
    (proposal,) = proposed(asking)
    assert proposal["differences"] == [{"key": "gears.face_width", "present": "0.02", "proposed": "0.025"}]


@pytest.mark.slow
def test_accepted_it_is_used_from_then_on_also_after_a_restart(tmp_path, network, recording, rig):
    data = tmp_path / "data"
    with serving(data, network, SqliteFile(data), new_assets="ask") as asking:
        begun(asking, network, recording)
        network.on_rig("unsw", rig.replace(*OTHER_LIFE))
        wait_until(lambda: proposed(asking))
        (proposal,) = proposed(asking)
        status, answer = decide(asking, "accept", "0" * 16)
        assert status == 409 and proposal["digest"] in answer["detail"]  # it is not the one that was seen
        status, answer = decide(asking, "accept", proposal["digest"], by="Ann", note="after the overhaul")
        assert (status, answer["kind"], answer["done"], answer["by"]) == (201, "rig_accepted", True, "Ann")
        assert asking.get(f"{UNSW}/rig")["end_of_life"]["max_depth"] == 3e-4 and proposed(asking) == []
        assert decide(asking, "accept", proposal["digest"])[0] == 409
        entry = asking.get("/v1/audit")[-1]
        assert (entry["action"], entry["note"], entry["outcome"]) == ("rig_accepted", "after the overhaul", "done")
    with serving(data, network, SqliteFile(data), new_assets="ask") as asking:
        assert asking.get(f"{UNSW}/rig")["end_of_life"]["max_depth"] == 3e-4
        longer = write_recording(tmp_path / "longer.mcap", WINDOWS + 1)
        replay(longer, (), 0, publish_to=network.open_publisher)
        assert len(asking.wait_for_windows(WINDOWS + 1)) == WINDOWS + 1
        assert proposed(asking) == []


@pytest.mark.slow
def test_accepted_with_other_gears_it_asks_whose_they_are(asking, network, recording, rig):
    begun(asking, network, recording)
    network.on_rig("unsw", rig.replace(*OTHER_GEARS))
    wait_until(lambda: proposed(asking))
    status, answer = decide(asking, "accept", proposed(asking)[0]["digest"])
    assert (status, answer["effect"]["question"]) == (201, "gears_differ")
    assert asking.get(f"{UNSW}/rig")["gears"]["face_width"] == 0.02 and waiting(asking) == 0
    assert change(asking, "gears_replaced")[0] == 201
    assert asking.get(f"{UNSW}/rig")["gears"]["face_width"] == 0.025 and asking.get(UNSW)["epoch"] == 1


@pytest.mark.slow
def test_rejected_it_does_not_come_back_after_a_restart(tmp_path, network, recording, rig, capsys):
    data, other = tmp_path / "data", rig.replace(*OTHER_LIFE)
    with serving(data, network, SqliteFile(data), new_assets="ask") as asking:
        before = begun(asking, network, recording)
        network.on_rig("unsw", other)
        wait_until(lambda: proposed(asking))
        url = f"http://{asking.http}"
        assert run(["remote", "assets", "rig", "--url", url]) == 0
        said = capsys.readouterr().out
        digest = proposed(asking)[0]["digest"]
        assert digest in said and "end_of_life.max_depth" in said and "0.0003" in said
        assert run(["remote", "assets", "rig", "unsw", "--reject", digest, "--by", "me", "--url", url]) == 0
        assert "rig file rejected for unsw: done" in capsys.readouterr().out
        assert proposed(asking) == [] and asking.get(f"{UNSW}/rig") == before
    with serving(data, network, SqliteFile(data), new_assets="ask") as asking:
        network.on_rig("unsw", other)
        network.on_rig("unsw", rig.replace(*OTHER_GEARS))
        wait_until(lambda: proposed(asking))
        assert [p["digest"] == digest for p in proposed(asking)] == [False]
        network.on_rig("unsw", other)
        assert [p["digest"] == digest for p in proposed(asking)] == [False]


# -- where assets are adopted ----------------------------------------------------------------------------


@pytest.mark.slow
def test_a_new_asset_has_the_offered_rig_file_and_another_one_is_a_proposal(adopting, network, recording, rig):
    """A rig file that differed elsewhere than in its gears was ignored without a word."""
    replay(recording, (), 0, publish_to=network.open_publisher)
    adopting.wait_for_windows(WINDOWS)
    assert adopting.get(f"{UNSW}/rig")["name"] == "unsw" and proposed(adopting) == []
    network.on_rig("unsw", rig)
    network.on_rig("unsw", rig.replace(*OTHER_LIFE))
    wait_until(lambda: proposed(adopting))
    (proposal,) = proposed(adopting)
    assert [d["key"] for d in proposal["differences"]] == ["end_of_life.max_depth"]
    assert adopting.get(UNSW)["question"] is None
    assert decide(adopting, "accept", proposal["digest"])[0] == 201
    assert adopting.get(f"{UNSW}/rig")["end_of_life"]["max_depth"] == 3e-4


@pytest.mark.slow
@pytest.mark.parametrize("offers", ["to whoever asks", "once"])
def test_an_asset_that_was_changed_before_its_first_frame_has_the_rig_file_that_is_offered_then(
    adopting, network, recording, rig, offers
):
    """It was looked for with the change, when nobody offered one yet, and never again."""
    assert post(adopting, "/v1/assets", {"asset": "unsw"})[0] == 201
    assert change(adopting, "retired")[0] == change(adopting, "reinstated")[0] == 201
    assert adopting.get(f"{UNSW}/rig")["status"] == "not available"
    if offers == "once":
        network.on_rig("unsw", rig)
        wait_until(lambda: adopting.get(f"{UNSW}/rig").get("name") == "unsw")
    replay(recording, (), 0, publish_to=network.open_publisher)
    adopting.wait_for_windows(WINDOWS)
    assert adopting.get(f"{UNSW}/rig")["name"] == "unsw" and proposed(adopting) == []


@pytest.mark.slow
def test_a_rig_file_that_comes_after_windows_were_learned_without_one_is_a_proposal(
    adopting, network, recording, rig, tmp_path
):
    """It was left out without a word."""
    replay(write_recording(tmp_path / "bare.mcap", WINDOWS, rig=None), (), 0, publish_to=network.open_publisher)
    adopting.wait_for_windows(WINDOWS)
    network.on_rig("unsw", rig)
    wait_until(lambda: proposed(adopting))
    assert adopting.get(f"{UNSW}/rig")["status"] == "not available"
    assert decide(adopting, "accept", proposed(adopting)[0]["digest"])[0] == 201
    assert adopting.get(f"{UNSW}/rig")["name"] == "unsw" and proposed(adopting) == []


@pytest.mark.slow
def test_events_and_changes_carry_no_rig_files(adopting, network, recording, rig, tmp_path):
    replay(recording, (), 0, publish_to=network.open_publisher)
    adopting.wait_for_windows(WINDOWS)
    network.on_rig("unsw", rig.replace(*OTHER_LIFE))
    wait_until(lambda: proposed(adopting))
    decide(adopting, "accept", proposed(adopting)[0]["digest"])
    (entry,) = adopting.get(f"{UNSW}/changes")
    assert entry["effect"]["values"] == 1 and "gears" not in json.dumps(entry)
