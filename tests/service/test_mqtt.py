"""Results and alarms at a real MQTT broker: what is published, and what happens when the broker is not there."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from contextlib import contextmanager
from pathlib import Path

import pytest
import service_fakes as fakes
import trustme
from jsonschema import Draft202012Validator
from memory_transport import MemoryNetwork
from mqtt_broker import TestBroker, broker_at_work, reading, wait_until
from pwdlib import PasswordHash
from pwdlib.hashers.argon2 import Argon2Hasher
from service_streams import RIG, SqliteFile, write_recording
from test_other_parts import serving

from service.access.access import Access
from service.bridges import mqtt
from service.bridges.bridge import BridgeThread
from service.bridges.kept import KeptNumbers
from service.contract import plant
from service.errors import InputError
from service.runtime.bridging import bridges_of
from service.runtime.replay import replay
from service.settings import Settings

ALARM = {
    "id": 7, "asset": "unsw", "rule": "level", "quantity": "rms", "place": "y6", "level": "alarm",
    "state": "active_unacknowledged", "active": True, "acknowledged": False, "value": 12.0, "limit": 9.0,
    "unit": "m/s²", "reason": "The level is above its limit.", "action": "Check the machine.",
    "raised_at": "2023-11-14T22:13:20.000000000Z", "window": 3, "history": [],
}  # fmt: skip


def settings_for(url, data, **given):
    return Settings(mqtt=url, data=data, **given)


@contextmanager
def bridged(settings, board, store, **given):
    """A bridge at work; what the thread is.

    board  a worker's, or what a test shows on one
    """
    bridge = mqtt.MqttBridge(
        settings, getattr(board, "own", board), store, KeptNumbers(settings.data / "bridges" / "mqtt.json")
    )
    thread = BridgeThread(bridge, first_pause=0.05, **given)
    thread.start()
    try:
        yield thread
    finally:
        thread.end()
        thread.join(30.0)
        assert not thread.is_alive()


def raise_alarm(store, board, asset="unsw", verb="raised"):
    """An alarm as the service keeps and shows it."""
    alarm = {**ALARM, "asset": asset}
    store.note(asset, [("alarm", {"verb": verb, "alarm": alarm})])
    shown = () if verb == "cleared" else (alarm,)
    board.update(asset, alarms=shown, last_event_id=store.last_event_id(asset))


def valid(payload):
    """The payload, which is by its model."""
    model = next(m for m in plant.MODELS if f"'{payload['type']}'" in str(m.model_fields["type"].annotation))
    Draft202012Validator(model.model_json_schema()).validate(payload)
    return payload


@pytest.mark.slow
def test_result_alarms_and_changes_are_published_and_a_reader_who_comes_later_gets_the_latest(tmp_path, store, board):
    fakes.campaign(store, board, windows=4)
    with broker_at_work() as broker, reading(broker.port) as reader:
        with bridged(settings_for(broker.url, tmp_path), board, store) as bridge:
            wait_until(lambda: reader.latest("gear-twin/unsw/result"))
            first = valid(reader.latest("gear-twin/unsw/result"))
            assert first["asset"] == "unsw" and first["level"] == "normal" and first["data"] == "ok"
            assert first["wear"]["depth_um"] == fakes.report(18000.0, 4)["wear"]["max_depth_um"]["combined"]
            assert first["wear"]["limit_um"] == fakes.END_OF_LIFE_UM
            assert first["life"]["hours"] == fakes.report(18000.0, 4)["rul"]["hours"]
            assert first["window"]["index"] == 3 and first["window"]["rms_measured_m_s2"] > 0
            assert valid(reader.latest("gear-twin/service"))["state"] == "online"
            assert reader.payloads("gear-twin/unsw/alarm") == []  # what happened before is history
            raise_alarm(store, board)
            wait_until(lambda: reader.latest("gear-twin/unsw/alarm"))
            wait_until(lambda: (reader.latest("gear-twin/unsw/alarms") or {}).get("alarms"))
            change = valid(reader.latest("gear-twin/unsw/alarm"))
            assert change["verb"] == "raised" and change["alarm"]["id"] == 7 and "history" not in change["alarm"]
            assert valid(reader.latest("gear-twin/unsw/alarms"))["alarms"][0]["reason"] == ALARM["reason"]
            with reading(broker.port) as late:
                wait_until(lambda: late.latest("gear-twin/unsw/result") and late.latest("gear-twin/unsw/alarms"))
                assert late.payloads("gear-twin/unsw/alarm") == []
            assert bridge.figures()["mqtt_connected"] == 1.0 and bridge.figures()["mqtt_messages"] >= 4
            assert not [m for m in reader.messages if m.topic.endswith("/state")]
        wait_until(lambda: reader.latest("gear-twin/service")["state"] == "offline")


@pytest.mark.slow
def test_what_cannot_be_computed_is_published_with_its_reason(tmp_path, store, board):
    fakes.take(store, board, "unknown", 0, 100.0, report=fakes.little_known_report())
    board.update("waiting")
    with (
        broker_at_work() as broker,
        reading(broker.port) as reader,
        bridged(settings_for(broker.url, tmp_path), board, store),
    ):
        wait_until(lambda: reader.latest("gear-twin/unknown/result") and reader.latest("gear-twin/waiting/result"))
    result = valid(reader.latest("gear-twin/unknown/result"))
    assert result["wear"] == {
        "status": "not available", "reason": "the rig file does not give gears.module, gears.face_width"
    }  # fmt: skip
    assert result["life"]["status"] == "not available"
    waiting = valid(reader.latest("gear-twin/waiting/result"))
    assert waiting["window"] is None and waiting["level"] == "no_verdict" and waiting["data"] == "waiting"


def test_preliminary_figures_say_so():
    wear = {"max_depth_um": {"combined": fakes.band(20.0, 0.5)}, "preliminary": {"reasons": ["Too few windows."]}}
    board = fakes.scratch_table()
    board.update("unsw", report={**fakes.report(100.0, 1), "wear": wear})
    whole = board.get("unsw").whole
    result = valid(plant.plant_result(whole, None, (), "2026-01-01T00:00:00.000000000Z"))
    assert result["wear"]["preliminary"] == ["Too few windows."] and result["life"]["preliminary"] == []


@pytest.mark.slow
def test_counters_that_change_alone_are_not_published_again(tmp_path, store, board):
    fakes.campaign(store, board, windows=4)
    with (
        broker_at_work() as broker,
        reading(broker.port) as reader,
        bridged(settings_for(broker.url, tmp_path), board, store),
    ):
        wait_until(lambda: reader.latest("gear-twin/unsw/result"))
        for index in range(5):
            board.update("unsw", quality={"channels": {"accel/y6": {"frames": index}}})
        raise_alarm(store, board)
        wait_until(lambda: reader.latest("gear-twin/unsw/alarm"))
        wait_until(lambda: len(reader.payloads("gear-twin/unsw/result")) >= 2)
        assert len(reader.payloads("gear-twin/unsw/result")) == 2  # at first, and with the alarm


@pytest.mark.slow
def test_broker_that_is_away_at_start_and_again_later_gets_the_latest_state_and_every_change_of_an_alarm(
    tmp_path, store, board, caplog, monkeypatch
):
    fakes.campaign(store, board, windows=4)
    broker, reader_is_there, connect = TestBroker(), threading.Event(), mqtt._Link.open
    reader_is_there.set()
    monkeypatch.setattr(mqtt._Link, "open", lambda link, to: reader_is_there.wait(60) and connect(link, to))
    with bridged(settings_for(broker.url, tmp_path), board, store) as bridge:
        wait_until(lambda: bridge.figures()["mqtt_failures"] >= 2)
        assert bridge.figures()["mqtt_connected"] == 0.0
        raise_alarm(store, board)
        try:
            broker.start()
            wait_until(lambda: bridge.figures()["mqtt_connected"] == 1.0)
            with reading(broker.port) as reader:
                wait_until(lambda: reader.latest("gear-twin/unsw/alarms"))
            reader_is_there.clear()
            broker.stop()
            wait_until(lambda: bridge.figures()["mqtt_connected"] == 0.0)
            raise_alarm(store, board, verb="acknowledged")
            raise_alarm(store, board, verb="cleared")
            for index in range(1000):  # nothing waits for the broker
                board.update("unsw", last_frame_ns=index)
            assert bridge.figures()["mqtt_connected"] == 0.0
            broker.start()
            with reading(broker.port) as reader:
                reader_is_there.set()
                wait_until(lambda: len(reader.payloads("gear-twin/unsw/alarm")) == 2)
                wait_until(lambda: reader.latest("gear-twin/unsw/alarms") is not None)
                assert [c["verb"] for c in reader.payloads("gear-twin/unsw/alarm")] == ["acknowledged", "cleared"]
                assert reader.latest("gear-twin/unsw/alarms")["alarms"] == []
        finally:
            broker.stop()
    refused = [r for r in caplog.records if "cannot be reached" in r.getMessage()]
    assert len(refused) <= 2  # once for each time that it was away, however often it was tried


@pytest.mark.slow
def test_kept_position_publishes_changes_that_a_killed_service_left(tmp_path, store, board):
    fakes.campaign(store, board, windows=3)
    with broker_at_work() as broker:
        settings = settings_for(broker.url, tmp_path)
        with bridged(settings, board, store) as bridge:
            wait_until(lambda: bridge.figures()["mqtt_messages"] > 0)
        wait_until(lambda: KeptNumbers(tmp_path / "bridges" / "mqtt.json").section("events"))
        raise_alarm(store, board)
        with reading(broker.port) as reader, bridged(settings, fakes.WrittenTable(store), store):
            wait_until(lambda: reader.payloads("gear-twin/unsw/alarm"))


@pytest.mark.slow
def test_renamed_asset_leaves_nothing_retained_and_no_change_is_published_twice(tmp_path, store, board):
    fakes.campaign(store, board, windows=3)
    with broker_at_work() as broker, reading(broker.port) as reader:
        with bridged(settings_for(broker.url, tmp_path), board, store):
            raise_alarm(store, board)
            wait_until(lambda: reader.latest("gear-twin/unsw/alarm"))
            board.update("unsw", label="press-4")
            wait_until(lambda: reader.latest("gear-twin/press-4/result"))
            wait_until(lambda: reader.payloads("gear-twin/unsw/result")[-1] is None)
            assert reader.payloads("gear-twin/press-4/alarm") == []
        with reading(broker.port) as late:
            wait_until(lambda: late.latest("gear-twin/press-4/result"))
            assert not [m for m in late.messages if m.topic.startswith("gear-twin/unsw/")]


@pytest.mark.parametrize("again", [False, True], ids=["while it runs", "before a restart"])
def test_assets_that_are_renamed_while_the_broker_is_away_have_every_change_published_once(
    tmp_path, store, board, again
):
    for asset in ("unsw", "other"):
        fakes.take(store, board, asset, 0, 100.0)
    kept = {"unsw": store.last_event_id("unsw")}
    raise_alarm(store, board)  # not yet published
    raise_alarm(store, board, "other")
    kept["other"] = store.last_event_id("other")
    KeptNumbers(tmp_path / "bridges" / "mqtt.json").keep("events", kept)
    settings = settings_for("mqtt://127.0.0.1:1", tmp_path)
    bridge = mqtt.MqttBridge(settings, board, store, KeptNumbers(tmp_path / "bridges" / "mqtt.json"))
    fakes.rename(store, board, "unsw", "press-3")
    fakes.rename(store, board, "unsw", "press-4")
    fakes.rename(store, board, "other", "press-5")
    raise_alarm(store, board, "other", "acknowledged")
    fakes.take(store, board, "new", 0, 100.0)
    raise_alarm(store, board, "new")
    if again:
        shown, kept = fakes.WrittenTable(store), KeptNumbers(tmp_path / "bridges" / "mqtt.json")
        bridge = mqtt.MqttBridge(settings, shown, store, kept)
    sent = []

    class Link:
        def send(self, topic, payload, *, retain):
            if topic.endswith("/alarm"):
                sent.append((topic.split("/")[1], payload["verb"]))

        def settle(self):
            pass

        def take_count(self):
            return 0

    bridge._publish(Link(), ("press-4", "press-5", "new", "unsw", "other"))
    assert sorted(sent) == [("new", "raised"), ("press-4", "raised"), ("press-5", "acknowledged")]


@pytest.mark.slow
def test_service_that_is_lost_is_announced_by_the_broker(tmp_path, store, board):
    code = f"""
