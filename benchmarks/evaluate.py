"""Recordings with undeclared effects through `assess`: what was named, and the errors before and after.

    python -m benchmarks.evaluate [--set judge|fresh|tune|wide|clean|shared|all …] [--only TEXT …] [--json OUT]
                                  [--channels all|accel+encoders|accel] [--conditions own|one|two] [--folder DIR]
                                  [--spreads N] [--draw N] [--processes N] [--limits FILE …]

The campaigns of the tables `judge`, `fresh` and `tune` are made by the project's own generator where they are not kept
yet; `shared` are the reference campaigns beside the project (GEAR_TWIN_SHARED sets where). With `--spreads 2` the
machines that are made are twice as far from the rig file as the twin takes them to be, in structure, teeth and discs:
the generator's usual spreads are the twin's default tolerances. `wide` and `clean` are campaigns on three machines
(`trace_campaigns.wide`), `wide` with twice the spreads unless `--spreads` says otherwise. `--draw 2` draws the sets
fresh, wide and clean again. `--limits` takes what `gear-twin detectability --json FILE` writes for each machine, and
counts single effects above the printed limits by themselves. Prints one line a campaign, the parameters against the
truth, tables of false alarms, errors of added effects and bands, and a summary with the aims. The status is 0 whenever
it ran.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from benchmarks.channels import SETS, only
from benchmarks.evaluate_claims import claim_tables
from benchmarks.evaluate_tables import campaign_table, figure_table, size_table, summary
from benchmarks.printed_limits import Limits, above_limit, read_limits
from benchmarks.realised import with_draws
from benchmarks.scoring import ROOT, read_truth, truth_beside
from benchmarks.trace_campaigns import judge, tune, wide
from benchmarks.trace_campaigns.generate import FOLDER, make_all
from benchmarks.trace_campaigns.table import Row
from benchmarks.tracing_score import Traced, no_answer, score_tracing
from service.errors import InputError
from service.runtime.assess import assess
from service.runtime.twin_port import gear_twin
from twin.options import Options

SETS_MADE = ("judge", "fresh", "tune", "wide", "clean")
CONDITIONS = {"own": None, "one": False, "two": True}


def rows_of(table: str, draw: int = 1) -> Sequence[Row]:
    """The campaigns of a set that is made; `draw` is that of the sets that are drawn again."""
    drawn = {"fresh": judge.fresh, "wide": wide.rows, "clean": wide.clean}
    return drawn[table](draw) if table in drawn else {"judge": judge.ROWS, "tune": tune.ROWS}[table]


def without_tracing() -> Options | None:
    """Options that leave the tracing out; None where the program has no such option."""
    if "trace" not in {f.name for f in fields(Options)}:
        return None
    left_out: dict[str, Any] = {"trace": False}
    return Options(**left_out)


def _noting(lives: list[dict[str, Any]]) -> Any:
    """The twin itself, which notes after every window what it says of the remaining life."""
    twin = gear_twin(None)

    def step(*given: Any) -> tuple[Any, Any]:
        state, estimate = twin.step(*given)
        record, report = estimate.record, estimate.report
        lives.append({"revolutions": record.get("revolutions"), "kind": record.get("kind"), "rul": report.get("rul")})
        return state, estimate

    return replace(twin, step=step)


def evaluate(path: Path, channels: str = "all", limits: Limits | None = None) -> Traced:
    """One recording's score: assessed without and with tracing; `limits`: detection limits of the machines."""
    beside = truth_beside(path)
    assert beside is not None
    truth = with_draws(read_truth(beside))
    name = truth.get("id", path.stem)
    untraced = without_tracing()
    lives: list[dict[str, Any]] = []
    try:
        with only(SETS[channels]):
            before = None if untraced is None else assess(path, options=untraced)
            start = time.process_time()
            answer = assess(path, twin=_noting(lives))
            used = time.process_time() - start
    except InputError as why:
        return replace(no_answer(truth, str(why), name=name), refused=True)
    except Exception as fault:  # one campaign without an answer is a line of the table, not the end of all
        return no_answer(truth, f"{type(fault).__name__}: {fault}", name=name)
    score = score_tracing(truth, answer, before, name=name, lives=lives)
    return replace(score, seconds=used, above_limit=above_limit(truth, answer["rig"]["name"], limits or {}))


