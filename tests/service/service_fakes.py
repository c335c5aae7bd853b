"""A made-up campaign in the shapes of the contract: what the answering side is tested and looked at with.

The curves have the paper's look (156 µm at 6000 revolutions, RMS growing with depth) and no physics.
"""

from __future__ import annotations

import math
import shutil
import weakref
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
from segments import segment_of

from service.alarms.keeper import AlarmKeeper
from service.results.alarm_store import AlarmStore
from service.results.asset_table import AssetTable
from service.results.baseline_store import BaselineStore
from service.results.data_folder import BASELINES, SEGMENTS
from service.results.jobs import DECISION, INSPECTION, Job, Jobs
from service.results.names import Names
from service.results.snapshot import Snapshot
from service.results.sql_store import SqlStore, Superseded, new_mark
from service.results.window_jobs import WindowJobs
from service.runtime.commits import Commits, Marks
from service.runtime.outcomes import Outcome
from service.stream.quality import received_quality
from twin.windows import Edges, Window

START_NS = 1_700_000_000_000_000_000
SHARE = {"combined": 1.0, "pinion": 0.7324, "gear": 0.2676}
END_OF_LIFE_UM = 500.0
SEGMENT = segment_of(
    Window(start_time_ns=7, encoders={"pinion": Edges(per_rev=1, first_index=0, times=np.arange(5.0))})
)


def depth_um(revolutions: float) -> float:
    return 156.0 * (revolutions / 6000.0) ** 0.93


def band(value: float, spread: float) -> dict[str, float]:
    return {"median": value, "p05": value * (1 - spread), "p95": value * (1 + spread)}


def status(level: str, *reasons: str, action: str = "Look at the machine.") -> dict:
    """A status that says these reasons, as the contract has it."""
    findings = [{"subject": "effect", "level": level, "reason": reason, "action": action} for reason in reasons]
    return {"level": level, "reasons": list(reasons), "findings": [] if level == "normal" else findings}


def profile() -> dict:
    """Depth along both flanks, zero near the pitch point."""
    out: dict = {"path_position_mm": [-5.2 + 9.75 * i / 80 for i in range(81)]}
    for flank, share in (("pinion", 0.7324), ("gear", 0.2676)):
        s = [-5.2 + 9.75 * i / 80 for i in range(81)]
        shape = [share * abs(math.sin(0.42 * v)) ** 1.2 * (1 - (v / 7.5) ** 4) for v in s]
        out[flank] = {
            "radius_mm": [30 + 0.1 * v for v in s],
            "roll_angle_deg": [20.9 + 3.2 * v for v in s],
            "depth_um": [150 * v for v in shape],
        }
    return out


def record(
    index: int,
    revolutions: float,
    *,
    updated: bool = False,
    kind: str = "measurement",
    rms_predicted: float | None = None,
) -> dict:
    measured = 14.0 + 0.55 * depth_um(revolutions) ** 0.95 + 1.5 * math.sin(2.1 * index)
    predicted = rms_predicted or measured * (1.18 if updated else 1.02 - 0.01 * (index % 3))
    return {
        "index": index,
        "kind": kind,
        "start_time": datetime.fromtimestamp(START_NS / 1e9 + 600 * index, UTC).isoformat(),
        "revolutions": revolutions,
        "speed_hz": 2.0 if kind == "calibration" else 10.0,
        "torque_nm": 10.0,
        "rms_measured": measured,
        "rms_predicted": predicted,
        "error_percent": 100 * (predicted - measured) / measured,
        "updated": updated,
        "rms_after": measured * 1.012 if updated else predicted,
        "k_wear_per_n": 2.7e-6 * (1 + 0.02 * math.sin(index)),
        "wear_depth_um": depth_um(revolutions),
        "notes": ["beyond the steady states of the model"] if depth_um(revolutions) > 320 else [],
    }


