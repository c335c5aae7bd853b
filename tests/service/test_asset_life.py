"""The life of an asset: questions, changes, names; nothing mixes, nothing is lost or counted twice by a kill."""

from __future__ import annotations

import json
import signal
import threading

import pytest
import service_fakes as fakes
from memory_transport import MemoryNetwork
from service_streams import RIG, Service, SqliteFile, wait_until, write_recording
from test_decisions import post
from test_other_parts import serving

from service.alarms.keeper import AlarmKeeper
from service.alarms.rules import Rule
from service.cli import run
from service.errors import DeliveryError, InputError
from service.results.alarm_store import AlarmStore
from service.results.jobs import Jobs
from service.results.window_jobs import WindowJobs
from service.runtime.followed import Followed
from service.runtime.replay import replay
from service.runtime.spool import Spool

WINDOWS = 4
LATER = 86_400.0  # [s]
UNSW = "/v1/assets/unsw"


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    return write_recording(tmp_path_factory.mktemp("first") / "first.mcap", WINDOWS)


@pytest.fixture(scope="module")
def second(tmp_path_factory):
    """Another machine, or new gears, under the same name: recorded a day later, its revolutions begin again."""
    return write_recording(tmp_path_factory.mktemp("second") / "second.mcap", WINDOWS, later=LATER, seed=8)


@pytest.fixture
def network():
    return MemoryNetwork()


@pytest.fixture
def running(tmp_path, network):
    with serving(tmp_path, network, SqliteFile(tmp_path)) as running:
        yield running


def send(network, recording):
    replay(recording, (), 0, publish_to=network.open_publisher)


def change(running, kind, asset="unsw", **given):
    return post(running, f"/v1/assets/{asset}/changes", {"kind": kind, **given})


def waiting(running, asset="unsw"):
    question = running.get(f"/v1/assets/{asset}")["question"]
    return None if question is None else question["waiting"]


def asked(running, network, first, second):
    """Both recordings sent; the question is open, and all windows of the second one wait."""
    send(network, first)
    running.wait_for_windows(WINDOWS)
    send(network, second)
    wait_until(lambda: waiting(running) == WINDOWS)
    return running.get(UNSW)


def revolutions(windows):
    return [round(w["revolutions"]) for w in windows]


def events(running, asset="unsw"):
    with running.store() as store:
        return [(e.kind, e.data) for e in store.events(asset, 0, 10_000)]


FIRST = [10, 610, 1210, 1810]


@pytest.mark.slow
def test_revolutions_that_fall_ask_whose_they_are_and_the_windows_wait(running, network, first, second):
    """They were mixed into the first machine's history, or refused one by one, while the status stayed `ok`."""
    state = asked(running, network, first, second)
    assert state["question"]["text"] == "Gears replaced, or another machine?"
    assert state["question"]["answers"] == ["gears_replaced", "counter_reset", "other_machine", "ignore"]
    assert state["status"]["level"] == "no_verdict" and "another machine?" in state["status"]["reasons"][0]
    assert revolutions(running.windows()) == FIRST  # none of the second is in the first one's history
    (summary,) = running.get("/v1/assets")
    assert summary["status"]["level"] != "normal" and summary["windows"] == WINDOWS
    wait_until(lambda: json.loads(network.published[-1][1])["question"]["waiting"] == WINDOWS)
    assert [data["kind"] for kind, data in events(running) if kind == "question"] == ["count_fell"]


