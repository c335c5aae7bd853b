"""Results for OPC UA clients, asked by a real client: values with their quality, changes, and who is let in."""

from __future__ import annotations

import asyncio
import logging
import subprocess
import sys
import time
from contextlib import asynccontextmanager, contextmanager
from datetime import UTC, datetime
from pathlib import Path

import pytest
import service_fakes as fakes
from asyncua import Client, ua
from asyncua.crypto.cert_gen import setup_self_signed_certificate
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256
from cryptography.x509.oid import ExtendedKeyUsageOID
from service_streams import free_port, wait_until

from service.access.access import Access
from service.access.keys import KeyStore
from service.access.roles import Role
from service.bridges.bridge import BridgeThread
from service.bridges.opcua import NAMESPACE, OpcUaBridge
from service.bridges.readings import UNITS, VARIABLES, readings_of
from service.contract.plant import plant_result
from service.errors import InputError
from service.results.snapshot import Stale
from service.runtime.bridging import bridges_of
from service.settings import Settings

START = datetime.fromtimestamp(fakes.START_NS / 1e9, UTC)
logging.getLogger("asyncua").setLevel(logging.CRITICAL)


@contextmanager
def serving(board, data, access=None, **given):
    """A server over a board; its settings, and the thread of its bridge."""
    settings = Settings(opcua=f"opc.tcp://127.0.0.1:{free_port()}/gear-twin", data=data, **given)
    thread = BridgeThread(OpcUaBridge(settings, board, access or Access()), first_pause=0.05)
    thread.start()
    try:
        wait_until(lambda: thread.figures()["opcua_connected"] == 1.0)
        yield settings.opcua, thread
    finally:
        thread.end()
        thread.join(30.0)
        assert not thread.is_alive()


class Reader:
    """Reads variables of assets by their names."""

    def __init__(self, client, namespace):
        self.client, self.namespace = client, namespace

    def node(self, name):
        return self.client.get_node(ua.NodeId(name, self.namespace))

    async def read(self, name):
        """Value and status code's name; a node that is not there has BadNodeIdUnknown."""
        found = await self.node(name).read_data_value(raise_on_bad_status=False)
        return found.Value and found.Value.Value, found.StatusCode.name

    async def until(self, name, wanted):
        """Waits for a value."""
        deadline = time.monotonic() + 30
        while (found := await self.read(name)) != wanted:
            assert time.monotonic() < deadline, f"{name} is {found}"
            await asyncio.sleep(0.02)


@asynccontextmanager
async def connected(url, user=None, password=None, security=None):
    client = Client(url, timeout=30, watchdog_intervall=30)  # of a machine that is busy with other tests
    if security is not None:
        client.application_uri = "urn:reader"
        await client.set_security(SecurityPolicyBasic256Sha256, *map(str, security))
    if user is not None:
        client.set_user(user)
        client.set_password(password)
    async with client:
        yield Reader(client, await client.get_namespace_index(NAMESPACE))


@pytest.fixture(scope="module")
def plant(tmp_path_factory):
    """A server whose board every test gives assets of its own."""
    board = fakes.scratch_table()
    with serving(board, tmp_path_factory.mktemp("data")) as (url, thread):
        yield board, url, thread


def show(board, asset, **changes):
    """An asset with one window and a whole report."""
    report = {**fakes.report(6000.0, 5), **changes.pop("report", {})}
    record = {**fakes.record(3, 6000.0), "quality": "good", **changes.pop("record", {})}
    board.update(asset, report=report, records=(record,), **changes)


def asked(url, question, **given):
    """Runs an asynchronous question to the server."""

    async def whole():
        async with connected(url, **given) as reader:
            return await question(reader)

    return asyncio.run(asyncio.wait_for(whole(), 60))