def report(revolutions: float, windows: int) -> dict:
    depth = depth_um(revolutions)
    spread = 0.03 + 0.3 / (1 + windows)
    left = max(6000.0 * (END_OF_LIFE_UM / 156.0) ** (1 / 0.93) - revolutions, 0.0)
    return {
        "wear": {
            "k_wear_per_n": 2.7e-6,
            "dwell_time_s": 9.6e-5,
            "specific_wear_rate_m2_per_n": 2.1e-12,
            "max_depth_um": {flank: band(depth * share, spread) for flank, share in SHARE.items()},
            "profile": profile(),
            "method": "transmission error",
            "validity": {"contact_loss_from_um": 320.0, "steady_state_to_um": 500.0, "valid": depth < 320.0},
            "methods": {
                "fused": {
                    "k_wear_per_n": 2.7e-6,
                    "wear_depth_um": depth,
                    "std_um": 0.02 * depth,
                    "from_lines_um": depth,
                    "misfit": 0.3,
                },
                "rms": {
                    "k_wear_per_n": 2.3e-6,
                    "wear_depth_um": 0.84 * depth,
                    "rms_predicted": 175.1,
                    "rms_after": 180.2,
                    "updated": True,
                    "converged": True,
                    "iterations": 2,
                },
            },
        },
        "rul": {
            "criterion": "max_depth",
            "max_depth_um": END_OF_LIFE_UM,
            "reached": False,
            "revolutions": band(left, 2 * spread),
            "hours": band(left / 36000.0, 2 * spread),
            "speed_hz": 10.0,
            "torque_nm": 10.0,
        },
        "residual": {
            "rms_error_percent": 1.4,
            "waveform_error_percent": 12.5,
            "bands": [
                {"harmonic": h, "frequency_hz": 190.0 * h, "measured": 20.0 / h, "predicted": 19.0 / h + 0.3}
                for h in range(1, 6)
            ],
            "orders": [{"order": 37.64, "frequency_hz": 376.4, "share_percent": 1.9}],
        },
        "effects": [],
        "unexplained": {
            "share_percent": 3.1,
            "orders": [],
            "verdict": "explained",
            "reason": "",
            "limit_percent": 30.0,
        },
        "status": status("normal", "The twin explains the vibration."),
        "calibration": {
            "from": "windows",
            "values": {"stiffness_scale": 1.012, "modal_ratio": 0.048, "contact_half_width": 2.05e-4},
            "std_percent": {"stiffness_scale": 2.0, "modal_ratio": 9.1, "contact_half_width": 5.3},
            "windows": 3,
        },
    }


def little_known_report() -> dict:
    """What the twin says of a machine with tooth counts and speed only."""
    reason = "the rig file does not give gears.module, gears.face_width"
    missing = {"status": "not available", "reason": reason}
    return {"wear": missing, "rul": missing, "residual": missing, "effects": [], "unexplained": missing}


def traced_report(revolutions: float, windows: int) -> dict:
    """A report with two effects, and with what they rest on."""

    def error(waveform: float, rms: float) -> dict:
        return {"rms_percent": rms, "waveform_percent": waveform, "noise_percent": 0.2}

    effects = [
        {
            "name": "gear_eccentricity",
            "status": "found",
            "parameters": {"eccentricity": {"value": 79.5e-6, "unit": "m", "std": 1e-6}},
            "evidence": {"log_evidence": 390.0, "over_runner_up": None, "runner_up": None,
                "indistinguishable_from": [], "detail": "run-out 79.5 µm"},
            "error_before": error(31.0, 9.0),
            "error_after": error(24.0, 7.5),
            "wear_depth_um_before": 180.0,
            "wear_depth_um_after": 180.0,
            "onset_revolutions": 0.0,
        },
        {
            "name": "misalignment",
            "status": "pinned",
            "parameters": {"lead_gap": {"value": 40.1e-6, "unit": "m", "std": 4.3e-6}},
            "evidence": {
                "log_evidence": 304.0, "over_runner_up": 134.0, "runner_up": "mesh_stiffness_loss",
                "indistinguishable_from": [], "detail": ""
            },
            "error_before": error(24.0, 7.5),
            "error_after": error(9.0, 2.5),
            "wear_depth_um_before": 180.0,
            "wear_depth_um_after": 152.0,
            "rul_revolutions_before": 9800.0,
            "rul_revolutions_after": 11400.0,
            "onset_revolutions": 4095.0,
        },
    ]  # fmt: skip
    turns = [revolutions * (i + 1) / windows for i in range(windows)]
    lines = [{"order": 19.0 * k, "frequency_hz": 190.0 * k, "measured": 9.0 / k, "before": 3.0 / k, "after": 0.4 / k}
             for k in range(1, 6)]  # fmt: skip
    bands = [
        {"harmonic": k, "frequency_hz": 190.0 * k, "measured": 20.0 / k, "before": 15.0 / k, "after": 19.5 / k,
         "residual_before": 6.0 / k, "residual_after": 1.0 / k}
        for k in range(1, 6)
    ]  # fmt: skip
    tracing = {
        "reason": None,
        "candidates": [
            {"name": "misalignment", "log_evidence": 304.0},
            {"name": "tooth_friction", "log_evidence": -2.0},
        ],
        "misfit_before": 4.2,
        "misfit_after": 0.13,
        "other_structure": False,
        "held_out": [2, 5],
        "fitted": [0, 1, 3, 4],
        "not_confirmed": [],
        "refused": {},
        "rejected": ["tooth_friction"],
        "errors": error(9.0, 2.5),
        "skipped": [],
        "depths": [
            {"index": i, "revolutions": n, "wear_depth_um_before": 0.03 * n, "wear_depth_um_after": 0.026 * n}
            for i, n in enumerate(turns)
        ],
        "residual": {"window": 5, "bands": bands, "orders": lines},
        "unknown": "",
        "log": [{"action": "found", "name": "misalignment", "window": 6, "revolutions": 7029.0, "log_evidence": 304.0}],
    }
    return {**report(revolutions, windows), "effects": effects, "tracing": tracing}


