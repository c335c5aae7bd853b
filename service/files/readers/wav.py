"""WAV files, by scipy: integers of 8, 16, 24, 32 bits as shares of full scale, floating-point numbers as they are."""

from __future__ import annotations

import warnings
from datetime import datetime
from pathlib import Path

import numpy as np
from scipy.io import wavfile

from service.files.dates import stated_in
from service.files.readers.table import Column, Table


def read_wav(path: Path) -> Table:
    """The tracks of the file as `channel 1`, `channel 2`, …"""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", wavfile.WavFileWarning)  # chunks of measuring devices that scipy does not know
        rate, data = wavfile.read(path)
    notes: tuple[str, ...] = ()
    if data.dtype.kind in "iu":
        notes = ("values are shares of full scale, −1 to 1: the file states no unit",)
        if data.dtype.kind == "u":
            data = (data.astype(float) - 128) / 128
        else:
            data = data / float(2 ** (8 * data.dtype.itemsize - 1))  # scipy shifts 24 bits to the top of 32
    tracks = np.atleast_2d(data.T)
    columns = (Column(name=f"channel {i}", values=track, rate=float(rate)) for i, track in enumerate(tracks, start=1))
    return Table(format="WAV", columns=tuple(columns), rate=float(rate), started=_started(path), notes=notes)


def _started(path: Path) -> datetime | None:
    """When the recording began, by the chunk of broadcast wave files (`bext`) or the entry `ICRD`."""
    found: dict[bytes, bytes] = {}
    with path.open("rb") as file:
        file.seek(12)
        while len(head := file.read(8)) == 8:
            size = int.from_bytes(head[4:], "little")
            if head[:4] in (b"bext", b"LIST"):
                found[head[:4]] = file.read(min(size, 2**16))
                size -= len(found[head[:4]])
            file.seek(size + size % 2, 1)
    info = found.get(b"LIST", b"")
    at = info.find(b"ICRD")
    date = b"" if at < 0 else info[at + 8 : at + 8 + int.from_bytes(info[at + 4 : at + 8], "little")]
    day, hour = found.get(b"bext", b"")[320:330], found.get(b"bext", b"")[330:338]
    return stated_in([("date", day + b" " + hour), ("date", date.rstrip(b"\0"))])
