"""Days of a machine's windows: as recordings that are replayed, or written into the service's database at once."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from benchmarks.long_run.service import LONGEST, Service
from benchmarks.long_run.stand_in import CAMPAIGN, StandInState, record_of, template
from service.results.data_folder import DATABASE
from service.results.sql_store import SqlStore
from service.stream.frames import NS, EncoderFrame, SampleFrame
from service.stream.sources.mcap import Recording
from service.stream.sources.mcap_write import RecordingWriter
from service.stream.wire.codec import encode
from service.stream.wire.topics import Channel

LENGTH = 0.2  # of a window [s]: what the service costs, not the twin, is measured
RATE = 1000.0  # [Hz]
SPEED = 10.0  # turns of the pinion a second
EDGES = {"pinion": 1024, "gear": 2048}
RATIO = 19 / 52  # turns of the gear a turn of the pinion


@dataclass(frozen=True, slots=True, kw_only=True)
class Calendar:
    """When windows are measured: at an even spacing, the last one about now."""

    windows: int  # an asset, altogether
    spacing: float = 600.0  # [s]
    end_ns: int

    def start_ns(self, number: int) -> int:
        """Start of a window, Unix time [ns]."""
        return self.end_ns - round((self.windows - number) * self.spacing * NS)

    def revolutions(self, number: int) -> float:
        """Turns of the pinion by a window's start: it runs one minute in ten."""
        return SPEED * 60.0 * number


def replay(service: Service, assets: Sequence[str], calendar: Calendar, numbers: range, folder: Path) -> None:
    """Sends the windows of some numbers over Zenoh, and waits until all are processed."""
    path = folder / "day.mcap"
    with Recording(CAMPAIGN) as recording:
        rig_text = recording.rig_text
    with RecordingWriter(path, rig_text=rig_text, metadata={"asset": assets[0]}) as writer:
        for number in numbers:
            for asset in assets:
                for frame in _frames(asset, calendar, number):
                    writer.write(frame.channel, frame.end_time_ns, encode(frame))
    before = {asset: _known(service, asset) for asset in assets}
    command = [sys.executable, "-m", "service", "replay", str(path), "--connect", service.endpoint, "--speed", "0"]
    subprocess.run(command, check=True, capture_output=True, text=True)
    path.unlink()
    deadline = time.monotonic() + LONGEST
    for asset in assets:
        while _known(service, asset) < before[asset] + len(numbers):
            if time.monotonic() > deadline:
                raise RuntimeError(f"{asset}: {_known(service, asset) - before[asset]} of {len(numbers)} windows")
            time.sleep(0.1)


def fill(data: Path, assets: Sequence[str], calendar: Calendar, numbers: range) -> None:
    """Writes the windows of some numbers into the database of a service that is not running, as it would have."""
    with SqlStore(data / DATABASE) as store:
        report = template()["report"]
        kept = {asset: store.asset(asset) for asset in assets}
        for number in numbers:
            for asset in assets:
                start = calendar.start_ns(number)
                record = record_of(number, calendar.revolutions(number))
                record["start_time"] = datetime.fromtimestamp(start / NS, UTC).isoformat()
                store.commit(
                    asset,
                    start,
                    record=record,
                    state=StandInState(windows=number + 1).to_dict(),
                    report=report,
                    assembly=kept[asset].assembly or {},
                    quality=kept[asset].quality or {},
                    received_ns=start + round(LENGTH * NS),
                    events=(("window", record),),
                )


def size(data: Path) -> int:
    """What a data directory takes [bytes]."""
    return sum(path.stat().st_size for path in data.rglob("*") if path.is_file())


def _known(service: Service, asset: str) -> int:
    rows = {row["asset"]: row["windows"] for row in service.get("/v1/assets")}
    return rows.get(asset, 0)


def _frames(asset: str, calendar: Calendar, number: int) -> list[SampleFrame | EncoderFrame]:
    start, turns = calendar.start_ns(number), calendar.revolutions(number)
    count = round(LENGTH * RATE)
    noise = np.random.default_rng(number).normal(0.0, 10.0, count).astype(np.float32)
    common = {"start_time_ns": start, "sequence": number}
    frames: list[SampleFrame | EncoderFrame] = [
        SampleFrame(channel=Channel(asset, "accel", "y6"), sample_rate=RATE, values=noise, **common),
        SampleFrame(
            channel=Channel(asset, "torque", "pinion"),
            sample_rate=RATE,
            values=np.full(count, 10.0, np.float32),
            **common,
        ),
    ]
    for shaft, per_rev in EDGES.items():
        ratio = 1.0 if shaft == "pinion" else RATIO
        offsets = np.arange(round(SPEED * ratio * LENGTH * per_rev)) / (SPEED * ratio * per_rev) * NS
        frames.append(
            EncoderFrame(
                channel=Channel(asset, "encoder", shaft), edges_per_rev=per_rev,
                first_edge_index=round(turns * ratio * per_rev), edge_offsets_ns=offsets, **common,
            )
        )  # fmt: skip
    return frames
