"""Is a service after a year as fast as on its first day?

    python -m benchmarks.long_run [year|decade|fleet …] [--data DIR] [--json OUT]

| case | history |
| --- | --- |
| year | one asset, a window every ten minutes: 52,560 windows |
| decade | the same for ten years, thinned by the retention of the settings |
| fleet | 200 assets for a month |

Two data directories are filled, one up to the first day's end and one up to the last day's, and a service runs on each.
Both are measured in turn, so that whatever else the machine does slows both: windows go through them (frames over
Zenoh, database, board, REST, states on Zenoh), every route that reads a history is asked, and both are started anew.
The twin is a stand-in that answers with a recorded answer of full size, so that no cost of the service is hidden by
the twin's; starts are those of the service as it is installed. Processor times and memory are those of the service
with its workers. An answer that is longer on the last day, as there is more to show, is compared by its bytes.

Ends with 1 where a cost of the last day is more than LIMIT times that of the first day, a start takes longer than
START, or the database is another size than the stated formula gives, by more than SIZE.

What has been filled stays in DIR, and is used again by the next run with the same DIR.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.long_run.history import Calendar, fill, replay, size
from benchmarks.long_run.service import PROGRAM, ROUTES, Service, serving
from benchmarks.long_run.stand_in import write_template
from service.results.data_folder import DATABASE
from service.results.store_size import forecast_of
from service.runtime.retention_job import retention_of
from service.settings import Settings

LIMIT = 1.5  # last day over first day
START = 3.0  # [s]
SIZE = 0.1  # relative
LEAST_MS = 5.0  # answers that are faster than this are not compared: they are the clock's and the socket's
PORT = 17_800
WARM_UP = 0.1  # share of the measured windows that are not timed
ROUNDS = 4  # in which the windows are sent, to each service in turn
STARTS = 5  # of each service
ASKED = 40  # requests of each route
DAYS = ("first", "last")


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """A history to be measured."""

    assets: int
    days: int
    day: int  # windows an asset and day
    live: int  # windows an asset that are measured
    settings: dict[str, Any] = field(default_factory=dict)

    @property
    def names(self) -> list[str]:
        return [f"machine-{n:03d}" for n in range(self.assets)]

    def windows(self, day: str) -> int:
        """How many windows an asset has when the measurement of a day has ended."""
        return max(self.day, self.live + 1) if day == "first" else self.days * self.day


CASES = {
    "year": Case(assets=1, days=365, day=144, live=288),
    "decade": Case(assets=1, days=3650, day=144, live=288),
    "fleet": Case(assets=200, days=30, day=144, live=5),
}


@dataclass(slots=True, kw_only=True)
class Day:
    """What a day costs."""

    windows: int  # of all assets, by its end
    cpu: float = 0.0  # of the measured windows [s]
    memory_mb: float = 0.0
    bytes: int = 0  # of the data directory
    database_bytes: int = 0
    formula_bytes: float = 0.0  # of the database, by the stated formula
    starts: list[tuple[float, float]] = field(default_factory=list)  # until ready, and processor time [s]
    latencies: dict[str, list[float]] = field(default_factory=dict)  # by route [ms]
    sizes: dict[str, int] = field(default_factory=dict)  # of the answers [bytes]


def filled(case: Case, folder: Path, say: Callable[[str], None]) -> Calendar:
    """Fills a data directory for each day, up to the windows that are measured; the times of the windows."""
    mark = folder / "filled.json"
    if mark.exists():
        return Calendar(**json.loads(mark.read_text(encoding="utf-8")))
    shutil.rmtree(folder, ignore_errors=True)
    calendar = Calendar(windows=case.windows("last"), end_ns=time.time_ns())
    folder.mkdir(parents=True)
    with serving(folder / "first", PORT, trace="false", signal_bytes=0, **case.settings) as service:
        replay(service, case.names, calendar, range(1), folder)  # all assets are known, with their rig file
    shutil.copytree(folder / "first", folder / "last")
    for day in DAYS:
        begun, numbers = time.monotonic(), range(1, case.windows(day) - case.live)
        fill(folder / day, case.names, calendar, numbers, retention_of(Settings(**case.settings)))
        say(f"{day} day: {len(numbers) * case.assets} windows written in {time.monotonic() - begun:.0f} s")
    mark.write_text(json.dumps(asdict(calendar)), encoding="utf-8")
    return calendar


def run(case: Case, folder: Path, say: Callable[[str], None]) -> tuple[Day, Day]:
    """First and last day of a case."""
    with tempfile.TemporaryDirectory() as template:
        write_template(Path(template) / "answer.json")
        calendar = filled(case, folder / "filled", say)
        measured = folder / "measured"
        shutil.rmtree(measured, ignore_errors=True)
        shutil.copytree(folder / "filled", measured)
        days = [Day(windows=case.windows(day) * case.assets) for day in DAYS]
        given = {"assets": case.assets, "trace": "false", "signal_bytes": 0, **case.settings}
        with ExitStack() as stack:
            services = [
                stack.enter_context(serving(measured / day, PORT + 10 * n, **given)) for n, day in enumerate(DAYS)
            ]
            _send(case, services, days, calendar, measured)
            _ask(services, days, case)
        for _ in range(STARTS):
            for n, day in enumerate(DAYS):
                with serving(measured / day, PORT + 10 * n, program=PROGRAM, **given) as service:
                    days[n].starts.append((service.start_wall, service.start_cpu))
        for day, found in zip(DAYS, days, strict=True):
            database = measured / day / DATABASE
            found.bytes, found.database_bytes = size(measured / day), database.stat().st_size
            found.formula_bytes = forecast_of(database, retention_of(Settings(**case.settings))).now
        shutil.rmtree(measured)
    return days[0], days[1]


def _send(case: Case, services: Sequence[Service], days: Sequence[Day], calendar: Calendar, folder: Path) -> None:
    """Sends the measured windows to each service in turn."""
    warm = max(1, round(WARM_UP * case.live))
    bounds = [0, *np.linspace(warm, case.live, ROUNDS + 1).astype(int)]
    for a, b in pairwise(bounds):
        for service, day, name in zip(services, days, DAYS, strict=True):
            first = case.windows(name) - case.live
            before = service.cpu()
            replay(service, case.names, calendar, range(first + a, first + b), folder)
            if a:
                day.cpu += service.cpu() - before
    time.sleep(2.0)  # counters of the last second are shown
    for service, day in zip(services, days, strict=True):
        day.memory_mb = service.memory()


def _ask(services: Sequence[Service], days: Sequence[Day], case: Case) -> None:
    """Asks each route of each service in turn."""
    for route in ROUTES:
        for _ in range(ASKED):
            for service, day, name in zip(services, days, DAYS, strict=True):
                asked = route.format(asset=case.names[0], middle=case.windows(name) // 2)
                took, day.sizes[route] = service.asked(asked)
                day.latencies.setdefault(route, []).append(took)


def lines(case: Case, first: Day, last: Day) -> tuple[list[str], list[str]]:
    """The table of a case, and what misses its limit."""
    measured = (case.live - max(1, round(WARM_UP * case.live))) * case.assets
    starts = [np.median(np.array(day.starts), axis=0) for day in (first, last)]
    rows: list[tuple[str, float, float, str, bool]] = [
        ("processor time of a window", 1e3 * first.cpu / measured, 1e3 * last.cpu / measured, "ms", True),
        ("memory", first.memory_mb, last.memory_mb, "MB", True),
        ("start until ready", starts[0][0], starts[1][0], "s", True),
        ("processor time of a start", starts[0][1], starts[1][1], "s", True),
    ]
    for route in ROUTES:
        one, other = first.latencies[route], last.latencies[route]
        now, more = float(np.median(other)), max(1.0, last.sizes[route] / max(first.sizes[route], 1))
        rows.append((f"GET {route}, median", float(np.median(one)) * more, now, "ms", now > LEAST_MS))
        rows.append((f"GET {route}, 99 %", float(np.percentile(one, 99)), float(np.percentile(other, 99)), "ms", False))
    out = [f"{'':<70}{'first day':>11}{'last day':>11}{'ratio':>7}"]
    missed = []
    for what, a, b, unit, judged in rows:
        out.append(f"{what:<70}{a:>8.2f} {unit:<2}{b:>8.2f} {unit:<2}{b / a:>7.2f}")
        if judged and b > LIMIT * a:
            missed.append(f"{what}: {b / a:.2f} times the first day's, limit {LIMIT:g}")
    out.append(f"{'data directory':<70}{first.bytes / 1e6:>8.1f} MB{last.bytes / 1e6:>8.1f} MB")
    formula = last.formula_bytes / last.database_bytes
    out += [f"{'database by the stated formula, over its size':<92}{formula:>7.2f}", ""]
    if abs(formula - 1) > SIZE:
        missed.append(f"the stated formula gives {formula:.2f} times the size of the database, limit ± {SIZE:g}")
    if starts[1][0] > START:
        missed.append(f"start until ready: {starts[1][0]:.1f} s, limit {START:g} s")
    return out, missed


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.long_run", description="Costs after years.")
    parser.add_argument("cases", nargs="*", choices=[*CASES, []], default=list(CASES), help="which cases; default: all")
    parser.add_argument("--data", type=Path, help="directory that keeps what is filled; default: a temporary one")
    parser.add_argument("--days", type=int, help="days of the history, in place of the case's")
    parser.add_argument("--json", type=Path, help="file for the figures")
    chosen = parser.parse_args()
    kept, missed = {}, []
    for name in chosen.cases:
        case = CASES[name]
        if chosen.days:
            case = Case(**{**asdict(case), "days": chosen.days})
        folder = chosen.data or Path(tempfile.mkdtemp(prefix="gear-twin-"))
        try:
            first, last = run(case, folder / name, lambda line: print(line, file=sys.stderr, flush=True))
        finally:
            if chosen.data is None:
                shutil.rmtree(folder, ignore_errors=True)
        table, fails = lines(case, first, last)
        print(f"{name}: {case.assets} assets, {case.days} days, {last.windows} windows", *table, sep="\n", flush=True)
        missed += [f"{name}: {line}" for line in fails]
        kept[name] = {"first": asdict(first), "last": asdict(last)}
    if chosen.json:
        chosen.json.write_text(json.dumps(kept, indent=1), encoding="utf-8")
    for line in missed:
        print(f"missed: {line}", file=sys.stderr)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
