"""MQTT: each asset's result, open alarms and changes of alarms as JSON, and slow values in (`slow_inputs.py`).

    {prefix}/service          whether the service runs; retained, with a last will
    {prefix}/{asset}/result   the result in short; at each change
    {prefix}/{asset}/alarms   the open alarms; at each change
    {prefix}/{asset}/alarm    each change of an alarm, once or (after a kill) twice, never retained
    {prefix}/{asset}/state    the whole state, where that is set

The payloads are those of `service/contract/plant.py`. The latest state counts: what changes while the broker is away is
published once, when it is there again; changes of alarms are read from the store, so that none is missing.
MQTT 3.1.1 by paho-mqtt, which is imported here only.
"""

from __future__ import annotations

import hashlib
import json
import platform
import ssl
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

from service.bridges.bridge import LOOK_EVERY, BridgeDown
from service.bridges.kept import KeptNumbers
from service.bridges.slow_inputs import SlowInputs
from service.contract.base import iso_time
from service.contract.plant import plant_alarm_change, plant_alarms, plant_result, plant_service
from service.errors import InputError
from service.printable import all_printable
from service.results.asset_table import AssetTable
from service.results.snapshot import Snapshot
from service.results.sql_store import SqlStore
from service.settings import Settings
from service.steady_clock import later_time_ns

try:
    import paho.mqtt.client as paho
    from paho.mqtt.enums import CallbackAPIVersion
except ImportError:
    raise InputError("setting mqtt: the package paho-mqtt is not installed: pip install 'gear-twin[mqtt]'") from None

CONNECT_WAIT = 10.0  # for the broker to accept the connection [s]
ACKNOWLEDGE_WAIT = 10.0  # for the broker to acknowledge what was published [s]
KEEP_ALIVE = 30  # silence after which the broker publishes the last will is 1.5 times as long [s]
PAGE = 500  # events read from the store at once
OF_ASSET = ("result", "alarms", "state")  # topics of an asset that may be retained


@dataclass(frozen=True, slots=True, kw_only=True)
class BrokerAddress:
    """Where the broker is."""

    host: str
    port: int
    tls: bool

    @classmethod
    def of(cls, url: str) -> BrokerAddress:
        """From `mqtt://HOST[:PORT]` or `mqtts://HOST[:PORT]`, as the settings have checked it."""
        parts = urlsplit(url)
        tls = parts.scheme == "mqtts"
        return cls(host=parts.hostname or "", port=parts.port or (8883 if tls else 1883), tls=tls)

    def __str__(self) -> str:
        return f"mqtt{'s' if self.tls else ''}://{self.host}:{self.port}"


