"""Campaigns to work on: thresholds and priors may be set by these."""

from __future__ import annotations

from benchmarks.trace_campaigns.table import CONTRACT_EFFECTS, Put, Row

_MEDIUM_ONSETS = {"tooth_crack": 0.45}


def _singles() -> list[Row]:
    """Every effect at medium size."""
    return [
        Row(
            f"T{i:02d}-{name}-2",
            41000 + 7 * i,
            "single",
            (Put(name, "medium", _MEDIUM_ONSETS.get(name, 0.0)),),
            windows=7 if name in _MEDIUM_ONSETS else 6,
            calibrated=i % 5 == 4,
        )
        for i, name in enumerate(CONTRACT_EFFECTS, start=1)
    ]


def _clean() -> list[Row]:
    return [
        Row("T16-clean", 41201, "clean"),
        Row("T17-clean-running-in", 41208, "clean", running_in=True),
        Row("T18-clean-two-conditions", 41213, "clean", windows=7, two_conditions=True, calibrated=True),
        Row("T19-clean-drift", 41220, "clean", extra={"sensors": {"encoder_drift_um": 4.0, "torque_drift_nm": 0.1}}),
        Row("T20-clean-no-gear-encoder", 41227, "clean", extra={"sensors": {"missing": ["encoder/gear"]}}),
        Row("T21-clean-damping", 41234, "clean", extra={"machine": {"damping_spread": 0.35}}),
    ]


def _pairs() -> list[Row]:
    def pair(name: str, seed: int, one: Put, two: Put, windows: int = 6) -> Row:
        return Row(name, seed, "pair", (one, two), windows=windows)

    return [
        pair(
            "T22-misalignment+gear_eccentricity", 41301, Put("misalignment", "medium"),
            Put("gear_eccentricity", "large"),
        ),
        pair("T23-misalignment+friction", 41308, Put("misalignment", "medium"), Put("tooth_friction", "medium")),
        pair("T24-pitch+misalignment", 41315, Put("pitch_error", "medium"), Put("misalignment", "large")),
        pair("T25-pitch+friction", 41322, Put("pitch_error", "medium"), Put("tooth_friction", "medium")),
        pair(
            "T26-crack+pinion_eccentricity", 41329, Put("tooth_crack", "large", 0.45),
            Put("pinion_eccentricity", "medium"), 7,
        ),
        pair("T27-gain+gear_eccentricity", 41336, Put("sensor_gain", "medium"), Put("gear_eccentricity", "medium")),
        pair(
            "T28-friction+gear_eccentricity", 41343, Put("tooth_friction", "large"),
            Put("gear_eccentricity", "large"),
        ),
        pair(
            "T29-unbalance+gain", 41350, Put("mass_unbalance", "large"), Put("sensor_gain", "medium"),
        ),
    ]  # fmt: skip


def _unknown() -> list[Row]:
    return [
        Row("T30-unknown-mains", 41401, "unknown", (Put("mains_interference", "medium", 0.3),), windows=7),
        Row("T31-unknown-order_tone", 41408, "unknown", (Put("order_tone", "medium"),)),
        Row("T32-unknown-level_modulation", 41415, "unknown", (Put("level_modulation", "medium"),)),
        Row("T33-unknown-random_impacts", 41422, "unknown", (Put("random_impacts", "medium", 0.4),), windows=7),
    ]


def _levels() -> list[Row]:
    """Other sizes of what is hard, and effects that set in."""
    put = (
        ("misalignment", "small", 0.0), ("misalignment", "large", 0.55), ("tooth_friction", "small", 0.0),
        ("tooth_friction", "medium", 0.45), ("tooth_crack", "small", 0.4), ("tooth_crack", "large", 0.0),
        ("pitch_error", "small", 0.0), ("gear_eccentricity", "small", 0.0), ("pinion_eccentricity", "large", 0.0),
        ("bearing_defect", "small", 0.45), ("sensor_gain", "small", 0.0), ("sensor_gain", "large", 0.55),
        ("profile_error", "large", 0.0), ("mesh_stiffness_loss", "large", 0.0),
    )  # fmt: skip
    return [
        Row(
            f"T{i}-{name}-{1 if level == 'small' else 3 if level == 'large' else 2}{'-onset' if onset else ''}",
            41500 + 7 * i,
            "single",
            (Put(name, level, onset),),
            windows=7 if onset else 6,
        )
        for i, (name, level, onset) in enumerate(put, start=34)
    ]


def _weak() -> list[Row]:
    """More of what was told least well, other draws and sizes."""
    put = (
        ("bearing_defect", "medium", 0.0), ("bearing_defect", "large", 0.0), ("torque_ripple", "medium", 0.0),
        ("torque_ripple", "large", 0.0), ("mass_unbalance", "large", 0.0), ("tooth_crack", "medium", 0.45),
        ("pitch_error", "large", 0.0), ("mesh_stiffness_loss", "large", 0.0), ("mesh_damping", "large", 0.0),
    )  # fmt: skip
    singles = [
        Row(
            f"T{i}-{name}-{3 if level == 'large' else 2}",
            42000 + 7 * i,
            "single",
            (Put(name, level, onset),),
            windows=7 if onset else 6,
        )
        for i, (name, level, onset) in enumerate(put, start=48)
    ]
    discs = {"sensors": {"gear_graduation_um": [3.0, 1.4, 0.5, 0.4]}}
    both = (Put("bearing_defect", "medium"), Put("pitch_error", "medium"))
    return [
        *singles,
        Row("T57-clean-poor-discs", 42415, "clean", extra=discs),
        Row("T58-bearing+pitch", 42422, "pair", both),
    ]


ROWS: tuple[Row, ...] = (*_singles(), *_clean(), *_pairs(), *_unknown(), *_levels(), *_weak())
