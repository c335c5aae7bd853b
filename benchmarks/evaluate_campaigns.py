"""Depth, RMS and remaining life of recorded campaigns against their truth.

    python -m benchmarks.evaluate_campaigns [--campaigns DIR] [--only NAME …] [--json OUT]

Runs every recording that has truth/NAME.json beside it through `assess --no-trace`, which knows wear alone
(`benchmarks.evaluate` has the effects), in parallel over processes, and prints a
table per campaign (fused and paper's way side by side) and a summary. Without DIR: the reference campaigns beside the
project (GEAR_TWIN_SHARED sets where) and the bundled recordings.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from benchmarks.scoring import ROOT, Score, read_truth, score, truth_beside
from service.runtime.assess import assess
from twin.options import Options


def recordings_in(folders: Iterable[Path]) -> list[Path]:
    """Recordings with their truth beside them."""
    return [path for folder in folders for path in sorted(folder.glob("*.mcap")) if truth_beside(path)]


def evaluate(path: Path) -> tuple[Score, float]:
    """One recording's score, and the processor time that `assess` took [s]."""
    start = time.process_time()
    answer = assess(path, options=Options(trace=False))
    used = time.process_time() - start
    truth = truth_beside(path)
    assert truth is not None
    used_windows = [w for w in answer["windows"] if w["quality"] != "refused"]
    return score(path.stem, used_windows, answer["rul"], read_truth(truth)), used


def number(value: float | None, form: str = "7.1f") -> str:
    width = int(form.split(".")[0].lstrip("+"))
    return f"{'–':>{width}}" if value is None or value != value else f"{value:{form}}"


def window_table(result: Score) -> list[str]:
    """One line a measurement window."""
    out = [
        f"{result.name}: {', '.join(result.effects) or 'no effect'}",
        "     revs    true   fused  5–95 % band      error      rms   error  RMS m/s²   before    after",
        "               µm      µm           µm          %       µm       %                  %        %",
    ]
    for r in result.rows:
        error = r.depth_error if r.true >= 1 else None
        paper = r.paper_error if r.true >= 1 else None
        out.append(
            f"{r.revolutions:9.0f}{number(r.true, '8.2f')}{number(r.depth, '8.2f')}"
            f"{number(r.low, '7.1f')} …{number(r.high, '6.1f')}{number(error, '+9.2f')}"
            f"{number(r.paper, '9.2f')}{number(paper, '+8.1f')}{number(r.rms, '10.2f')}"
            f"{number(r.error_before, '+9.1f')}{number(r.error_after, '+9.1f')}{'  updated' if r.updated else ''}"
        )
    notes = dict.fromkeys(f"{r.revolutions:.0f}: {note}" for r in result.rows for note in r.notes)
    return out + [f"    at {note}" for note in notes]


def summary_table(results: Sequence[tuple[Score, float]]) -> list[str]:
    """One line a campaign: worst errors from 20 µm on."""
    out = [
        "                      worst depth error %         RMS within   band      life left, revolutions     CPU",
        "                 fused ≤150   >150    rms ≤150   >150   5 %   holds        true      twin  error %     s",
    ]
    for s, used in results:
        out.append(
            f"{s.name:16s}{number(s.worst(), '+11.2f')}{number(s.worst(deep=True), '+7.2f')}"
            f"{number(s.worst('paper_error'), '+12.1f')}{number(s.worst('paper_error', deep=True), '+7.1f')}"
            f"{100 * s.within(5.0):5.0f} %{number(100 * s.coverage, '6.0f')} %"
            f"{number(s.life_true, '12.0f')}{number(s.life, '10.0f')}{number(s.life_error, '+9.1f')}{used:6.1f}"
        )
    return out


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.evaluate_campaigns", description=__doc__)
    parser.add_argument("--campaigns", type=Path, metavar="DIR", help="folder of recordings with truth/ in it")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="names of recordings, without .mcap")
    parser.add_argument("--json", type=Path, metavar="OUT", help="write all figures to this file")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    given = parser.parse_args(arguments)
    beside = Path(os.environ.get("GEAR_TWIN_SHARED", ROOT.parent / "shared")) / "campaigns"
    folders = [given.campaigns] if given.campaigns else [beside, ROOT / "recordings"]
    paths = [p for p in recordings_in(folders) if not given.only or p.stem in given.only]
    if not paths:
        print(f"no recording with truth/NAME.json beside it in {', '.join(map(str, folders))}", file=sys.stderr)
        return 2
    with ProcessPoolExecutor(min(given.processes, len(paths))) as pool:
        results = list(pool.map(evaluate, paths))
    for result, _ in results:
        print("\n".join(window_table(result)), end="\n\n")
    print("\n".join(summary_table(results)))
    if given.json:
        data = [{**result.to_dict(), "cpu_s": used} for result, used in results]
        given.json.write_text(json.dumps(data, ensure_ascii=False, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
