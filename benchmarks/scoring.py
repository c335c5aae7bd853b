"""The twin's answer about a recording against the truth that lies beside it.

Truth is for scoring only: nothing here feeds back into an estimate.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from service.contract.estimate import Estimate, step
from service.files.rig import rig_of
from service.stream.sources.mcap import Recording, read_windows
from twin.options import Options
from twin.rig import Rig
from twin.state import State
from twin.windows import Window

ROOT = Path(__file__).resolve().parents[1]
SHALLOWEST = 20.0  # depth from which errors are stated [µm]
DEEP = 150.0  # depth beyond which they are stated apart [µm]


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One measurement window: depths in µm, errors in percent."""

    revolutions: float
    true: float
    depth: float | None
    low: float | None
    high: float | None
    paper: float | None
    rms: float
    error_before: float | None
    error_after: float | None
    updated: bool
    way: str | None
    notes: tuple[str, ...]

    @property
    def depth_error(self) -> float | None:
        return _percent(self.depth, self.true)

    @property
    def paper_error(self) -> float | None:
        return _percent(self.paper, self.true)

    @property
    def worn(self) -> bool:
        return self.true >= SHALLOWEST


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """One recording."""

    name: str
    effects: tuple[str, ...]
    rows: tuple[Row, ...]
    life: float | None  # revolutions left after the last window, as the twin says
    life_band: tuple[float, float] | None
    life_true: float | None

    @property
    def life_error(self) -> float | None:
        return _percent(self.life, self.life_true)

    @property
    def worn(self) -> list[Row]:
        """Windows from SHALLOWEST on for which a depth is given."""
        return [row for row in self.rows if row.worn and row.depth is not None]

    def worst(self, way: str = "depth_error", *, deep: bool = False) -> float | None:
        """Largest error of a way up to DEEP, or beyond it; None where there is no such window."""
        errors = [getattr(r, way) for r in self.worn if (r.true > DEEP) == deep and getattr(r, way) is not None]
        return max(errors, key=abs, default=None)

    def within(self, percent: float) -> float:
        """Share of windows whose RMS error, after the update where there was one, lies within a bound."""
        errors = [r.error_after for r in self.rows if r.error_after is not None]
        return float(np.mean(np.abs(errors) <= percent)) if errors else float("nan")

    @property
    def coverage(self) -> float:
        """Share of worn windows whose 5–95 % band holds the true depth."""
        inside = [r.low <= r.true <= r.high for r in self.worn if r.low is not None and r.high is not None]
        return float(np.mean(inside)) if inside else float("nan")

    def to_dict(self) -> dict[str, Any]:
        """JSON-safe, with what the tables show."""
        rows = [{**asdict(r), "depth_error": r.depth_error, "paper_error": r.paper_error} for r in self.rows]
        return {
            "name": self.name,
            "effects": list(self.effects),
            "windows": rows,
            "worst_percent": {"to_150_um": self.worst(), "beyond": self.worst(deep=True)},
            "paper_worst_percent": {
                "to_150_um": self.worst("paper_error"),
                "beyond": self.worst("paper_error", deep=True),
            },
            "rms_within_5_percent": self.within(5.0),
            "band_coverage": self.coverage,
            "life": {"revolutions": self.life, "true": self.life_true, "error_percent": self.life_error},
        }


def _percent(value: float | None, true: float | None) -> float | None:
    return None if value is None or not true else 100 * (value / true - 1)


def read_truth(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text())


def truth_beside(recording: Path) -> Path | None:
    """truth/NAME.json beside a recording."""
    path = recording.parent / "truth" / f"{recording.stem}.json"
    return path if path.is_file() else None


def life_left(truth: Mapping[str, Any]) -> float | None:
    """Revolutions from the last window to the end of life.

    The bundled recordings' truth counts them from new gears, that of the reference campaigns from the last window.
    """
    end = truth.get("end_of_life", {}).get("revolutions")
    if end is None:
        return None
    last = truth["windows"][-1]
    return end - last["revolutions"] if last["kind"] == "measurement" else end


def score(name: str, records: Iterable[Mapping[str, Any]], rul: Mapping[str, Any], truth: Mapping[str, Any]) -> Score:
    """Window records and the last remaining life against the truth, matched by revolution count."""
    known = [w for w in truth["windows"] if w["kind"] in ("wear", "measurement")]
    counts = np.array([w["revolutions"] for w in known])
    rows = []
    for record in records:
        if record["kind"] != "measurement" or record["revolutions"] is None:
            continue
        i = int(np.argmin(np.abs(counts - record["revolutions"])))
        rows.append(_row(record, known[i]["depth"]["combined_um"]))
    life = rul.get("revolutions")
    return Score(
        name=name,
        effects=tuple(e["name"] if isinstance(e, Mapping) else str(e) for e in truth.get("effects", ())),
        rows=tuple(rows),
        life=None if life is None else life["median"],
        life_band=None if life is None else (life["p05"], life["p95"]),
        life_true=life_left(truth),
    )


def _row(record: Mapping[str, Any], true: float) -> Row:
    paper = (record.get("methods") or {}).get("rms")
    return Row(
        revolutions=record["revolutions"],
        true=true,
        depth=record["wear_depth_um"],
        low=record.get("wear_depth_p05_um"),
        high=record.get("wear_depth_p95_um"),
        paper=None if paper is None else paper["wear_depth_um"],
        rms=record["rms_measured"],
        error_before=record["error_percent"],
        error_after=record.get("error_after_percent"),
        updated=record["updated"],
        way=record.get("method"),
        notes=tuple(record["notes"]),
    )


def windows_of(recording: Path) -> tuple[Rig, list[Window]]:
    """The attached rig and all windows of a recording of one asset."""
    with Recording(recording) as file:
        rig = rig_of(file, None)
    return rig, read_windows(recording)[2]


def run(rig: Rig, windows: Sequence[Window], options: Options | None = None) -> tuple[State, list[Estimate]]:
    """All windows through the twin, one after the other."""
    state, estimates = State(), []
    for window in windows:
        state, estimate = step(rig, state, window, options or Options())
        estimates.append(estimate)
    return state, estimates


def score_run(name: str, estimates: Sequence[Estimate], truth: Mapping[str, Any]) -> Score:
    """The score of what `run` gave."""
    return score(name, [e.record for e in estimates], estimates[-1].report["rul"], truth)
