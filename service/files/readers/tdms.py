"""TDMS files of LabVIEW and FlexLogger, by nptdms."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from service.files.readers.contents import Contents
from service.files.readers.stored import read_in_pieces
from service.files.readers.table import Table, unique_names


def read_tdms(path: Path) -> Table:
    """The channels of all groups, with the rate, start and unit that their waveform properties state."""
    from nptdms import TdmsFile

    with TdmsFile.open(path) as file:
        channels = [(group.name, channel) for group in file.groups() for channel in group.channels()]
        names = unique_names([(group, channel.name) for group, channel in channels])
        found = Contents(format="TDMS", entries=_with_utc(file))
        for name, (_, channel) in zip(names, channels, strict=True):
            stated = {k: v for k, v in channel.properties.items() if not k.startswith("NI_Scale")}  # nptdms applies it
            offset = float(stated.pop("wf_start_offset", 0.0))
            moment = _moment(stated.get("wf_start_time"))
            started = None if moment is None else moment + timedelta(seconds=offset)
            start = offset if started is None else 0.0
            found.add(name, partial(read_in_pieces, channel, len(channel)), stated, start=start, started=started)
        return found.table()


def _with_utc(file: Any) -> list[tuple[str, Any]]:
    """The properties of groups and file; their times are UTC, as all times of this format."""
    properties = [item for holder in (*file.groups(), file) for item in holder.properties.items()]
    return [(k, f"{v}Z" if isinstance(v, np.datetime64) else v) for k, v in properties]


def _moment(value: Any) -> datetime | None:
    """The start of a waveform; None where it is not stated, or the zero of LabVIEW's clock."""
    if value is None:
        return None
    moment = datetime.fromtimestamp(np.datetime64(value, "us").astype(int) / 1e6, UTC)
    return moment if moment.timestamp() > 0 else None
