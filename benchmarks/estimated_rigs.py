"""Depth bands with rig files of `gear-twin init`, the machines' own rig files withheld.

    python -m benchmarks.estimated_rigs [NAME …] [--trace]

NAMEs are reference campaigns (D00 …), by default all. What their data sheet would say is in docs/examples/answers.toml.
A window counts as inside where the 5–95 % band of its depth holds the true depth; width is that of the last window's
band over its depth.
"""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.scoring import ROOT, Row, read_truth, run, score_run, truth_beside, windows_of
from service.setup.answers import load_answers
from service.setup.rig_file import draft_of
from twin.options import Options
from twin.rig import Rig

ANSWERS = ROOT / "docs" / "examples" / "answers.toml"


@dataclass(frozen=True, slots=True, kw_only=True)
class Bands:
    """The bands of one campaign."""

    name: str
    effects: tuple[str, ...]
    rows: tuple[Row, ...]  # windows with a depth

    @property
    def inside(self) -> list[bool]:
        """Whether each window's band holds the true depth."""
        return [
            r.low is not None and r.high is not None and r.low <= r.true + 1e-6 and r.true <= r.high + 1e-6
            for r in self.rows
        ]

    @property
    def width(self) -> float:
        """Width of the last band over its depth."""
        last = self.rows[-1]
        assert last.high is not None and last.low is not None and last.depth
        return (last.high - last.low) / last.depth

    @property
    def error(self) -> float | None:
        """Largest error of a depth from 20 µm on [%]."""
        errors = [r.depth_error for r in self.rows if r.worn and r.depth_error is not None]
        return max(errors, key=abs, default=None)


def estimated_rig() -> Rig:
    """The rig file that `gear-twin init` makes of the answers file."""
    return draft_of(load_answers(ANSWERS)).rig


def bands_of(recording: Path, rig: Rig, *, trace: bool = False) -> Bands:
    """The bands of a recording, with a rig file that is not its own."""
    truth = truth_beside(recording)
    if truth is None:
        raise FileNotFoundError(f"no truth beside {recording}")
    _, windows = windows_of(recording)
    _, estimates = run(rig, windows, Options(trace=trace))
    scored = score_run(recording.stem, estimates, read_truth(truth))
    return Bands(
        name=recording.stem, effects=scored.effects, rows=tuple(r for r in scored.rows if r.depth is not None)
    )  # fmt: skip


def main() -> None:
    names = [a for a in sys.argv[1:] if not a.startswith("--")]
    campaigns = Path(os.environ.get("GEAR_TWIN_SHARED", ROOT.parent / "shared")) / "campaigns"
    paths = [campaigns / f"{n}.mcap" for n in names] or sorted(campaigns.glob("D??.mcap"))
    rig, inside = estimated_rig(), []
    print(f"{'campaign':10}{'inside':>10}{'largest error':>16}{'width':>8}  effects")
    for path in paths:
        found = bands_of(path, rig, trace="--trace" in sys.argv)
        inside += found.inside
        error = "–" if found.error is None else f"{found.error:+.0f} %"
        counted = f"{sum(found.inside)} of {len(found.inside)}"
        print(
            f"{found.name:10}{counted:>10}{error:>16}{found.width:8.2f}  {', '.join(found.effects) or 'none'}",
            flush=True,
        )
    print(f"\n{sum(inside)} of {len(inside)} windows inside their band ({100 * np.mean(inside):.0f} %)")


if __name__ == "__main__":
    main()