@pytest.mark.slow
def test_replaced_gears_begin_an_epoch_with_the_windows_that_waited(running, network, first, second):
    asked(running, network, first, second)
    status, answer = change(running, "gears_replaced", by="A. Fitter", note="pinion pitted")
    assert (status, answer["done"], answer["effect"]["epoch"], answer["by"]) == (201, True, 1, "A. Fitter")
    windows = running.wait_for_windows(WINDOWS)
    wait_until(lambda: running.get(UNSW)["windows_total"] == WINDOWS)
    state = running.get(UNSW)
    assert state["question"] is None and state["epoch"] == 1
    assert revolutions(state["windows"]) == FIRST and [w["index"] for w in windows] == [4, 5, 6, 7]
    assert revolutions(running.get(f"{UNSW}/windows?epoch=0")) == FIRST
    trend = running.get(f"{UNSW}/trend?resolution=100")
    assert [p["index"] for p in trend] == [4, 5, 6, 7]  # revolutions of a chart never run backwards
    epochs = running.get(f"{UNSW}/epochs")
    assert [(e["epoch"], e["windows"], e["first"]) for e in epochs] == [(0, 4, 0), (1, 4, 4)]
    assert epochs[1]["since"] == windows[0]["start_time"]
    (event,) = [data for kind, data in events(running) if kind == "change"]
    assert event["kind"] == "gears_replaced" and event["note"] == "pinion pitted"
    (kept,) = running.get(f"{UNSW}/changes")
    assert kept["kind"] == "gears_replaced" and kept["by"] == "A. Fitter"


@pytest.mark.slow
def test_a_counter_that_was_reset_goes_on_from_the_sum(running, network, first, second):
    asked(running, network, first, second)
    assert change(running, "counter_reset")[0] == 201
    windows = running.wait_for_windows(2 * WINDOWS)
    assert revolutions(windows) == [*FIRST, *(n + FIRST[-1] for n in FIRST)]
    assert running.get(UNSW)["epoch"] == 0


@pytest.mark.slow
def test_another_machine_is_an_asset_of_its_own_with_the_stream_from_then_on(running, network, first, second, tmp_path):
    asked(running, network, first, second)
    assert change(running, "other_machine", name="bench-2", by="me")[0] == 201
    assert revolutions(running.wait_for_windows(WINDOWS, "bench-2")) == FIRST
    assert revolutions(running.windows()) == FIRST and running.get(UNSW)["question"] is None
    assert running.get("/v1/assets/bench-2/rig")["name"] == "unsw"
    third = write_recording(tmp_path / "third.mcap", WINDOWS, later=2 * LATER, seed=9)
    send(network, third)
    wait_until(lambda: waiting(running, "bench-2") == WINDOWS)  # frames under the old name are the new asset's now
    assert waiting(running) is None and revolutions(running.windows()) == FIRST


@pytest.mark.slow
def test_a_window_that_closes_before_the_stream_has_followed_is_the_other_machines_too(
    running, network, first, second, tmp_path, monkeypatch
):
    """It was used as the first machine's: whoever computes had committed the change, and had not said so yet."""
    asked(running, network, first, second)
    only_last(write_recording(tmp_path / "longer.mcap", WINDOWS + 1, later=LATER, seed=8), tmp_path / "last.mcap")
    closed, go_on, follow, keep = threading.Event(), threading.Event(), Followed._follow, Spool._keep

    def late(followed):
        if go_on.is_set():
            follow(followed)

    def kept(spool, window):
        closed.set()
        return keep(spool, window)

    monkeypatch.setattr(Followed, "_follow", late)
    monkeypatch.setattr(Spool, "_keep", kept)
    asking = threading.Thread(target=change, args=(running, "other_machine"), kwargs={"name": "bench-2"})
    asking.start()
    wait_until(lambda: running.get("/v1/assets/bench-2") is not None)  # it has been committed
    sending = threading.Thread(target=send, args=(network, tmp_path / "last.mcap"))
    sending.start()  # it ends once all is stored
    assert closed.wait(30)
    go_on.set()
    sending.join()
    asking.join()
    assert revolutions(running.wait_for_windows(WINDOWS + 1, "bench-2")) == [*FIRST, 2410]
    assert revolutions(running.windows()) == FIRST and running.get(UNSW)["question"] is None


@pytest.mark.slow
def test_windows_that_are_ignored_are_listed_as_refused_and_nobody_is_asked_again(running, network, first, second):
    asked(running, network, first, second)
    assert change(running, "ignore")[0] == 201
    wait_until(lambda: len(running.windows()) == 2 * WINDOWS)
    refused = running.windows()[WINDOWS:]
    assert all(w["quality"] == "refused" and "revolution count are not used" in w["reason"] for w in refused)
    assert running.get(UNSW)["question"] is None