class MqttBridge:
    """A `Bridge` to one broker."""

    name = "mqtt"

    def __init__(
        self,
        settings: Settings,
        table: AssetTable,
        store: SqlStore,
        kept: KeptNumbers,
        inputs: SlowInputs | None = None,
        clock: Callable[[], int] = later_time_ns,
    ) -> None:
        """InputError where certificates or the password cannot be read, whatever the broker says later."""
        assert settings.mqtt is not None
        self._settings, self._table, self._store, self._kept = settings, table, store, kept
        self._inputs, self._clock = inputs, clock
        self._address = BrokerAddress.of(settings.mqtt)
        self._tls = _tls_context(settings) if self._address.tls else None
        _password(settings)
        known = {snapshot.asset: snapshot.last_event_id for snapshot in table.every()}
        # by asset: the newest event that was published; what happened before the first start is history
        self._events = kept.section("events") or known
        kept.keep("events", self._events)
        self._names: dict[str, str] = {}  # by asset: under which it is published
        self._published: dict[str, bytes] = {}  # digest by topic of what the broker has since it was connected
        self._messages = 0

    @property
    def peer(self) -> str:
        return str(self._address)

    def serve(self, stopping: threading.Event, up: Callable[[], None]) -> None:
        """Publishes until `stopping` is set."""
        self._published.clear()
        with self._connected(stopping) as link, self._table.follow() as changes:
            link.send(self._topic("service"), plant_service("online"), retain=True)
            link.settle()
            up()
            for name in self._kept.section("names"):
                if self._table.find(name) is None:
                    self._clear(link, name)
            while not stopping.is_set():
                self._publish(link, changes.take(LOOK_EVERY))
                link.demand_connection()

    def figures(self) -> dict[str, Any]:
        """Figures for /metrics."""
        return {"messages": float(self._messages), **(self._inputs.figures() if self._inputs else {})}

    # -- publishing ----------------------------------------------------------------------------------

    def _publish(self, link: _Link, assets: Sequence[str]) -> None:
        """Publishes what has changed of some assets; returns once the broker has acknowledged it."""
        events, names = dict(self._events), self._kept.section("names")
        for asset in assets:
            snapshot = self._table.latest(asset)
            if snapshot is None:
                continue
            if (before := self._names.get(asset)) not in (None, snapshot.name):
                self._clear(link, str(before))
                names.pop(str(before), None)
            self._names[asset] = snapshot.name
            names[snapshot.name] = 1
            events[asset] = self._publish_changes(link, snapshot, events.get(asset, 0))
            self._publish_state(link, snapshot)
        link.settle()
        self._messages += link.take_count()
        self._kept.keep("names", names)
        if events != self._events:
            self._events = events
            self._kept.keep("events", events)

    def _publish_changes(self, link: _Link, snapshot: Snapshot, after: int) -> int:
        name, newest = snapshot.name, snapshot.last_event_id
        while after < newest:
            page = self._store.events(snapshot.asset, after, PAGE)
            for event in page:
                if event.kind == "alarm":
                    link.send(self._topic(name, "alarm"), plant_alarm_change(name, event.id, event.data), retain=False)
            link.settle()
            after = page[-1].id if page else newest
        return after

    def _publish_state(self, link: _Link, snapshot: Snapshot) -> None:
        name, now = snapshot.name, iso_time(self._clock())
        payloads: dict[str, Mapping[str, Any]] = {
            "result": plant_result(snapshot.whole, snapshot.rig, snapshot.alarms, now),
            "alarms": plant_alarms(name, snapshot.alarms, now),
        }
        if self._settings.mqtt_full_state:
            payloads["state"] = {key: value for key, value in snapshot.whole.items() if key != "windows"}
        for what, payload in payloads.items():
            topic = self._topic(name, what)
            digest = _digest({key: value for key, value in payload.items() if key != "time"})
            if self._published.get(topic) != digest:
                link.send(topic, payload, retain=what == "alarms" or self._settings.mqtt_retain)
                self._published[topic] = digest

    def _clear(self, link: _Link, name: str) -> None:
        """Ends what the broker has retained of an asset that had this name."""
        for what in OF_ASSET:
            topic = self._topic(name, what)
            self._published.pop(topic, None)
            link.send(topic, None, retain=True)

    def _topic(self, *parts: str) -> str:
        return "/".join((self._settings.mqtt_prefix, *parts))

    # -- the connection ------------------------------------------------------------------------------

    @contextmanager
    def _connected(self, stopping: threading.Event) -> Iterator[_Link]:
        settings = self._settings
        client = paho.Client(
            CallbackAPIVersion.VERSION2,
            client_id=client_id(settings),
            protocol=paho.MQTTv311,
            reconnect_on_failure=False,
        )
        client.connect_timeout = CONNECT_WAIT
        if self._tls is not None:
            client.tls_set_context(self._tls)
        if settings.mqtt_user is not None:
            client.username_pw_set(settings.mqtt_user, _password(settings))
        topic, will = self._topic("service"), _text(plant_service("offline"))
        client.will_set(topic, will, qos=settings.mqtt_qos, retain=True)
        link = _Link(client, settings.mqtt_qos, stopping)
        if self._inputs is not None:
            link.listen(self._inputs)
        try:
            link.open(self._address)
            try:
                yield link
            finally:
                link.close(topic, will)
        finally:
            client.loop_stop()


