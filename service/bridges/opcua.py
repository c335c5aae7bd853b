"""OPC UA: a server with one object for each asset, whose variables are the asset's result; clients can only read.

    Objects / gear-twin / {asset} / depth_um, life_hours, level, alarms, …      node ids ns=2;s={asset}/depth_um

The variables are those of `readings.py`, with engineering units and ranges. What is not established is Uncertain, what
cannot be computed is BadNoData, and figures of a machine that sends nothing are UncertainLastUsableValue; source
timestamps are those of the measurement windows. Each change of an alarm is an event of the Server object: acknowledging
and clearing stay with the service, where people sign with their names. By asyncua, which is imported here only.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Mapping
from contextlib import AsyncExitStack
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from service.access.access import Access, Refused
from service.access.addresses import is_loopback
from service.access.roles import Role
from service.bridges.bridge import LOOK_EVERY, BridgeDown
from service.bridges.readings import UNITS, VARIABLES, Kind, Quality, Reading, Variable, readings_of
from service.contract.base import iso_time
from service.contract.plant import plant_result
from service.errors import InputError
from service.printable import all_printable, printable
from service.results.asset_changes import AssetChanges
from service.results.asset_table import AssetTable
from service.results.snapshot import Snapshot
from service.settings import Settings

try:
    from asyncua import Server, ua
    from asyncua.common.node import Node
    from asyncua.crypto.permission_rules import User, UserRole
    from asyncua.crypto.truststore import TrustStore
    from asyncua.crypto.validator import CertificateValidator, CertificateValidatorOptions
    from asyncua.server.internal_server import InternalServer
    from asyncua.server.user_managers import UserManager
    from cryptography import x509
    from cryptography.hazmat.primitives.serialization import load_der_private_key, load_pem_private_key
except ImportError:
    raise InputError("setting opcua: the package asyncua is not installed: pip install 'gear-twin[opcua]'") from None

NAMESPACE = "urn:gear-twin:results:1"
APPLICATION = "urn:gear-twin"
FOLDER = "gear-twin"
FOLDER_ID = "/"  # which no asset is called
LARGEST_MESSAGE = 4 * 2**20  # [bytes]
UNECE = "http://www.opcfoundation.org/UA/units/un/cefact"
SEVERITY_OF = {"alarm": 800, "watch": 500}  # of events, 1 … 1000
SEVERITY_OF_END = 100
CODES: dict[Quality, int] = {
    "good": ua.StatusCodes.Good,
    "preliminary": ua.StatusCodes.Uncertain,
    "degraded": ua.StatusCodes.UncertainSubNormal,
    "last": ua.StatusCodes.UncertainLastUsableValue,
    "none": ua.StatusCodes.BadNoData,
    "waiting": ua.StatusCodes.BadWaitingForInitialData,
}
TYPES: dict[Kind, ua.VariantType] = {
    "number": ua.VariantType.Double,
    "count": ua.VariantType.UInt32,
    "yes": ua.VariantType.Boolean,
    "text": ua.VariantType.String,
    "lines": ua.VariantType.String,
}
BLANK: dict[Kind, Any] = {"number": 0.0, "count": 0, "yes": False, "text": "", "lines": []}


class OpcUaBridge:
    """A `Bridge` that listens for OPC UA clients."""

    name = "opcua"

    def __init__(
        self,
        settings: Settings,
        table: AssetTable,
        access: Access,
        clock: Callable[[], datetime] = lambda: datetime.now(UTC),
    ) -> None:
        """InputError where certificates cannot be used, or others could reach a server that nothing protects."""
        assert settings.opcua is not None
        self._settings, self._table, self._access, self._clock = settings, table, access, clock
        self._url = settings.opcua
        self._local = is_loopback(urlsplit(self._url).hostname)
        self._own = _own_of(settings)
        self._demand_protection()
        self._clients: _Clients | None = None
        self._writes = 0

    @property
    def peer(self) -> str:
        return self._url

    def serve(self, stopping: threading.Event, up: Callable[[], None]) -> None:
        """Serves clients until `stopping` is set."""
        asyncio.run(self._serve(stopping, up))

    def figures(self) -> dict[str, float]:
        """Figures for /metrics."""
        return {"values": float(self._writes), "refused": float(self._clients.refused if self._clients else 0)}

    # -- the server ----------------------------------------------------------------------------------

    def _demand_protection(self) -> None:
        if self._local:
            return
        if self._own is None:
            raise InputError(
                f"opcua = {self._url}: other computers can reach this address, where only encrypted connections are "
                "allowed; give the service a certificate (opcua_certificate, opcua_key), or listen at 127.0.0.1"
            )
        if not self._access.configured and self._access.anonymous is None:
            raise InputError(
                f"opcua = {self._url}: other computers can reach this address, and there are no credentials; make a "
                "key (gear-twin db keys add), listen at 127.0.0.1, or permit everybody to read ([access] anonymous = "
                '"read")'
            )

    async def _serve(self, stopping: threading.Event, up: Callable[[], None]) -> None:
        async with AsyncExitStack() as stack:
            server = await self._started()
            stack.push_async_callback(server.stop)
            space = _Space(server, await server.register_namespace(NAMESPACE), self._clock)
            await space.begin()
            up()
            with self._table.follow() as changes:
                while not stopping.is_set():
                    await self._show(space, await asyncio.to_thread(AssetChanges.take, changes, LOOK_EVERY))

    async def _started(self) -> Server:
        clients = self._clients = _Clients(self._access, self._local)
        server = Server(user_manager=clients)
        await server.init()
        server.set_endpoint(self._url)
        server.set_server_name("gear-twin")
        server.limits.max_message_size = LARGEST_MESSAGE
        server.allow_remote_admin(False)
        server.set_identity_tokens([ua.AnonymousIdentityToken, ua.UserNameIdentityToken])
        await server.set_application_uri(APPLICATION if self._own is None else self._own.application)
        if self._own is None:
            server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
        else:
            server.set_security_policy([ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt])
            server.iserver.certificate, server.iserver.private_key = self._own.certificate, self._own.key
            await self._trust(server)
        try:
            await server.start()
        except OSError as error:
            await server.stop()
            raise BridgeDown(f"cannot be listened at: {(error.strerror or str(error)).lower()}") from None
        return server

    async def _trust(self, server: Server) -> None:
        """Lets in only clients whose certificates, or their authority's, are in a folder, where one is set."""
        folder = self._settings.opcua_clients
        if folder is None:
            return
        store = TrustStore([folder], [])
        await store.load()
        options = CertificateValidatorOptions.TRUSTED | CertificateValidatorOptions.TIME_RANGE
        server.set_certificate_validator(CertificateValidator(options | CertificateValidatorOptions.PEER_CLIENT, store))

    async def _show(self, space: _Space, assets: tuple[str, ...]) -> None:
        for asset in assets:
            if (snapshot := self._table.latest(asset)) is not None:
                self._writes += await space.show(snapshot)
            await asyncio.sleep(0)  # clients are answered between two assets