@pytest.mark.slow
def test_one_disturbed_count_closes_its_question_itself(running, network, first, tmp_path):
    send(network, first)
    running.wait_for_windows(WINDOWS)
    send(network, write_recording(tmp_path / "glitch.mcap", 1, later=3600, seed=8))
    wait_until(lambda: waiting(running) == 1)
    longer = write_recording(tmp_path / "on.mcap", WINDOWS + 1, later=7200, seed=9)
    only_last(longer, tmp_path / "last.mcap")
    send(network, tmp_path / "last.mcap")
    wait_until(lambda: running.get(UNSW)["windows_total"] == WINDOWS + 2)  # shown, which follows being kept
    state = running.get(UNSW)
    assert state["question"] is None
    assert "disturbance of the counter" in next(w for w in state["windows"] if w["quality"] == "refused")["reason"]


def only_last(recording, out):
    """The last window of a recording alone."""
    from service.stream.sources.mcap import Recording
    from service.stream.sources.mcap_write import RecordingWriter
    from service.stream.wire.codec import encode

    with Recording(recording) as source, RecordingWriter(out, rig_text=source.rig_text, metadata={}) as writer:
        frames = list(source.frames(lambda *_: None))
        begin = max(f.start_time_ns for f in frames) - 3 * 10**9
        for frame in frames:
            if frame.start_time_ns > begin:
                writer.write(frame.channel, frame.end_time_ns, encode(frame))


@pytest.mark.slow
def test_an_older_recording_of_another_machine_is_asked_about_too(running, network, first, second):
    """All its frames were dropped as late or duplicate, while the replay said `delivered` and the status `ok`."""
    send(network, second)
    running.wait_for_windows(WINDOWS)
    send(network, first)
    wait_until(lambda: waiting(running) == WINDOWS)
    assert change(running, "other_machine", name="older")[0] == 201
    assert revolutions(running.wait_for_windows(WINDOWS, "older")) == FIRST


@pytest.mark.slow
def test_a_rig_file_of_other_gears_is_asked_about_before_its_windows_are_used(running, network, first, tmp_path):
    """A second machine's rig file was ignored, and its windows evaluated with the gears of the first one."""
    send(network, first)
    running.wait_for_windows(WINDOWS)
    wider = write_recording(
        tmp_path / "wider.mcap", WINDOWS, later=LATER, changed=(b"face_width = 0.020", b"face_width = 0.025")
    )
    network.on_rig("unsw", b"".join(_rig_text(wider)))
    wait_until(lambda: waiting(running) == 0)
    question = running.get(UNSW)["question"]
    assert question["kind"] == "gears_differ" and "gears.face_width = 0.025 (was 0.02)" in question["detail"]
    send(network, wider)
    wait_until(lambda: waiting(running) == WINDOWS)
    assert change(running, "gears_replaced")[0] == 201
    wait_until(lambda: running.get(UNSW)["windows_total"] == WINDOWS)
    assert running.get(f"{UNSW}/rig")["gears"]["face_width"] == 0.025 and running.get(UNSW)["epoch"] == 1


def _rig_text(recording):
    from service.stream.sources.mcap import Recording

    with Recording(recording) as source:
        yield source.rig_text


@pytest.mark.slow
def test_a_rig_file_of_the_settings_that_differs_is_asked_about_and_the_service_starts(tmp_path, network, first):
    """The service refused to start."""
    with serving(tmp_path, network, SqliteFile(tmp_path)) as running:
        send(network, first)
        running.wait_for_windows(WINDOWS)
        given = running.get(f"{UNSW}/rig")
    rig = tmp_path / "wider.toml"
    rig.write_text(RIG.read_text().replace("face_width = 0.020", "face_width = 0.025"))
    with serving(tmp_path, network, SqliteFile(tmp_path), rig=rig) as running:
        wait_until(lambda: waiting(running) == 0)
        assert running.get(UNSW)["question"]["kind"] == "gears_differ"
        assert running.get(f"{UNSW}/rig") == given  # the earlier rig file holds until people have answered
    with serving(tmp_path, network, SqliteFile(tmp_path)) as running:
        wait_until(lambda: running.get(UNSW)["question"] is None)  # with the earlier rig file there is nothing to ask
    with serving(tmp_path, network, SqliteFile(tmp_path), rig=rig) as running:
        wait_until(lambda: waiting(running) == 0)
        assert change(running, "ignore")[0] == 201
    with serving(tmp_path, network, SqliteFile(tmp_path), rig=rig) as running:
        assert running.get(UNSW)["question"] is None  # answered once


