"""Malformed input found by coverage: libFuzzer, through atheris, changes what brings it to code it has not seen.

    python -m tests.chaos guided [--count SECONDS] [--seed S] [--only TARGET ...]

Each target gets its share of the time, in a process of its own, and begins with sound input that is made here. It may
answer, or refuse with the errors that are meant for it; whatever else it raises, more than MEMORY, or longer than
LONGEST for one input, is a fault. Without atheris, which is not there for every system and Python, that is said and
nothing is tried.
"""

from __future__ import annotations

import importlib.util
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

TARGETS = ("frames", "recordings", "rigs", "positions", "windows")
ROOT = Path(__file__).parents[2]
LONGEST = 30  # for one input [s]
MEMORY = 2000  # resident, at most [MB]
LARGEST = 65_536  # input [bytes]
# libFuzzer takes the peak memory of the process that began it for its own, but not that of a process before
BETWEEN = "import subprocess, sys; sys.exit(subprocess.run(sys.argv[1:], check=False).returncode)"


@dataclass(slots=True)
class Tally:
    """What became of the targets."""

    skipped: str | None = None
    inputs: dict[str, int] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)


def attack(seconds: int, seed: int, folder: Path, say: Callable[[str], None], only: Sequence[str] = ()) -> Tally:
    """Tries the targets one after the other, for so long together."""
    tally = Tally()
    if importlib.util.find_spec("atheris") is None:
        tally.skipped = "atheris is not installed"
        return tally
    targets = list(only or TARGETS)
    for target in targets:
        corpus, artefacts = folder / f"{target}-corpus", folder / target
        corpus.mkdir()
        artefacts.mkdir()
        command = [
            sys.executable, "-c", BETWEEN, sys.executable, "-m", "tests.chaos.guided", target, str(corpus),
            f"-artifact_prefix={artefacts}/",
            f"-max_total_time={max(1, seconds // len(targets))}", f"-timeout={LONGEST}", f"-rss_limit_mb={MEMORY}",
            f"-max_len={LARGEST}", f"-seed={seed}", "-print_final_stats=1", "-verbosity=1",
        ]  # fmt: skip
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        counted = [line.split()[-1] for line in done.stderr.splitlines() if "number_of_executed_units" in line]
        tally.inputs[target] = int(counted[0]) if counted else 0
        if done.returncode != 0:
            found = [path.read_bytes()[:2000].hex() for path in sorted(artefacts.iterdir())]
            tally.faults.append(f"{target}: ended with {done.returncode}: {done.stderr[-3000:]}; input {found[:1]}")
        say(f"{target}: {tally.inputs[target]} inputs, {len(tally.faults)} faults so far")
    return tally


# -- in the process of a target ---------------------------------------------------------------------------


def _run(target: str, corpus: Path, options: list[str]) -> None:
    import atheris

    sys.path.insert(0, str(ROOT / "tests" / "service"))  # the fakes of the service's tests
    with atheris.instrument_imports(include=["service", "twin", "mcap", "zipfile", "tomllib", "numpy.lib"]):
        take, sound = _TARGETS[target]()
    for number, data in enumerate(sound):
        (corpus / f"{number:03d}").write_bytes(data)
    warnings.simplefilter("error")
    atheris.Setup([sys.argv[0], str(corpus), *options], take)
    atheris.Fuzz()


def _frames() -> tuple[Callable[[bytes], None], list[bytes]]:
    from service_streams import write_recording

    from service.errors import FrameError
    from service.stream.channels import CHANNEL_KINDS
    from service.stream.sources.mcap import Recording
    from service.stream.wire.codec import decode, start_time_of
    from service.stream.wire.topics import Channel

    kinds = sorted(CHANNEL_KINDS)

    def take(data: bytes) -> None:
        if not data:
            return
        channel = Channel("a", kinds[data[0] % len(kinds)], "x")
        start_time_of(channel, data[1:])
        try:
            decode(channel, data[1:])
        except FrameError:
            return

    path = write_recording(Path(tempfile.mkdtemp()) / "sound.mcap", windows=1)
    with Recording(path) as recording:
        raws = list(recording.messages())[:16]
    return take, [bytes([kinds.index(raw.channel.kind)]) + raw.payload for raw in raws]


def _recordings() -> tuple[Callable[[bytes], None], list[bytes]]:
    from service_streams import write_recording

    from service.errors import FrameError, InputError
    from service.stream.sources.mcap import Recording
    from service.stream.wire.codec import decode

    folder = Path(tempfile.mkdtemp())
    path = folder / "input.mcap"

    def take(data: bytes) -> None:
        path.write_bytes(data)
        try:
            with Recording(path) as recording:
                for raw in recording.messages():
                    try:
                        decode(raw.channel, raw.payload)
                    except FrameError:
                        continue
        except InputError as error:
            assert "\n" not in str(error)

    sound = [write_recording(folder / f"{n}.mcap", windows=n).read_bytes() for n in (0, 1)]
    return take, [*sound, sound[1][: len(sound[1]) // 2]]


def _rigs() -> tuple[Callable[[bytes], None], list[bytes]]:
    from service.errors import InputError
    from service.files.documents import parsed_document
    from service.files.rig import checked_rig

    def take(data: bytes) -> None:
        try:
            checked_rig(parsed_document(data, "the rig file"), "the rig file")
        except InputError as error:
            assert "\n" not in str(error)

    return take, [path.read_bytes() for path in sorted((ROOT / "recordings" / "rigs").glob("*.toml"))]


def _positions() -> tuple[Callable[[bytes], None], list[bytes]]:
    from service.contract.position import ChannelPositionModel, PositionModel, position_of, position_text

    def take(data: bytes) -> None:
        found = position_of(data)
        if found is not None:
            assert position_of(position_text(found)) == found

    channel = ChannelPositionModel(sequence=7, start_time_ns=10**18, missing=[(2, 3)])
    whole = PositionModel(asset="a", instance="b", accepting=False, reason="c", channels={"accel/y6": channel})
    return take, [position_text(whole).encode(), b"{}"]


def _windows() -> tuple[Callable[[bytes], None], list[bytes]]:
    import numpy as np

    from service.results.segment_file import read_segment, write_segment
    from service.stream.frames import SampleFrame
    from service.stream.pieces import Piece
    from service.stream.samples import Span
    from service.stream.segment import Segment
    from service.stream.wire.topics import Channel

    path = Path(tempfile.mkdtemp()) / "window.mcap"
    frame = SampleFrame(
        channel=Channel("a", "accel", "y6"), start_time_ns=10**18, sequence=0, sample_rate=2000.0,
        values=np.arange(400, dtype=np.float32),
    )  # fmt: skip
    pieces = {"accel/y6": [Piece(frame, 0, 300, 1)]}
    write_segment(path, Segment(span=Span(frame.start_time_ns, frame.end_time_ns), pieces=pieces))

    def take(data: bytes) -> None:
        path.write_bytes(data)
        try:
            read_segment(path)
        except (OSError, ValueError):
            return

    return take, [path.read_bytes()]


_TARGETS: dict[str, Callable[[], Any]] = {
    "frames": _frames, "recordings": _recordings, "rigs": _rigs, "positions": _positions, "windows": _windows,
}  # fmt: skip

if __name__ == "__main__":
    _run(sys.argv[1], Path(sys.argv[2]), sys.argv[3:])
