"""A real service process: replayed campaigns over Zenoh TCP, restarts, kills, and a clean end."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import threading
import time
from dataclasses import replace
from functools import partial

import fake_twin
import pytest
import zenoh
from service_streams import RIG, ROOT, Service, free_port, service, wait_until, write_recording

from service.errors import InputError
from service.json_text import plain
from service.runtime import pump
from service.runtime.assess import assess
from service.runtime.http_server import listening_at
from service.runtime.replay import replay
from service.runtime.serve import run
from service.settings import Settings
from service.transport.zenoh import open_session
from tests.streams import shuffled, twice

WINDOWS = 6


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return write_recording(tmp_path_factory.mktemp("recording") / "short.mcap", WINDOWS)


@pytest.fixture(scope="module")
def assessed(recording):
    return plain(assess(recording, twin=fake_twin.TWIN))


@pytest.mark.parametrize(
    "disturb",
    [
        lambda frames: frames,
        pytest.param(twice, marks=pytest.mark.slow),
        pytest.param(partial(shuffled, horizon=24), marks=pytest.mark.slow),
    ],
    ids=["once", "twice", "shuffled"],
)
def test_replayed_campaign_gives_the_same_state_as_assess(tmp_path, recording, assessed, disturb):
    with service(tmp_path) as running:
        replay(recording, [running.endpoint], 0, disturb=disturb)
        assert running.wait_for_windows(WINDOWS) == assessed["windows"]
        whole = running.get("/v1/assets/unsw")
        for part in ("asset", "windows", "wear", "rul", "residual", "effects"):
            assert whole[part] == assessed[part], part
        assert running.get("/v1/assets/unsw/rig")["name"] == "unsw"  # the recording's own, offered on Zenoh


@pytest.mark.slow
def test_killed_service_goes_on_where_it_was_and_counts_nothing_twice(tmp_path, recording, assessed):
    running = Service(tmp_path, slow=0.3).start()
    sending = threading.Thread(target=lambda: _ignoring(replay, recording, [running.endpoint], 0), daemon=True)
    sending.start()
    acknowledged = running.wait_for_windows(2)
    running.end(signal.SIGKILL)
    running.slow = 0.0
    try:
        running.start()
        kept = running.windows()
        assert kept[: len(acknowledged)] == acknowledged  # what was told is there
        replay(recording, [running.endpoint], 0)  # from the start again: what was counted is known
        assert running.wait_for_windows(WINDOWS) == assessed["windows"]
        assert running.get("/v1/assets/unsw")["rul"] == assessed["rul"]
    finally:
        running.end(signal.SIGKILL)


@pytest.mark.slow
def test_replay_goes_on_through_a_kill_of_the_service_and_nothing_is_missing(tmp_path, recording, assessed):
    running, delivered = Service(tmp_path, IDLE_TIMEOUT="5").start(), []
    pace = {"speed": 4.0, "max_pause": 1.5}
    sending = threading.Thread(
        target=lambda: delivered.append(replay(recording, [running.endpoint], **pace)), daemon=True
    )
    sending.start()
    try:
        running.wait_for_windows(2)
        running.end(signal.SIGKILL)
        running.start()
        sending.join(30)
        assert delivered, "the replay did not end"
        assert running.wait_for_windows(WINDOWS) == assessed["windows"]
    finally:
        running.end(signal.SIGKILL)


def _ignoring(call, *given):
    try:
        call(*given)
    except Exception as error:  # the service is killed under it
        assert error is not None


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGINT])
@pytest.mark.slow
def test_signal_ends_the_service_within_seconds_also_in_mid_window(tmp_path, recording, how):
    with service(tmp_path, slow=0.6) as running:
        threading.Thread(target=_ignoring, args=(replay, recording, [running.endpoint], 0), daemon=True).start()
        running.wait_for_windows(1)
        status, said, complained = running.end(how)
        assert status == 0 and "Traceback" not in complained
        assert f"http://{running.http}/" in said
    with service(tmp_path) as again:  # windows that had closed go on where they were
        assert again.wait_for_windows(WINDOWS - 1)[0]["index"] == 0


def test_process_that_has_loaded_zenoh_flushes_and_ends_without_tearing_the_interpreter_down():
    code = (
        "import atexit, zenoh; from service.__main__ import leave; "
        "atexit.register(print, 'torn down'); print('said'); leave(3)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (3, "said\n", "")


@pytest.mark.slow
def test_stream_is_held_up_by_slow_windows_without_a_loss_and_its_last_window_closes_as_soon(tmp_path):
    short = write_recording(tmp_path / "short.mcap", 4)
    with service(tmp_path / "data", slow=2.5, QUEUE_FRAMES="16") as running:
        replay(short, [running.endpoint], 100.0)  # windows come while the first is in the twin
        wait_until(lambda: len(running.windows()) == 4, 20.0)
        assert [w["quality"] for w in running.windows()] == ["good"] * 4
        wait_until(lambda: 'gear_twin_frames_left_out_total{cause="no_room"} 0.0' in running.text("/metrics"))


@pytest.mark.slow
def test_window_that_takes_long_does_not_hold_the_end_up(tmp_path, recording):
    with service(tmp_path, slow=60.0) as running:
        threading.Thread(target=_ignoring, args=(replay, recording, [running.endpoint], 0), daemon=True).start()
        wait_until(lambda: running.get("/v1/assets"))
        time.sleep(2.0)  # the first window is in the twin by now
        status, _, complained = running.end(signal.SIGTERM)
        assert status == 0 and "Traceback" not in complained
    with service(tmp_path) as again:  # what was not committed is taken from the stream again
        replay(recording, [again.endpoint], 0)
        assert len(again.wait_for_windows(WINDOWS)) == WINDOWS


def of_zenoh(session, selector):
    (reply,) = session.get(selector)
    return json.loads(reply.ok.payload.to_bytes())


def of_rest(running):
    """What a state on Zenoh says as well: all but the list of windows."""
    return {key: part for key, part in running.get("/v1/assets/unsw").items() if key != "windows"}


@pytest.mark.slow
def test_state_is_published_and_answers_get_with_the_json_of_rest(tmp_path, recording):
    seen = []
    with service(tmp_path) as running, open_session(connect=[running.endpoint]) as session:
        subscriber = session.declare_subscriber(
            "gearbox/unsw/twin/state", lambda sample: seen.append(sample.payload.to_bytes())
        )
        replay(recording, [running.endpoint], 0)
        running.wait_for_windows(WINDOWS)
        counts = lambda: [json.loads(p)["windows_total"] for p in seen]  # noqa: E731
        wait_until(lambda: WINDOWS in counts())
        assert sorted(counts()) == counts()
        for selector in ("gearbox/unsw/twin/state", "gearbox/*/twin/state"):
            (reply,) = session.get(selector)
            assert str(reply.ok.key_expr) == "gearbox/unsw/twin/state"
            wait_until(lambda selector=selector: of_zenoh(session, selector) == of_rest(running))
            assert str(reply.ok.encoding) == "application/json"
        assert list(session.get("gearbox/nobody/twin/state")) == []
        (token,) = session.liveliness().get("gearbox/*/twin/alive")
        assert str(token.ok.key_expr) == "gearbox/unsw/twin/alive"
        lost = threading.Event()
        watcher = session.liveliness().declare_subscriber(
            "gearbox/unsw/twin/alive",
            lambda sample: lost.set() if sample.kind == zenoh.SampleKind.DELETE else None,
        )
        running.end()
        assert lost.wait(10)
        subscriber.undeclare()
        watcher.undeclare()


@pytest.mark.slow
def test_machine_without_a_rig_file_gets_what_needs_none(tmp_path):
    bare = write_recording(tmp_path / "bare.mcap", 2, rig=None)
    with service(tmp_path / "data") as running:
        replay(bare, [running.endpoint], 0)
        windows = running.wait_for_windows(2)
        assert all(w["rms_measured"] > 0 for w in windows)
        assert running.get("/v1/assets/unsw/wear")["status"] == "not available"
        assert running.get("/v1/assets/unsw/rig")["status"] == "not available"


@pytest.mark.slow
def test_own_rig_file_goes_before_the_one_offered(tmp_path, recording):
    rig = tmp_path / "own.toml"
    rig.write_text(RIG.read_text().replace('name = "unsw"', 'name = "mine"'))
    with service(tmp_path / "data", RIG=str(rig)) as running:
        replay(recording, [running.endpoint], 0)
        running.wait_for_windows(WINDOWS)
        assert running.get("/v1/assets/unsw/rig")["name"] == "mine"
        running.end()
    with service(tmp_path / "data") as again:  # and is remembered
        assert again.get("/v1/assets/unsw/rig")["name"] == "mine"


def test_service_waits_for_an_external_router_and_says_so(tmp_path):
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    running = Service(tmp_path, CONNECT=json.dumps([endpoint]))
    starting = threading.Thread(target=running.start, daemon=True)
    starting.start()
    wait_until(lambda: running.get("/healthz") is not None)
    assert not running.ready()
    with open_session(listen=[endpoint]):
        wait_until(lambda: running.ready())
        starting.join(5)
    wait_until(lambda: not running.ready())  # the router is gone, and the service is alive
    assert running.get("/healthz") == {"status": "ok"}
    wait_until(lambda: "gear_twin_network_connected 0.0" in running.text("/metrics"))
    with open_session(listen=[endpoint]):
        wait_until(lambda: running.ready())
        assert running.end()[0] == 0


@pytest.mark.slow
def test_service_that_waits_for_a_router_still_ends_on_a_signal(tmp_path):
    running = Service(tmp_path, CONNECT=json.dumps([f"tcp/127.0.0.1:{free_port()}"]))
    threading.Thread(target=_ignoring, args=(running.start,), daemon=True).start()
    wait_until(lambda: running.get("/healthz") is not None)
    assert running.end()[0] == 0


@pytest.mark.serve_only("a fleet's worker takes its partition from whoever has it, whatever its folder")
def test_taken_address_and_taken_data_directory_are_one_clear_line(tmp_path):
    any_port = {"HTTP": "127.0.0.1:0", "LISTEN": '["tcp/127.0.0.1:0"]'}
    with service(tmp_path / "a") as running:
        for folder, given, why in (
            ("b", {"HTTP": running.http}, f"HTTP cannot be served at {running.http}: address already in use"),
            ("a", {}, "another service has this data directory"),
            ("c", {"LISTEN": json.dumps([running.endpoint])}, f"cannot listen at {running.endpoint}"),
        ):
            data = str(tmp_path / folder)
            other = Service(tmp_path / f"said {folder}", **any_port | {"DATA": data} | given)
            with pytest.raises(AssertionError, match="the service did not start"):
                other.start()
            assert why in other.said()[1].strip().splitlines()[-1]


def test_rig_file_with_a_typo_is_refused_before_anything_starts(tmp_path):
    rig = tmp_path / "rig.toml"
    rig.write_text("[gears]\nmodul = 0.002\n")
    with pytest.raises(InputError, match=r"rig\.toml: gears\.modul is not a key.*gears\.module"):
        run(Settings(rig=rig, data=tmp_path / "data"))
    assert not (tmp_path / "data").exists()


@pytest.mark.slow
def test_fault_of_the_program_costs_its_window_and_ends_nothing_else(tmp_path, recording, monkeypatch):
    monkeypatch.setattr(pump, "JOINED", fake_twin.JOINED)

    def failing(rig, state, window, options):
        if state.windows_seen == 2 and not failed:
            failed.append(True)
            raise ZeroDivisionError("a defect")
        return fake_twin.step(rig, state, window, options)

    failed, stop, addresses = [], threading.Event(), []
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    settings = Settings(http="127.0.0.1:0", listen=[endpoint], data=tmp_path, idle_timeout=0.7)
    given = {"twin": replace(fake_twin.TWIN, step=failing), "stop": stop, "announce": addresses.append}
    serving = threading.Thread(target=run, args=(settings,), kwargs=given)
    serving.start()
    try:
        wait_until(lambda: addresses)
        replay(recording, [endpoint], 0)
        reader = Service(tmp_path)
        reader.http = addresses[0].removeprefix("http://").strip("/")
        windows = reader.wait_for_windows(WINDOWS)
    finally:
        stop.set()
        serving.join(15)
    assert [w["quality"] for w in windows].count("refused") == 1
    assert "internal error: ZeroDivisionError: a defect" in windows[2]["reason"]


def test_answers_are_sent_at_once():
    with listening_at("127.0.0.1", 0) as listening:
        assert listening.proto == socket.IPPROTO_TCP  # else asyncio leaves each answer to wait for 40 ms