# -- kills -----------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_kill_while_windows_wait_and_while_they_are_processed_loses_and_doubles_none(tmp_path, first, second):
    running = Service(tmp_path, slow=0.3).start()
    try:
        replay(first, [running.endpoint], 0)
        running.wait_for_windows(WINDOWS)
        replay(second, [running.endpoint], 0)
        wait_until(lambda: (waiting(running) or 0) >= 2)
        running.end(signal.SIGKILL)
        running.start()
        assert waiting(running) >= 2
        replay(second, [running.endpoint], 0)  # what was committed before the kill is known, what was not comes again
        wait_until(lambda: waiting(running) == WINDOWS)
        with running.store() as store:
            Jobs(store.database).add("unsw", "gears_replaced", {"by": "me"})
        running.end(signal.SIGKILL)  # before the change was carried out
        running.start()
        wait_until(lambda: running.get(f"{UNSW}/windows?epoch=1"))
        running.end(signal.SIGKILL)  # while the windows that waited are processed
        running.start()
        wait_until(lambda: len(running.windows()) == WINDOWS)
        assert revolutions(running.windows()) == FIRST
        assert len(running.get(f"{UNSW}/windows?epoch=0")) == WINDOWS
        assert running.get(UNSW)["epoch"] == 1  # carried out once
        with running.store() as store:
            assert WindowJobs(store.database).waiting("unsw") == ()
    finally:
        running.end(signal.SIGKILL)


# -- names -----------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_renamed_asset_keeps_its_history_and_the_frames_of_its_old_name(running, network, first, tmp_path):
    send(network, first)
    running.wait_for_windows(WINDOWS)
    given = {"revolutions": 1200.0, "max_depth_um": 30.0, "flank": "combined", "std_um": 1.0}
    assert post(running, f"{UNSW}/inspections", given)[0] == 201
    status, answer = change(running, "renamed", name="press-7", by="me")
    assert (status, answer["effect"]) == (201, {"asset": "press-7", "was": "unsw"})
    assert running.get(UNSW) is None and revolutions(running.windows("press-7")) == FIRST
    assert len(running.get("/v1/assets/press-7/inspections")) == 1
    assert [a["asset"] for a in running.get("/v1/assets")] == ["press-7"]
    assert network.announced == {"press-7"}
    longer = write_recording(tmp_path / "on.mcap", WINDOWS + 2)
    send(network, longer)  # under the old name; its first windows are known
    assert revolutions(running.wait_for_windows(WINDOWS + 2, "press-7")) == [*FIRST, 2410, 3010]
    assert running.get(UNSW) is None
    status, answer = post(running, "/v1/assets", {"asset": "unsw"})
    assert status == 409 and "called so" in answer["detail"]


@pytest.mark.slow
def test_a_restart_knows_the_new_name_and_the_old_one(tmp_path, network, first):
    with serving(tmp_path, network, SqliteFile(tmp_path)) as running:
        send(network, first)
        running.wait_for_windows(WINDOWS)
        assert change(running, "renamed", name="press-7")[0] == 201
    with serving(tmp_path, network, SqliteFile(tmp_path)) as running:
        send(network, write_recording(tmp_path / "on.mcap", WINDOWS + 1))
        assert revolutions(running.wait_for_windows(WINDOWS + 1, "press-7")) == [*FIRST, 2410]
        assert running.get(UNSW) is None
        assert len(running.get("/v1/assets/press-7/signals")["windows"]) == WINDOWS + 1