class _Link:
    """One connection to the broker, from the bridge's thread; paho's own thread does the network."""

    def __init__(self, client: paho.Client, qos: int, stopping: threading.Event) -> None:
        self._client, self._qos, self._stopping = client, qos, stopping
        self._answered, self._lost = threading.Event(), threading.Event()
        self._refusal: str | None = None
        self._pending: list[paho.MQTTMessageInfo] = []
        self._sent = 0
        self._topics: tuple[str, ...] = ()
        client.on_connect, client.on_disconnect = self._on_connect, self._on_disconnect

    def listen(self, inputs: SlowInputs) -> None:
        """Subscribes to the topics of the inputs once connected."""
        self._topics = inputs.topics

        def received(client: paho.Client, userdata: Any, message: paho.MQTTMessage) -> None:
            inputs.receive(message.topic, bytes(message.payload), retained=message.retain)

        def subscribed(client: paho.Client, userdata: Any, number: int, codes: Any, properties: Any) -> None:
            for topic, code in zip(self._topics, codes, strict=False):
                if code.is_failure:
                    inputs.not_allowed(topic, str(code))

        self._client.on_message, self._client.on_subscribe = received, subscribed

    def open(self, address: BrokerAddress) -> None:
        """Connects; BridgeDown where the broker cannot be reached or refuses."""
        try:
            self._client.connect(address.host, address.port, keepalive=KEEP_ALIVE)
        except ssl.SSLError as error:
            raise BridgeDown(f"no TLS connection: {error.reason or error}") from None
        except OSError as error:
            raise BridgeDown(f"cannot be reached: {(error.strerror or str(error) or 'fault').lower()}") from None
        self._client.loop_start()
        if not self._answered.wait(CONNECT_WAIT):
            raise BridgeDown(f"the broker has not answered within {CONNECT_WAIT:g} s")
        if self._refusal is not None:
            raise BridgeDown(self._refusal)
        if self._topics:
            self._client.subscribe([(topic, 1) for topic in self._topics])

    def close(self, topic: str, text: str) -> None:
        """Says that the service ends, and disconnects."""
        if not self._lost.is_set():
            last = self._client.publish(topic, text, qos=self._qos, retain=True)
            _wait_published(last, 1.0)
            self._client.disconnect()

    def send(self, topic: str, payload: Mapping[str, Any] | None, *, retain: bool) -> None:
        """Publishes one payload; None ends what is retained."""
        self.demand_connection()
        done = self._client.publish(topic, None if payload is None else _text(payload), qos=self._qos, retain=retain)
        if done.rc != paho.MQTT_ERR_SUCCESS:
            raise BridgeDown("the connection was lost")
        self._pending.append(done)
        self._sent += 1

    def settle(self) -> None:
        """Returns once the broker has acknowledged all that was sent; BridgeDown where it does not."""
        until = time.monotonic() + ACKNOWLEDGE_WAIT
        for one in self._pending:
            while not one.is_published():
                self.demand_connection()
                if time.monotonic() > until:
                    raise BridgeDown(f"the broker has not acknowledged within {ACKNOWLEDGE_WAIT:g} s")
                if self._stopping.is_set() and time.monotonic() > until - ACKNOWLEDGE_WAIT + 1.0:
                    raise BridgeDown("the service ends")
                _wait_published(one, 0.1)
        self._pending.clear()

    def take_count(self) -> int:
        """Messages sent since the last call."""
        sent, self._sent = self._sent, 0
        return sent

    def demand_connection(self) -> None:
        """BridgeDown where the connection was lost."""
        if self._lost.is_set():
            raise BridgeDown("the connection was lost")

    def _on_connect(self, client: paho.Client, userdata: Any, flags: Any, code: Any, properties: Any) -> None:
        if code.is_failure:
            self._refusal = f"the broker refuses the connection: {str(code).lower()}"
        self._answered.set()

    def _on_disconnect(self, client: paho.Client, userdata: Any, flags: Any, code: Any, properties: Any) -> None:
        if not self._answered.is_set():
            self._refusal = f"the broker ended the connection: {str(code).lower()}"
            self._answered.set()
        self._lost.set()


def client_id(settings: Settings) -> str:
    """The name of the service at the broker: its own, or one made of this machine and the data directory."""
    if settings.mqtt_client_id is not None:
        return settings.mqtt_client_id
    place = f"{platform.node()}:{settings.data.absolute()}"
    return f"gear-twin-{hashlib.sha256(place.encode()).hexdigest()[:12]}"


def _tls_context(settings: Settings) -> ssl.SSLContext:
    try:
        context = ssl.create_default_context(cafile=settings.mqtt_ca)
        if settings.mqtt_certificate is not None:
            context.load_cert_chain(settings.mqtt_certificate, settings.mqtt_key)
    except (OSError, ssl.SSLError) as error:
        named = [str(p) for p in (settings.mqtt_ca, settings.mqtt_certificate, settings.mqtt_key) if p is not None]
        reason = (error.strerror or str(error)).lower()
        raise InputError(f"settings of mqtt: a certificate cannot be used ({', '.join(named)}): {reason}") from None
    return context


def _password(settings: Settings) -> str | None:
    """The password, from the setting or from its file, which is read at each connection."""
    if settings.mqtt_password is not None:
        return settings.mqtt_password.get_secret_value()
    if settings.mqtt_password_file is None:
        return None
    try:
        return settings.mqtt_password_file.read_text(encoding="utf-8").rstrip("\r\n")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not text"
        raise InputError(f"setting mqtt_password_file = {settings.mqtt_password_file}: {reason.lower()}") from None


def _wait_published(message: paho.MQTTMessageInfo, seconds: float) -> None:
    try:
        message.wait_for_publish(seconds)
    except (RuntimeError, ValueError):  # the client has given it up: the connection was lost
        return


def _text(payload: Mapping[str, Any]) -> str:
    return json.dumps(all_printable(payload), ensure_ascii=False, allow_nan=False, separators=(",", ":"))


def _digest(payload: Mapping[str, Any]) -> bytes:
    return hashlib.blake2b(_text(payload).encode(), digest_size=16).digest()
