"""States of version 1 from tests/data/store_v1.sqlite.gz, by asset."""

from __future__ import annotations

import gzip
import json
import sqlite3
from functools import cache
from pathlib import Path

FILE = Path(__file__).parent / "data" / "store_v1.sqlite.gz"


@cache
def _states() -> dict[str, str]:
    data = bytearray(gzip.decompress(FILE.read_bytes()))
    data[18:20] = b"\x01\x01"  # a database in memory has no write-ahead log
    db = sqlite3.connect(":memory:")
    db.deserialize(bytes(data))
    with_state = db.execute("SELECT asset, state FROM assets").fetchall()
    db.close()
    return dict(with_state)


def state_v1(asset: str) -> dict:
    """The state of one asset as version 1 kept it: `unsw-short`, `unsw-rig`, `bench` or `two-encoders`."""
    return json.loads(_states()[asset])
