"""Recordings made to take the memory or the processor: small files whose chunks unpack to gigabytes."""

from __future__ import annotations

import resource
import struct
import subprocess
import sys

import lz4.frame
import pytest
import zstandard
from service_streams import ROOT
from streams import bursts
from test_mcap import count_frames, written

from service.errors import InputError
from service.stream.sources import mcap_scan
from service.stream.sources.mcap import Recording
from service.stream.sources.mcap_scan import MAGIC

GIB = 2**30
ZEROS = bytes(2**20)


def zstd_zeros(size, stated=True):
    packer = zstandard.ZstdCompressor().compressobj(size=size if stated else -1)
    parts = [packer.compress(ZEROS) for _ in range(size // len(ZEROS))]
    return b"".join([*parts, packer.compress(bytes(size % len(ZEROS))), packer.flush()])


def lz4_zeros(size):
    with lz4.frame.LZ4FrameCompressor() as packer:
        parts = [packer.begin(), *(packer.compress(ZEROS) for _ in range(size // len(ZEROS))), packer.flush()]
    return b"".join(parts)


def chunk(packed, claimed, compression):
    name = compression.encode()
    body = struct.pack("<QQQII", 1, 2, claimed, 0, len(name)) + name + struct.pack("<Q", len(packed)) + packed
    return b"\x06" + struct.pack("<Q", len(body)) + body


def file_of(path, *chunks):
    path.write_bytes(MAGIC + b"".join(chunks))
    return path


def in_little_memory(path):
    """A process that reads a recording with 1.5 GB of address space: its output and processor time [s]."""
    code = (
        "import sys\nfrom service.stream.sources.mcap import Recording\n"
        "from service.errors import InputError\n"
        "import resource\nresource.setrlimit(resource.RLIMIT_AS, (1500 * 2**20,) * 2)\n"
        "try:\n"
        "    with Recording(sys.argv[1]) as r: print(sum(1 for _ in r.messages()), r.faults)\n"
        "except InputError as error: print('refused:', error)\n"
    )
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, "-c", code, str(path)], cwd=ROOT, capture_output=True, text=True, timeout=100
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert done.returncode == 0, done.stderr
    return done.stdout, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


@pytest.mark.parametrize(
    ("packed", "claimed", "compression", "said"),
    [
        (lambda: zstd_zeros(4 * GIB), 4 * GIB, "zstd", "claims 4294967296 bytes"),
        (lambda: zstd_zeros(GIB), 2**20, "zstd", "claims 1048576 bytes and holds 1073741824"),
        (lambda: zstd_zeros(GIB, stated=False), 2**20, "zstd", "cannot be unpacked"),
        (lambda: lz4_zeros(GIB), 2**20, "lz4", "claims 1048576 bytes and holds more"),
        (lambda: zstd_zeros(2**28), 2**28, "zstd", "holds no record at byte 0"),
    ],
    ids=["claimed", "more than claimed", "unstated", "lz4", "zeros"],
)
@pytest.mark.slow
def test_bomb_is_left_out_in_little_memory_and_time(tmp_path, packed, claimed, compression, said):
    path = file_of(tmp_path / "bomb.mcap", chunk(packed(), claimed, compression))
    printed, seconds = in_little_memory(path)
    assert printed.startswith("refused:"), printed
    assert seconds < 10


def test_chunk_that_holds_more_than_it_says_is_left_out(tmp_path):
    good = written(tmp_path / "a.mcap", bursts(2))
    count, _ = count_frames(good)
    for packed, name in (
        (zstd_zeros(2**22), "zstd"),
        (zstd_zeros(2**22, stated=False), "zstd"),
        (lz4_zeros(2**22), "lz4"),
    ):
        bomb = chunk(packed, 2**10, name)
        data = good.read_bytes()
        path = tmp_path / "b.mcap"
        path.write_bytes(MAGIC + bomb + data[len(MAGIC) :])
        left, faults = count_frames(path)
        (fault,) = [each for each in faults if "chunks damaged and left out" in each]
        assert left == count and "1 of" in fault, name  # that the summary is no longer in its place is said as well


def test_all_chunks_together_are_bounded_by_the_size_of_the_file(tmp_path, monkeypatch):
    monkeypatch.setattr(mcap_scan, "TOTAL", 10 * 2**20)
    monkeypatch.setattr(mcap_scan, "EXPANSION", 1)
    good = written(tmp_path / "a.mcap", bursts(2))
    record = b"\x80" + struct.pack("<Q", 2**21 - 9) + bytes(2**21 - 9)  # one private record of 2 MB
    bombs = [chunk(zstandard.compress(record), 2**21, "zstd") for _ in range(30)]
    path, data = tmp_path / "b.mcap", good.read_bytes()
    path.write_bytes(MAGIC + b"".join(bombs) + data[len(MAGIC) :])
    with Recording(path) as recording:
        assert list(recording.messages())  # of the true chunks those that still fit
        assert sum(recording._contents.unpacked.values()) <= mcap_scan.allowance(path.stat().st_size) < 20 * 2**20
        assert any("all chunks together would be over" in fault for fault in recording.faults)


def test_many_small_records_are_bounded(tmp_path, monkeypatch):
    monkeypatch.setattr(mcap_scan, "MOST_RECORDS", 1000)
    data = (b"\x80" + struct.pack("<Q", 0)) * 5000
    path = file_of(tmp_path / "many.mcap", chunk(zstandard.compress(data), len(data), "zstd"))
    with pytest.raises(InputError, match="can be read"), Recording(path) as recording:
        list(recording.messages())
