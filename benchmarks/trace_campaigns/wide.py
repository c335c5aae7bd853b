"""Campaigns on three machines: effects alone, in pairs and threes, unknown ones, faults of instruments, growth, wear.

`rows(1)` may be looked at while the tracing is worked on; later draws are looked at once, to judge by. Machines are
twice as far from their rig files as usual (`SPREADS_TWICE`), unless asked for otherwise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from benchmarks.trace_campaigns.levels import LEVELS
from benchmarks.trace_campaigns.table import CONTRACT_EFFECTS, Put, Row, merged

SPREADS_TWICE = 2.0
DRAWS_APART = 1_020_011  # between the seeds of two draws
ON = ("unsw", "pump", "spindle")
STEP = {"solver": {"step_rate_hz": 51200.0}}  # moves waveforms by 0.3 % of the usual step's, for half the time
LIFE = {"truth": {"to_end_of_life": True, "life_step_um": 1.0, "life_share": 0.9}}  # the last window near the end

_ONSETS = {
    ("misalignment", "large"): 0.55,
    ("tooth_friction", "medium"): 0.45,
    ("tooth_crack", "small"): 0.35,
    ("tooth_crack", "large"): 0.55,
    ("bearing_defect", "medium"): 0.42,
    ("sensor_gain", "medium"): 0.4,
}

PAIRS = (
    "misalignment medium, gear_eccentricity medium",
    "misalignment large 0.55, pinion_eccentricity large",
    "misalignment large, tooth_friction medium",
    "pitch_error medium, misalignment large",
    "pitch_error medium, tooth_friction large",
    "tooth_crack large 0.55, gear_eccentricity medium",
    "sensor_gain large, pinion_eccentricity medium",
    "profile_error large, gear_eccentricity large",
    "mass_unbalance large, misalignment medium",
    "torque_ripple large, pitch_error medium",
    "sensor_resonance large, misalignment large",
    "bearing_defect medium 0.4, pitch_error medium",
    "tooth_crack medium 0.45, bearing_defect large",
)
TRIPLES = (
    "misalignment large, gear_eccentricity large, tooth_friction large",
    "pitch_error medium, misalignment large, sensor_gain large",
    "pinion_eccentricity large, torque_ripple large, bearing_defect medium 0.45",
    "tooth_crack large 0.5, gear_eccentricity medium, misalignment medium",
    "profile_error large, mass_unbalance large, gear_eccentricity medium",
    "tooth_friction large, pitch_error large, pinion_eccentricity medium",
    "misalignment large 0.45, torque_ripple large, sensor_resonance large",
    "tooth_crack large 0.4, tooth_friction medium, bearing_defect large 0.6",
    "gear_eccentricity large, pinion_eccentricity large, misalignment large",
)

UNKNOWN_KINDS: dict[str, str] = {  # with the words of which one names the place
    "loose_bearing": "bearing|path",
    "drifting_tone": "drift",
    "second_mesh": "another machine|other machine|second machine|sideband",
    "shaft_rub": "rub|turn|shaft",
    "coupling_misalignment": "coupling|shaft",
    "loose_foot": "foundation|foot|loose|housing",
    "mains_interference": "mains|hum|electric",
}
INSTRUMENT_KINDS: dict[str, tuple[str, tuple[str, ...]]] = {  # place, and names that are no mistake
    "loose_accelerometer": ("accelerometer|accel|sensor|mount", ("sensor_gain", "sensor_resonance")),
    "time_shift": ("clock|time|shift|delay", ("sensor_resonance",)),
    "wrong_polarity": ("polarity|sign|accelerometer|accel|sensor", ("sensor_gain",)),
    "lost_encoder_line": ("encoder|count|line|edge", ()),
    "doubled_encoder_line": ("encoder|count|line|edge", ()),
}
LOOSE_NAMES = {"loose_foot": ("mass_unbalance",)}  # its cause is truly there


def _puts(text: str) -> tuple[Put, ...]:
    """Effects from "name level [onset], …"."""
    parts = [part.split() for part in text.split(",")]
    return tuple(Put(p[0], p[1], float(p[2]) if len(p) > 2 else 0.0) for p in parts)


def _singles() -> list[Row]:
    rows = []
    for i, name in enumerate(CONTRACT_EFFECTS):
        for j, level in enumerate(LEVELS):
            onset = _ONSETS.get((name, level), 0.0)
            rows.append(
                Row(
                    f"{name}-{j + 1}", 0, "single", (Put(name, level, onset),), windows=7 if onset else 6,
                    calibrated=(i + 2 * j) % 6 == 0, running_in=(i + j) % 7 == 3, two_conditions=(2 * i + j) % 4 == 1,
                    bench=ON[(i + j) % 3], group="with effects", extra=LIFE,
                )
            )  # fmt: skip
    return rows


def _several() -> list[Row]:
    rows = []
    for kind, texts in (("pair", PAIRS), ("triple", TRIPLES)):
        for i, text in enumerate(texts):
            puts = _puts(text)
            name = "+".join(put.name for put in puts)
            rows.append(
                Row(
                    name, 0, kind, puts, windows=7, bench=ON[i % 3], two_conditions=i % 4 == 3,
                    group="with effects", extra=LIFE,
                )
            )  # fmt: skip
    return rows


def _unknown() -> list[Row]:
    rows = []
    for i, (name, place) in enumerate(UNKNOWN_KINDS.items()):
        for j, level in enumerate(LEVELS):
            onset = 0.45 if (i + j) % 3 == 1 else 0.0
            rows.append(
                Row(
                    f"unknown-{name}-{j + 1}", 0, "unknown", (Put(name, level, onset),), windows=7 if onset else 6,
                    bench=ON[(i + j) % 3], two_conditions=name == "loose_bearing" or (i + j) % 4 == 2, place=place,
                    tolerated=LOOSE_NAMES.get(name, ()), extra=LIFE,
                )
            )  # fmt: skip
    return rows


def _instruments() -> list[Row]:
    rows = []
    for i, (name, (place, tolerated)) in enumerate(INSTRUMENT_KINDS.items()):
        for j, level in enumerate(LEVELS):
            onset = (0.0, 0.45, 0.0)[(i + j) % 3]
            rows.append(
                Row(
                    f"instrument-{name}-{j + 1}", 0, "instrument", (Put(name, level, onset),),
                    windows=7 if onset else 6, bench=ON[(i + j) % 3], place=place, tolerated=tolerated, extra=LIFE,
                )
            )  # fmt: skip
    return rows


def _growing() -> list[Row]:
    """Effects that grow, set in twice or begin late; onset and rate are scored."""
    twice = (Put("misalignment", "medium", 0.3), Put("misalignment", "medium", 0.65))
    drift = Put("sensor_gain", "small", 0.01, {"gain": 1.1}, full=1.0)  # ten windows, 1 % each
    what: tuple[tuple[str, tuple[Put, ...], str], ...] = (
        ("crack", (Put("tooth_crack", "large", 0.35, full=0.95),), "unsw"),
        ("crack", (Put("tooth_crack", "large", 0.25, full=0.9),), "spindle"),
        ("crack", (Put("tooth_crack", "large", 0.5, full=0.8),), "pump"),
        ("misalignment-twice", twice, "unsw"),
        ("misalignment-twice", twice, "pump"),
        ("gain-drift", (drift,), "unsw"),
        ("gain-drift", (drift,), "spindle"),
        ("bearing-late", (Put("bearing_defect", "large", 0.55, full=1.0),), "unsw"),
        ("bearing-late", (Put("bearing_defect", "large", 0.65, full=1.0),), "pump"),
        ("friction-rising", (Put("tooth_friction", "large", 0.2, full=0.9),), "spindle"),
    )
    return [
        Row(f"growth-{name}", 0, "growth", puts, windows=11, bench=bench, group="with effects", extra=LIFE)
        for name, puts, bench in what
    ]


def _wear() -> list[Row]:
    """Wear that differs between gears, along the face or from tooth to tooth; and by how the machine is run."""
    uneven: tuple[tuple[str, dict[str, Any], tuple[str, ...]], ...] = (
        ("pinion-only", {"gear_factor": 0.05}, ()),
        ("gear-only", {"pinion_factor": 0.05, "gear_factor": 3.0}, ()),
        ("one-end", {"face_gradient": 0.8}, ("misalignment",)),
        ("one-end-half", {"face_gradient": -0.4}, ("misalignment",)),
        ("tooth-to-tooth", {"tooth_scatter": 0.15}, ("pitch_error",)),
        ("tooth-to-tooth-much", {"tooth_scatter": 0.35}, ("pitch_error",)),
    )
    rows = [
        Row(
            f"wear-{name}", 0, "wear", windows=8, bench=ON[i % 3], tolerated=tolerated, group="uneven wear",
            given_names=(), extra=merged(LIFE, {"wear": wear, "machine": {"slices": 7}}),
        )
        for i, (name, wear, tolerated) in enumerate(uneven * 2)
    ]  # fmt: skip
    for i in range(4):
        bench = ON[i % 3]
        rows += [
            _run("constant", bench),
            _run("running-in", bench, running_in=True),
            _run("step", bench, stepped=True),
            _run("drift", bench, {"sensors": {"encoder_drift_um": 5.0, "torque_drift_nm": 0.12}}),
            _run("changing", bench, two_conditions=True),
        ]
    return rows


def _run(group: str, bench: str, extra: dict[str, Any] | None = None, *, stepped: bool = False, **more: Any) -> Row:
    """A sound machine whose depth and life are followed."""
    return Row(
        f"life-{group}", 0, "life", windows=10, bench=bench, group=group, extra=merged(LIFE, extra or {}),
        stepped=stepped, **more,
    )  # fmt: skip


def _ramps() -> list[Row]:
    """Windows in which speed or torque rises by tens of per cent, among steady ones and alone."""
    some = {"windows": {"speed_rise": [0.0, 0.3, 0.0, -0.25, 0.0, 0.4]}}
    every = {"windows": {"speed_rise": [0.2, 0.3, 0.35, 0.25, 0.4, 0.3]}}
    loaded = {"windows": {"torque_rise": [0.0, 0.3, 0.2, 0.3, -0.3, 0.4]}}
    rows = [
        Row(f"ramp-{name}", 0, "ramp", bench=bench, group="ramps", given_names=(), extra=merged(LIFE, extra))
        for name, extra in (("some", some), ("every", every), ("torque", loaded))
        for bench in ON
    ]
    effects = (Put("gear_eccentricity", "large"), Put("misalignment", "large"), Put("pitch_error", "large"))
    return rows + [
        Row(f"ramp-{put.name}", 0, "single", (put,), bench=bench, group="ramps", extra=merged(LIFE, some))
        for put, bench in zip(effects, ON, strict=True)
    ]


def _operating_points() -> list[Row]:
    """Effects that are alike at one speed and load: at one operating point, and at two."""
    what = (
        Put("mesh_stiffness_loss", "large"),
        Put("mesh_damping", "large"),
        Put("misalignment", "medium"),
        Put("tooth_friction", "small"),
    )
    return [
        Row(
            f"points-{1 + two}-{put.name}", 0, "points", (put,), bench=bench, two_conditions=bool(two),
            group="with effects", extra=LIFE,
        )
        for put in what
        for bench in ON
        for two in (0, 1)
    ]  # fmt: skip


POOR = {"sensors": {"gear_graduation_um": [3.5, 1.2, 0.6, 0.4]}}
CLEAN: tuple[tuple[str, dict[str, Any]], ...] = (  # name, what the row has of its own
    ("", {}),
    ("calibrated", {"calibrated": True}),
    ("running-in", {"running_in": True}),
    ("two-conditions", {"two_conditions": True}),
    ("two-conditions-calibrated", {"two_conditions": True, "calibrated": True}),
    ("poor-discs", {"extra": POOR}),
    ("no-gear-encoder", {"extra": {"sensors": {"missing": ["encoder/gear"]}}}),
    ("no-torque", {"extra": {"sensors": {"missing": ["torque/pinion"]}}}),
    ("encoder-drift", {"extra": {"sensors": {"encoder_drift_um": -5.0, "drift_revolutions": 3000.0}}}),
    ("torque-drift", {"extra": {"sensors": {"torque_drift_nm": 0.2}}}),
    ("restless", {"extra": {"drive": {"speed_wander": 0.003, "torque_wander": 0.012}}}),
    ("lost-frames", {"extra": {"faults": [{"kind": "lost", "window": 2, "channel": "encoder/gear", "count": 1}]}}),
)
CLEAN_ROWS = 204


def clean(draw: int = 1) -> tuple[Row, ...]:
    """Campaigns without effects, of three machines and both spreads, short and without a march to their end."""
    short = {**STEP, "truth": {"to_end_of_life": False}, "windows": {"seconds": 2.0}}
    rows = []
    for i in range(CLEAN_ROWS):
        what, own = CLEAN[i % len(CLEAN)]
        rows.append(
            Row(
                f"Z{i + 1:03d}-clean{'-' + what if what else ''}", 9_900_000 + 37 * i + draw * DRAWS_APART, "clean",
                windows=5, bench=ON[(i // len(CLEAN)) % 3], spreads=1.0 + (i // 36) % 2, group="clean",
                **{**own, "extra": merged(short, own.get("extra", {}))},
            )
        )  # fmt: skip
    return tuple(rows)


def rows(draw: int = 1) -> tuple[Row, ...]:
    """The set of one draw, 1 or more."""
    rows = [*_singles(), *_several(), *_unknown(), *_instruments(), *_growing(), *_wear(), *_ramps()]
    return _numbered([*rows, *_operating_points()], draw)


def _numbered(named: Sequence[Row], draw: int) -> tuple[Row, ...]:
    return tuple(
        replace(
            row,
            name=f"N{i:03d}-{row.name}",
            seed=8_800_000 + 37 * i + draw * DRAWS_APART,
            extra=merged(STEP, row.extra),
        )
        for i, row in enumerate(named, start=1)
    )
