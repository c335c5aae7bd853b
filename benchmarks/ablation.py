"""Which channels, and how many operating conditions, each effect needs to be named.

    python -m benchmarks.ablation [--set tune|judge …] [--only TEXT …] [--channels NAME …] [--conditions one two]
                                  [--json OUT] [--processes N] [--folder DIR]

Runs every campaign once for each choice of channels and conditions. `accel` leaves the accelerometer and a
tachometer of one edge a turn on the pinion, which tells speed and count but no transmission error. With two conditions
the same machine with the same effects changes between two speeds and loads from window to window.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence

from benchmarks.channels import SETS
from benchmarks.evaluate import arguments_of, campaigns, evaluated
from benchmarks.tracing_score import Traced

DEFAULT = ("accel", "accel+encoders", "all")
Choice = tuple[str, str]  # channels, conditions
Results = Mapping[Choice, Sequence[Traced]]


def cell(result: Traced) -> str:
    """What one run said: right, partly, nothing, or the wrong names."""
    if result.failed:
        return "no answer"
    if result.right:
        return "right"
    if result.false:
        return "wrong"
    return "part" if set(result.named) & set(result.expected) else "nothing"


def matrix(results: Results) -> list[str]:
    """One line a campaign, one column a choice; then the share that is right, by kind of campaign."""
    choices = list(results)
    heads = [f"{channels}, {conditions}" for channels, conditions in choices]
    first = results[choices[0]]
    wide = max(len(r.name) for r in first)
    widths = [max(len(head), 9) + 2 for head in heads]
    out = [f"{'channels, conditions':{wide}}" + "".join(f"{h:>{w}}" for h, w in zip(heads, widths, strict=True))]
    for i, result in enumerate(first):
        runs = [results[choice][i] for choice in choices]
        wrong = dict.fromkeys(name for r in runs for name in r.false)
        line = f"{result.name:{wide}}" + "".join(f"{cell(r):>{w}}" for r, w in zip(runs, widths, strict=True))
        out.append(line + (f"   wrong: {', '.join(wrong)}" if wrong else ""))
    for kind in ("single", "pair", "unknown", "clean"):
        counts = []
        for choice in choices:
            mine = [r for r in results[choice] if r.kind == kind]
            counts.append(f"{sum(r.right for r in mine)} of {len(mine)}")
        out.append(f"{kind:{wide}}" + "".join(f"{c:>{w}}" for c, w in zip(counts, widths, strict=True)))
    return out


def needs(results: Results) -> list[str]:
    """Of every effect alone: with which choices it is named, by size."""
    singles = sorted({r.expected[0] for runs in results.values() for r in runs if r.kind == "single"})
    out = []
    for name in singles:
        line = []
        for (channels, conditions), runs in results.items():
            named = [r.level for r in runs if r.expected == (name,) and r.right]
            if named:
                line.append(f"{channels}, {conditions}: {', '.join(dict.fromkeys(named))}")
        out.append(f"{name:22s}{'; '.join(line) or 'not named'}")
    return out


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.ablation", description=__doc__)
    arguments_of(parser)
    parser.add_argument("--channels", nargs="+", choices=list(SETS), default=list(DEFAULT), help="what is left")
    parser.add_argument(
        "--conditions", nargs="+", choices=["own", "one", "two"], default=["one", "two"],
        help="operating conditions of the campaigns",
    )  # fmt: skip
    given = parser.parse_args(arguments)
    results: dict[Choice, list[Traced]] = {}
    for conditions in given.conditions:
        paths = list(campaigns(given.set, given.folder, given.processes, given.only, conditions))
        if not paths:
            print(f"no campaign of {', '.join(given.set)} is named {' or '.join(given.only)}", file=sys.stderr)
            return 2
        for channels in given.channels:
            results[channels, conditions] = evaluated(paths, given.processes, channels)
    for table in (matrix(results), needs(results)):
        print("\n".join(table), end="\n\n")
    if given.json:
        data = [
            {"channels": channels, "conditions": conditions, "campaigns": [r.to_dict() for r in runs]}
            for (channels, conditions), runs in results.items()
        ]
        given.json.write_text(json.dumps(data, ensure_ascii=False, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
