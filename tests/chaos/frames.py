"""Malformed frames: a million, into a whole service but for the network, with one sound machine among them.

    python -m tests.chaos frames [--count N] [--seed S]

A frame is made from a sound one by one to four faults: bits, bytes and fields changed, left out, repeated or
contradictory; figures at and beyond their limits; other topics, invented names, foreign kinds. The service must neither
fail nor stop, and memory, assets, metrics and log must stay within their limits. Where people are asked about unknown
assets, the sound machine's windows must be those that it has without the attack. Where each new name is an asset, names
by the thousand share the service with it: what there is no room for must be left out as whole windows, and be reported.
"""

from __future__ import annotations

import json
import logging
import math
import random
import string
import struct
import threading
import time
import traceback
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import psutil
from fake_twin import TWIN
from memory_transport import MemoryNetwork
from service_streams import write_recording

from service.runtime.serve import run
from service.settings import Settings
from service.stream.channels import CHANNEL_KINDS
from service.stream.sources.mcap import Recording
from service.stream.wire.topics import topic_of
from twin.errors import NotAvailable
from twin.windows import Window

VARINT, FIXED64, BYTES, FIXED32 = 0, 1, 2, 5  # wire types of protobuf
EXTREME_INTEGERS = (0, 1, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**63, 2**64 - 1)
EXTREME_FLOATS = (
    0.0, -0.0, 1.0, -1.0, 1e-300, 5e-324, 1e300, -1e300, 1e8, 1e6, 999_999.0, 1e-3, math.inf, -math.inf, math.nan,
)  # fmt: skip
LARGEST = 4 * 2**20  # payloads that are blown up [bytes]
AMONG = 50  # malformed frames between two of a sound burst, at most
QUIET, LONGEST = 15.0, 300.0  # without anything taken or computed; until all windows are there [s]
NAMES = string.ascii_letters + string.digits + "_-."

Field = tuple[int, int, bytes]  # number, wire type, content without length


def varint(value: int) -> bytes:
    """A number in protobuf's varying length."""
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes((*out, value))


def fields_of(payload: bytes) -> list[Field]:
    """The fields of a sound message."""
    out, at = [], 0

    def number() -> int:
        nonlocal at
        value = shift = 0
        while True:
            byte = payload[at]
            at += 1
            value |= (byte & 0x7F) << shift
            if byte < 0x80:
                return value
            shift += 7

    while at < len(payload):
        key = number()
        kind = key & 7
        if kind == VARINT:
            content = varint(number())
        else:
            size = number() if kind == BYTES else {FIXED64: 8, FIXED32: 4}[kind]
            content, at = payload[at : at + size], at + size
        out.append((key >> 3, kind, content))
    return out


def message_of(fields: list[Field]) -> bytes:
    """The message that holds these fields."""
    parts = []
    for number, kind, content in fields:
        parts.append(varint(number << 3 | kind))
        if kind == BYTES:
            parts.append(varint(len(content)))
        parts.append(content)
    return b"".join(parts)


