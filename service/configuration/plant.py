"""Settings of what connects the service to other networks of a plant, and of its log lines."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar, Literal

from pydantic import Field, SecretStr

from service.configuration.tables import Table

BROKER = r"^mqtts?://(\[[0-9A-Fa-f:.]+\]|[^:/@\s]+)(:\d{1,5})?/?$"
OPC_TCP = r"^opc\.tcp://(\[[0-9A-Fa-f:.]+\]|[^:/@\s]+):\d{1,5}(/[A-Za-z0-9_.\-/]*)?$"
STORE = r"^((s3a?|gs|az)://[^/@:\s?#]+|abfss?://[^/:\s?#]+|file://[^/@:\s?#]*)(/[^\s?#]*)?$"
TOPIC = r"^[A-Za-z0-9_.\-]+(/[A-Za-z0-9_.\-]+)*$"

# what a setting with a pattern must be like
READ = {
    "raw_url": "must be the URL of an object store, such as s3://bucket/raw, without credentials",
    "otlp": "must be http(s)://HOST:PORT, such as http://127.0.0.1:4318",
    "opcua": "must be opc.tcp://HOST:PORT, such as opc.tcp://127.0.0.1:4840/gear-twin",
    "mqtt": "must be mqtt://HOST[:PORT] or mqtts://HOST[:PORT], without user and password",
    "mqtt_prefix": "must be letters, digits, '_', '-' and '.', in parts separated by '/', such as gear-twin",
    "mqtt_client_id": "must be 1 to 64 letters, digits, '_', '-' or '.'",
}


class Mqtt(Table):
    """Results and alarms at an MQTT broker, and slow values from it."""

    TABLE: ClassVar[str] = "mqtt"
    PREFIX: ClassVar[str] = "mqtt_"
    KEYS: ClassVar[dict[str, str]] = {"mqtt": "broker"}

    mqtt: str | None = Field(
        default=None,
        pattern=BROKER,
        description="broker that results are published to, mqtt(s)://HOST[:PORT]; none: no MQTT",
        examples=["mqtts://broker.example:8883"],
    )
    mqtt_user: str | None = Field(default=None, description="user name at the broker", examples=["gear-twin"])
    mqtt_password: SecretStr | None = Field(
        default=None, description="password at the broker", examples=["a long password"]
    )
    mqtt_password_file: Path | None = Field(
        default=None, description="file that holds the password instead", examples=["mqtt-password"]
    )
    mqtt_ca: Path | None = Field(
        default=None,
        description="certificates (PEM) by which the broker's is checked; none: those of the system",
        examples=["ca.pem"],
    )
    mqtt_certificate: Path | None = Field(
        default=None, description="certificate (PEM) of the service at the broker", examples=["gear-twin.pem"]
    )
    mqtt_key: Path | None = Field(default=None, description="its private key (PEM)", examples=["gear-twin.key"])
    mqtt_client_id: str | None = Field(
        default=None,
        pattern=r"^[A-Za-z0-9_.\-]{1,64}$",
        description="name of the service at the broker; none: one of its own for each data directory",
        examples=["gear-twin-1"],
    )
    mqtt_prefix: str = Field(default="gear-twin", pattern=TOPIC, description="first part of the topics at the broker")
    mqtt_qos: int = Field(default=1, ge=0, le=2, description="quality of service of what is published")
    mqtt_retain: bool = Field(default=True, description="whether the broker keeps the latest result of each asset")
    mqtt_full_state: bool = Field(default=False, description="whether the whole state is published, too")
    mqtt_inputs: Path | None = Field(
        default=None,
        description="file (TOML) of topics that hold slow values, such as an oil temperature",
        examples=["inputs.toml"],
    )


class OpcUa(Table):
    """Results for OPC UA clients."""

    TABLE: ClassVar[str] = "opcua"
    PREFIX: ClassVar[str] = "opcua_"
    KEYS: ClassVar[dict[str, str]] = {"opcua": "address"}

    opcua: str | None = Field(
        default=None,
        pattern=OPC_TCP,
        description="address that the OPC UA server listens at, opc.tcp://HOST:PORT; none: no OPC UA",
        examples=["opc.tcp://127.0.0.1:4840/gear-twin"],
    )
    opcua_certificate: Path | None = Field(
        default=None,
        description="certificate of the server (PEM or DER); with it every connection is encrypted",
        examples=["opcua.pem"],
    )
    opcua_key: Path | None = Field(default=None, description="its private key (PEM or DER)", examples=["opcua.key"])
    opcua_clients: Path | None = Field(
        default=None,
        description="folder of certificates (DER) of clients, or of their authorities, that are trusted; none: all are",
        examples=["opcua-clients"],
    )


class Monitoring(Table):
    """How the service is watched."""

    TABLE: ClassVar[str] = "monitoring"

    metrics_assets: int = Field(
        default=500,
        ge=0,
        le=100_000,
        description="assets with metrics of their own; all others are counted together as `(others)`",
    )
    loop_limit: float = Field(
        default=120.0,
        ge=5.0,
        le=3600.0,
        description="time without a turn after which a loop of the service counts as hung: `/healthz`, watchdog [s]",
    )
    otlp: str | None = Field(
        default=None,
        pattern=r"^https?://[^/\s]+(/\S*)?$",
        description="address of an OpenTelemetry collector (OTLP over HTTP) that the processing "
        "stages of each window are sent to; none: nothing is",
        examples=["http://127.0.0.1:4318"],
    )


class Raw(Table):
    """Recordings of all frames that come."""

    TABLE: ClassVar[str] = "raw"
    PREFIX: ClassVar[str] = "raw_"

    raw_folder: Path | None = Field(
        default=None,
        description="folder in which all frames that come are kept as MCAP recordings; none: they are not kept",
        examples=["/srv/gear-twin/raw"],
    )
    raw_url: str | None = Field(
        default=None,
        pattern=STORE,
        description="object store that completed recordings are moved to; until then they are in the folder, by "
        "default `raw` in the data directory. What is kept is then kept there. Its endpoint and credentials are read "
        "from the environment (AWS_ENDPOINT_URL, AWS_ACCESS_KEY_ID, …). Needs gear-twin[fleet]",
        examples=["s3://bucket/raw"],
    )
    raw_spool_gb: float = Field(
        default=10.0,
        gt=0,
        le=1e6,
        description="size of what waits in the folder for the object store, beyond which the oldest are deleted [GB]",
    )
    raw_keep_gb: float = Field(
        default=100.0, gt=0, le=1e6, description="size of all of them, beyond which the oldest are deleted [GB]"
    )
    raw_keep_days: float = Field(default=90.0, gt=0, le=1e5, description="age beyond which one is deleted [days]")
    raw_roll_mb: float = Field(default=256.0, ge=1, le=1e5, description="size at which a recording is completed [MB]")
    raw_roll_hours: float = Field(
        default=6.0, gt=0, le=1e4, description="time after which a recording is completed, too [h]"
    )
    raw_spare_gb: float = Field(
        default=2.0,
        ge=0,
        le=1e6,
        description="room of the disk that is left to others: recordings are deleted before, and then not made [GB]",
    )


class Log(Table):
    """Log lines on standard error."""

    TABLE: ClassVar[str] = "log"
    PREFIX: ClassVar[str] = "log_"

    log_format: Literal["text", "json"] = Field(
        default="text", description="lines for people, or one JSON object a line"
    )
    log_level: Literal["debug", "info", "warning", "error"] = Field(
        default="info", description="least level that is written; of other packages warnings at least"
    )
    log_lines: int = Field(
        default=10, ge=0, le=1_000_000, description="lines of one cause that are written within a minute; 0: all"
    )
