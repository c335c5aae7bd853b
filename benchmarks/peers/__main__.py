"""gear-twin and its peers on the same problems, in one run.

    python -m benchmarks.peers [--only NAME …] [--rounds N] [--folder DIR] [--json OUT]

gear-twin writes each problem into a file; the peer's program reads it, measures and answers. Each peer has an
environment of its own (benchmarks/peers/environments.py), which the first run makes; where a peer cannot be had, its
rows say why. All times are processor times on one thread, the shortest of many calls after one to warm up, over several
rounds: on a machine that does other things too, slow stretches last for seconds.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from benchmarks.peers import features, life, reading, stiffness, transient
from benchmarks.peers.asking import Ask, ask_in
from benchmarks.peers.environments import default_folder
from benchmarks.peers.rows import Row, quickest, table

COMPARISONS: Mapping[str, Callable[[Ask, Path], list[Row]]] = {
    "stiffness": stiffness.rows,
    "transient": transient.rows,
    "life": life.rows,
    "features": features.rows,
    "reading": reading.rows,
}


def compared(names: Sequence[str], ask: Ask, rounds: int = 1) -> list[Row]:
    """The rows of some comparisons, with the shortest times of several rounds of all of them."""
    with tempfile.TemporaryDirectory(prefix="gear-twin-peers-") as made:
        return quickest([[row for name in names for row in COMPARISONS[name](ask, Path(made))] for _ in range(rounds)])


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.peers", description="gear-twin and its peers.")
    parser.add_argument("--only", nargs="+", choices=list(COMPARISONS), metavar="NAME", help=", ".join(COMPARISONS))
    parser.add_argument("--folder", type=Path, default=default_folder(), help="where the peers' environments are kept")
    parser.add_argument("--json", type=Path, metavar="OUT", help="writes the rows as JSON")
    parser.add_argument(
        "--rounds", type=int, default=3, help="of all comparisons; the shortest times count (default 3)"
    )
    given = parser.parse_args()
    rows = compared(given.only or list(COMPARISONS), ask_in(given.folder), given.rounds)
    print(table(rows))
    if given.json:
        given.json.write_text(json.dumps([row.plain() for row in rows], indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
