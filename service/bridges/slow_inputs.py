"""Slow values from topics of a plant: an oil temperature, a load. Each becomes a frame of a slow channel.

A file (TOML) says which topic holds which channel's value:

    schema = "gear-inputs/1"

    [[inputs]]
    topic = "plant/line1/oil"        # no wildcards; several inputs may use one topic
    asset = "unsw"
    channel = "temperature/oil"      # of a slow kind
    value = "sensors.oil.value"      # path in the JSON; left out where the payload is a plain number
    time = "time"                    # path of the value's time; left out: the time of receipt
    time_format = "iso"              # iso, s, ms, us or ns of Unix time
    unit = "degF"                    # of the number times `factor` plus `offset`; left out: the channel's own unit
    factor = 1.0
    offset = 0.0
    interval = 1.0                   # values that follow sooner than this are left out [s]

What cannot be used is left out and counted by its cause. Nothing here holds the network up: values wait in a bounded
queue for a thread of their own, which hands them to the stream's inbox as any frame.
"""

from __future__ import annotations

import json
import logging
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from service.bridges.kept import KeptNumbers
from service.contract.base import iso_time
from service.errors import FrameError, InputError
from service.files.documents import Part, load_document
from service.steady_clock import later_time_ns
from service.stream.channels import AS_IT_IS, CHANNEL_KINDS, Conversion
from service.stream.frames import LATEST_START, NS, SampleFrame
from service.stream.wire.codec import encode
from service.stream.wire.topics import NAME, Channel, topic_of

log = logging.getLogger(__name__)

SCHEMA = "gear-inputs/1"
KEYS = ("topic", "asset", "channel", "value", "time", "time_format", "unit", "factor", "offset", "interval")
NS_OF = {"s": NS, "ms": 1_000_000, "us": 1_000, "ns": 1}
MOST_WAITING = 1000  # messages; beyond, the oldest are left out
MOST_BYTES = 65_536  # of one message
INTERVALS = 0.01, 86_400.0  # [s]
AHEAD_NS = 300 * NS  # of this machine's clock, by which a value's time may be wrong
RATE = 1.0  # that a frame of one value states [Hz]
CAUSES = ("malformed", "out_of_range", "too_soon", "not_newer", "ahead", "retained", "too_many", "not_allowed")
"""Why a value was left out; `retained`: a value without a time that the broker had kept is of unknown age."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Input:
    """One slow value of a topic."""

    topic: str
    channel: Channel
    value: tuple[str, ...]  # path in the JSON; empty where the payload is a plain number
    time: tuple[str, ...]  # path of the value's time; empty: the time of receipt
    time_format: str
    conversion: Conversion  # to the channel's unit, after factor and offset
    factor: float
    offset: float
    interval_ns: int


class Unusable(Exception):
    """A message without a usable value: `cause` is one of CAUSES."""

    def __init__(self, cause: str, reason: str) -> None:
        super().__init__(reason)
        self.cause = cause


# -- the file ----------------------------------------------------------------------------------------------


def load_inputs(path: Path) -> tuple[Input, ...]:
    """The inputs of a file; InputError names the first that cannot be used."""
    document = Part(str(path), load_document(path, "file of inputs")).of_schema(SCHEMA).only("schema", "inputs")
    rows = document.values.get("inputs")
    if not isinstance(rows, list) or not rows or not all(isinstance(row, dict) for row in rows):
        raise InputError(f"{path}: inputs must be one or more tables [[inputs]]")
    inputs = tuple(_input(Part(f"{path}: inputs[{number}]", row)) for number, row in enumerate(rows))
    channels = [each.channel for each in inputs]
    double = next((c for c in channels if channels.count(c) > 1), None)
    if double is not None:
        raise InputError(f"{path}: {topic_of(double)} is given by two inputs; each channel must have one")
    return inputs


def _input(row: Part) -> Input:
    topic, asset, label = row.only(*KEYS).text("topic"), row.asset(), row.text("channel")
    if "+" in topic or "#" in topic:
        raise row.fault("topic", "must be one topic, without + and #")
    segment, _, name = label.partition("/")
    kind = CHANNEL_KINDS.get(segment)
    if kind is None or not kind.slow or not NAME.fullmatch(name):
        slow = ", ".join(f"{k.segment}/{{{k.named_by}}}" for k in CHANNEL_KINDS.values() if k.slow)
        raise row.fault("channel", f"must be a slow channel: {slow}")
    units = {name: c for name, c in kind.import_units.items() if not c.per_volt and not c.left_out}
    return Input(
        topic=topic,
        channel=Channel(asset, segment, name),
        value=_path(row, "value"),
        time=_path(row, "time"),
        time_format=row.one_of("time_format", ("iso", *NS_OF), "iso"),
        conversion=units[row.one_of("unit", units)] if "unit" in row.values else AS_IT_IS,
        factor=row.number("factor", (-1e12, 1e12), default=1.0),
        offset=row.number("offset", (-1e12, 1e12), default=0.0),
        interval_ns=round(row.number("interval", INTERVALS, "s", default=1.0) * NS),
    )


def _path(row: Part, key: str) -> tuple[str, ...]:
    path = row.text(key, "must be a path such as sensors.oil.value", "", least=0)
    parts = tuple(path.split(".")) if path else ()
    if not all(parts):
        raise row.fault(key, "has an empty part; a path reads sensors.oil.value")
    return parts


# -- one message -------------------------------------------------------------------------------------------


def reading(wanted: Input, payload: bytes, received_ns: int, retained: bool) -> tuple[int, float]:
    """Unix time [ns] and value, in the channel's unit, of one message; Unusable says why there is none."""
    if len(payload) > MOST_BYTES:
        raise Unusable("malformed", f"{len(payload)} bytes, must be {MOST_BYTES} at most")
    try:
        content = json.loads(payload)
    except (ValueError, RecursionError):
        raise Unusable("malformed", "neither a number nor JSON") from None
    number = _number(_found(content, wanted.value), "value")
    if wanted.time:
        at = _time(_found(content, wanted.time), wanted.time_format)
    elif retained:
        raise Unusable("retained", "the broker had kept it, and it has no time: its age is not known")
    else:
        at = received_ns
    value = wanted.conversion.factor * (wanted.factor * number + wanted.offset) + wanted.conversion.offset
    kind = CHANNEL_KINDS[wanted.channel.kind]
    low, high = kind.values
    if not low <= value <= high:
        raise Unusable("out_of_range", f"{value:g} {kind.unit} is outside [{low:g}, {high:g}] {kind.unit}")
    return at, value


