"""Window files: every number comes back as it was, and a damaged file is refused in one way."""

from __future__ import annotations

import random

import pytest
from test_workers import window

from service.results.window_file import read_window, write_window


def test_damaged_file_is_refused_as_unreadable_or_gives_what_was_written(tmp_path):
    """Of every twelve damaged files one once raised what nobody expected: zlib.error, NotImplementedError, EOFError."""
    path = tmp_path / "window.npz"
    write_window(path, window())
    sound, data, refused = read_window(path), path.read_bytes(), 0
    for seed in range(600):
        rng, damaged = random.Random(seed), bytearray(data)
        for _ in range(rng.choice((1, 1, 2, 8))):
            at = rng.randrange(len(damaged)) if rng.random() < 0.5 else -1 - rng.randrange(700)
            damaged[at] ^= 1 << rng.randrange(8)
        path.write_bytes(damaged if rng.random() < 0.9 else damaged[: rng.randrange(len(damaged))])
        try:
            found = read_window(path)
        except (OSError, ValueError, KeyError):
            refused += 1
            continue
        assert found.start_time_ns == sound.start_time_ns
        assert (found.accelerations["y6"].values == sound.accelerations["y6"].values).all()
    assert refused > 400


def test_file_that_is_none_is_refused_as_unreadable(tmp_path):
    path = tmp_path / "window.npz"
    for content in (
        b"",
        b"PK",
        b"\x93NUMPY",
        b"PK\x05\x06" + bytes(18),
        bytes(4096),
        b"\x93NUMPY\x01\x00\x03\x00(((" + bytes(9),
    ):
        path.write_bytes(content)
        with pytest.raises((OSError, ValueError, KeyError)):
            read_window(path)