@pytest.mark.slow
def test_frames_of_a_retired_asset_are_left_out_until_it_is_reinstated(running, network, first, second):
    send(network, first)
    running.wait_for_windows(WINDOWS)
    assert change(running, "retired", by="me", note="scrapped")[0] == 201
    state = running.get(UNSW)
    assert state["retired"]["by"] == "me" and state["retired"]["note"] == "scrapped"
    assert running.get("/v1/assets")[0]["retired"] is True
    with pytest.raises(DeliveryError, match=r"^\d+ frames are not stored: asset unsw is retired"):
        replay(second, (), 0, publish_to=network.open_publisher, wait=0.5)
    assert waiting(running) is None and len(running.windows()) == WINDOWS
    assert change(running, "reinstated")[0] == 201
    assert running.get(UNSW)["retired"] is None


@pytest.mark.slow
def test_an_asset_is_created_with_its_rig_file_before_its_first_frame(running, network, first):
    rig = {"gears": {"pinion": {"teeth": 19}, "gear": {"teeth": 52}}}
    status, answer = post(running, "/v1/assets", {"asset": "unsw", "rig": rig, "by": "me"})
    assert (status, answer["asset"], answer["windows"]) == (201, "unsw", 0)
    assert post(running, "/v1/assets", {"asset": "unsw"})[0] == 409
    send(network, first)
    running.wait_for_windows(WINDOWS)
    assert running.get(f"{UNSW}/rig") == rig  # not the one that the recording offers


@pytest.mark.slow
def test_what_waits_at_a_start_is_carried_out_in_the_order_in_which_it_was_received(tmp_path, network, first):
    """The depth of the new gears was entered for the old ones, and then forgotten with them."""
    with serving(tmp_path, network, SqliteFile(tmp_path)) as running:
        send(network, first)
        running.wait_for_windows(WINDOWS)
    measured = {"revolutions": 10.0, "max_depth_um": 2.0, "flank": "combined", "std_um": 1.0}
    with running.store() as store:
        life = Jobs(store.database)
        fakes.decide(store, "unsw", "misalignment", "pin")
        life.add("unsw", "gears_replaced", {})
        life.add("unsw", "renamed", {"name": "press-7"})
        fakes.inspect(store, "unsw", measured, {"applied": False})
    with serving(tmp_path, network, SqliteFile(tmp_path)) as running:
        wait_until(lambda: [i["applied"] for i in running.get("/v1/assets/press-7/inspections") or ()] == [True])
        assert running.get("/v1/assets/press-7/wear")["max_depth_um"]["combined"]["median"] == 2.0
        told = [data.get("kind") or data.get("action") or kind for kind, data in events(running)]
    wanted = ["pin", "gears_replaced", "renamed", "inspection"]
    assert [what for what in told if what in wanted] == wanted


# -- refusals --------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["reassembled", "sensor_moved", "gears_replaced"])
def test_an_alarm_by_learned_limits_ends_with_the_change_after_which_they_are_learned_anew(
    running, network, first, kind
):
    send(network, first)
    running.wait_for_windows(WINDOWS)
    with running.store() as store:
        learned_and_raised(AlarmKeeper(AlarmStore(store.database)), running.windows()[0])
    assert [a["state"] for a in running.get(f"{UNSW}/alarms")] == ["active_unacknowledged"] * 2
    sensor = {"sensor": "y6"} if kind == "sensor_moved" else {}
    assert change(running, kind, **sensor)[0] == 201
    alarms = {a["rule"]: a for a in running.get(f"{UNSW}/alarms")}
    assert {rule: a["active"] for rule, a in alarms.items()} == {"level": False, "set": True}
    (ended,) = [h for h in alarms["level"]["history"] if h["verb"] == "ended"]
    assert ended["reason"] == f"The limits are learned anew after the change {kind}."
    told = [(data["verb"], data["alarm"]["rule"]) for name, data in events(running) if name == "alarm"]
    assert told == [("ended", "level")]