def _found(content: Any, path: tuple[str, ...]) -> Any:
    for part in path:
        if isinstance(content, dict) and part in content:
            content = content[part]
        elif isinstance(content, list) and part.isdecimal() and int(part) < len(content):
            content = content[int(part)]
        else:
            raise Unusable("malformed", f"no {part!r} in it")
    return content


def _number(found: Any, what: str) -> float:
    if isinstance(found, bool) or not isinstance(found, (int, float)):
        raise Unusable("malformed", f"its {what} is no number")
    try:
        number = float(found)
    except OverflowError:
        raise Unusable("malformed", f"its {what} is no finite number") from None
    if not isfinite(number):
        raise Unusable("malformed", f"its {what} is no finite number")
    return number


def _time(found: Any, form: str) -> int:
    """Unix time [ns]."""
    if form != "iso":
        number = _number(found, "time")
        at = found * NS_OF[form] if isinstance(found, int) else round(number * NS_OF[form])
    else:
        try:
            moment = datetime.fromisoformat(found)
        except (TypeError, ValueError):
            raise Unusable("malformed", "its time is not ISO 8601") from None
        if moment.tzinfo is None:
            raise Unusable("malformed", "its time names no time zone")
        since = moment - datetime(1970, 1, 1, tzinfo=UTC)
        at = (since.days * 86_400 + since.seconds) * NS + since.microseconds * 1_000
    if not 0 < at < LATEST_START:
        raise Unusable("malformed", "its time is outside the range of Unix time in ns")
    return at


# -- the thread --------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Message:
    topic: str
    payload: bytes
    received_ns: int
    retained: bool


