"""The published wear campaign, replayed: depth and RMS at 6000, 12,000 and 18,000 revolutions.

    python -m benchmarks.paper_campaign [--json OUT]

Feng et al. measured at 0, 6000, 12,000 and 18,000 revolutions, updated the wear coefficient once, at 6000, and found
no second update needed at 12,000; at 18,000 their twin was 7 % off the wear depth and 13 % off the RMS. Here the same
is done on recordings/paper-campaign.mcap with only those windows and with all of them, with one update (none after
6000) and with further ones, by transmission error (fused) and by the RMS (rms), from the same run.

Source   K. Feng et al., Wear 426–427 (2019) 1410–1415, sections 4.2 and 5
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from math import inf
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.scoring import ROOT, read_truth, run, truth_beside, windows_of
from twin.options import Options
from twin.rig import Rig
from twin.windows import Window

RECORDING = ROOT / "recordings" / "paper-campaign.mcap"
REPORTED = (6000, 12000, 18000)  # pinion revolutions
MEASURED_AT = (0, *REPORTED)
ONE_UPDATE = 6100.0  # revolutions after which the twin only predicts
NEAR = 60.0  # a window belongs to a revolution count this close to it
PAPERS = {18000: (7.0, 13.0)}  # error of wear depth and of RMS, by revolutions [%]


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """One method at one revolution count; errors in percent, RMS before any update in that window."""

    windows: str  # "paper's" or "all"
    updates: str  # "one" or "further"
    method: str  # "fused" or "rms"
    revolutions: int
    true_um: float
    depth_um: float
    depth_error: float
    rms_error: float
    rms_error_after: float
    updated: bool


def papers_windows(windows: Sequence[Window], rig: Rig) -> list[Window]:
    """The calibration windows and those at the paper's revolution counts."""
    return [w for w in windows if _is_slow(w, rig) or _count(w) is not None]


def _speed(window: Window) -> float:
    edges = window.encoders["pinion"]
    t = edges.times[np.isfinite(edges.times)]
    return (t.size - 1) / edges.per_rev / float(t[-1] - t[0])


def _is_slow(window: Window, rig: Rig) -> bool:
    return _speed(window) < 0.5 * rig.get("operating.pinion_speed_hz")


def _count(window: Window) -> int | None:
    """The paper's revolution count at which a window was taken."""
    edges = window.encoders["pinion"]
    middle = (edges.first_index + edges.times.size / 2) / edges.per_rev
    return next((n for n in MEASURED_AT if abs(middle - n) < NEAR), None)


def lines_of(records: Sequence[Mapping[str, Any]], truth: Mapping[str, Any], windows: str, updates: str) -> list[Line]:
    out = []
    for record in records:
        n = next((n for n in REPORTED if abs(record["revolutions"] - n) < NEAR), None)
        if n is None:
            continue
        near = min(truth["windows"], key=lambda w: abs(w["revolutions"] - record["revolutions"]))
        true, rms, paper = near["depth"]["combined_um"], record["rms_measured"], record["methods"]["rms"]
        for method, depth, before, after, updated in (
            ("fused", record["wear_depth_um"], record["rms_predicted"], record["rms_after"], record["updated"]),
            ("rms", paper["wear_depth_um"], paper["rms_predicted"], paper["rms_after"], paper["updated"]),
        ):
            out.append(
                Line(
                    windows=windows, updates=updates, method=method, revolutions=n, true_um=true, depth_um=depth,
                    depth_error=100 * (depth / true - 1), rms_error=100 * (before / rms - 1),
                    rms_error_after=100 * (after / rms - 1), updated=updated,
                )
            )  # fmt: skip
    return out


def paper_campaign() -> list[Line]:
    """Every method, with the paper's windows and with all, with one update and with further ones."""
    rig, every = windows_of(RECORDING)
    path = truth_beside(RECORDING)
    assert path is not None, f"{RECORDING} has no truth beside it"
    truth = read_truth(path)
    out = []
    for name, windows in (("paper's", papers_windows(every, rig)), ("all", every)):
        for updates, until in (("one", ONE_UPDATE), ("further", inf)):
            _, estimates = run(rig, windows, Options(update_until=until))
            out += lines_of([e.record for e in estimates], truth, name, updates)
    return out


def table(lines: Sequence[Line]) -> list[str]:
    out = [
        "windows  updates  method  revs    true µm   twin µm   depth error %   RMS error %   after update %",
    ]
    for x in lines:
        out.append(
            f"{x.windows:9}{x.updates:9}{x.method:6}{x.revolutions:6}{x.true_um:11.1f}{x.depth_um:10.1f}"
            f"{x.depth_error:+16.1f}{x.rms_error:+14.1f}" + (f"{x.rms_error_after:+15.1f}" if x.updated else "")
        )
    for n, (depth, rms) in PAPERS.items():
        out.append(f"Feng et al.: one update at 6000, at {n} revolutions {depth:.0f} % on depth and {rms:.0f} % on RMS")
    return out


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.paper_campaign", description=__doc__.split("\n")[0])
    parser.add_argument("--json", type=Path, metavar="OUT", help="write all figures to this file")
    given = parser.parse_args(arguments)
    lines = paper_campaign()
    print("\n".join(table(lines)))
    if given.json:
        given.json.write_text(json.dumps([asdict(x) for x in lines], ensure_ascii=False, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
