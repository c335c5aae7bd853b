"""Campaigns to judge by. ROWS have been looked at since; what is changed after that is judged by a fresh draw alone."""

from __future__ import annotations

from dataclasses import replace

from benchmarks.trace_campaigns.levels import LEVELS
from benchmarks.trace_campaigns.table import CONTRACT_EFFECTS, Put, Row

_ONSETS = {
    ("misalignment", "large"): 0.55,
    ("tooth_friction", "medium"): 0.45,
    ("tooth_crack", "small"): 0.35,
    ("tooth_crack", "large"): 0.55,
    ("bearing_defect", "medium"): 0.42,
    ("sensor_gain", "medium"): 0.4,
}
_GIVEN = {("tooth_crack", "medium"): {"shaft": "gear", "tooth": 31}}


def _singles() -> list[Row]:
    """Every effect at three sizes; some begin in mid-campaign, some campaigns change their condition."""
    rows = []
    for i, name in enumerate(CONTRACT_EFFECTS):
        for j, level in enumerate(LEVELS):
            onset = _ONSETS.get((name, level), 0.0)
            rows.append(
                Row(
                    f"J{3 * i + j + 1:02d}-{name}-{j + 1}",
                    730000 + 37 * (3 * i + j),
                    "single",
                    (Put(name, level, onset, _GIVEN.get((name, level), {})),),
                    windows=7 if onset else 5 + (i + j) % 3,
                    calibrated=(i + 2 * j) % 5 == 0,
                    running_in=(i + j) % 7 == 3,
                    two_conditions=(2 * i + j) % 6 == 4,
                )
            )
    return rows


def _pairs() -> list[Row]:
    def put(text: str) -> Put:
        name, level, *onset = text.split()
        return Put(name, level, float(onset[0]) if onset else 0.0)

    pairs = (
        ("misalignment medium", "gear_eccentricity medium"),
        ("misalignment large 0.55", "gear_eccentricity large"),
        ("misalignment large", "tooth_friction medium"),
        ("pitch_error medium", "misalignment large"),
        ("pitch_error medium", "tooth_friction large"),
        ("tooth_crack large 0.55", "gear_eccentricity medium"),
        ("sensor_gain medium", "pinion_eccentricity medium"),
        ("tooth_friction medium", "gear_eccentricity large"),
        ("mass_unbalance large", "misalignment medium"),
        ("pitch_error medium", "gear_eccentricity large"),
        ("sensor_gain large", "misalignment large"),
        ("bearing_defect medium 0.4", "pitch_error medium"),
    )
    return [
        Row(
            f"J{46 + i}-{'+'.join(text.split()[0] for text in both)}",
            741000 + 37 * i,
            "pair",
            (put(both[0]), put(both[1])),
            windows=7 if any(len(text.split()) > 2 for text in both) else 6,
        )
        for i, both in enumerate(pairs)
    ]


def _unknown() -> list[Row]:
    put = (
        Put("mains_interference", "small", 0.3),
        Put("mains_interference", "large"),
        Put("order_tone", "medium", 0.45),
        Put("order_tone", "large"),
        Put("level_modulation", "large"),
        Put("random_impacts", "large", 0.55),
        Put("rub", "medium"),
        Put("rub", "large", 0.4),
    )
    return [
        Row(f"J{58 + i}-unknown-{p.name}", 752000 + 37 * i, "unknown", (p,), windows=7 if p.onset else 6)
        for i, p in enumerate(put)
    ]


def _clean() -> list[Row]:
    def row(number: int, what: str, **more) -> Row:
        return Row(f"J{number}-clean{what}", 763000 + 37 * number, "clean", **more)

    lost = [
        {"kind": "lost", "window": 2, "channel": "encoder/gear", "count": 1},
        {"kind": "disorder", "window": 3, "channel": "accel/y6", "count": 2},
        {"kind": "lost", "window": 4, "channel": "accel/y6", "count": 2},
    ]
    return [
        row(66, ""),
        row(67, "", windows=7),
        row(68, "-calibrated", calibrated=True),
        row(69, "-running-in", running_in=True),
        row(70, "-running-in-calibrated", running_in=True, calibrated=True, windows=7),
        row(71, "-two-conditions", two_conditions=True, windows=7),
        row(72, "-two-conditions-running-in", two_conditions=True, running_in=True),
        row(73, "-lost-frames", extra={"faults": lost}),
        row(74, "-no-gear-encoder", extra={"sensors": {"missing": ["encoder/gear"]}}),
        row(75, "-no-torque", extra={"sensors": {"missing": ["torque/pinion"]}}),
        row(76, "-encoder-drift", extra={"sensors": {"encoder_drift_um": -6.0, "drift_revolutions": 3000.0}}),
        row(77, "-torque-drift", extra={"sensors": {"torque_drift_nm": 0.25}}),
        row(78, "-poor-discs", extra={"sensors": {"gear_graduation_um": [3.5, 1.2, 0.6, 0.4]}}),
        row(79, "-restless", extra={"drive": {"speed_wander": 0.003, "torque_wander": 0.012}}),
    ]


ROWS: tuple[Row, ...] = (*_singles(), *_pairs(), *_unknown(), *_clean())

DRAWS_APART = 1_010_009  # between the seeds of two draws


def fresh(draw: int = 1) -> tuple[Row, ...]:
    """The same campaigns in another draw of machines and sizes, 1 or more.

    A draw is looked at once: whoever changes the tracing because of it judges by the next one.
    """
    return tuple(replace(row, name=f"L{row.name[1:]}", seed=row.seed + draw * DRAWS_APART) for row in ROWS)
