"""MDF files of vehicle measurement (versions 3 and 4), by asammdf."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from service.files.readers.table import Column, Table, unique_names


def read_mdf(path: Path) -> Table:
    """The channels of all groups, with the times of their own master channel."""
    from asammdf import MDF

    with MDF(path) as file:
        signals = list(file.iter_channels(skip_master=True))
        groups = [str(s.group_index) for s in signals]
        started = file.header.start_time
    names = unique_names([(f"group {g}", s.name) for g, s in zip(groups, signals, strict=True)])
    columns, others = [], []
    for name, signal in zip(names, signals, strict=True):
        values = np.asarray(signal.samples)
        if values.dtype.kind not in "fiub" or values.ndim != 1 or values.size < 2:
            others.append(name)
            continue
        times = np.asarray(signal.timestamps, dtype=float)
        columns.append(Column(name=name, values=values, unit=signal.unit or "", times=times))
    return Table(format="MDF", columns=tuple(columns), other_names=tuple(others), started=started)
