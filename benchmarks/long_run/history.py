"""Days of a machine's windows: as recordings that are replayed, or written into the service's database at once."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from sqlalchemy import Connection, delete, insert, select, update

from benchmarks.long_run.service import LONGEST, Service
from benchmarks.long_run.stand_in import CAMPAIGN, StandInState, record_of, template
from service.json_text import JsonText
from service.results.data_folder import DATABASE
from service.results.retention import Retention, delete_old
from service.results.schema import ASSETS, EVENTS, EXTREMES, WINDOWS
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
LOOK = 0.5  # between two looks whether all windows have been processed [s]
AT_ONCE = 144  # windows of an asset that one transaction writes


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
    before = service.windows()
    command = [sys.executable, "-m", "service", "replay", str(path), "--connect", service.endpoint, "--speed", "0"]
    subprocess.run(command, check=True, capture_output=True, text=True)
    path.unlink()
    deadline = time.monotonic() + LONGEST
    while missing := _missing(service.windows(), before, assets, len(numbers)):
        if time.monotonic() > deadline:
            raise RuntimeError(f"{missing} of {len(numbers) * len(assets)} windows have not been processed")
        time.sleep(LOOK)


def fill(data: Path, assets: Sequence[str], calendar: Calendar, numbers: range, retention: Retention) -> None:
    """Writes the windows of some numbers into the database of a service that is not running, as it would have.

    The first asset's are committed as the service commits them; the rows of each day are then those of the others too.
    What is older than the retention keeps is deleted day by day.
    """
    with SqlStore(data / DATABASE) as store:
        report = JsonText(json.dumps(template()["report"]))
        for begun in range(numbers.start, numbers.stop, AT_ONCE):
            some = range(begun, min(begun + AT_ONCE, numbers.stop))
            with store.database.transaction() as db:
                for number in some:
                    start = calendar.start_ns(number)
                    record = record_of(number, calendar.revolutions(number))
                    record["start_time"] = datetime.fromtimestamp(start / NS, UTC).isoformat()
                    store.commit(
                        assets[0],
                        start,
                        record=record,
                        state=StandInState(windows=number + 1).to_dict(),
                        report=report,
                        received_ns=start + round(LENGTH * NS),
                        events=(("window", record),),
                    )
                if len(assets) > 1:
                    _copy(db, assets[0], calendar.start_ns(some[0]), calendar.start_ns(some[-1]))
            for asset in assets:
                while delete_old(store.database, asset, retention):
                    pass
        with store.database.transaction() as db:
            _copy_extremes(db, assets[0])


def _copy(db: Connection, of: str, first_ns: int, last_ns: int) -> None:
    """Gives all other assets the windows of one, with their events, in the order of time."""
    others = ASSETS.alias("others")
    for table in (WINDOWS, EVENTS):
        columns = [column for column in table.c if column.name not in ("asset", "id")]
        rows = (
            select(others.c.asset, *columns)
            .select_from(table.join(others, others.c.asset != of))
            .where(table.c.asset == of, table.c.start_ns.between(first_ns, last_ns))
            .order_by(table.c.start_ns, others.c.asset)
        )
        db.execute(insert(table).from_select(["asset", *(column.name for column in columns)], rows))
    names = ("state", "report", "windows", "updates", "epoch", "received_ns", "seal")
    row = db.execute(select(*(ASSETS.c[name] for name in names)).where(ASSETS.c.asset == of)).one()
    db.execute(update(ASSETS).where(ASSETS.c.asset != of).values(row._asdict()))


def _copy_extremes(db: Connection, of: str) -> None:
    """Gives all other assets the extremes of one's history."""
    db.execute(delete(EXTREMES).where(EXTREMES.c.asset != of))
    columns = [column for column in EXTREMES.c if column.name != "asset"]
    rows = select(ASSETS.c.asset, *columns).join(ASSETS, ASSETS.c.asset != of).where(EXTREMES.c.asset == of)
    db.execute(insert(EXTREMES).from_select(["asset", *(column.name for column in columns)], rows))


def size(data: Path) -> int:
    """What a data directory takes [bytes]."""
    return sum(path.stat().st_size for path in data.rglob("*") if path.is_file())


def _missing(now: dict[str, int], before: dict[str, int], assets: Sequence[str], each: int) -> int:
    """How many windows have not been processed, where each asset was sent so many."""
    return sum(max(0, before.get(asset, 0) + each - now.get(asset, 0)) for asset in assets)


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
