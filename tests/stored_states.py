"""States of four assets from tests/data/states.json.gz, as services have kept them."""

from __future__ import annotations

import gzip
import json
from functools import cache
from pathlib import Path

from twin.state import State

FILE = Path(__file__).parent / "data" / "states.json.gz"


@cache
def _states() -> dict[str, dict]:
    return json.loads(gzip.decompress(FILE.read_bytes()))


def stored_state(asset: str) -> State:
    """The state of one asset: `unsw-short`, `unsw-rig`, `bench` or `two-encoders`."""
    return State.from_dict(_states()[asset])