@pytest.mark.slow
def test_values_have_the_time_of_their_window_an_engineering_unit_and_a_range(plant):
    board, url, thread = plant
    show(board, "values")

    async def question(reader):
        await reader.until("values/level", ("normal", "Good"))
        depth = await reader.node("values/depth_um").read_data_value()
        assert depth.Value.Value == pytest.approx(fakes.depth_um(6000.0))
        assert depth.SourceTimestamp == START.replace(microsecond=0) + (depth.SourceTimestamp - START)
        assert depth.SourceTimestamp == datetime.fromtimestamp(fakes.START_NS / 1e9 + 1800, UTC)
        unit = await (await reader.node("values/depth_um").get_child("0:EngineeringUnits")).read_value()
        assert (unit.UnitId, unit.DisplayName.Text) == (13384, "µm")  # 4H of UNECE Recommendation 20
        span = await (await reader.node("values/depth_um").get_child("0:EURange")).read_value()
        assert (span.Low, span.High) == (0.0, fakes.END_OF_LIFE_UM)
        assert await reader.read("values/depth_limit_um") == (fakes.END_OF_LIFE_UM, "Good")
        assert await reader.read("values/window") == (3, "Good")
        assert (await reader.read("values/life_hours"))[1] == "Good"
        found = {(await node.read_browse_name()).Name for node in await reader.node("values").get_variables()}
        assert found == set(VARIABLES)

    asked(url, question)
    assert thread.figures()["opcua_values"] >= len(VARIABLES)


@pytest.mark.slow
def test_what_is_not_established_or_not_available_is_no_good_value(plant):
    board, url, _ = plant
    preliminary = {"reasons": ["Too few windows."], "remedies": []}
    show(board, "preliminary", report={"wear": {**fakes.report(6000.0, 5)["wear"], "preliminary": preliminary}})
    board.update("unknown", report=fakes.little_known_report(), records=({**fakes.record(0, 1.0), "quality": "good"},))
    board.update("waiting")
    show(board, "stale", stale=Stale(since_ns=fakes.START_NS, reason="nothing comes"))
    show(board, "degraded", record={"quality": "degraded"})

    async def question(reader):
        await reader.until("degraded/data", ("degraded", "Good"))
        assert (await reader.read("preliminary/depth_um"))[1] == "Uncertain"
        assert await reader.read("preliminary/depth_note") == (["Too few windows."], "Good")
        assert (await reader.read("preliminary/life_hours"))[1] == "Good"
        assert await reader.read("unknown/depth_um") == (None, "BadNoData")
        assert (await reader.read("unknown/depth_note"))[0] == [
            "the rig file does not give gears.module, gears.face_width"
        ]
        assert await reader.read("waiting/rms_measured_m_s2") == (None, "BadWaitingForInitialData")
        assert (await reader.read("stale/depth_um"))[1] == "UncertainLastUsableValue"
        assert await reader.read("stale/level") == ("no_verdict", "Good")
        assert (await reader.read("degraded/depth_um"))[1] == "UncertainSubNormal"

    asked(url, question)


def test_client_can_write_nothing(plant):
    board, url, _ = plant
    show(board, "read-only")

    async def question(reader):
        await reader.until("read-only/level", ("normal", "Good"))
        for name, value in (("depth_um", 1.0), ("level", "normal"), ("alarms", ["none"])):
            with pytest.raises(ua.UaStatusCodeError):
                await reader.node(f"read-only/{name}").write_value(value)
        with pytest.raises(ua.UaStatusCodeError):
            await reader.node("read-only").add_variable(ua.NodeId("more", reader.namespace), "more", 1.0)
        with pytest.raises(ua.UaStatusCodeError):
            await reader.client.delete_nodes([reader.node("read-only")])
        assert await reader.read("read-only/level") == ("normal", "Good")

    asked(url, question)


