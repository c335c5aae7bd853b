"""`gear-twin serve` with the fake twin of the service's tests, in worker processes too.

CHAOS_CLOCK names a file with how far the clock of this host is off [s]; it is read again at each look at the clock.
"""

from __future__ import annotations

import os
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

if "CHAOS_CLOCK" in os.environ:
    _file, _true_ns = Path(os.environ["CHAOS_CLOCK"]), time.time_ns

    def _time_ns() -> int:
        return _true_ns() + round(float(_file.read_text() or 0) * 1e9)

    time.time_ns, time.time = _time_ns, lambda: _time_ns() / 1e9

sys.path.insert(0, str(Path(__file__).parents[1] / "service"))

from fake_twin import TWIN

from service.__main__ import leave
from service.runtime.serve import run
from service.runtime.twin_port import Twin
from service.settings import Settings


def make(options: Any = None) -> Twin:
    """The fake twin, in any process."""
    return replace(TWIN, make=make, options=options)


if __name__ == "__main__":
    from tests.chaos.fake_service import make as make_twin  # by a name that other processes can import

    leave(run(Settings(), twin=make_twin()))
