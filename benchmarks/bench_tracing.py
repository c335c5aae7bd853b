"""What tracing costs: a search from scratch, a confirmation that nothing is new, and a whole campaign.

    python -m benchmarks.bench_tracing

On a campaign with one effect (misaligned shafts) and one without, which the generator makes and keeps. Processor time
of one thread.
"""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from benchmarks.bench_pipeline import Figure, command
from benchmarks.scoring import windows_of
from benchmarks.trace_campaigns import tune
from benchmarks.trace_campaigns.generate import FOLDER, make_all
from twin.options import Options
from twin.rig import Rig
from twin.scales import Scales
from twin.state import State
from twin.step import step
from twin.tracing.change_detection import change_indicators, is_new
from twin.tracing.trace import Traced, trace
from twin.updating.history import UpdateOptions, update_window
from twin.windows import Window

ONE_EFFECT, HEALTHY = "T03-misalignment-2", "T16-clean"


def recording(name: str) -> Path:
    (row,) = [row for row in tune.ROWS if row.name == name]
    (found,) = make_all([row], FOLDER, 1, None)
    assert found[1] is not None, found[2]
    return found[1]


def followed(rig: Rig, windows: Sequence[Window]) -> State:
    state = State()
    for window in windows:
        state, _ = step(rig, state, window, Options())
    return state


def traced(rig: Rig, state: State, **how) -> tuple[Traced, float]:
    """A trace of what a state remembers, and what it took [s]; curves that it keeps are not counted twice."""
    tracing = state.tracing
    begun = time.process_time()
    found = trace(rig, tracing.history, dict(tracing.stages[0].depths), tracing.stages[0].memory.phase, **how)
    return found, time.process_time() - begun


def main() -> list[Figure]:
    """Prints all figures; answers them."""
    print(f"{'tracing':<58}{'found':>10} {'':<7}{'aim':>10} {'ratio':>7}")
    figures: list[Figure] = []

    def tell(figure: Figure) -> None:
        print(figure.line, flush=True)
        figures.append(figure)

    path = recording(ONE_EFFECT)
    rig, windows = windows_of(path)
    state = followed(rig, windows)
    from twin.tracing.mesh_wear import curve_with

    curve_with.cache_clear()
    found, taken = traced(rig, state)
    names = ", ".join(f.name for f in found.found)
    tell(Figure(what="full trace of a campaign with one effect", value=taken, unit="s", aim=0.5, limit=10.0,
                note=f"{len(found.fitted)} windows fitted; found {names}"))  # fmt: skip
    _, taken = traced(rig, state, kept=state.tracing.found, tolerated=2 * (found.misfit_after or 0.0))
    tell(Figure(what="  the same, with the effects fitted again", value=taken, unit="s"))

    rig, windows = windows_of(recording(HEALTHY))
    state = followed(rig, windows)
    found, taken = traced(rig, state)
    tell(Figure(what="trace of a healthy machine: nothing is new", value=taken, unit="s", aim=0.05, limit=1.0,
                note=f"{len(found.fitted)} windows fitted; found {len(found.found)}"))  # fmt: skip
    latest = state.tracing.history[-1]
    outcome = update_window(
        rig, state.memory, latest, UpdateOptions(threshold=0.05, update="fused", update_until=float("inf"))
    )
    begun = time.process_time()
    is_new(change_indicators(rig, latest, outcome), state.tracing.signs, Scales.of(rig))
    tell(Figure(what="  the watch of one window", value=1e3 * (time.process_time() - begun), unit="ms"))

    with tempfile.TemporaryDirectory(prefix="gear-twin-bench-") as folder:
        out = Path(folder) / "answer.json"
        run = command("assess", str(path), "--json", str(out))
        count = len(json.loads(out.read_text(encoding="utf-8"))["windows"])
    tell(Figure(what=f"assess of {count} windows with one effect, traced", value=run.cpu, unit="s", aim=60.0,
                note=f"{run.peak:.0f} MB"))  # fmt: skip
    return figures


if __name__ == "__main__":
    main()
