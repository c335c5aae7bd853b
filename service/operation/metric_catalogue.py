"""Every metric of /metrics: its type, unit, labels, meaning, and what to do about it.

The collector (service/api/collector.py) makes its families from this list and exports nothing that is not in it; the
operations page is made from it too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

Type = Literal["gauge", "counter", "histogram"]
Others = Literal["sum", "max", "none"]

PREFIX = "gear_twin_"
OTHERS = "(others)"  # value of the label `asset` for all assets beyond the bound together
TIMES = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0)  # upper bounds of a histogram [s]


@dataclass(frozen=True, slots=True, kw_only=True)
class MetricEntry:
    """One metric.

    others  what is exported for the assets beyond the bound together: their sum, their maximum, or nothing
    only    when it is exported; empty: always
    """

    name: str  # without prefix, and without `_total`
    type: Type
    meaning: str
    action: str = ""  # what to do where it is not as it should be; empty where it only informs
    unit: str = ""  # empty: a number of things
    labels: tuple[str, ...] = ()
    others: Others = "sum"
    only: str = ""

    @property
    def shown(self) -> str:
        """The name as it is exported."""
        return f"{PREFIX}{self.name}{'_total' if self.type == 'counter' else ''}"


def _entry(type: Type, name: str, meaning: str, action: str = "", *, labels: str = "", **more: Any) -> MetricEntry:
    """A metric; `labels` in one text."""
    return MetricEntry(name=name, type=type, meaning=meaning, action=action, labels=tuple(labels.split()), **more)


_gauge, _counter, _times = partial(_entry, "gauge"), partial(_entry, "counter"), partial(_entry, "histogram", unit="s")


def _of_each_asset(*entries: MetricEntry) -> tuple[MetricEntry, ...]:
    """Metrics whose first label is the asset."""
    return tuple(replace(entry, labels=("asset", *entry.labels)) for entry in entries)


REPORT = "Report it, with the lines of the log: it is an internal error."
STORAGE = "The log and `/readyz` give the cause: free space, repair the disk, or start the database server."
MQTT, INPUTS, OPCUA = "with MQTT", "with slow values from MQTT", "with OPC UA"
FIGURE = "where the twin of the asset has this figure"

OF_ASSETS = _of_each_asset(
    _gauge(
        "status",
        "1 at the status of the machine, 0 at every other level",
        "Follow the action that the page shows.",
        labels="level",
    ),
    _gauge(
        "data",
        "1 at the quality of the machine's data, 0 at every other level",
        "`degraded`: the page says what is wrong with the data. `stale`: no usable window is received; check data "
        "acquisition, cable and clock.",
        labels="level",
    ),
    _gauge(
        "alarms",
        "open alarms by level and state",
        "Acknowledge an alarm once somebody looks after it.",
        labels="level state",
    ),
    _gauge(
        "stale",
        "1 where no whole window has been received for longer than the service allows",
        "Check data acquisition, cable and clock; retire the asset if nothing more is expected.",
    ),
    _gauge(
        "lag_seconds",
        "how long the oldest window that has not been processed has waited",
        "Above two window lengths for minutes: compare `workers_busy` with `workers`; give more worker processes or "
        "switch tracing off.",
        unit="s",
        others="max",
    ),
    _gauge(
        "backlog_windows",
        "windows that are stored and wait to be processed",
        "Rising for hours: give more worker processes, longer windows or fewer machines.",
    ),
    _gauge(
        "held_windows",
        "windows that wait until a person has answered a question about the asset",
        "Answer the question that the page shows.",
    ),
    _counter("frames", "frames received", labels="channel"),
    _counter(
        "frame_faults",
        "frames that were lost, late, duplicate, out of order or refused, by kind",
        "A steady rate points to the network, or to the clock or the numbering of a logger; see the kinds below.",
        labels="channel kind",
    ),
    _counter(
        "missing_frames",
        "frames that a publisher numbered and that were never received",
        "Check the network; let loggers keep frames until the service has stored them.",
    ),
    _counter("recovered_frames", "frames that were received after later ones, and were put in their place"),
    _counter(
        "windows", "measurement windows by grade", "Look into `refused` ones: each states its reason.", labels="quality"
    ),
    _counter(
        "windows_shed",
        "windows left out because there was no room: at `reception` the frames of the window, at "
        "`processing` a stored window that waited",
        "reception: a publisher floods, or one core cannot assemble all streams. processing: give more worker "
        "processes, longer windows or fewer machines.",
        labels="where",
    ),
    _counter(
        "data_faults",
        "frames, samples or edges with a fault, by kind",
        "Check the sensor that the channel names.",
        labels="kind channel",
    ),
    _counter("updates", "windows that updated the wear coefficient"),
    _gauge(
        "last_window_seconds",
        "Unix time at which the newest window was stored",
        "Compare it with the time: an asset that sends windows and has none stored has a problem.",
        unit="s",
        others="none",
    ),
    _gauge("effects", "effects in the model besides wear"),
    _counter("decisions", "decisions on effects that were carried out", labels="decision"),
    _gauge(
        "wear_depth_micrometres",
        "largest wear depth, quantiles 0.05, 0.5 and 0.95",
        labels="flank quantile",
        unit="µm",
        others="none",
        only=FIGURE,
    ),
    _gauge("wear_depth_limit_micrometres", "wear depth at the end of life", unit="µm", others="none", only=FIGURE),
    _gauge(
        "remaining_life_hours",
        "remaining life at the present operating condition, quantiles 0.05, 0.5 and 0.95",
        "Plan the exchange of the gears.",
        labels="quantile",
        unit="h",
        others="none",
        only=FIGURE,
    ),
)

OF_STREAMS = (
    _gauge("assets", "assets that are known"),
    _gauge(
        "unknown_assets",
        "assets that are not known and wait to be adopted",
        "Adopt or dismiss them: `gear-twin remote assets unknown`, or the page.",
    ),
    _counter(
        "unknown_asset_frames",
        "frames of such assets, and of those of another partition of the fleet, which were left out",
    ),
    _counter("unknown_assets_forgotten", "entries of the list that ended without a decision, or had no room"),
    _gauge(
        "rig_proposals",
        "rig files that came on the stream and wait for a decision",
        "Accept or reject them: `gear-twin remote assets rig`, or the page. One that nobody has sent on purpose is a "
        "wrong or hostile publisher.",
    ),
    _gauge(
        "queue_frames",
        "frames received that have not been assembled yet",
        "Rising for minutes: one core cannot assemble all streams; give fewer machines to this service.",
    ),
    _gauge("queue_bytes", "the same in bytes", unit="byte"),
    _gauge(
        "network_connected", "1 while the service is subscribed to the network", "`/readyz` and the log say why not."
    ),
    _counter("received_frames", "frames received from the network"),
    _counter(
        "frames_left_out",
        "frames that were not used, by cause: `no_room` (the queue is full), `bad_key`, "
        "`too_many_streams`, `closed` (the service ends), `unknown_asset` (nobody has adopted it), "
        "`retired` (the asset is out of use), `unopened` (a new asset "
        "while the storage cannot be used)",
        "`no_room`: compare with `windows_shed`. `bad_key`, `too_many_streams`: look for a publisher that uses wrong "
        "keys. `retired`: switch the logger off, or take the asset into use again.",
        labels="cause",
    ),
    _counter(
        "missed_frames",
        "frames that the network reported as lost and no publisher could send again",
        "Check the network; let loggers keep frames until the service has stored them.",
    ),
    _counter("callback_errors", "internal errors in callbacks of the network", REPORT),
)

OF_PROCESSING = (
    _gauge(
        "windows_waiting",
        "windows of all assets that are stored and wait to be processed",
        "Rising for hours: give more worker processes or switch tracing off.",
    ),
    _gauge("windows_waiting_bytes", "the same on disk", unit="byte"),
    _gauge("windows_in_memory_bytes", "windows that could not be stored yet", STORAGE, unit="byte"),
    _counter("program_faults", "windows or decisions refused because of an internal error", REPORT),
    _gauge("workers", "worker processes; 0: the service's own process computes"),
    _gauge(
        "workers_busy",
        "worker processes that compute at present",
        "All busy for hours with windows waiting: give more.",
    ),
    _counter(
        "worker_deaths",
        "worker processes that ended unexpectedly or took too long",
        "Look for lack of memory in the log of the operating system; otherwise report it.",
    ),
    _counter(
        "worker_servers_replaced",
        "times that the process which makes worker processes did not answer and was replaced",
        "Do not stop the service's processes; look for a machine that hangs or swaps.",
    ),
    _gauge("twin_calls_waiting", "assets whose windows wait for a worker"),
    _gauge(
        "twin_call_seconds",
        "how long the longest present computation has taken",
        "Tracing takes some 10 s; a computation of minutes calls for a look at the asset.",
        unit="s",
    ),
    _times("processing_seconds", "computation of one window, decision, inspection or change", labels="task"),
    _times("trace_seconds", "the part of it that searches for effects besides wear"),
    _times(
        "window_delay_seconds", "from the end of reception of a window to its stored result", "As for `lag_seconds`."
    ),
)

RAW = "where `[raw] folder` or `[raw] url` is set"
RAW_STORE = "where `[raw] url` is set"
OF_STORAGE = (
    _gauge("raw_recordings", "raw recordings in their folder", only=RAW),
    _gauge("raw_recording_bytes", "the same in bytes; bounded by `[raw] keep_gb`", unit="byte", only=RAW),
    _gauge(
        "raw_recording_newest_seconds",
        "end of the newest frame in a raw recording, Unix time; 0 before the first",
        "Old while frames come: see `raw_recording_stopped` and the log.",
        unit="s",
        only=RAW,
    ),
    _gauge(
        "raw_recording_stopped",
        "1 while no raw recordings are written: the disk, the network or the recorder's process fails",
        "The log says why: free space, or repair the disk; it goes on by itself. Windows are not affected.",
        only=RAW,
    ),
    _counter("raw_frames_recorded", "frames written to raw recordings", only=RAW),
    _counter(
        "raw_frames_left_out",
        "frames that are missing in raw recordings: the disk is too slow, full or fails",
        "Record to a faster disk; see `raw_recording_stopped`.",
        only=RAW,
    ),
    _counter("raw_recordings_deleted", "raw recordings deleted by age or for room, since the start", only=RAW),
    _counter("raw_segments_stored", "raw recordings moved to the object store, since the start", only=RAW_STORE),
    _counter("raw_segments_failed", "attempts to move one that failed", only=RAW_STORE),
    _counter(
        "raw_segments_deleted",
        "raw recordings deleted in the object store by age or for room, since the start",
        only=RAW_STORE,
    ),
    _gauge(
        "raw_segments_waiting",
        "completed raw recordings that wait for the object store",
        "See the log for why the store cannot be used; the oldest are deleted beyond `[raw] spool_gb`.",
        only=RAW_STORE,
    ),
    _gauge(
        "raw_store_unavailable",
        "1 while the object store of raw recordings cannot be used",
        "The log says why; it is tried again by itself. Windows are not affected.",
        only=RAW_STORE,
    ),
    _gauge("storage_unavailable", "1 while the database or the disk cannot be used", STORAGE),
    _counter("storage_failures", "failed attempts to store something", STORAGE),
    _gauge(
        "storage_free_bytes",
        "free space of the file system that holds the data directory",
        "Free space, or keep less: settings of the table `results`.",
        unit="byte",
    ),
    _gauge(
        "store_bytes",
        "size of the database, with its write-ahead log",
        "Compare it with the formula in the guide on the database; keep less.",
        unit="byte",
        only="while the database can be used",
    ),
    _times(
        "store_commit_seconds",
        "transactions of the database, from begin to the end of the commit",
        "Rising: the disk or the server is slow.",
    ),
    _times("store_read_seconds", "queries of the database"),
    _counter("old_rows_deleted", "rows that were ever deleted because they were older than they are kept"),
)

OF_HTTP = (
    _gauge("http_connections", "open HTTP connections"),
    _counter(
        "http_connections_refused",
        "connections beyond the limits",
        "Look for a client that opens too many; raise the limit if all are wanted.",
    ),
    _counter(
        "http_slow_clients",
        "connections that were ended because the request did not come in time",
        "Many: somebody holds connections open on purpose; the log names the client.",
    ),
    _counter(
        "http_refused",
        "requests refused before they were read, by status: 414, 415, 421, 429, 431, 503",
        "421: add the name to `[http] hosts`. 429: the log names the client. Others: a faulty client.",
        labels="status",
    ),
    _counter("refused_requests", "requests without the role that they need", "See `/v1/audit`."),
    _counter(
        "wrong_credentials", "keys and tokens that were not accepted", "Many: somebody is guessing; see `/v1/audit`."
    ),
    _counter("audit_entries", "entries added to the audit log since the service was started"),
    _counter(
        "log_lines", "log lines written, by level", "Look at the lines of level `error` and `critical`.", labels="level"
    ),
    _counter("log_lines_left_out", "log lines that were counted instead of written", "The log says which."),
)

OF_CONNECTIONS = (
    _gauge(
        "webhooks_waiting",
        "messages about alarms that are not delivered yet",
        "Check the receiver.",
        only="while the database can be used",
    ),
    _counter("webhooks_delivered", "messages about alarms that were delivered"),
    _counter("webhook_failures", "attempts to deliver that failed", "Check the receiver."),
    _counter(
        "webhooks_given_up",
        "messages that were given up after three days",
        "Inform those concerned; repair the receiver.",
    ),
    _gauge("mqtt_connected", "1 while the MQTT broker is connected", "The log says why it is not.", only=MQTT),
    _counter(
        "mqtt_failures", "connections to the broker that failed or were lost", "The log gives the cause.", only=MQTT
    ),
    _counter("mqtt_messages", "messages published to the broker", only=MQTT),
    _counter("mqtt_inputs_values", "slow values received from the broker and used", only=INPUTS),
    _counter(
        "mqtt_inputs_dropped", "slow values for which the queue had no room", "As for `frames_left_out`.", only=INPUTS
    ),
    _counter(
        "mqtt_inputs_left_out",
        "slow values that were not used, by cause",
        "The log names the topic; compare it with the file of inputs.",
        labels="cause",
        only=INPUTS,
    ),
    _gauge("opcua_connected", "1 while OPC UA is served", "The log says why it is not.", only=OPCUA),
    _counter(
        "opcua_failures",
        "starts of the OPC UA server that failed, and its unexpected ends",
        "The log gives the cause.",
        only=OPCUA,
    ),
    _counter("opcua_values", "values written for OPC UA clients", only=OPCUA),
    _counter(
        "opcua_refused",
        "OPC UA clients that were refused",
        "See the log; trust the client's certificate if it is wanted.",
        only=OPCUA,
    ),
)

FLEET = "of a front end of a fleet"
OF_FLEETS = (
    _gauge("fleet_partitions", "partitions of the fleet", only=FLEET),
    _gauge(
        "fleet_partitions_served",
        "partitions that a worker serves at present; other figures of processing are those of these workers together",
        "Below `fleet_partitions` for more than a minute: `/readyz` names the partitions, and the log of the node that "
        "should serve them says why.",
        only=FLEET,
    ),
    _gauge("fleet_assets", "assets of the fleet by the level of their status", labels="level", only=FLEET),
)

GROUPS: dict[str, tuple[MetricEntry, ...]] = {
    "Machines": OF_ASSETS,
    "Streams": OF_STREAMS,
    "Processing": OF_PROCESSING,
    "Storage": OF_STORAGE,
    "HTTP, access and log": OF_HTTP,
    "Connections to other systems": OF_CONNECTIONS,
    "Fleets": OF_FLEETS,
}
METRICS: dict[str, MetricEntry] = {entry.name: entry for group in GROUPS.values() for entry in group}
