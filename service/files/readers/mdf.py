"""MDF files of vehicle measurement (versions 3 and 4), by asammdf."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from service.files.readers.contents import Contents
from service.files.readers.table import Table, unique_names


def read_mdf(path: Path) -> Table:
    """The channels of all groups, with the times of their own master channel; NaN where a sample is marked invalid."""
    from asammdf import MDF

    with MDF(path) as file:
        signals = list(file.iter_channels(skip_master=True))
        groups = [str(s.group_index) for s in signals]
        started = file.header.start_time
    names = unique_names([(f"group {g}", s.name) for g, s in zip(groups, signals, strict=True)])
    found = Contents(format="MDF")
    for name, signal in zip(names, signals, strict=True):
        times = np.asarray(signal.timestamps, dtype=float)
        found.add(name, partial(_valid, signal), unit=signal.unit or "", times=times)
    return found.table(started)


def _valid(signal: Any) -> np.ndarray:
    values, invalid = np.asarray(signal.samples), signal.invalidation_bits
    if invalid is None or values.dtype.kind not in "fiub" or not np.any(invalid):
        return values
    return np.where(np.asarray(invalid, dtype=bool), np.nan, values)