@dataclass(slots=True)
class FrameFaults:
    """Draws malformed frames."""

    rng: random.Random
    sound: list[tuple[str, bytes]]  # topics and payloads of frames as they should be
    invented: set[str] = field(default_factory=set)  # topics that no machine has

    def draw(self) -> tuple[str, bytes]:
        """Topic and payload of one malformed frame."""
        topic, payload = self.rng.choice(self.sound)
        for _ in range(self.rng.choice((1, 1, 1, 2, 2, 3, 4))):
            if self.rng.random() < 0.25:
                topic = self.rng.choice((self._other_kind, self._other_name, self._broken_topic))(topic)
                self.invented.add(topic)
            else:
                payload = self.rng.choice(self._PAYLOADS)(self, payload)
        return topic, payload

    # -- payloads ------------------------------------------------------------------------------------

    def _bits(self, payload: bytes) -> bytes:
        out = bytearray(payload or b"\0")
        for _ in range(self.rng.choice((1, 1, 2, 8, 64))):
            at = self.rng.randrange(min(len(out), self.rng.choice((16, 64, 1 << 30))))
            out[at] ^= 1 << self.rng.randrange(8)
        return bytes(out)

    def _cut(self, payload: bytes) -> bytes:
        return payload[: self.rng.randrange(len(payload) + 1)]

    def _noise(self, payload: bytes) -> bytes:
        return self.rng.randbytes(self.rng.choice((0, 1, 7, 64, 1024, 20_000)))

    def _spliced(self, payload: bytes) -> bytes:
        _, other = self.rng.choice(self.sound)
        return payload[: self.rng.randrange(len(payload) + 1)] + other[self.rng.randrange(len(other)) :]

    def _by_field(self, change: Callable[[list[Field], int], None]) -> Callable[[bytes], bytes]:
        def changed(payload: bytes) -> bytes:
            try:
                fields = fields_of(payload)
            except (IndexError, KeyError):
                return self._bits(payload)
            if fields:
                change(fields, self.rng.randrange(len(fields)))
            return message_of(fields)

        return changed

    def _field_left_out(self, payload: bytes) -> bytes:
        return self._by_field(lambda fields, at: fields.pop(at) and None)(payload)

    def _field_twice(self, payload: bytes) -> bytes:
        return self._by_field(lambda fields, at: fields.insert(0, fields[at]))(payload)

    def _field_renumbered(self, payload: bytes) -> bytes:
        numbers = (1, 2, 3, 4, 5, 6, 15, 19_000, 2**29 - 1)

        def change(fields: list[Field], at: int) -> None:
            fields[at] = (self.rng.choice(numbers), *fields[at][1:])

        return self._by_field(change)(payload)

    def _other_type(self, payload: bytes) -> bytes:
        def change(fields: list[Field], at: int) -> None:
            number = fields[at][0]
            fields[at] = self.rng.choice(
                (
                    (number, VARINT, varint(self.rng.choice(EXTREME_INTEGERS))),
                    (number, FIXED64, self.rng.randbytes(8)),
                    (number, FIXED32, self.rng.randbytes(4)),
                    (number, BYTES, self.rng.randbytes(self.rng.choice((0, 3, 8, 100)))),
                )
            )

        return self._by_field(change)(payload)

    def _extreme(self, payload: bytes) -> bytes:
        def change(fields: list[Field], at: int) -> None:
            number, kind, content = fields[at]
            if kind == VARINT:
                content = varint(self.rng.choice(EXTREME_INTEGERS))
            elif kind == FIXED64 and number == 1:
                content = struct.pack("<Q", self.rng.choice((*EXTREME_INTEGERS, self._time(content))))
            elif kind == FIXED64:
                content = struct.pack("<d", self.rng.choice(EXTREME_FLOATS))
            else:
                content = self._extreme_values(content)
            fields[at] = number, kind, content

        return self._by_field(change)(payload)

    def _time(self, content: bytes) -> int:
        """A time off by nanoseconds to centuries."""
        step = self.rng.choice((1, 10**6, 10**9, 60 * 10**9, 3600 * 10**9, 86_400 * 10**9, 10**18))
        return max(0, min(2**64 - 1, int.from_bytes(content, "little") + self.rng.choice((-1, 1)) * step))

    def _extreme_values(self, content: bytes) -> bytes:
        """Some values of a packed field beyond what a sensor can give, or the field far longer."""
        if self.rng.random() < 0.01:
            return (content * (LARGEST // max(len(content), 1)))[:LARGEST]
        size, code = (8, "<d") if self.rng.random() < 0.5 else (4, "<f")
        out = bytearray(content)
        for _ in range(min(len(out) // size, self.rng.choice((1, 1, 5, 10_000)))):
            at = size * self.rng.randrange(len(out) // size)
            value = self.rng.choice((*EXTREME_FLOATS, self.rng.uniform(-1e6, 1e6)))
            out[at : at + size] = struct.pack(code, value if size == 8 or abs(value) < 3e38 else math.inf)
        return bytes(out)

    _PAYLOADS = (
        _bits, _bits, _cut, _noise, _spliced, _field_left_out, _field_twice, _field_renumbered, _other_type, _extreme,
        _extreme, _extreme,
    )  # fmt: skip

    # -- topics --------------------------------------------------------------------------------------

    def _other_kind(self, topic: str) -> str:
        prefix, asset, _, name = (topic.split("/") + [""] * 4)[:4]
        return "/".join((prefix, asset, self.rng.choice((*CHANNEL_KINDS, "speed", "twin", "")), name))

    def _other_name(self, topic: str) -> str:
        parts = topic.split("/")
        at = self.rng.choice((1, 1, 3)) % len(parts)
        parts[at] = "".join(self.rng.choices(NAMES, k=self.rng.choice((1, 2, 8, 64, 65))))
        return "/".join(parts)

    def _broken_topic(self, topic: str) -> str:
        return self.rng.choice(
            (topic + "/more", topic.rpartition("/")[0], topic.replace("/", "//"), "..", ".", "",
             topic.replace("gearbox", "other"), topic + "\u2028", topic + " ", "é" * 10, "a/" * 300)
        )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What became of an attack."""

    sent: int
    seconds: float
    memory_before: float  # resident [MB]
    memory_after: float
    memory_peak: float
    assets: int
    unsound_windows: int
    metrics: int  # size of /metrics [bytes]
    log: int  # [bytes]
    data: int  # size of the data directory [bytes]
    sound: bool  # whether the sound machine's windows are those that it has without the attack
    failure: str | None


class _Log(logging.Handler):
    """Counts what is logged, and remembers what carries a traceback."""

    def __init__(self) -> None:
        super().__init__()
        self.bytes, self.tracebacks = 0, list[str]()

    def emit(self, record: logging.LogRecord) -> None:
        self.bytes += len(self.format(record)) + 1
        if record.exc_info:
            self.tracebacks.append(self.format(record))


def sound_frames(path: Path, asset: str) -> Iterator[tuple[str, bytes]]:
    """Topics and payloads of a recording's frames."""
    with Recording(path) as recording:
        for raw in recording.messages():
            yield topic_of(raw.channel._replace(asset=asset)), raw.payload


class Attack:
    """A whole service in this process, but for the network, and frames offered to it."""

    WINDOWS = 12  # of the sound machine

    def __init__(self, seed: int, folder: Path) -> None:
        self.folder = folder
        recording = write_recording(folder / "sound.mcap", windows=self.WINDOWS, asset="sound")
        self.steady = list(sound_frames(recording, "sound"))
        self.faults = FrameFaults(random.Random(seed), list(sound_frames(recording, "attacked")))

    def run(self, count: int, say: Callable[[str], None] = lambda line: None, *, ask: bool = True) -> Outcome:
        """Sends so many malformed frames and the sound machine's; `ask`: unknown assets wait for a person."""
        log, peak = _Log(), _Peak()
        logging.getLogger().addHandler(log)
        data = self.folder / f"data-{count}-{ask}"
        failure: list[str] = []
        try:
            with _service(data, failure, ask) as (network, address):
                peak.start()
                before, begun = peak.now(), time.monotonic()
                sent = 0
                for topic, payload, malformed in self._mixed(count):
                    network.inbox.offer(topic, payload)
                    sent += malformed
                    if failure:
                        break
                    if malformed and sent % 50_000 == 0:
                        say(f"{sent} malformed frames, {peak.now():.0f} MB")
                windows = _settled_windows(network, address, self.WINDOWS if ask else None, failure)
                after, seconds = peak.now(), time.monotonic() - begun
                shown = _get(address, "/v1/assets")
                metrics = len(_text(address, "/metrics"))
                unsound = sum(row["windows"] for row in shown if row["asset"] != "sound")
        finally:
            logging.getLogger().removeHandler(log)
            peak.end()
        if log.tracebacks:
            failure.append(log.tracebacks[0])
        return Outcome(
            sent=sent, seconds=seconds, memory_before=before, memory_after=after, memory_peak=peak.most,
            assets=len(shown), unsound_windows=unsound, metrics=metrics, log=log.bytes,
            data=sum(p.stat().st_size for p in data.rglob("*") if p.is_file()),
            sound=_are_sound(windows, self._undisturbed(), whole=ask), failure=failure[0] if failure else None,
        )  # fmt: skip

    def _mixed(self, count: int) -> Iterator[tuple[str, bytes, bool]]:
        """Topics and payloads: the sound machine's bursts, with malformed frames among and between them."""
        each = len(self.steady) // self.WINDOWS
        for number in range(self.WINDOWS):
            malformed = count * (number + 1) // self.WINDOWS - count * number // self.WINDOWS
            among = min(malformed // each, AMONG)
            for topic, payload in self.steady[number * each : (number + 1) * each]:
                yield topic, payload, False
                for _ in range(among):
                    yield *self.faults.draw(), True
            for _ in range(malformed - among * each):
                yield *self.faults.draw(), True

    def _undisturbed(self) -> list[dict[str, Any]]:
        """The sound machine's windows without any attack."""
        failure: list[str] = []
        with _service(self.folder / "undisturbed", failure, ask=False) as (network, address):
            for topic, payload in self.steady:
                network.inbox.offer(topic, payload)
            return _settled_windows(network, address, self.WINDOWS, failure)


class _Peak(threading.Thread):
    """Watches the resident memory of this process."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self._own, self._ended, self.most = psutil.Process(), threading.Event(), 0.0

    def now(self) -> float:
        """Resident memory [MB]."""
        return self._own.memory_info().rss / 1e6

    def run(self) -> None:
        while not self._ended.wait(0.05):
            self.most = max(self.most, self.now())

    def end(self) -> None:
        self._ended.set()


def _step(rig: Any, state: Any, window: Window, options: Any) -> tuple[Any, Any]:
    """The fake twin's step, for windows that have what it reads."""
    if "pinion" not in window.encoders or "pinion" not in window.torques or "y6" not in window.accelerations:
        raise NotAvailable("the window has no torque, no encoder or no acceleration")
    return TWIN.step(rig, state, window, options)


@contextmanager
def _service(data: Path, failure: list[str], ask: bool) -> Iterator[tuple[MemoryNetwork, str]]:
    """A running service with the fake twin; what ended it is added to `failure`."""
    network, stop, address, ready = MemoryNetwork(), threading.Event(), list[str](), threading.Event()

    def announce(where: str) -> None:
        address.append(where.rstrip("/"))
        ready.set()

    def serve() -> None:
        try:
            run(
                Settings(
                    data=data,
                    http="127.0.0.1:0",
                    idle_timeout=1.0,
                    new_assets="ask" if ask else "adopt",
                    assets=["sound", "attacked"],
                ),
                twin=replace(TWIN, step=_step),
                open_transport=network.open,
                announce=announce,
                stop=stop,
            )
        except BaseException as error:
            failure.append("".join(traceback.format_exception(error)))
        finally:
            ready.set()

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        assert ready.wait(30) and network.subscribed.wait(30), failure
        yield network, address[0]
    finally:
        stop.set()
        thread.join(30)
        if thread.is_alive():
            failure.append("the service did not end within 30 s")


def _settled_windows(
    network: MemoryNetwork, address: str, count: int | None, failure: list[str]
) -> list[dict[str, Any]]:
    """The sound machine's windows: as soon as there are so many, or, without a number, once nothing more is done."""
    begun = changed = time.monotonic()
    windows, before = list[dict[str, Any]](), None
    while not failure:
        with suppress(urllib.error.HTTPError):
            windows = _get(address, "/v1/assets/sound/windows?limit=1000")
        now = time.monotonic()
        done = len(windows), sum(row["windows"] for row in _get(address, "/v1/assets")), network.inbox.depth
        if done != before:
            before, changed = done, now
        if len(windows) == count or (count is None and now - changed > QUIET and now - begun > 2 * QUIET):
            break
        if now - begun > LONGEST:
            failure.append(f"{len(windows)} of {count} windows of the sound machine within {LONGEST:g} s")
        time.sleep(0.1)
    return windows


def _are_sound(windows: list[dict[str, Any]], undisturbed: list[dict[str, Any]], *, whole: bool) -> bool:
    """Whether the windows are as without the attack; unless `whole`, some may be left out where that is reported."""
    if whole:
        return windows == undisturbed
    sound = {window["start_time"]: _measured(window) for window in undisturbed}
    shed = any(fault["kind"] == "shed" for window in windows for fault in window["faults"])
    used = [window for window in windows if window["quality"] != "refused"]
    missing = len(used) < len(undisturbed)
    return all(sound.get(w["start_time"]) == _measured(w) for w in used) and (shed or not missing)


def _measured(window: dict[str, Any]) -> tuple[Any, ...]:
    return tuple(window[name] for name in ("quality", "revolutions", "speed_hz", "torque_nm", "rms_measured"))


def _text(address: str, path: str) -> str:
    with urllib.request.urlopen(address + path, timeout=60) as answer:
        return answer.read().decode()


def _get(address: str, path: str) -> Any:
    return json.loads(_text(address, path))
