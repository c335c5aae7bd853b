"""Makes the campaigns of a table and says where they are.

python -m benchmarks.trace_campaigns tune|judge|wide|clean [--draw N] [--folder DIR] [--processes N]
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

from benchmarks.trace_campaigns import judge, tune, wide
from benchmarks.trace_campaigns.generate import FOLDER, make_all


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.trace_campaigns", description=__doc__)
    parser.add_argument("table", choices=["tune", "judge", "wide", "clean"])
    parser.add_argument("--draw", type=int, default=1, metavar="N", help="which draw of wide or clean")
    parser.add_argument("--folder", type=Path, default=FOLDER, help="where recordings are kept")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    given = parser.parse_args()
    made = {"tune": lambda draw: tune.ROWS, "judge": lambda draw: judge.ROWS, "wide": wide.rows, "clean": wide.clean}
    rows = made[given.table](given.draw)
    spreads = wide.SPREADS_TWICE if given.table == "wide" else 1.0
    failed = 0
    for row, path, why in make_all(rows, given.folder, given.processes, spreads=spreads):
        print(path if path is not None else f"{row.name} could not be made: {why}", flush=True)
        failed += path is None
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
