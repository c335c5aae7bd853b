"""How much faster many recordings are assessed side by side than by one process.

    python -m benchmarks.fleet_assess [--recordings 500] [--workers 2] [--trace]

The bundled recording under so many names, assessed and written by one process and then by `fleet assess`, from its call
to its end, with the start of Ray and of its workers. The same answers are demanded. Wall times hold where nothing else
runs; processor times, of all processes of Ray too, hold on a busy machine: the work of one process over that of all is
the speed-up per worker that the machine would give if it had nothing else to do.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import psutil

from benchmarks.bench_pipeline import Figure

SOURCE = Path(__file__).parents[1] / "recordings" / "short-campaign.mcap"
AIM, LIMIT = 0.85, 0.7  # speed-up per worker
LOOK_EVERY = 0.5  # at the processor times of all processes [s]


@dataclass(frozen=True, slots=True)
class Taken:
    """What a run took [s]."""

    wall: float
    processor: float


def copies(folder: Path, count: int) -> Path:
    """So many recordings of one content, as links to one file."""
    folder.mkdir()
    first = folder / "machine000.mcap"
    shutil.copy(SOURCE, first)
    for number in range(1, count):
        os.link(first, folder / f"machine{number:03d}.mcap")
    return folder


def run(code: str, *arguments: str) -> Taken:
    """A program's wall time, and the processor time of it and all that it starts."""
    root = Path(__file__).parents[1]
    environment = os.environ | {"PYTHONPATH": str(root)}
    begun = time.perf_counter()
    spent: dict[tuple[int, float], float] = {}
    with subprocess.Popen([sys.executable, "-c", code, *arguments], env=environment) as process:
        top = psutil.Process(process.pid)
        while process.poll() is None:
            for each in (top, *_children(top)):
                try:
                    times = each.cpu_times()
                    spent[each.pid, each.create_time()] = times.user + times.system
                except psutil.Error:
                    continue
            time.sleep(LOOK_EVERY)
    if process.returncode != 0:
        raise RuntimeError(f"the program ended with status {process.returncode}")
    return Taken(time.perf_counter() - begun, sum(spent.values()))


def _children(process: psutil.Process) -> list[psutil.Process]:
    try:
        return process.children(recursive=True)
    except psutil.Error:
        return []


ALONE = """
import sys
from service.fleet.assess_task import assess_one
from service.fleet.cli import work_of
from service.fleet.stored_recordings import stored_recordings
work = work_of(sys.argv[2], None, "fused", sys.argv[3] == "True")
assert all(assess_one(work, each).state == "assessed" for each in stored_recordings([sys.argv[1]]))
"""
SIDE_BY_SIDE = """
import sys
from service.fleet.batch import assess_all
from service.fleet.cli import work_of
from service.fleet.stored_recordings import stored_recordings
work = work_of(sys.argv[2], None, "fused", sys.argv[3] == "True")
found = stored_recordings([sys.argv[1]])
assert assess_all(found, work, workers=int(sys.argv[4])).counts["assessed"] == len(found)
"""


def measured(count: int, workers: int, trace: bool) -> tuple[Taken, Taken]:
    """What one process took, and what so many workers took."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        recordings = copies(folder / "recordings", count)
        alone = run(ALONE, str(recordings), str(folder / "alone"), str(trace))
        together = run(SIDE_BY_SIDE, str(recordings), str(folder / "together"), str(trace), str(workers))
        for result in (folder / "alone").glob("*.json"):
            assert (folder / "together" / result.name).read_bytes() == result.read_bytes(), result.name
    return alone, together


def figures(count: int, workers: int, trace: bool) -> list[Figure]:
    """Speed-up per worker, by the wall clock and by processor time."""
    alone, together = measured(count, workers, trace)
    how = "traced" if trace else "wear alone"
    what = f"{count} recordings, {workers} workers, {how}: speed-up per worker"
    by_processor = alone.processor / together.processor
    by_wall = alone.wall / together.wall / workers
    each = 1e3 / count
    return [
        Figure(
            what=f"{what}, processor time", value=by_processor, unit="",
            note=f"{each * alone.processor:.0f}, {each * together.processor:.0f} ms a recording; aim {AIM:g} or more",
        ),
        Figure(
            what=f"{what}, wall clock", value=by_wall, unit="",
            note=f"{alone.wall:.1f} and {together.wall:.1f} s, load {os.getloadavg()[0]:.1f}; aim {AIM:g} or more",
        ),
    ]  # fmt: skip


def main(count: int, workers: int, trace: bool) -> int:
    """Prints the figures; 1 where the speed-up by processor time is below its limit."""
    found = figures(count, workers, trace)
    for figure in found:
        print(figure.line)
    return 1 if found[0].value < LIMIT else 0


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fleet_assess", description=__doc__)
    parser.add_argument("--recordings", type=int, default=500)
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--trace", action="store_true", help="search for effects, too")
    chosen = parser.parse_args()
    sys.exit(main(chosen.recordings, chosen.workers, chosen.trace))