class SlowInputs(threading.Thread):
    """Takes messages to the stream's inbox, until ended.

    Sequence numbers go on over restarts: they are kept before their frames are handed on, so that a jump says truly
    that frames were lost.
    """

    def __init__(
        self,
        inputs: tuple[Input, ...],
        offer: Callable[[str, bytes], bool],
        kept: KeptNumbers,
        prefix: str,
        clock: Callable[[], int] = later_time_ns,
    ) -> None:
        """offer  of the stream's inbox: topic, payload → whether there was room"""
        super().__init__(name="slow inputs", daemon=True)
        self._offer, self._kept, self._prefix, self._clock = offer, kept, prefix, clock
        self._by_topic: dict[str, list[Input]] = {}
        for each in inputs:
            self._by_topic.setdefault(each.topic, []).append(each)
        self._sequences, self._newest = kept.section("sequences"), kept.section("newest_ns")
        self._waiting: deque[_Message] = deque()
        self._changed = threading.Condition()
        self._stopping = False
        self._values = self._dropped = 0
        self._left_out = dict.fromkeys(CAUSES, 0)

    @property
    def topics(self) -> tuple[str, ...]:
        """The topics to subscribe to."""
        return tuple(self._by_topic)

    def receive(self, topic: str, payload: bytes, *, retained: bool) -> None:
        """A message has come; never waits."""
        message = _Message(topic, payload[: MOST_BYTES + 1], self._clock(), retained)
        with self._changed:
            if len(self._waiting) >= MOST_WAITING:
                self._waiting.popleft()
                self._left_out["too_many"] += 1
            self._waiting.append(message)
            self._changed.notify_all()

    def not_allowed(self, topic: str, reason: str) -> None:
        """The broker does not let the service have a topic."""
        self._count(topic, Unusable("not_allowed", f"the broker refuses the subscription: {reason}"))

    def run(self) -> None:
        """Works until ended."""
        while True:
            with self._changed:
                while not self._waiting and not self._stopping:
                    self._changed.wait()
                if self._stopping:
                    return
                messages = list(self._waiting)
                self._waiting.clear()
            self.take(messages)

    def end(self) -> None:
        """Ends the thread."""
        with self._changed:
            self._stopping = True
            self._changed.notify_all()
        if self.is_alive():
            self.join(1.0)

    def take(self, messages: list[_Message]) -> None:
        """Makes frames of some messages and hands them to the inbox."""
        frames = [frame for message in messages for frame in self._frames(message)]
        if not frames:
            return
        self._kept.keep("sequences", self._sequences)
        self._kept.keep("newest_ns", self._newest)
        for frame in frames:
            if self._offer(topic_of(frame.channel, self._prefix), encode(frame)):
                self._values += 1
            else:
                self._dropped += 1

    def figures(self) -> dict[str, Any]:
        """Figures for /metrics."""
        values, dropped = float(self._values), float(self._dropped)
        return {"inputs_values": values, "inputs_dropped": dropped, "inputs_left_out": dict(self._left_out)}

    def _frames(self, message: _Message) -> list[SampleFrame]:
        found = []
        for wanted in self._by_topic.get(message.topic, ()):
            try:
                found.append(self._frame(wanted, message))
            except Unusable as error:
                self._count(message.topic, error)
            except FrameError as error:
                self._count(message.topic, Unusable("malformed", str(error)))
        return found

    def _frame(self, wanted: Input, message: _Message) -> SampleFrame:
        at, value = reading(wanted, message.payload, message.received_ns, message.retained)
        name = topic_of(wanted.channel, self._prefix)
        latest = message.received_ns + AHEAD_NS
        if at > latest:
            raise Unusable("ahead", f"its time {iso_time(at)} is ahead of this machine's clock")
        newest = self._newest.get(name, 0)
        if newest > latest:  # this machine's clock was ahead then
            newest = 0
        if at <= newest:
            raise Unusable("not_newer", "its time is not after that of the value before")
        if at - newest < wanted.interval_ns:
            raise Unusable("too_soon", "it follows the value before too soon")
        sequence = self._sequences.get(name, -1) + 1
        frame = SampleFrame(
            channel=wanted.channel, start_time_ns=at, sequence=sequence, sample_rate=RATE,
            values=np.array([value], dtype=np.float32),
        )  # fmt: skip
        self._sequences[name], self._newest[name] = sequence, at
        return frame

    def _count(self, topic: str, error: Unusable) -> None:
        first = not self._left_out[error.cause]
        self._left_out[error.cause] += 1
        if first and error.cause != "too_soon":
            log.warning("slow values: %s: a value was left out (%s): %s", topic, error.cause, error)
