"""Makes the recordings of a table and keeps them: NAME-DIGEST.mcap, and the truth in truth/ beside.

The digest covers the spec, the rig file and the generator's source, so what is kept is never stale.
"""

from __future__ import annotations

import hashlib
import json
import os
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from itertools import repeat
from pathlib import Path
from typing import Any

from benchmarks.trace_campaigns.table import Row, spec_of
from recordings.generator import SimulationError, simulate, write

ROOT = Path(__file__).resolve().parents[2]
RIG = ROOT / "recordings" / "rigs" / "unsw.toml"
FOLDER = ROOT / ".gear-twin" / "campaigns"


@cache
def _generator_digest() -> bytes:
    sources = [RIG, *sorted((ROOT / "recordings" / "generator").glob("*.py"))]
    return hashlib.sha256(b"".join(path.read_bytes() for path in sources)).digest()


def digest_of(spec: Mapping[str, Any]) -> str:
    """Of all that a recording depends on."""
    text = json.dumps(spec, sort_keys=True).encode()
    return hashlib.sha256(text + _generator_digest()).hexdigest()[:10]


def recording_of(row: Row, folder: Path, two_conditions: bool | None = None, spreads: float = 1.0) -> Path:
    """Where a row's recording is kept."""
    return folder / f"{row.name}-{digest_of(spec_of(row, two_conditions=two_conditions, spreads=spreads))}.mcap"


def make(row: Row, path: Path, two_conditions: bool | None = None, spreads: float = 1.0) -> Path:
    """The row's recording at `path`, truth/NAME.json beside it; made unless it is there already."""
    truth = path.parent / "truth" / f"{path.stem}.json"
    if path.is_file() and truth.is_file():
        return path
    truth.parent.mkdir(parents=True, exist_ok=True)
    rig = RIG.read_text(encoding="utf-8")
    campaign = simulate(spec_of(row, two_conditions=two_conditions, spreads=spreads), tomllib.loads(rig))
    campaign.truth |= {
        "id": row.name,
        "kind": row.kind,
        "levels": [put.level for put in row.effects],
        "expected_names": list(row.expected),
        "tolerated_names": list(row.tolerated),
    }
    part = path.with_suffix(f".{os.getpid()}.part")
    write(campaign, part, truth, rig)
    part.replace(path)
    return path


def make_all(
    rows: Iterable[Row],
    folder: Path,
    processes: int = 1,
    two_conditions: bool | None = None,
    spreads: float = 1.0,
) -> Iterator[tuple[Row, Path | None, str]]:
    """All rows' recordings, in order, over several processes; None, and why, for one that could not be made."""
    rows = list(rows)
    with ProcessPoolExecutor(max(1, min(processes, len(rows)))) as pool:
        work = pool.map(_made, rows, repeat(folder), repeat(two_conditions), repeat(spreads))
        for row, (path, why) in zip(rows, work, strict=True):
            yield row, path, why


def _made(row: Row, folder: Path, two_conditions: bool | None, spreads: float) -> tuple[Path | None, str]:
    try:
        return make(row, recording_of(row, folder, two_conditions, spreads), two_conditions, spreads), ""
    except SimulationError as why:
        return None, str(why)