FAULT = {"kind": "gap", "channel": "accel/y6", "count": 3, "action": "degraded", "detail": "frames 12 to 14"}


def counts_of(store: SqlStore, asset: str, grade: str) -> dict:
    """The counts of windows with one more of a grade."""
    stored = store.asset(asset).making or {"windows": dict.fromkeys(("good", "degraded", "refused"), 0)}
    return {"windows": {**stored["windows"], grade: stored["windows"][grade] + 1}, "faults": [], "found": {}}


def take(store: SqlStore, board: AssetTable | None, asset: str, index: int, revolutions: float, **changes) -> bool:
    """One window into store and board, as the service does; False where it was there already."""
    grade, faults = changes.pop("quality", "good"), list(changes.pop("faults", ()))
    given = changes.pop("report", None) or report(revolutions, index + 1)
    entry = {**record(index, revolutions, **changes), "quality": grade, "faults": faults}
    if "status" in given["wear"]:
        unknown = ("rms_predicted", "error_percent", "rms_after", "wear_depth_um", "k_wear_per_n")
        entry.update(dict.fromkeys(unknown))
    happened = [("window", entry), ("rul", given["rul"])]
    if entry["updated"]:
        happened.append(("update", {"revolutions": revolutions, "k_wear_per_n": entry["k_wear_per_n"]}))
    happened += [("data_fault", fault) for fault in faults]
    start = START_NS + index * 600_000_000_000
    counts = counts_of(store, asset, grade)
    quality = received_quality({"accel/y6": {"frames": 40 * (index + 1), "duplicate": index}}, (), ())
    store.keep(asset, assembly={"closed_until_ns": start}, quality=quality)
    window = store.commit(
        asset, start, record=entry, state={"windows_seen": index + 1, "memory": {}}, report=given,
        making=counts, events=happened, received_ns=start,
    )  # fmt: skip
    if window is None:
        return False
    if board is not None:
        last = store.last_event_id(asset)
        board.add_window(
            asset, window, report=given, counts=counts, quality=quality, last_event_id=last, received_ns=start
        )
    return True


def campaign(store: SqlStore, board: AssetTable | None, asset: str = "unsw", windows: int = 14) -> None:
    """A campaign of calibration and measurement windows with one update and one degraded window."""
    rig = {
        "schema": "gear-rig/1",
        "name": "unsw",
        "gears": {"pinion": {"teeth": 19}, "gear": {"teeth": 52}},
        "end_of_life": {"max_depth": 5e-4},
    }
    store.keep_rig(asset, rig)
    if board is not None:
        board.update(asset, rig=rig)
    for index in range(windows):
        if index < 2:
            take(store, board, asset, index, 10.0 * (index + 1), kind="calibration")
        else:
            n = 18000.0 * (index - 1) / (windows - 2)
            bad = index == 6
            take(
                store, board, asset, index, n, updated=index == 5,
                quality="degraded" if bad else "good", faults=(FAULT,) if bad else (),
            )  # fmt: skip


