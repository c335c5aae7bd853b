"""Damaged recordings, rig files and measurement files: each must be read as far as it goes or be refused by one line.

    python -m tests.chaos recordings [--count N] [--seed S]
    python -m tests.chaos rigs [--count N] [--seed S]
    python -m tests.chaos measurements [--count N] [--seed S]

A file is made from a sound one by bits, bytes and records changed, left out, repeated or exchanged. Most recordings are
read into windows; every WHOLE-th goes through `gear-twin assess`. Measurement files of all formats go through
`gear-twin import --guess`. Each file is read by a process of its own, and none may raise anything but the errors that
are meant for people, print a traceback or a library's warning, end the process, take longer than LONGEST, or more
memory than MEMORY.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import os
import random
import resource
import signal
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from mcap.reader import make_reader
from measurement_files import WRITERS
from measurement_files import signal as vibration
from service_streams import write_recording

from service.cli import run
from service.errors import InputError
from service.files.rig import load_rig
from service.stream.sources.mcap import Recording, read_windows
from service.stream.sources.mcap_write import RecordingWriter
from service.stream.wire.topics import parse_topic
from tests.chaos.frames import FrameFaults

SOURCE = Path(__file__).parents[2] / "recordings" / "short-campaign.mcap"
RIG = Path(__file__).parents[2] / "recordings" / "rigs" / "unsw.toml"
READERS = ("asammdf", "h5py", "mat73", "nptdms", "pyarrow.parquet", "service.cli.importing")
WHOLE = 20
LONGEST = 20  # [s]
MEMORY = 1000  # resident, at most [MB]
CLEAR = 1000  # the longest sentence that a person reads [characters]
FIRST_WINDOWS = 2  # of the bundled campaign
WORDS = (
    b"nan",
    b"inf",
    b"1e400",
    b"-1",
    b"-",
    b"",
    b"\n",
    b"\r",
    b"\x00",
    b",",
    b";",
    b'"',
    b"9" * 30,
    b"\xff\xfe",
    b"\x1b[2J",
)
MAGIC = 8  # bytes at both ends of an MCAP file


@dataclass(slots=True)
class Tally:
    """What became of damaged files."""

    files: int = 0
    used: int = 0
    refused: int = 0
    windows: int = 0
    slowest: float = 0.0  # [s]
    memory: float = 0.0  # of the largest process [MB]
    faults: list[str] = field(default_factory=list)

    def add(self, outcome: dict[str, Any]) -> None:
        """Counts one file."""
        self.files += 1
        self.used += outcome["status"] == 0
        self.refused += outcome["status"] == 2
        self.windows += outcome.get("windows", 0)
        self.slowest = max(self.slowest, outcome["seconds"])
        self.memory = max(self.memory, outcome["memory"])
        if outcome["fault"]:
            self.faults.append(f"{outcome['name']}: {outcome['fault']}")


class ByteFaults:
    """Draws damaged files of any format."""

    def __init__(self, rng: random.Random) -> None:
        self.rng = rng

    def draw(self, data: bytes) -> bytes:
        """The bytes of a sound file, damaged."""
        for _ in range(self.rng.choice((1, 1, 1, 2, 3))):
            data = self.rng.choice(self._WAYS)(self, data)
        return data

    def _bits(self, data: bytes) -> bytes:
        out = bytearray(data or b"\0")
        for _ in range(self.rng.choice((1, 1, 4, 32))):
            out[self.rng.randrange(len(out))] ^= 1 << self.rng.randrange(8)
        return bytes(out)

    def _head(self, data: bytes) -> bytes:
        """Damage where the file says what it holds."""
        out = bytearray(data or b"\0")
        for _ in range(self.rng.choice((1, 2, 8))):
            out[self.rng.randrange(min(len(out), 4096))] = self.rng.randrange(256)
        return bytes(out)

    def _tail(self, data: bytes) -> bytes:
        out = bytearray(data or b"\0")
        for _ in range(self.rng.choice((1, 2, 8))):
            out[-1 - self.rng.randrange(min(len(out), 2048))] = self.rng.randrange(256)
        return bytes(out)

    def _cut(self, data: bytes) -> bytes:
        return data[: self.rng.randrange(len(data) + 1)]

    def _hole(self, data: bytes) -> bytes:
        at = self.rng.randrange(len(data) + 1)
        return data[:at] + data[at + self.rng.choice((1, 8, 100, 10_000)) :]

    def _noise(self, data: bytes) -> bytes:
        at = self.rng.randrange(len(data) + 1)
        return data[:at] + self.rng.randbytes(self.rng.choice((1, 9, 4096))) + data[at:]

    def _zeros(self, data: bytes) -> bytes:
        at, length = self.rng.randrange(len(data) + 1), self.rng.choice((8, 512, 4096, 65_536))
        return data[:at] + bytes(min(length, len(data) - at)) + data[at + length :]

    def _extreme(self, data: bytes) -> bytes:
        """A number, binary or as text, that no recorder writes, mostly where the file says what it holds."""
        at = self.rng.randrange(min(len(data), self.rng.choice((256, 4096, len(data)))) + 1)
        length = self.rng.choice((1, 2, 4, 8))
        number = self.rng.choice((0, 1, 2 ** (8 * length - 1) - 1, 2 ** (8 * length - 1), 2 ** (8 * length) - 1))
        word = self.rng.choice((number.to_bytes(length, "little"), *WORDS))
        return data[:at] + word + data[at + len(word) :]

    def _repeated(self, data: bytes) -> bytes:
        at, length = self.rng.randrange(len(data) + 1), self.rng.choice((1, 16, 512, 8192))
        return data[:at] + data[at : at + length] * self.rng.choice((2, 3)) + data[at + length :]

    _WAYS: tuple[Any, ...] = (
        _bits, _bits, _head, _head, _tail, _cut, _hole, _noise, _zeros, _extreme, _extreme, _extreme, _repeated,
    )  # fmt: skip


class RecordingFaults(ByteFaults):
    """Draws damaged recordings."""

    def _records(self, data: bytes) -> bytes:
        """Records left out, repeated, exchanged, or with another type or length."""
        records = list(_records(data))
        if len(records) < 2:
            return self._bits(data)
        for _ in range(self.rng.choice((1, 2, 5))):
            at, other = (self.rng.randrange(len(records)) for _ in range(2))
            kind = self.rng.randrange(5)
            if kind == 0:
                del records[at]
            elif kind == 1:
                records.insert(other, records[at])
            elif kind == 2:
                records[at], records[other] = records[other], records[at]
            elif kind == 3:
                records[at] = bytes([self.rng.choice((*range(1, 16), 0, 0x80, 255))]) + records[at][1:]
            else:
                length = self.rng.choice((0, 1, 2**16, 2**31, 2**40, 2**63 - 1, 2**64 - 1))
                records[at] = records[at][:1] + length.to_bytes(8, "little") + records[at][9:]
            if len(records) < 2:
                break
        return data[:MAGIC] + b"".join(records) + data[-MAGIC:]

    _WAYS = (*ByteFaults._WAYS, *(_records,) * 6)


def _records(data: bytes) -> Iterator[bytes]:
    """The records of an MCAP file, each with its type and length."""
    at = MAGIC
    while at + 9 <= len(data) - MAGIC:
        end = at + 9 + int.from_bytes(data[at + 1 : at + 9], "little")
        if end > len(data) - MAGIC:
            return
        yield data[at:end]
        at = end


class RigFaults:
    """Draws damaged rig files."""

    WORDS = (
        "0", "-1", "1e400", "nan", "inf", "-inf", "1e-320", "true", "[]", "{}", '""', '"a"', "[1, 2]", "1979-05-27",
        "0x7fffffffffffffffffff", "9" * 400, "1_0", "19.5", "20", "19", "[[]]", '"\\u0000"',
    )  # fmt: skip

    def __init__(self, rng: random.Random, sound: bytes) -> None:
        self.rng, self.sound = rng, sound

    def draw(self) -> bytes:
        """The bytes of one damaged rig file."""
        lines = self.sound.decode().splitlines()
        for _ in range(self.rng.choice((1, 1, 2, 4))):
            at = self.rng.randrange(len(lines))
            kind = self.rng.randrange(6)
            if kind == 0:
                del lines[at]
            elif kind == 1:
                lines.insert(at, self.rng.choice(lines))
            elif kind in (2, 3) and "=" in lines[at]:
                lines[at] = f"{lines[at].partition('=')[0]}= {self.rng.choice(self.WORDS)}"
            elif kind == 4:
                lines[at] = lines[at][: self.rng.randrange(len(lines[at]) + 1)]
            else:
                text = bytearray("\n".join(lines).encode())
                text[self.rng.randrange(len(text))] = self.rng.randrange(256)
                return bytes(text)
            if not lines:
                lines = [""]
        return "\n".join(lines).encode()


# -- one file ------------------------------------------------------------------------------------------


def _alone(name: str, work: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """What came of a piece of work in a process of its own, with its time and memory; what must not be is a fault."""
    reads, writes = os.pipe()
    child = os.fork()
    if not child:
        os.close(reads)
        os.write(writes, json.dumps(_outcome(work)).encode())
        os._exit(0)
    os.close(writes)
    until = time.monotonic() + LONGEST
    while not (ended := os.waitpid(child, os.WNOHANG))[0] and time.monotonic() < until:
        time.sleep(0.002)
    if not ended[0]:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
    with os.fdopen(reads, "rb") as pipe:
        said = pipe.read()
    if said.endswith(b"}"):
        return {"name": name, **json.loads(said)}
    fault = f"ended with {os.waitstatus_to_exitcode(ended[1])}" if ended[0] else f"not done within {LONGEST} s"
    return {"name": name, "fault": fault, "seconds": float(LONGEST), "memory": 0.0, "status": 1}


def _outcome(work: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    before = resource.getrusage(resource.RUSAGE_SELF)
    fault, found = None, {"status": 2}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            found = work()
    except InputError as error:
        if "\n" in str(error):
            fault = f"more than one line: {error}"
    except BaseException as error:
        fault = f"{type(error).__name__}: {error}"
    after = resource.getrusage(resource.RUSAGE_SELF)
    memory = _peak_memory()
    if fault is None and memory > MEMORY:
        fault = f"{memory:.0f} MB of memory"
    fault = fault and fault[:2000]
    return {"fault": fault, "seconds": after.ru_utime - before.ru_utime, "memory": memory, **found}


def _peak_memory() -> float:
    """The most that this process had resident [MB]; `ru_maxrss` would count the memory of the process that began it."""
    line = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM:"))
    return int(line.split()[1]) / 1e3


def _windows(path: Path) -> dict[str, Any]:
    *_, windows = read_windows(path)
    return {"status": 0, "windows": len(windows)}


def _assessed(path: Path) -> dict[str, Any]:
    return _command("assess", path, "--no-trace", "--json", str(path.with_suffix(".json")))


def _imported(path: Path) -> dict[str, Any]:
    return _command(
        "import", path, "--guess", "--teeth=23/57", "--zone=UTC", f"--out={path}.mcap", f"--write={path}.toml"
    )


def _command(command: str, path: Path, *options: str) -> dict[str, Any]:
    """A command as a person runs it: what is printed of errors, also by libraries, is one line for each."""
    warnings.resetwarnings()
    for hidden in (DeprecationWarning, ResourceWarning):  # as where nobody asks for them
        warnings.filterwarnings("ignore", category=hidden)
    said = path.with_name(path.name + ".said")
    with said.open("ab") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    with (
        said.open("a", encoding="utf-8") as err,
        open(os.devnull, "w") as out,
        contextlib.redirect_stderr(err),
        contextlib.redirect_stdout(out),
    ):
        status = run([command, str(path), *options])
    complaint = said.read_text(encoding="utf-8", errors="replace")
    lines = complaint.splitlines()
    odd = [line for line in lines if not line.startswith("gear-twin: ")]
    odd += [line for line in lines if len(line) > CLEAR]
    if status not in (0, 2) or odd or (status == 2 and len(lines) != 1):
        raise AssertionError(f"status {status}: {complaint[-2000:]}")
    return {"status": status, "said": complaint}


def _rig(path: Path) -> dict[str, Any]:
    load_rig(path)
    return {"status": 0}


def _files(kind: str, seed: int, numbers: range, sources: Sequence[str], folder: str) -> list[dict[str, Any]]:
    """Damaged files of some numbers, drawn and read one after the other; each number draws the same in any run."""
    out = []
    if kind == "measurements":
        for module in READERS:  # once, and not in each process
            importlib.import_module(module)
    for number in numbers:
        rng = random.Random(f"{kind} {seed} {number}")
        source = Path(rng.choice(sources))
        sound, name = source.read_bytes(), f"{number}.{source.name.partition('.')[2]}"
        if kind == "rigs":
            data, read = RigFaults(rng, sound).draw(), _rig
        elif kind == "measurements":
            data, read = ByteFaults(rng).draw(sound), _imported
        else:
            data = RecordingFaults(rng).draw(sound)
            read = _assessed if number % WHOLE == 0 else _windows
        with TemporaryDirectory(dir=folder) as own:
            path = Path(own) / name
            path.write_bytes(data)
            out.append(_alone(f"{kind} seed {seed} number {number} {source.name}", partial(read, path)))
    return out


def attack(kind: str, count: int, seed: int, folder: Path, say: Callable[[str], None], processes: int = 1) -> Tally:
    """Draws and reads so many damaged files in processes of their own."""
    sound = {"rigs": lambda *_: [RIG], "measurements": _sound_measurements, "recordings": _sound_recordings}
    sources = [str(path) for path in sound[kind](folder, seed)]
    tally, step = Tally(), 50
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        parts = [
            pool.submit(_files, kind, seed, range(at, min(at + step, count)), sources, str(folder))
            for at in range(0, count, step)
        ]
        for number, part in enumerate(parts):
            for outcome in part.result():
                tally.add(outcome)
            if number % 10 == 9:
                say(f"{tally.files} files, {len(tally.faults)} faults, at most {tally.memory:.0f} MB")
    return tally


def _sound_measurements(folder: Path, seed: int) -> list[Path]:
    """A file of each format and kind."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the libraries that write
        for name, write in WRITERS.items():
            write(folder / name, vibration())
    return [folder / name for name in WRITERS]


def _sound_recordings(folder: Path, seed: int) -> list[Path]:
    """A made-up campaign, the first windows of the bundled one, and one whose frames are malformed."""
    made = write_recording(folder / "made.mcap", windows=3)
    short, malformed = folder / "short.mcap", folder / "malformed.mcap"
    *_, windows = read_windows(SOURCE)
    until = windows[FIRST_WINDOWS].start_time_ns
    rng = random.Random(seed)
    with Recording(SOURCE) as recording, SOURCE.open("rb") as file:
        reader = make_reader(file)
        with (
            RecordingWriter(short, rig_text=recording.rig_text, metadata=dict(recording.metadata)) as sound,
            RecordingWriter(malformed, rig_text=recording.rig_text, metadata=dict(recording.metadata)) as broken,
        ):
            for _, channel, message in reader.iter_messages(ending_before=until):
                to = parse_topic(channel.topic)
                if to is None:
                    continue
                sound.write(to, message.log_time, message.data)
                faults = FrameFaults(rng, [(channel.topic, message.data)])
                payload = faults.draw()[1] if rng.random() < 0.05 else message.data
                broken.write(to, message.log_time, payload)
    return [made, short, malformed]