class _Clients(UserManager):
    """Who may read: by the same rule as REST. A client gives its API key as password, with any user name."""

    def __init__(self, access: Access, local: bool) -> None:
        self._access, self._address = access, "127.0.0.1" if local else None
        self.refused = 0

    def get_user(
        self, iserver: InternalServer, username: str | None = None, password: str | None = None, certificate: Any = None
    ) -> User | None:
        try:
            who = self._access.who(password if username is not None else None, self._address)
            self._access.demand(who, Role.read)
        except Refused:
            self.refused += 1
            return None
        return User(role=UserRole.User, name=who.name)


class _Space:
    """The nodes of all assets."""

    def __init__(self, server: Server, namespace: Any, clock: Callable[[], datetime]) -> None:
        self._server, self._namespace, self._clock = server, namespace, clock
        self._names: dict[str, str] = {}  # under which assets are shown
        self._objects: dict[str, Node] = {}  # by name
        self._written: dict[str, tuple[Any, ...]] = {}  # by node: value, quality and, of figures, time
        self._alarms: dict[str, dict[int, Mapping[str, Any]]] = {}  # that are open, by asset and number

    async def begin(self) -> None:
        """The folder of all assets, and the events of alarms."""
        self._folder = await self._server.nodes.objects.add_folder(self._id(FOLDER_ID), self._name(FOLDER))
        self._events = await self._server.get_event_generator()

    async def show(self, snapshot: Snapshot) -> int:
        """Writes what has changed of an asset; how many variables that are."""
        asset, now = snapshot.name, self._clock()
        if (before := self._names.get(snapshot.asset)) not in (None, asset):
            await self._remove(str(before))
        self._names[snapshot.asset] = asset
        if asset not in self._objects:
            await self._add(asset)
        result = plant_result(snapshot.whole, snapshot.rig, snapshot.alarms, iso_time(0))
        readings, written = readings_of(result, snapshot.alarms, now), 0
        for name, reading in readings.items():
            variable = VARIABLES[name]
            key = f"{asset}/{name}"
            figure = variable.kind == "number"
            held = (reading.value, reading.quality, reading.time if figure and name != "depth_limit_um" else None)
            if self._written.get(key) != held:
                self._written[key] = held
                await self._server.write_attribute_value(self._id(key), data_value(variable, reading, now))
                written += 1
        await self._range(asset, readings["depth_limit_um"].value)
        await self._tell_alarms(snapshot)
        return written

    async def _remove(self, name: str) -> None:
        """Takes the nodes away of an asset that has another name now."""
        self._written = {key: held for key, held in self._written.items() if not key.startswith(f"{name}/")}
        await self._server.delete_nodes([self._objects.pop(name)], recursive=True)

    async def _add(self, asset: str) -> None:
        node = await self._folder.add_object(self._id(asset), self._name(asset))
        for name, variable in VARIABLES.items():
            kind = TYPES[variable.kind]
            blank = ua.Variant(BLANK[variable.kind], kind, is_array=variable.kind == "lines")
            made = await node.add_variable(self._id(f"{asset}/{name}"), self._name(name), blank)
            about = ua.DataValue(ua.Variant(ua.LocalizedText(variable.meaning)))
            await made.write_attribute(ua.AttributeIds.Description, about)
            if variable.unit:
                await made.add_property(
                    self._id(f"{asset}/{name}/unit"), ua.QualifiedName("EngineeringUnits", 0), unit_of(variable.unit)
                )
        self._objects[asset] = node

    async def _range(self, asset: str, limit: float | None) -> None:
        """The range of the depths, which ends at the limit; none where none is stated."""
        key = f"{asset}/range"
        if limit is None or self._written.get(key) == (limit,):
            return
        for name in (name for name, variable in VARIABLES.items() if variable.end):
            node = self._id(f"{asset}/{name}/range")
            given = ua.Range(0.0, limit)
            if key in self._written:
                await self._server.write_attribute_value(node, ua.DataValue(ua.Variant(given)))
            else:
                owner = self._server.get_node(self._id(f"{asset}/{name}"))
                await owner.add_property(node, ua.QualifiedName("EURange", 0), given)
        self._written[key] = (limit,)

    async def _tell_alarms(self, snapshot: Snapshot) -> None:
        """An event for each alarm that is new, is of another level or state, or is listed no longer."""
        before = self._alarms.get(snapshot.asset)
        now = {alarm["id"]: alarm for alarm in snapshot.alarms}
        self._alarms[snapshot.asset] = now
        if before is None:  # clients that connect read the variables
            return
        for number, alarm in now.items():
            was = before.get(number)
            if was is None or (was["level"], was["state"]) != (alarm["level"], alarm["state"]):
                state = alarm["state"].replace("_", " ")
                await self._event(snapshot.name, f"{alarm['reason']} ({state})", SEVERITY_OF[alarm["level"]])
        for number, alarm in before.items():
            if number not in now:
                await self._event(snapshot.name, f"{alarm['reason']} (closed)", SEVERITY_OF_END)

    async def _event(self, asset: str, message: str, severity: int) -> None:
        self._events.event.SourceName, self._events.event.SourceNode = asset, self._id(asset)
        self._events.event.Severity = severity
        await self._events.trigger(message=printable(message))

    def _id(self, name: str) -> ua.NodeId:
        identifier: Any = name
        return ua.NodeId(identifier, self._namespace)

    def _name(self, name: str) -> ua.QualifiedName:
        return ua.QualifiedName(name, self._namespace)


