"""WAV files, by scipy: integers of 8, 16, 24, 32 bits as shares of full scale, floating-point numbers as they are."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
from scipy.io import wavfile

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
    return Table(format="WAV", columns=tuple(columns), rate=float(rate), notes=notes)
