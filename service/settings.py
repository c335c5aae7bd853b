"""The settings of the service: one typed object, made once and passed in.

Every field can be set by an environment variable `GEAR_TWIN_` + its name in capitals, lists as JSON, or in the
configuration file in the table that its class names (`service/configuration`). A new setting is a field of one of
the tables, with its limits and its meaning.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, ClassVar, Literal
from urllib.parse import urlsplit

from pydantic import Field, SecretStr, field_validator, model_validator
from pydantic_settings import BaseSettings, PydanticBaseSettingsSource, SettingsConfigDict

from service.access.addresses import is_loopback
from service.access.roles import Role
from service.configuration.fleet import Fleet
from service.configuration.new_assets import NewAssets, Rule, rule_of
from service.configuration.plant import Log, Monitoring, Mqtt, OpcUa, Raw
from service.configuration.sources import CONFIG, Environment, FileSource
from service.configuration.tables import Table
from service.transport.zenoh_links import ZenohLinks
from twin.attention import STATUS_LIMITS, StatusLimits

_HOST_PORT = r"^(\[[0-9A-Fa-f:.]+\]|[^:\s]+):\d{1,5}$"
HOUR = 3600.0  # [s]
Algorithm = Literal["RS256", "RS384", "RS512", "PS256", "PS384", "PS512", "ES256", "ES384", "ES512", "EdDSA"]


class Stream(Table):
    """Frames from the network."""

    TABLE: ClassVar[str] = "stream"

    listen: list[str] = Field(default=["tcp/127.0.0.1:7447"], description="endpoints of the embedded Zenoh router")
    connect: list[str] = Field(
        default=[],
        description="endpoints of an external router; the embedded one is then off",
        examples=[["tcp/127.0.0.1:7448"]],
    )
    prefix: str = Field(
        default="gearbox", pattern=r"^[A-Za-z0-9_.\-]+(/[A-Za-z0-9_.\-]+)*$", description="first part of all keys"
    )
    queue_frames: int = Field(
        default=4096,
        ge=16,
        le=1_000_000,
        description="frames that wait in the queues of all streams; beyond, whole windows are left out",
    )
    queue_bytes: int = Field(default=256 * 2**20, ge=2**20, description="bytes of these frames")
    idle_timeout: float = Field(default=3.0, gt=0, le=3600, description="silence that ends a window in progress [s]")
    channel_wait: float = Field(
        default=10.0,
        ge=0,
        le=3600,
        description="how long a channel that the others have gone on without is waited for, once it is late [s]",
    )

    stale_after: float = Field(
        default=86_400.0, gt=0, le=1e9, description="time without a whole window that makes an asset stale [s]"
    )
    fruitless_after: float = Field(
        default=300.0,
        gt=0,
        le=1e9,
        description="the same while frames keep coming, at least three window lengths [s]",
    )


class Windows(Table):
    """How frames are cut into windows."""

    TABLE: ClassVar[str] = "windows"
    PREFIX: ClassVar[str] = "window_"

    window_length: float = Field(default=10.0, gt=0.05, le=600, description="cut of an unbroken stream [s]")
    window_gap: float = Field(default=1.0, gt=0, le=600, description="pause that ends a burst [s]")
    patience: int = Field(default=256, ge=2, le=100_000, description="frames a key waits for a missing one")
    settle: int = Field(default=24, ge=1, le=100_000, description="frames in good order that prove a gap real")
    window_bytes: int = Field(default=512 * 2**20, ge=2**20, description="one window with all its channels [bytes]")
    buffer_bytes: int = Field(default=128 * 2**20, ge=2**20, description="frames held while waiting, an asset [bytes]")


class Twin(Table):
    """What is computed from a window."""

    TABLE: ClassVar[str] = "twin"

    rig: Path | None = Field(default=None, description="rig file of all assets that no other names")
    update: Literal["fused", "rms"] = Field(default="fused", description="method that sets the depth")
    error_threshold: float = Field(default=0.05, gt=0, lt=1, description="RMS error that triggers an update")

    baseline: Path | None = Field(default=None, description="baseline file of machines whose rig file gives no model")
    relation: Path | None = Field(
        default=None, description="relation file of level and wear depth, for machines whose rig file gives no model"
    )
    false_alarm_rate: float = Field(
        default=0.01,
        gt=0,
        lt=1,
        description="share of campaigns of healthy machines in which an effect may be reported",
    )
    detectability: list[Path] = Field(
        default=[], description="files of `gear-twin detectability`, each used for machines with its rig file's values"
    )
    trace: bool = Field(
        default=True, description="whether to search for effects besides wear, and to add them to the model"
    )

    life_horizon_hours: float = Field(
        default=STATUS_LIMITS.horizon / HOUR,
        ge=0,
        le=1e6,
        description="how far ahead the status looks for the end of life [h], 0: not at all; by the calendar where the "
        "running time per day is known, else of operation; a rig file may state its own, `end_of_life.horizon_days`",
    )


class Workers(Table):
    """Processes that compute what the twin says."""

    TABLE: ClassVar[str] = "workers"
    PREFIX: ClassVar[str] = "worker_"
    KEYS: ClassVar[dict[str, str]] = {"workers": "processes"}

    workers: int | None = Field(
        default=None,
        ge=0,
        le=256,
        description="worker processes, at a lower priority (nice 10); by default the usable cores "
        "(affinity, quota of processor time) but one, and at least two; 0: none",
        examples=[3],
    )
    task_limit: float = Field(
        default=1800.0, gt=0, le=86_400, description="time after which a call to the twin is given up [s]"
    )
    backlog_windows: int = Field(
        default=500, ge=1, le=1000, description="windows of one asset that wait to be processed, at most"
    )
    backlog_bytes: int = Field(
        default=512 * 2**20, ge=2**20, le=2**30, description="what those take on disk, at most [bytes]"
    )
    backlog_total_windows: int = Field(
        default=10_000, ge=1, description="windows of all assets that wait to be processed, at most"
    )
    backlog_total_bytes: int = Field(
        default=4 * 2**30, ge=2**20, description="what those take on disk, at most [bytes]"
    )
    backlog_memory_bytes: int = Field(
        default=256 * 2**20,
        ge=2**20,
        description="windows held in memory while the storage cannot be used, at most [bytes]",
    )
    worker_cache_bytes: int = Field(
        default=512 * 2**20, ge=2**20, description="wear curves that one worker process keeps [bytes]"
    )


class Alarms(Table):
    """Alarms and who is notified."""

    TABLE: ClassVar[str] = "alarms"
    PREFIX: ClassVar[str] = "alarm_"

    alarm_rules: Path | None = Field(
        default=None, description="file of alarm rules (TOML) of all assets that have none of their own"
    )
    webhooks: list[str] = Field(
        default=[],
        description="addresses (http, https) that every change of an alarm is sent to",
        examples=[["https://example.org/hook"]],
    )


class Results(Table):
    """Where results are kept."""

    TABLE: ClassVar[str] = "results"

    data: Path = Field(default=Path(".gear-twin"), description="directory of the database and of the raw signals")
    database: SecretStr | None = Field(
        default=None,
        description="URL of a PostgreSQL database for the results; otherwise SQLite in the data directory is used",
        examples=["postgresql://twin@127.0.0.1/gear_twin"],
    )
    keep_whole_days: float = Field(
        default=365.0, ge=0, le=1e5, description="age up to which all windows are kept, by an asset's newest [days]"
    )
    keep_every: int = Field(
        default=10, ge=1, le=10_000, description="of older windows one in so many is kept, and each that updated"
    )
    keep_days: float = Field(default=3650.0, ge=0, le=1e5, description="age beyond which no window is kept [days]")
    keep_events: int = Field(default=100_000, ge=1000, le=10**9, description="newest events that are kept of an asset")
    keep_alarms: int = Field(
        default=10_000, ge=100, le=10**9, description="newest closed alarms that are kept of an asset"
    )
    signal_bytes: int = Field(
        default=256 * 2**20, ge=0, le=2**50, description="raw signals kept for viewing, an asset [bytes]; 0: none"
    )


class Http(Table):
    """REST and the page."""

    TABLE: ClassVar[str] = "http"
    PREFIX: ClassVar[str] = "http_"
    KEYS: ClassVar[dict[str, str]] = {"http": "address"}

    http: str = Field(default="127.0.0.1:8080", pattern=_HOST_PORT, description="HOST:PORT of REST and the page")
    http_hosts: list[str] = Field(
        default=[],
        description="names by which clients call the service, such as *.plant.example; addresses, localhost and this "
        "computer's own name always hold",
        examples=[["twin.plant.example"]],
    )
    http_certificate: Path | None = Field(
        default=None,
        description="certificate (PEM) with those in between; with it HTTP is served over TLS alone",
        examples=["twin.pem"],
    )
    http_private_key: Path | None = Field(
        default=None, description="private key (PEM) of the certificate", examples=["twin.key"]
    )
    http_tls_minimum: Literal["1.2", "1.3"] = Field(default="1.2", description="least version of TLS")
    http_client_authorities: Path | None = Field(
        default=None,
        description="authorities (PEM) by which certificates of clients are verified",
        examples=["authorities.pem"],
    )
    http_client_certificates: Literal["optional", "required"] = Field(
        default="optional", description="whether clients must show a certificate, where there are authorities"
    )
    http_certificate_roles: dict[str, Role] = Field(
        default={},
        description="role by the subject (common name) of a client's certificate",
        examples=[{"logger-7": "read"}],
    )
    http_rate: int = Field(default=3000, ge=1, le=10**9, description="requests of one client in a minute")
    http_connections: int = Field(default=512, ge=8, le=60_000, description="connections at once")
    http_connections_per_client: int = Field(default=64, ge=1, le=60_000, description="connections of one client")
    http_streams: int = Field(default=256, ge=1, le=60_000, description="event streams at once")
    http_streams_per_client: int = Field(default=32, ge=1, le=60_000, description="event streams of one client")
    http_header_time: float = Field(default=10.0, gt=0, le=600, description="for the headers of a request [s]")
    http_body_time: float = Field(
        default=30.0, gt=0, le=3600, description="for the body of a request, and more for large files [s]"
    )


class Admission(Table):
    """Who may do what."""

    TABLE: ClassVar[str] = "access"

    anonymous: Literal["none", "read"] = Field(
        default="none", description="what everybody may do without a key or token: nothing, or read everything"
    )
    audit_entries: int = Field(
        default=100_000, ge=1000, le=10**9, description="entries of the audit log that are kept, the newest"
    )


class Oidc(Table):
    """Tokens of an OpenID Connect issuer."""

    TABLE: ClassVar[str] = "oidc"
    PREFIX: ClassVar[str] = "oidc_"

    oidc_issuer: str | None = Field(
        default=None,
        pattern=r"^https?://\S+$",
        description="address of the issuer whose tokens are accepted; without one no token is",
        examples=["https://login.example.org/realms/plant"],
    )
    oidc_audience: str = Field(default="gear-twin", min_length=1, description="audience that a token must name")
    oidc_algorithms: list[Algorithm] = Field(
        default=["RS256", "ES256"], min_length=1, description="algorithms of signature that are accepted"
    )
    oidc_leeway: float = Field(default=30.0, ge=0, le=300, description="difference of clocks that is allowed [s]")
    oidc_role_claim: str = Field(
        default="roles",
        min_length=1,
        description="claim that names the roles, a list or words; parts of its path are separated by dots",
        examples=["realm_access.roles"],
    )
    oidc_roles: dict[str, Role] = Field(
        default={"read": Role.read, "operate": Role.operate, "administer": Role.administer},
        description="role of this service for each value of the claim",
    )
    oidc_name_claim: str = Field(
        default="preferred_username", min_length=1, description="claim that names the person; sub where it is not there"
    )
    oidc_keys_url: str | None = Field(
        default=None,
        pattern=r"^https?://\S+$",
        description="address of the issuer's keys; without it the one that the issuer's own description names",
        examples=["https://login.example.org/realms/plant/certs"],
    )
    oidc_ca: Path | None = Field(
        default=None,
        description="certificates (PEM) of the authorities that the issuer is verified by; without it the system's",
        examples=["authorities.pem"],
    )


class Zenoh(Table):
    """How the links of Zenoh are protected; the endpoints are in [stream], such as tls/0.0.0.0:7447."""

    TABLE: ClassVar[str] = "zenoh"
    PREFIX: ClassVar[str] = "zenoh_"

    zenoh_config: Path | None = Field(
        default=None,
        description="a whole configuration of Zenoh (JSON5), such as one with access control; endpoints and what "
        "else is set here are laid over it",
        examples=["zenoh-access.json5"],
    )
    zenoh_authorities: Path | None = Field(
        default=None, description="certificates (PEM) by which the other side is verified", examples=["plant-ca.pem"]
    )
    zenoh_certificate: Path | None = Field(
        default=None, description="own certificate (PEM), of the embedded router or of a client", examples=["zenoh.pem"]
    )
    zenoh_private_key: Path | None = Field(
        default=None, description="private key (PEM) of the certificate", examples=["zenoh.key"]
    )
    zenoh_client_certificates: bool = Field(
        default=False,
        description="whether the embedded router lets in only clients with a certificate of the authorities",
    )
    zenoh_verify_name: bool = Field(
        default=True, description="whether a client demands that the router's certificate names its address"
    )
    zenoh_user: str | None = Field(default=None, description="name of this client", examples=["logger-7"])
    zenoh_password: SecretStr | None = Field(default=None, description="its password", examples=["..."])
    zenoh_users: Path | None = Field(
        default=None,
        description="file of the users that the embedded router lets in, a line `name:password` each",
        examples=["zenoh-users"],
    )
    zenoh_open: bool = Field(
        default=False,
        description="permits the embedded router to listen where other computers reach it and to let everybody in",
    )


class Settings(
    Stream,
    NewAssets,
    Windows,
    Twin,
    Workers,
    Alarms,
    Results,
    Raw,
    Fleet,
    Http,
    Admission,
    Oidc,
    Mqtt,
    OpcUa,
    Monitoring,
    Log,
    Zenoh,
    BaseSettings,
):
    """Settings of `gear-twin serve`, `demo` and whatever else takes windows apart."""

    model_config = SettingsConfigDict(
        env_prefix="GEAR_TWIN_", env_ignore_empty=True, extra="forbid", validate_default=True
    )

    config: Path | None = Field(default=None, description="configuration file (TOML)")

    @classmethod
    def settings_customise_sources(
        cls, settings_cls: type[BaseSettings], init_settings: Any, *_: Any, **__: Any
    ) -> tuple[PydanticBaseSettingsSource, ...]:
        """Options before the environment before the file."""
        path = init_settings.init_kwargs.get("config") or os.environ.get(CONFIG)
        return init_settings, Environment(settings_cls), FileSource(settings_cls, Path(path) if path else None)

    @field_validator("listen", "connect")
    @classmethod
    def _endpoints(cls, endpoints: list[str]) -> list[str]:
        for endpoint in endpoints:
            protocol, slash, address = endpoint.partition("/")
            if not (protocol and slash and address):
                raise ValueError(f"endpoint {endpoint!r} must read protocol/address, such as tcp/127.0.0.1:7447")
        return endpoints

    @field_validator("database")
    @classmethod
    def _database(cls, url: SecretStr | None) -> SecretStr | None:
        if url is not None and url.get_secret_value().partition("://")[0] not in ("postgresql", "sqlite"):
            raise ValueError("must be a URL such as postgresql://user@host/name or sqlite:////path/file")
        return url

    @field_validator("webhooks")
    @classmethod
    def _addresses(cls, addresses: list[str]) -> list[str]:
        for address in addresses:
            scheme, _, rest = address.partition("://")
            if scheme not in ("http", "https") or not rest.partition("/")[0]:
                raise ValueError(f"webhook {address!r} must read http://host/path or https://host/path")
        return addresses

    @field_validator("oidc_issuer", "oidc_keys_url")
    @classmethod
    def _protected(cls, url: str | None) -> str | None:
        if url is not None and not url.startswith("https://") and not is_loopback(urlsplit(url).hostname):
            raise ValueError("must be an https:// address: what comes over http:// could be changed on its way")
        return url

    @model_validator(mode="after")
    def _belong_together(self) -> Settings:
        if (self.http_certificate is None) is not (self.http_private_key is None):
            raise ValueError("http_certificate and http_private_key must both be given, or neither")
        if (self.zenoh_certificate is None) is not (self.zenoh_private_key is None):
            raise ValueError("zenoh_certificate and zenoh_private_key must both be given, or neither")
        if (self.zenoh_user is None) is not (self.zenoh_password is None):
            raise ValueError("zenoh_user and zenoh_password must both be given, or neither")
        if self.zenoh_client_certificates and (self.zenoh_authorities is None or self.zenoh_certificate is None):
            raise ValueError("zenoh_client_certificates needs zenoh_authorities and zenoh_certificate")
        if self.http_client_authorities is not None and self.http_certificate is None:
            raise ValueError("http_client_authorities needs http_certificate: clients show theirs over TLS alone")
        if self.http_certificate_roles and self.http_client_authorities is None:
            raise ValueError("http_certificate_roles needs http_client_authorities, by which certificates are verified")
        return self

    @property
    def zenoh_links(self) -> ZenohLinks:
        """How the links of Zenoh are protected."""
        return ZenohLinks(
            config=self.zenoh_config,
            authorities=self.zenoh_authorities,
            certificate=self.zenoh_certificate,
            key=self.zenoh_private_key,
            demand=self.zenoh_client_certificates,
            verify_name=self.zenoh_verify_name,
            user=self.zenoh_user,
            password=None if self.zenoh_password is None else self.zenoh_password.get_secret_value(),
            users=self.zenoh_users,
        )

    @property
    def rule_of_new_assets(self) -> tuple[Rule, str | None]:
        """What becomes of an asset that is not known, and why where that is not set."""
        return rule_of(self.new_assets, self.http_host, self.listen, self.connect)

    def effective(self, name: str) -> tuple[Any, str | None]:
        """A setting's value, and why it holds where it follows from others."""
        return self.rule_of_new_assets if name == "new_assets" else (getattr(self, name), None)

    @property
    def status_limits(self) -> StatusLimits:
        """When a depth or a life calls for attention."""
        return StatusLimits(horizon=self.life_horizon_hours * HOUR)

    @property
    def http_host(self) -> str:
        return self.http.rpartition(":")[0].strip("[]")

    @property
    def http_port(self) -> int:
        return int(self.http.rpartition(":")[2])