def data_value(variable: Variable, reading: Reading, now: datetime) -> ua.DataValue:
    """A reading as OPC UA has it: value, status code, time of the source and of the server."""
    value = all_printable(reading.value)
    if value is None:
        variant = ua.Variant(None, ua.VariantType.Null)
    else:
        variant = ua.Variant(value, TYPES[variable.kind], is_array=variable.kind == "lines")
    code: Any = CODES[reading.quality]
    source: Any = reading.time
    server: Any = now
    return ua.DataValue(variant, ua.StatusCode(code), SourceTimestamp=source, ServerTimestamp=server)


def unit_of(code: str) -> ua.EUInformation:
    """The engineering unit of a code of UNECE Recommendation 20, whose number is made of its letters."""
    symbol, name = UNITS[code]
    return ua.EUInformation(
        NamespaceUri=UNECE,
        UnitId=int.from_bytes(code.encode(), "big"),
        DisplayName=ua.LocalizedText(symbol),
        Description=ua.LocalizedText(name),
    )


@dataclass(frozen=True, slots=True)
class _Own:
    """The server's certificate and its key."""

    certificate: x509.Certificate
    key: Any

    @property
    def application(self) -> str:
        """The application's address that the certificate names, by which clients know the server."""
        try:
            names = self.certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        except x509.ExtensionNotFound:
            return APPLICATION
        return next(iter(names.get_values_for_type(x509.UniformResourceIdentifier)), APPLICATION)


def _own_of(settings: Settings) -> _Own | None:
    """What the server shows clients; InputError names the setting that cannot be used."""
    own, key, clients = settings.opcua_certificate, settings.opcua_key, settings.opcua_clients
    if own is None or key is None:
        if own is not None or key is not None or clients is not None:
            raise InputError("settings of opcua: a certificate needs opcua_certificate and opcua_key, both of them")
        return None
    if clients is not None and not (clients.is_dir() and any(clients.iterdir())):
        raise InputError(f"setting opcua_clients = {clients}: must be a folder that holds certificates")
    text = _read(key, "opcua_key")
    try:
        loaded: Any = (load_pem_private_key if _is_pem(text) else load_der_private_key)(text, None)
    except (ValueError, TypeError):
        raise InputError(f"setting opcua_key = {key}: must be a private key (PEM or DER) without a password") from None
    text = _read(own, "opcua_certificate")
    try:
        return _Own((x509.load_pem_x509_certificate if _is_pem(text) else x509.load_der_x509_certificate)(text), loaded)
    except ValueError:
        raise InputError(f"setting opcua_certificate = {own}: must be a certificate (PEM or DER)") from None


def _is_pem(text: bytes) -> bool:
    return b"-----BEGIN" in text[:4096]


def _read(path: Path, setting: str) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"setting {setting} = {path}: {(error.strerror or 'fault').lower()}") from None
