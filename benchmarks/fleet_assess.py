"""How much faster many recordings are assessed side by side than by one process.

    python -m benchmarks.fleet_assess [--recordings 500] [--workers 2] [--trace] [--kill]

The bundled recording under so many names, assessed and written by one process and then by `fleet assess`, from its call
to its end, with the start of Ray and of its workers. The same answers are demanded. Wall times hold where nothing else
runs; processor times, of all processes of Ray too, hold on a busy machine: the work of one process over that of all is
the speed-up per worker that the machine would give if it had nothing else to do.
With `--kill` one of Ray's workers is killed once half of the recordings have been assessed.
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


def run(code: str, *arguments: str, kill_after: tuple[Path, int] | None = None) -> Taken:
    """A program's wall time, and the processor time of it and all that it starts.

    kill_after  a folder, and the number of results in it after which one of Ray's workers is killed
    """
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
            if kill_after is not None and len(list(kill_after[0].glob("*.json"))) >= kill_after[1]:
                kill_after = None if _worker_killed(top) else kill_after
            time.sleep(LOOK_EVERY)
    if process.returncode != 0:
        raise RuntimeError(f"the program ended with status {process.returncode}")
    return Taken(time.perf_counter() - begun, sum(spent.values()))


def _worker_killed(top: psutil.Process) -> bool:
    """Kills one of Ray's processes that assess; whether there was one."""
    for each in _children(top):
        try:
            if each.cmdline()[:1] == ["ray::assess_one"]:
                each.kill()
                print(f"process {each.pid}, which was assessing, has been killed", flush=True)
                return True
        except psutil.Error:
            continue
    return False


def _children(process: psutil.Process) -> list[psutil.Process]:
    try:
        return process.children(recursive=True)
    except psutil.Error:
        return []


ALONE = """
import sys
from service.fleet.assess_task import assess_one
from service.fleet.cli import work_of
from service.results.stored_recordings import stored_recordings
work = work_of(sys.argv[2], None, "fused", sys.argv[3] == "True")
assert all(assess_one(work, each).state == "assessed" for each in stored_recordings([sys.argv[1]]))
"""
SIDE_BY_SIDE = """
import sys
from service.fleet.batch import assess_all
from service.fleet.cli import work_of
from service.results.stored_recordings import stored_recordings
work = work_of(sys.argv[2], None, "fused", sys.argv[3] == "True")
found = stored_recordings([sys.argv[1]])
assert assess_all(found, work, workers=int(sys.argv[4])).counts["assessed"] == len(found)
"""


def measured(count: int, workers: int, trace: bool, kill: bool = False) -> tuple[Taken, Taken]:
    """What one process took, and what so many workers took."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        recordings = copies(folder / "recordings", count)
        alone = run(ALONE, str(recordings), str(folder / "alone"), str(trace))
        together = run(
            SIDE_BY_SIDE, str(recordings), str(folder / "together"), str(trace), str(workers),
            kill_after=(folder / "together", count // 2) if kill else None,
        )  # fmt: skip
        for result in (folder / "alone").glob("*.json"):
            assert (folder / "together" / result.name).read_bytes() == result.read_bytes(), result.name
    return alone, together


def figures(count: int, workers: int, trace: bool, kill: bool = False) -> list[Figure]:
    """Speed-up per worker, by the wall clock and by processor time."""
    alone, together = measured(count, workers, trace, kill)
    how = ("traced" if trace else "wear alone") + (", a worker killed half-way" if kill else "")
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


def main(count: int, workers: int, trace: bool, kill: bool) -> int:
    """Prints the figures; 1 where the speed-up by processor time is below its limit."""
    found = figures(count, workers, trace, kill)
    for figure in found:
        print(figure.line)
    return 1 if found[0].value < LIMIT else 0


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fleet_assess", description=__doc__)
    parser.add_argument("--recordings", type=int, default=500)
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--trace", action="store_true", help="search for effects, too")
    parser.add_argument("--kill", action="store_true", help="kill one of Ray's workers half-way")
    chosen = parser.parse_args()
    sys.exit(main(chosen.recordings, chosen.workers, chosen.trace, chosen.kill))