import sys
import threading
from pathlib import Path
sys.path.append({str(Path(__file__).parent)!r})
from service.bridges.bridge import BridgeThread
from service.bridges.kept import KeptNumbers
from service.bridges.mqtt import MqttBridge
from service_fakes import scratch_table
from service.settings import Settings
data = Path({str(tmp_path)!r})
bridge = MqttBridge(Settings(mqtt={{url!r}}, data=data), scratch_table(), None, KeptNumbers(data / "mqtt.json"))
BridgeThread(bridge).start()
threading.Event().wait(30)
"""
    with broker_at_work() as broker, reading(broker.port) as reader:
        process = subprocess.Popen([sys.executable, "-c", code.format(url=broker.url)], cwd=Path(__file__).parents[2])
        try:
            wait_until(lambda: reader.latest("gear-twin/service"))
            assert reader.latest("gear-twin/service")["state"] == "online"
        finally:
            process.kill()
            process.wait(10)
        wait_until(lambda: reader.latest("gear-twin/service")["state"] == "offline")


@pytest.mark.slow
def test_right_password_is_accepted_and_a_wrong_one_is_named(tmp_path, store, board, caplog):
    fakes.campaign(store, board, windows=3)
    file = tmp_path / "users"
    file.write_text(f"twin:{PasswordHash((Argon2Hasher(time_cost=1, memory_cost=8, parallelism=1),)).hash('right')}\n")
    secret = tmp_path / "secret"
    secret.write_text("wrong\n")
    with broker_at_work(passwords=file) as broker:
        settings = settings_for(broker.url, tmp_path, mqtt_user="twin", mqtt_password_file=secret)
        with bridged(settings, board, store) as bridge:
            wait_until(lambda: bridge.figures()["mqtt_failures"] >= 3)
            refused = [r.getMessage() for r in caplog.records if "refuses the connection" in r.getMessage()]
            assert len(refused) == 1 and "wrong" not in refused[0]
            secret.write_text("right\n")  # read at each attempt
            wait_until(lambda: bridge.figures()["mqtt_connected"] == 1.0)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:Exception ignored in. <ssl.SSLSocket")  # paho leaves it to the collector
def test_tls_with_the_right_authority_connects_and_with_another_does_not(tmp_path, store, board, caplog):
    fakes.campaign(store, board, windows=3)
    own, other = trustme.CA(), trustme.CA()
    served = own.issue_cert("127.0.0.1")
    served.cert_chain_pems[0].write_to_path(tmp_path / "cert.pem")
    served.private_key_pem.write_to_path(tmp_path / "key.pem")
    for name, authority in (("own.pem", own), ("other.pem", other)):
        authority.cert_pem.write_to_path(tmp_path / name)
    with broker_at_work(tls=(tmp_path / "cert.pem", tmp_path / "key.pem")) as broker:
        with bridged(settings_for(broker.url, tmp_path, mqtt_ca=tmp_path / "other.pem"), board, store) as bridge:
            wait_until(lambda: bridge.figures()["mqtt_failures"] >= 1)
            assert bridge.figures()["mqtt_messages"] == 0
        assert any("certificate" in r.getMessage().lower() for r in caplog.records)
        with (
            reading(broker.port, ca=tmp_path / "own.pem") as reader,
            bridged(settings_for(broker.url, tmp_path, mqtt_ca=tmp_path / "own.pem"), board, store),
        ):
            wait_until(lambda: reader.latest("gear-twin/unsw/result"))


@pytest.mark.slow
def test_whole_state_is_published_where_it_is_set_and_prefix_and_retain_are_as_set(tmp_path, store, board):
    fakes.campaign(store, board, windows=3)
    given = {"mqtt_full_state": True, "mqtt_prefix": "plant/gears", "mqtt_retain": False, "mqtt_qos": 0}
    with (
        broker_at_work() as broker,
        reading(broker.port) as reader,
        bridged(settings_for(broker.url, tmp_path, **given), board, store),
    ):
        wait_until(lambda: reader.latest("plant/gears/unsw/state"))
        assert reader.latest("plant/gears/unsw/state")["wear"]["k_wear_per_n"] == 2.7e-6
        assert "windows" not in reader.latest("plant/gears/unsw/state")
        with reading(broker.port) as late:
            wait_until(lambda: late.latest("plant/gears/unsw/alarms"))
            assert not [m for m in late.messages if m.topic.endswith(("/result", "/state"))]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"mqtt_password_file": "none"}, "mqtt_password_file"),
        ({"mqtt": "mqtts://127.0.0.1:8883", "mqtt_ca": "none.pem"}, "none.pem"),
        ({"mqtt": None, "mqtt_inputs": "inputs.toml"}, "give it in the setting mqtt"),
        ({"mqtt_inputs": "inputs.toml"}, "inputs.toml"),
    ],
)
def test_setting_that_cannot_be_used_is_named_at_the_start(tmp_path, store, board, given, said):
    settings = Settings(**{"mqtt": "mqtt://127.0.0.1:1", "data": tmp_path, **given})
    with pytest.raises(InputError, match=said):
        bridges_of(settings, board, store, lambda topic, payload: True, Access())


@pytest.mark.parametrize("url", ["127.0.0.1:1883", "http://broker", "mqtt://user:secret@broker", "mqtt://"])
def test_address_of_a_broker_without_scheme_or_with_a_password_in_it_is_refused(url):
    with pytest.raises(ValueError):
        Settings(mqtt=url)


@pytest.mark.slow
def test_package_is_loaded_only_where_it_is_set_and_its_absence_is_one_clear_line(tmp_path):
    code = (
        "import sys; import service.runtime.serve; from service.runtime.bridging import bridges_of\n"
        "from service.settings import Settings; from pathlib import Path\n"
        "assert 'paho' not in sys.modules and 'asyncua' not in sys.modules\n"
        "sys.modules['paho'] = None\n"
        "from service.errors import InputError\n"
        "try:\n    bridges_of(Settings(mqtt='mqtt://127.0.0.1:1', data=Path(sys.argv[1])), None, None, None, None)\n"
        "except InputError as error:\n    print(error)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, cwd=Path(__file__).parents[2]
    )
    assert done.returncode == 0, done.stderr
    assert "paho-mqtt is not installed: pip install 'gear-twin[mqtt]'" in done.stdout


def test_thread_of_a_bridge_says_each_cause_once_and_counts_all(caplog):
    class Down:
        name, peer = "test", "nowhere"
        causes = iter(["one", "one", "one", "two", "two"])

        def serve(self, stopping, up):
            cause = next(self.causes, None)
            if cause is None:
                stopping.set()
                raise ZeroDivisionError("a fault")
            raise mqtt.BridgeDown(cause)

        def figures(self):
            return {}

    thread = BridgeThread(Down(), first_pause=0.001)
    thread.run()
    said = [r.getMessage() for r in caplog.records]
    assert len(said) == 2 and "one" in said[0] and "two" in said[1]
    assert thread.figures() == {"test_connected": 0.0, "test_failures": 6.0}


def test_changes_of_assets_are_held_once_each_and_never_wait():
    board = fakes.scratch_table()
    board.update("first")
    with board.follow() as changes:
        assert changes.take(0) == ("first",)
        for _ in range(10_000):
            changes.note("a", "b")
        assert changes.take(0) == ("a", "b") and changes.take(0) == ()
        threading.Timer(0.05, lambda: board.update("late")).start()
        assert changes.take(5) == ("late",)
        board.update("late", label="later")
        assert changes.take(0) == ("late",)
    assert board._followers == []


def test_file_of_kept_numbers_that_is_damaged_is_begun_again(tmp_path, caplog):
    path = tmp_path / "bridges" / "kept.json"
    KeptNumbers(path).keep("events", {"unsw": 12})
    assert KeptNumbers(path).section("events") == {"unsw": 12}
    path.write_text('{"events": [')
    assert KeptNumbers(path).section("events") == {} and "begun again" in caplog.text
    path.unlink()
    path.mkdir()
    kept = KeptNumbers(path)
    kept.keep("events", {"unsw": 13})
    kept.keep("events", {"unsw": 14})
    assert kept.section("events") == {"unsw": 14}
    assert sum("cannot be written" in r.getMessage() for r in caplog.records) == 1


@pytest.mark.slow
def test_whole_service_publishes_to_a_broker_and_shows_the_temperature_that_it_has_from_there(tmp_path):
    recording = write_recording(tmp_path / "short.mcap", 2)
    inputs = tmp_path / "inputs.toml"
    inputs.write_text(
        'schema = "gear-inputs/1"\n[[inputs]]\ntopic = "plant/oil"\nasset = "unsw"\nchannel = "temperature/oil"\n'
        'unit = "K"\nvalue = "oil"\ntime = "at"\ntime_format = "s"\n'
    )
    network = MemoryNetwork()
    with broker_at_work() as broker, reading(broker.port) as plant_side:
        given = {"mqtt": broker.url, "mqtt_inputs": inputs, "rig": RIG}
        with serving(tmp_path / "data", network, SqliteFile(tmp_path / "data"), **given) as running:
            wait_until(lambda: "gear_twin_mqtt_connected 1.0" in running.text("/metrics"))
            plant_side.publish("plant/oil", {"oil": 333.15, "at": 1_700_000_001})
            wait_until(lambda: "gear_twin_mqtt_inputs_values_total 1.0" in running.text("/metrics"))
            replay(recording, (), 0, publish_to=network.open_publisher)
            records = running.wait_for_windows(2)
            assert records[0]["temperatures"]["oil"]["value"] == pytest.approx(60.0, abs=1e-3)
            wait_until(lambda: (plant_side.latest("gear-twin/unsw/result") or {}).get("window"))
            wait_until(lambda: plant_side.latest("gear-twin/unsw/result")["window"]["index"] == 1)
        wait_until(lambda: plant_side.latest("gear-twin/service")["state"] == "offline")


def test_payload_is_strict_json(store, board):
    fakes.campaign(store, board, windows=3)
    text = mqtt._text(plant.plant_result(board.get("unsw").whole, None, (), "now"))
    json.loads(text, parse_constant=lambda name: pytest.fail(name))