def learned_and_raised(keeper, window):
    """Ten healthy windows and a loud one, judged by a learned limit and by one that a rule sets."""
    rules = [Rule(name="level", quantity="rms", windows=1), Rule(name="set", quantity="rms", watch=20.0)]
    keeper.set_rules("unsw", rules, "me", "")
    for index in range(100, 111):
        record = {
            **window,
            "index": index,
            "quality": "good",
            "indicators": {"y6": {"rms": 90.0 if index == 110 else 2.0}},
        }
        keeper.window("unsw", index, record, None, {"level": "ok", "reason": ""})


@pytest.mark.slow
def test_what_cannot_be_changed_is_refused_with_its_reason(running, network, first):
    send(network, first)
    running.wait_for_windows(WINDOWS)

    def refused(kind, status, text, **given):
        got, answer = change(running, kind, **given)
        assert got == status and text in answer["detail"], answer

    refused("ignore", 409, "answers a question, and none that it answers is open")
    refused("other_machine", 409, "none that it answers is open", name="b")
    refused("other_machine", 422, "name: Field required")
    refused("renamed", 409, "there is an asset 'unsw' already", name="unsw")
    refused("renamed", 422, "name", name="a/b")
    refused("sensor_moved", 422, "sensor: Field required")
    refused("sensor_moved", 409, "no accelerometer 'y9' has sent a frame; known: y6", sensor="y9")
    refused("oil_changed", 422, "count: Extra inputs are not permitted", count=3.0)
    refused("painted", 422, "gears_replaced")
    assert post(running, "/v1/assets/nobody/changes", {"kind": "oil_changed"})[0] == 404
    status, answer = post(running, "/v1/assets", {"asset": "b", "rig": {"gears": {"modul": 2}}})
    assert status == 409 and "did you mean gears.module" in answer["detail"]


# -- command line ----------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_command_lists_the_question_and_answers_it(running, network, first, second, capsys, tmp_path):
    asked(running, network, first, second)
    url = f"http://{running.http}"

    def gear_twin(*arguments, status=0):
        assert run(["remote", "assets", *arguments, "--service", url]) == status
        said = capsys.readouterr()
        return said.out if status == 0 else said.err

    listed = gear_twin("list")
    assert "unsw  no verdict" in listed and "Gears replaced, or another machine?" in listed
    assert "4 windows wait. Answer: gear-twin remote assets change unsw\n  with one of " in listed
    assert gear_twin("change", "unsw", "other_machine", "--name", "bench-2", "--by", "me") == (
        "other_machine of unsw: done\n"
    )
    running.wait_for_windows(WINDOWS, "bench-2")
    assert gear_twin("changes", "unsw").split()[-4:] == ["other_machine", "yes", "me", "bench-2"]
    assert gear_twin("rename", "bench-2", "press-7") == "renamed of bench-2: done\n"
    assert gear_twin("retire", "press-7", "--note", "scrapped") == "retired of press-7: done\n"
    assert "press-7  retired" in gear_twin("list")
    assert gear_twin("reinstate", "press-7") == "reinstated of press-7: done\n"
    assert "created" in gear_twin("create", "new-one", "--rig", str(RIG))
    assert running.get("/v1/assets/new-one/rig")["name"] == "unsw"
    refused = gear_twin("change", "unsw", "ignore", status=2)
    assert refused.count("\n") == 1 and "answers a question" in refused


@pytest.mark.slow
def test_a_recording_is_replayed_under_the_name_of_another_asset(running, network, first, tmp_path):
    replay(first, (), 0, publish_to=network.open_publisher, asset="bench-9")
    assert revolutions(running.wait_for_windows(WINDOWS, "bench-9")) == FIRST
    assert [a["asset"] for a in running.get("/v1/assets")] == ["bench-9"]
    assert running.get("/v1/assets/bench-9/rig")["name"] == "unsw"  # the recording's rig file is offered under it, too
    with pytest.raises(InputError, match=r"asset = 'a b' must be 1 to 64 letters"):
        replay(first, (), 0, publish_to=network.open_publisher, asset="a b")
