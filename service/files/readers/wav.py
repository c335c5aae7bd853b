"""WAV files, by scipy: integers of 8, 16, 24, 32 bits as shares of full scale, floating-point numbers as they are.

A recorder that was interrupted leaves sizes of 0 or of the largest number in the header, or half a frame at the end:
the whole frames that are there are read.
"""

from __future__ import annotations

import io
import struct
import warnings
from pathlib import Path

import numpy as np
from scipy.io import wavfile

from service.files.readers.table import Column, Table


def read_wav(path: Path) -> Table:
    """The tracks of the file as `channel 1`, `channel 2`, …"""
    mended, notes = _mended(path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", wavfile.WavFileWarning)  # chunks of measuring devices that scipy does not know
        rate, data = wavfile.read(mended or path)
    if data.dtype.kind in "iu":
        notes = (*notes, "values are shares of full scale, −1 to 1: the file states no unit")
        if data.dtype.kind == "u":
            data = (data.astype(float) - 128) / 128
        else:
            data = data / float(2 ** (8 * data.dtype.itemsize - 1))  # scipy shifts 24 bits to the top of 32
    tracks = np.atleast_2d(data.T)
    columns = (Column(name=f"channel {i}", values=track, rate=float(rate)) for i, track in enumerate(tracks, start=1))
    return Table(format="WAV", columns=tuple(columns), rate=float(rate), notes=notes)


def _mended(path: Path) -> tuple[io.BytesIO | None, tuple[str, ...]]:
    """The file with the true size of its samples, and a note, where its header is wrong; None where it is right."""
    whole = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(12)
        if head[:4] not in (b"RIFF", b"RIFX") or head[8:12] != b"WAVE":
            return None, ()
        order = "<" if head[:4] == b"RIFF" else ">"
        form, frame = b"", 0
        while len(mark := file.read(8)) == 8:
            size = struct.unpack(f"{order}I", mark[4:])[0]
            if mark[:4] == b"data":
                break
            chunk = file.read(size + size % 2)
            if mark[:4] == b"fmt " and len(chunk) >= 16:
                form, frame = chunk, struct.unpack(f"{order}H", chunk[12:14])[0]
        else:
            raise ValueError("its header ends before any samples")
        if not frame:
            raise ValueError("its header does not say how its samples are stored")
        there = whole - file.tell()
        if 0 < size <= there and size % frame == 0:
            return None, ()
        count = (there if size == 0 or size > there else size) // frame
        if count < 2:
            raise ValueError(f"it holds {count} samples")
        samples = file.read(count * frame)
    parts = b"fmt " + struct.pack(f"{order}I", len(form)) + form + b"data" + struct.pack(f"{order}I", len(samples))
    riff = head[:4] + struct.pack(f"{order}I", min(4 + len(parts) + len(samples), 2**32 - 1)) + b"WAVE"
    note = (
        f"the header states {size} bytes of samples where {there} are there, as an interrupted recorder leaves it: the "
        f"{count} whole samples of each channel are read"
    )
    return io.BytesIO(riff + parts + samples), (note,)