def campaigns(
    chosen: Sequence[str],
    folder: Path,
    processes: int,
    names: Sequence[str],
    conditions: str,
    spreads: float | None = None,
    draw: int = 1,
) -> Iterator[Path]:
    """The recordings of some sets; those that are missing are made."""
    for table in SETS_MADE:
        if table not in chosen and "all" not in chosen:
            continue
        wanted = [row for row in rows_of(table, draw) if _named(row.name, names)]
        usual = wide.SPREADS_TWICE if table == "wide" else 1.0
        made = make_all(wanted, folder, processes, CONDITIONS[conditions], usual if spreads is None else spreads)
        for i, (row, path, why) in enumerate(made, start=1):
            _tell(f"campaign {i} of {len(wanted)}: {row.name}")
            if path is None:
                print(f"left out: {row.name} could not be made: {why}", file=sys.stderr)
            else:
                yield path
    if "shared" in chosen or "all" in chosen:
        beside = Path(os.environ.get("GEAR_TWIN_SHARED", ROOT.parent / "shared")) / "campaigns"
        found = [p for p in sorted(beside.glob("*.mcap")) if truth_beside(p) and _named(p.stem, names)]
        if not found:
            print(f"left out: no reference campaigns in {beside} (GEAR_TWIN_SHARED)", file=sys.stderr)
        yield from found


def _named(name: str, names: Sequence[str]) -> bool:
    return not names or any(text in name for text in names)


def _tell(what: str) -> None:
    if sys.stderr.isatty():
        print(f"\r\x1b[K{what}", end="", file=sys.stderr)


def evaluated(
    paths: Sequence[Path], processes: int, channels: str = "all", limits: Limits | None = None
) -> list[Traced]:
    """All recordings' scores, in order, over several processes."""
    out = []
    with ProcessPoolExecutor(max(1, min(processes, len(paths)))) as pool:
        for result in pool.map(evaluate, paths, [channels] * len(paths), [limits] * len(paths)):
            out.append(result)
            _tell(f"assessed {len(out)} of {len(paths)}: {result.name}")
    _tell("")
    return out


def arguments_of(parser: argparse.ArgumentParser) -> None:
    """What this command and the ablation share."""
    parser.add_argument(
        "--set", nargs="+", choices=[*SETS_MADE, "shared", "all"], default=["judge", "shared"], help="which campaigns"
    )
    parser.add_argument("--only", nargs="+", metavar="TEXT", default=[], help="campaigns with this in their name")
    parser.add_argument("--json", type=Path, metavar="OUT", help="write all figures to this file")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--folder", type=Path, default=FOLDER, help="where recordings are kept")


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.evaluate", description=__doc__)
    arguments_of(parser)
    parser.add_argument("--channels", choices=list(SETS), default="all", help="what the twin is shown")
    parser.add_argument(
        "--conditions", choices=list(CONDITIONS), default="own", help="operating conditions of the campaigns"
    )
    parser.add_argument(
        "--spreads", type=float, metavar="N", help="times the usual spreads of structure and instruments"
    )
    parser.add_argument(
        "--draw", type=int, default=1, metavar="N", help="which draw of the sets fresh, wide and clean, 1 or more"
    )
    parser.add_argument(
        "--limits", nargs="+", type=Path, metavar="FILE", default=[], help="detection limits, a file for each machine"
    )
    given = parser.parse_args(arguments)
    if given.draw < 1:
        parser.error(f"--draw {given.draw}: draws are numbered from 1")
    if given.spreads not in (None, 1) and {"shared", "all"} & set(given.set):
        print("--spreads makes campaigns: the reference campaigns are as they are and are left out", file=sys.stderr)
        given.set = [name for name in (SETS_MADE if "all" in given.set else given.set) if name != "shared"]
    paths = list(
        campaigns(given.set, given.folder, given.processes, given.only, given.conditions, given.spreads, given.draw)
    )
    if not paths:
        print(f"no campaign of {', '.join(given.set)} is named {' or '.join(given.only)}", file=sys.stderr)
        return 2
    results = evaluated(paths, given.processes, given.channels, read_limits(given.limits))
    if without_tracing() is None:
        print("this program has no tracing: what stands after is what stands before", end="\n\n")
    in_short = [*size_table(results), "-" * 62, *summary(results)]
    for table in (campaign_table(results), figure_table(results), *claim_tables(results), in_short):
        print("\n".join(table), end="\n\n")
    if given.json:
        text = json.dumps([r.to_dict() for r in results], ensure_ascii=False, indent=1)
        given.json.write_text(text + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