def test_subscription_gets_changes_and_an_event_for_each_change_of_an_alarm(plant):
    board, url, _ = plant
    show(board, "subscribed")
    alarm = {"id": 1, "level": "alarm", "reason": "The level is high.", "state": "active_unacknowledged",
             "active": True, "acknowledged": False, "quantity": "depth", "place": "", "action": "Look.",
             "raised_at": "2026-01-01T00:00:00Z"}  # fmt: skip

    class Listener:
        values, events = [], []

        def datachange_notification(self, node, value, data):
            self.values.append(value)

        def event_notification(self, event):
            self.events.append((event.SourceName, event.Message.Text, event.Severity))

    async def question(reader):
        await reader.until("subscribed/level", ("normal", "Good"))
        listener = Listener()
        subscription = await reader.client.create_subscription(20, listener)
        await subscription.subscribe_data_change(reader.node("subscribed/alarms_active"))
        await subscription.subscribe_events()
        board.update("subscribed", alarms=(alarm,))
        await reader.until("subscribed/alarms", (["alarm: The level is high."], "Good"))
        board.update("subscribed", alarms=({**alarm, "state": "active_acknowledged", "acknowledged": True},))
        await reader.until("subscribed/alarms_unacknowledged", (0, "Good"))
        board.update("subscribed", alarms=())
        await reader.until("subscribed/alarms", ([], "Good"))
        deadline = time.monotonic() + 20
        while (len(listener.events) < 3 or listener.values[-1:] != [0]) and time.monotonic() < deadline:
            await asyncio.sleep(0.02)
        assert listener.values[0] == 0 and 1 in listener.values and listener.values[-1] == 0
        assert listener.events == [
            ("subscribed", "The level is high. (active unacknowledged)", 800),
            ("subscribed", "The level is high. (active acknowledged)", 800),
            ("subscribed", "The level is high. (closed)", 100),
        ]

    asked(url, question)


def test_asset_is_added_renamed_and_retired_while_clients_are_connected(plant):
    board, url, _ = plant

    async def question(reader):
        show(board, "first-name")
        await reader.until("first-name/level", ("normal", "Good"))
        board.update("first-name", label="second-name")
        await reader.until("second-name/level", ("normal", "Good"))
        await reader.until("first-name/level", (None, "BadNodeIdUnknown"))
        board.update("first-name", retired={"since": "2026-01-01", "by": "Anna", "note": ""})
        await reader.until("second-name/retired", (True, "Good"))
        assert (await reader.read("second-name/depth_um"))[1] == "UncertainLastUsableValue"

    asked(url, question)


def test_limit_that_is_set_anew_ends_the_range_anew(plant):
    board, url, _ = plant
    show(board, "limits")

    async def question(reader):
        await reader.until("limits/depth_limit_um", (500.0, "Good"))
        show(board, "limits", report={"rul": {**fakes.report(6000.0, 5)["rul"], "max_depth_um": 300.0}})
        await reader.until("limits/depth_limit_um", (300.0, "Good"))
        await reader.until("limits/depth_um/range", (ua.Range(0.0, 300.0), "Good"))

    asked(url, question)


@pytest.mark.slow
def test_port_that_is_taken_is_said_and_tried_again(plant, tmp_path, caplog):
    _, url, _ = plant
    settings = Settings(opcua=url, data=tmp_path)
    thread = BridgeThread(OpcUaBridge(settings, fakes.scratch_table(), Access()), first_pause=0.05)
    thread.start()
    wait_until(lambda: thread.figures()["opcua_failures"] >= 1)
    thread.end()
    assert "cannot be listened at: " in caplog.text and thread.figures()["opcua_connected"] == 0.0


def certificate(folder, name, use):
    """Key and self-signed certificate of an application; PEM and DER."""
    key, der = folder / f"{name}-key.pem", folder / f"{name}.der"
    asyncio.run(setup_self_signed_certificate(key, der, f"urn:{name}", "localhost", [use], {"commonName": name}))
    return der, key