def fill(store: SqlStore, data: Path) -> None:
    """Something in every table but the audit's, with the files in `data` that the rows name."""
    campaign(store, None)
    campaign(store, None, "other", windows=3)
    decide(store, "unsw", "misalignment", "pin", "Anna")
    inspect(store, "unsw", {"revolutions": 10.0}, {})
    jobs_of(store).add("unsw", "retired", {"by": "Anna"})
    Names(store.database).rename("other", "spindle")
    life = WindowJobs(store.database, data / SEGMENTS)
    assert life.add_waiting("other", life.write(SEGMENT))
    baselines = BaselineStore(store.database, data / BASELINES)
    path = baselines.new_path()
    path.write_bytes(b"a baseline")
    baselines.use("unsw", path.name, {"by": "Anna"})
    alarms = AlarmStore(store.database)
    alarms.keep_memory("unsw", alarms.memory("unsw"))
    alarms.enqueue("unsw", "http://127.0.0.1:9/", {"alarm": 1}, 1)
    alarms.keep_rules("other", [], {"by": "Anna", "note": "", "at": ""})
    keeper = AlarmKeeper(alarms)
    keeper.data("unsw", {"level": "stale", "reason": "no frame for 2 h"})
    assert keeper.open("unsw")


class Written:
    """A table of assets with what a test shows, written at once."""

    def add_window(self, asset: str, window, **changes):
        """Shows one committed window."""
        return self._show(
            (self.latest(asset) or Snapshot(asset=asset, label=asset)).with_window(window), stale=None, **changes
        )

    def update(self, asset: str, **changes):
        """Shows changes; those of what is kept are kept."""
        kept = {
            name: changes[name] for name in ("rig", "report", "question", "retired", "received_ns") if name in changes
        }
        with self._store.database.transaction():
            if kept:
                self._store.keep(asset, **kept)
            if "label" in changes and Names(self._store.database).label(asset) != changes["label"]:
                Names(self._store.database).rename(asset, changes["label"])
        if "unstored" in changes:
            self.note_unstored(changes.pop("unstored"))
        return self._show(self.latest(asset) or Snapshot(asset=asset, label=asset), **changes)

    def _show(self, snapshot, **changes):
        shown = replace(snapshot, **changes).with_whole()
        self.written(shown, self.write(shown))
        return shown


class WrittenTable(Written, AssetTable):
    """That of a service which takes in the windows of all assets."""

    def __init__(self, store, alarms=None) -> None:
        super().__init__(store, alarms or AlarmKeeper(AlarmStore(store.database)), most=None)
        self.load()


def scratch_table() -> WrittenTable:
    """A table of assets over a database of its own, which goes with it."""
    folder = mkdtemp()
    store = SqlStore(Path(folder) / "twin.sqlite")
    table = WrittenTable(store)
    weakref.finalize(table, lambda: (store.close(), shutil.rmtree(folder)))
    return table


def commit(commits: Commits, outcome: Outcome) -> None:
    """Commits an outcome that goes on from whatever is there."""
    while True:
        with suppress(Superseded):
            return commits.commit(outcome, None, Marks(commits._store.mark(outcome.asset), new_mark()))


def jobs_of(store) -> Jobs:
    """People's jobs in a store."""
    return Jobs(store.database)


def decide(store, asset: str, name: str, verb: str, by: str | None = None, note: str | None = None) -> int:
    """Submits a decision; its id."""
    return jobs_of(store).add(asset, DECISION, {"name": name, "verb": verb, "by": by, "note": note})


def inspect(store, asset: str, inspection: dict, answer: dict) -> int:
    """Submits a measured depth; its id."""
    return jobs_of(store).add(asset, INSPECTION, {"inspection": inspection, "answer": answer})


def decisions(store, asset: str) -> tuple[Job, ...]:
    return jobs_of(store).of(asset, DECISION)


def carry_out(store, job: Job, outcome: dict | None = None, events=(), **parts) -> bool:
    """Carries a job out, as the service does: once, with all that it changes."""
    with store.database.transaction():
        first = jobs_of(store).end(job, outcome)
        if first:
            store.keep(job.asset, **parts)
            store.note(job.asset, events)
        return first


def rename(store, board, asset: str, name: str) -> None:
    """Another name of an asset, as the service keeps and shows it."""
    jobs, names = jobs_of(store), Names(store.database)
    effect = {"asset": name, "was": names.label(asset)}
    with jobs.transaction():
        number = jobs.add(asset, "renamed", {"name": name})
        jobs.end(jobs.job(number), effect)
        names.rename(asset, name)
        store.note(asset, [("change", {"id": number, "kind": "renamed", "name": name, "effect": effect})])
    board.update(asset, label=name, last_event_id=store.last_event_id(asset))
