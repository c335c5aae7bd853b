"""TDMS files of LabVIEW and FlexLogger, by nptdms."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from service.files.dates import stated_in
from service.files.readers.table import Column, Table, unique_names

UNITS = ("unit_string", "NI_UnitDescription", "Unit", "unit")


def read_tdms(path: Path) -> Table:
    """The channels of all groups, with the rate, start and unit that their waveform properties state."""
    from nptdms import TdmsFile

    file = TdmsFile.read(path)
    channels = [(group.name, channel) for group in file.groups() for channel in group.channels()]
    names = unique_names([(group, channel.name) for group, channel in channels])
    columns, others, starts = [], [], []
    for name, (_, channel) in zip(names, channels, strict=True):
        values = np.asarray(channel[:])
        if values.dtype.kind not in "fiub" or values.size < 2:
            others.append(name)
            continue
        step = float(channel.properties.get("wf_increment", 0.0))
        unit = next((str(channel.properties[u]) for u in UNITS if channel.properties.get(u)), "")
        columns.append(
            Column(
                name=name,
                values=values,
                unit=unit,
                rate=1 / step if step > 0 else None,
                start=float(channel.properties.get("wf_start_offset", 0.0)),
            )
        )
        starts.append(_moment(channel.properties.get("wf_start_time")))
    known = [s for s in starts if s is not None]
    started = min(known) if known else stated_in(_with_utc(file))
    return Table(format="TDMS", columns=tuple(columns), other_names=tuple(others), started=started)


def _with_utc(file: Any) -> dict[str, Any]:
    """The properties of file and groups; their times are UTC, as all times of this format."""
    properties = {k: v for holder in (*file.groups(), file) for k, v in holder.properties.items()}
    return {k: f"{v}Z" if isinstance(v, np.datetime64) else v for k, v in properties.items()}


def _moment(value: Any) -> datetime | None:
    """The start of a waveform; None where it is not stated, or the zero of LabVIEW's clock."""
    if value is None:
        return None
    moment = datetime.fromtimestamp(np.datetime64(value, "us").astype(int) / 1e6, UTC)
    return moment if moment.timestamp() > 0 else None
