"""Are the bands right? Depth and remaining life as stated, against the truth, by class of machine.

    python -m benchmarks.reliability histories [--number N] [--picture]
    python -m benchmarks.reliability campaigns [--folder DIR] [--set judge|fresh|shared …] [--only TEXT …] [--each N]
                                               [--spreads N] [--processes N]

`campaigns` reads recordings with truth, traced, and takes the depth of every worn window, and the life to two depths:
that which the machine has at twice the revolutions (half-life), and at 1/0.9 of them (near the end). `histories` draws
wear histories of seven classes (benchmarks/wear_histories.py) and feeds their depths to the functions that the twin
uses: the prior probabilities of wear_forecast.py were tuned on even seeds, and the odd seeds are judged. A distribution
is calibrated where the truth lies below its quantiles as often as they say; shares are given with their binomial error
(95 %), as if all were independent, which windows of one campaign are not.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from benchmarks.evaluate import campaigns
from benchmarks.reliability_campaigns import of_campaign
from benchmarks.reliability_scores import NOMINAL, Scored, table
from benchmarks.trace_campaigns.generate import FOLDER
from benchmarks.wear_histories import CLASSES, drawn, followed

PICTURES = Path(__file__).parents[1] / "docs" / "pictures"
COLOURS = ("#1f4e9c", "#d9730d", "#2a8c55", "#777777", "#8a3ea8", "#b8860b", "#c0392b")


def history_scores(number: int, seeds: slice) -> Iterator[Scored]:
    """Scores of drawn histories of all classes; seeds 0 to 2·number, of which some are taken."""
    for kind in CLASSES:
        for seed in range(2 * number)[seeds]:
            yield from followed(drawn(kind, seed))


def picture(rows: Sequence[Scored], path: Path) -> None:
    """Reliability diagrams, one for each of what is stated, with a line for each class."""
    whats = list(dict.fromkeys(r.what for r in rows))
    kinds = list(dict.fromkeys(r.kind for r in rows))
    figure = Figure(figsize=(4.4 * len(whats), 4.4), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    for i, what in enumerate(whats):
        axes = figure.add_subplot(1, len(whats), i + 1)
        axes.plot([0, 100], [0, 100], color="black", linewidth=0.8)
        for kind, colour in zip(kinds, COLOURS, strict=False):
            u = np.array([r.quantile for r in rows if r.what == what and r.kind == kind])
            if not u.size:
                continue
            shares = np.array([np.mean(u <= p) for p in NOMINAL])
            error = 1.96 * np.sqrt(np.maximum(shares * (1 - shares), 0.25 / u.size) / u.size)
            axes.errorbar(
                100 * np.array(NOMINAL), 100 * shares, 100 * error, color=colour, marker="o", markersize=3,
                linewidth=1, capsize=2, label=f"{kind} ({u.size})",
            )  # fmt: skip
        axes.set(title=what, xlabel="stated quantile [%]", ylabel="truth below it [%]", xlim=(0, 100), ylim=(0, 100))
        axes.legend(fontsize=7, loc="upper left", frameon=False)
        axes.grid(color="#dddddd", linewidth=0.6)
    figure.savefig(path)


def histories(given: argparse.Namespace) -> int:
    judged = list(history_scores(given.number, slice(1, None, 2)))
    tuned = list(history_scores(given.number, slice(0, None, 2))) if given.tuned else []
    for title, rows in (("even seeds (tuned on)", tuned), ("odd seeds (judged by)", judged)):
        if rows:
            print(f"life of drawn histories, {title}")
            print("\n".join(table(rows, lambda r: f"{r.kind}, {r.what}")), end="\n\n")
    if given.picture:
        picture(judged, PICTURES / "reliability-histories.png")
    return 0


def measured(given: argparse.Namespace) -> int:
    found = list(campaigns(given.set, given.folder, given.processes, given.only, "own", given.spreads))
    paths = found[:: given.each]
    if not paths:
        print("no campaign of this name", file=sys.stderr)
        return 2
    with ProcessPoolExecutor(min(given.processes, len(paths))) as pool:
        rows = [r for of_one in pool.map(of_campaign, paths) for r in of_one]
    established = [r for r in rows if not r.preliminary]
    print(f"established figures of {len({r.campaign for r in rows})} campaigns")
    print("\n".join(table(established, lambda r: f"{r.what}, {r.group}, {r.kind}")))
    print("\npreliminary figures")
    print("\n".join(table([r for r in rows if r.preliminary], lambda r: f"{r.what}, {r.group}")))
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.reliability", description=__doc__)
    commands = parser.add_subparsers(required=True)
    drawn_ones = commands.add_parser("histories")
    drawn_ones.add_argument("--number", type=int, default=400, metavar="N", help="judged, of each class")
    drawn_ones.add_argument("--tuned", action="store_true", help="those tuned on as well")
    drawn_ones.add_argument("--picture", action="store_true", help="draw the reliability diagram into docs/pictures")
    drawn_ones.set_defaults(run=histories)
    recorded = commands.add_parser("campaigns")
    recorded.add_argument(
        "--set", nargs="+", choices=["judge", "fresh", "shared"], default=["judge", "fresh", "shared"]
    )
    recorded.add_argument("--folder", type=Path, default=FOLDER, help="where recordings are kept")
    recorded.add_argument("--only", nargs="+", metavar="TEXT", default=[], help="campaigns with this in their name")
    recorded.add_argument("--each", type=int, default=1, metavar="N", help="only every N-th campaign")
    recorded.add_argument("--spreads", type=float, default=1.0, help="times the usual spreads of the machines")
    recorded.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    recorded.set_defaults(run=measured)
    given = parser.parse_args(arguments)
    return int(given.run(given))


if __name__ == "__main__":
    sys.exit(main())