@pytest.mark.slow
def test_encrypted_server_lets_in_trusted_clients_with_a_key_and_nobody_else(tmp_path):
    board = fakes.scratch_table()
    show(board, "unsw")
    own, own_key = certificate(tmp_path, "gear-twin", ExtendedKeyUsageOID.SERVER_AUTH)
    reader = certificate(tmp_path, "reader", ExtendedKeyUsageOID.CLIENT_AUTH)
    (tmp_path / "other").mkdir()
    other = certificate(tmp_path / "other", "reader", ExtendedKeyUsageOID.CLIENT_AUTH)
    trusted = tmp_path / "trusted"
    trusted.mkdir()
    (trusted / "reader.der").write_bytes(reader[0].read_bytes())
    keys = KeyStore(tmp_path)
    right, revoked = keys.add("reader", Role.read), keys.add("former", Role.read)
    keys.revoke("former")
    access = Access(keys)
    given = {"opcua_certificate": own, "opcua_key": own_key, "opcua_clients": trusted}

    async def level(reader):
        await reader.until("unsw/level", ("normal", "Good"))

    with serving(board, tmp_path, access, **given) as (url, thread):
        asked(url, level, user="reader", password=right, security=reader)
        for wrong in (
            {"security": reader},  # anonymous
            {"user": "reader", "password": "gt_wrong", "security": reader},
            {"user": "former", "password": revoked, "security": reader},
            {"user": "reader", "password": right, "security": other},  # not trusted
            {"user": "reader", "password": right},  # not encrypted
        ):
            with pytest.raises((ua.UaError, ConnectionError, asyncio.TimeoutError)):
                asked(url, level, **wrong)
        assert thread.figures()["opcua_refused"] == 3.0 and access.failed == 2


@pytest.mark.parametrize(
    ("given", "access", "said"),
    [
        ({"opcua": "opc.tcp://0.0.0.0:4840"}, Access(anonymous=Role.read), "only encrypted connections are allowed"),
        ({"opcua": "opc.tcp://0.0.0.0:4840", "certificates": True}, Access(), "there are no credentials"),
        ({"opcua_certificate": "none.pem"}, Access(), "both of them"),
        ({"opcua_certificate": "none.pem", "opcua_key": "none.key"}, Access(), "opcua_key = none.key: no such file"),
        ({"certificates": True, "opcua_clients": "none"}, Access(), "must be a folder that holds certificates"),
        ({"certificates": True, "opcua_key": "not.key"}, Access(), "must be a private key"),
    ],
)
def test_server_that_nothing_protects_or_whose_files_cannot_be_used_is_refused_at_the_start(
    tmp_path, monkeypatch, given, access, said
):
    monkeypatch.chdir(tmp_path)
    Path("not.key").write_text("x")
    given = {"opcua": "opc.tcp://127.0.0.1:4840", "data": tmp_path, **given}
    if given.pop("certificates", False):
        own, key = certificate(tmp_path, "gear-twin", ExtendedKeyUsageOID.SERVER_AUTH)
        given = {"opcua_certificate": own, "opcua_key": key, **given}
    with pytest.raises(InputError, match=said):
        bridges_of(Settings(**given), fakes.scratch_table(), None, lambda topic, payload: True, access)


@pytest.mark.parametrize("url", ["127.0.0.1:4840", "http://127.0.0.1:4840", "opc.tcp://127.0.0.1", "opc.tcp://a:b@c:1"])
def test_address_that_is_none_of_opc_ua_is_refused(url):
    with pytest.raises(ValueError):
        Settings(opcua=url)


def test_every_variable_has_a_reading_and_every_unit_is_known():
    board = fakes.scratch_table()
    show(board, "unsw")
    now = datetime.now(UTC)
    found = readings_of(plant_result(board.get("unsw").whole, None, (), "now"), (), now)
    assert list(found) == list(VARIABLES)
    assert {v.unit for v in VARIABLES.values() if v.unit} <= set(UNITS)
    bad = board.get("unsw").whole | {"windows": [{**fakes.record(1, 1.0), "start_time": "1066-10-14"}]}
    assert readings_of(plant_result(bad, None, (), "now"), (), now)["speed_hz"].time == now


@pytest.mark.slow
def test_package_is_loaded_only_where_it_is_set_and_its_absence_is_one_clear_line(tmp_path):
    code = (
        "import sys; from service.runtime.bridging import bridges_of\n"
        "from service.settings import Settings; from pathlib import Path\n"
        "assert 'asyncua' not in sys.modules\nsys.modules['asyncua'] = None\n"
        "from service.errors import InputError\n"
        "try:\n    bridges_of(Settings(opcua='opc.tcp://127.0.0.1:4840', data=Path(sys.argv[1])), *[None] * 4)\n"
        "except InputError as error:\n    print(error)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, cwd=Path(__file__).parents[2]
    )
    assert done.returncode == 0, done.stderr
    assert "asyncua is not installed: pip install 'gear-twin[opcua]'" in done.stdout
