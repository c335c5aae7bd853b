"""Is a service after a year as fast as on its first day?

    python -m benchmarks.long_run [year|decade|fleet …] [--data DIR] [--json OUT]

| case | history |
| --- | --- |
| year | one asset, a window every ten minutes: 52,560 windows |
| decade | the same for ten years, thinned by the retention of the settings |
| fleet | 200 assets for a month |

The first day and the last day go through a running service: frames over Zenoh, windows, database, board, REST, states
on Zenoh. The days between are written into its database while it does not run. The twin is a stand-in that answers
with a recorded answer of full size, so that no cost of the service is hidden by the twin's. Processor times are those
of the service with its workers; latencies are taken while no frames come. Ends with 1 where a cost of the last day is
more than LIMIT times that of the first day, or a restart takes longer than RESTART.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.long_run.history import Calendar, fill, replay, size
from benchmarks.long_run.service import Service, serving
from benchmarks.long_run.stand_in import write_template

LIMIT = 1.5  # last day over first day
RESTART = 3.0  # [s]
LEAST_MS = 5.0  # answers that are faster than this are not compared: they are the clock's and the socket's
PORT = 17_800
WARM_UP = 0.1  # share of a day's windows that are not timed


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """A history to be measured."""

    assets: int
    days: int
    day: int  # windows an asset and day
    live: int  # windows an asset that a measured day sends
    settings: dict[str, Any] = field(default_factory=dict)


CASES = {
    "year": Case(assets=1, days=365, day=144, live=288),
    "decade": Case(assets=1, days=3650, day=144, live=288),
    "fleet": Case(assets=200, days=30, day=144, live=6),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Day:
    """What a day costs."""

    windows: int  # that the service has, by its end
    cpu_ms: float  # a window
    memory_mb: float
    start_wall: float  # [s]
    start_cpu: float  # [s]
    bytes: int  # of the data directory
    latencies: dict[str, tuple[float, float, int]]


def measured(service: Service, case: Case, calendar: Calendar, first: int, folder: Path, data: Path) -> Day:
    """Sends a day's windows through a service."""
    names = [f"machine-{n:03d}" for n in range(case.assets)]
    warm = max(1, round(WARM_UP * case.live))
    replay(service, names, calendar, range(first, first + warm), folder)
    before = service.cpu()
    replay(service, names, calendar, range(first + warm, first + case.live), folder)
    spent = service.cpu() - before
    time.sleep(2.0)  # counters of the last second are shown
    return Day(
        windows=(first + case.live) * case.assets,
        cpu_ms=1e3 * spent / ((case.live - warm) * case.assets),
        memory_mb=service.memory(),
        start_wall=service.start_wall,
        start_cpu=service.start_cpu,
        bytes=size(data),
        latencies=service.latencies(names[0]),
    )


def run(case: Case, data: Path, say: Callable[[str], None]) -> tuple[Day, Day]:
    """First and last day of a case."""
    total = case.days * case.day
    calendar = Calendar(windows=total, end_ns=time.time_ns())
    names = [f"machine-{n:03d}" for n in range(case.assets)]
    with tempfile.TemporaryDirectory() as folder:
        write_template(Path(folder) / "answer.json")
        with serving(data, PORT, trace="false", signal_bytes=0, **case.settings) as service:
            first = measured(service, case, calendar, 0, Path(folder), data)
        say(f"first day: {first.cpu_ms:.1f} ms a window")
        begun = time.monotonic()
        fill(data, names, calendar, range(case.live, total - case.live))
        say(f"{(total - 2 * case.live) * case.assets} windows written in {time.monotonic() - begun:.0f} s")
        with serving(data, PORT, trace="false", signal_bytes=0, **case.settings) as service:
            last = measured(service, case, calendar, total - case.live, Path(folder), data)
    return first, last


def lines(first: Day, last: Day) -> tuple[list[str], list[str]]:
    """The table of a case, and what misses its limit."""
    rows: list[tuple[str, float, float, str, bool]] = [
        ("processor time of a window", first.cpu_ms, last.cpu_ms, "ms", True),
        ("memory", first.memory_mb, last.memory_mb, "MB", True),
        ("start until ready", first.start_wall, last.start_wall, "s", False),
        ("processor time of a start", first.start_cpu, last.start_cpu, "s", True),
    ]
    for route, (median, slow, _) in first.latencies.items():
        now, now_slow, _ = last.latencies[route]
        rows.append((f"GET {route}, median", median, now, "ms", now > LEAST_MS))
        rows.append((f"GET {route}, 99 %", slow, now_slow, "ms", False))
    out = [f"{'':<58}{'first day':>11}{'last day':>11}{'ratio':>7}"]
    missed = []
    for what, one, other, unit, judged in rows:
        ratio = other / one if one else float("nan")
        out.append(f"{what:<58}{one:>8.2f} {unit:<2}{other:>8.2f} {unit:<2}{ratio:>7.2f}")
        if judged and ratio > LIMIT:
            missed.append(f"{what}: {ratio:.2f} times the first day's, limit {LIMIT:g}")
    out += [f"{'data directory':<58}{first.bytes / 1e6:>8.1f} MB{last.bytes / 1e6:>8.1f} MB", ""]
    if last.start_wall > RESTART:
        missed.append(f"start until ready: {last.start_wall:.1f} s, limit {RESTART:g} s")
    return out, missed


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.long_run", description="Costs after years.")
    parser.add_argument("cases", nargs="*", choices=[*CASES, []], default=list(CASES), help="which cases; default: all")
    parser.add_argument("--data", type=Path, help="directory of the databases; default: a temporary one")
    parser.add_argument("--days", type=int, help="days of the history, in place of the case's")
    parser.add_argument("--json", type=Path, help="file for the figures")
    chosen = parser.parse_args()
    kept, missed = {}, []
    for name in chosen.cases:
        case = CASES[name]
        if chosen.days:
            case = Case(**{**asdict(case), "days": chosen.days})
        folder = chosen.data or Path(tempfile.mkdtemp(prefix="gear-twin-"))
        data = folder / name
        shutil.rmtree(data, ignore_errors=True)
        try:
            first, last = run(case, data, lambda line: print(line, file=sys.stderr, flush=True))
        finally:
            if chosen.data is None:
                shutil.rmtree(folder, ignore_errors=True)
        table, fails = lines(first, last)
        print(f"{name}: {case.assets} assets, {case.days} days, {last.windows} windows", *table, sep="\n")
        missed += [f"{name}: {line}" for line in fails]
        kept[name] = {"first": asdict(first), "last": asdict(last)}
    if chosen.json:
        chosen.json.write_text(json.dumps(kept, indent=1), encoding="utf-8")
    for line in missed:
        print(f"missed: {line}", file=sys.stderr)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
