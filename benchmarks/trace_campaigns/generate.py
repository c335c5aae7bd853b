"""Makes the recordings of a table and keeps them: NAME-DIGEST.mcap, and the truth in truth/ beside.

The digest covers the spec, the rig file and the generator's edition (`recordings.generator.EDITION`, and that of the
spec's effects), which a test holds to what the generator gives: what is kept stays of use while the generator grows.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from itertools import repeat
from pathlib import Path
from typing import Any

from benchmarks.trace_campaigns.benches import BENCHES
from benchmarks.trace_campaigns.table import Row, spec_of
from recordings.generator import EDITION, SimulationError, simulate, write
from recordings.generator.effects import EFFECTS

ROOT = Path(__file__).resolve().parents[2]
RIG = BENCHES["unsw"].rig
FOLDER = ROOT / ".gear-twin" / "campaigns"


@cache
def _edition(rig: Path) -> bytes:
    return hashlib.sha256(rig.read_bytes() + f"edition {EDITION}".encode()).digest()


def digest_of(spec: Mapping[str, Any], rig: Path = RIG) -> str:
    """Of all that a recording depends on; a new effect or key of the generator changes nothing for other specs."""
    editions = {e["name"]: EFFECTS[e["name"]].edition for e in spec.get("effects", ())}
    changed = {name: edition for name, edition in editions.items() if edition != 1}
    text = json.dumps([spec, changed] if changed else spec, sort_keys=True).encode()
    return hashlib.sha256(text + _edition(rig)).hexdigest()[:10]


def recording_of(row: Row, folder: Path, two_conditions: bool | None = None, spreads: float = 1.0) -> Path:
    """Where a row's recording is kept."""
    digest = digest_of(spec_of(row, two_conditions=two_conditions, spreads=spreads), BENCHES[row.bench].rig)
    return folder / f"{row.name}-{digest}.mcap"


def make(row: Row, path: Path, two_conditions: bool | None = None, spreads: float = 1.0) -> Path:
    """The row's recording at `path`, truth/NAME.json beside it; made unless it is there already."""
    truth = path.parent / "truth" / f"{path.stem}.json"
    if path.is_file() and truth.is_file():
        return path
    truth.parent.mkdir(parents=True, exist_ok=True)
    rig = BENCHES[row.bench].rig.read_text(encoding="utf-8")
    campaign = simulate(spec_of(row, two_conditions=two_conditions, spreads=spreads), tomllib.loads(rig))
    campaign.truth |= {
        "id": row.name,
        "kind": row.kind,
        "bench": row.bench,
        "levels": [put.level for put in row.effects],
        "expected_names": list(row.expected),
        "tolerated_names": list(row.tolerated),
    } | {key: value for key, value in (("place", row.place), ("group", row.group)) if value}
    part = path.with_suffix(f".{os.getpid()}.part")
    write(campaign, part, truth, with_limit(rig, campaign.truth.get("end_of_life")))
    part.replace(path)
    return path


def with_limit(rig: str, end_of_life: Mapping[str, Any] | None) -> str:
    """A rig file's text with the end-of-life limit that a campaign was given."""
    if end_of_life is None:
        return rig
    head, table, tail = rig.partition("[end_of_life]")
    limit = f"max_depth = {1e-6 * end_of_life['limit_um']:.6g}"
    return head + table + re.sub(r"max_depth = [0-9.e+-]+", limit, tail, count=1)


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
