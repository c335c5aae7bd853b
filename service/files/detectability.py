"""What the simulated healthy machines of a rig say, kept in a file: thresholds and detection limits.

A file is JSON and names the values of the rig file that it belongs to. It is used for machines with these values alone.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from service.errors import InputError
from service.file_faults import json_of_file
from service.json_text import json_text, plain, write_text
from twin.required_evidence import NullEvidence

if TYPE_CHECKING:
    from twin.detectability.study import Study
    from twin.rig import Rig

SCHEMA = "gear-detectability/1"


def answer(rig: Rig, study: Study) -> dict[str, Any]:
    """A study of a rig as plain data."""
    required = study.required
    return plain(
        {
            "schema": SCHEMA,
            "rig": rig.name,
            "rig_digest": rig.digest,
            "false_alarm_rate": required.rate,
            "conditions": [{"speed_hz": c.speed_hz, "torque_nm": c.torque} for c in study.campaign.conditions],
            "wear_depth_um": 1e6 * study.campaign.depth,
            "window_seconds": study.campaign.instruments.seconds,
            "channels": ["accelerometer", *study.campaign.instruments.channels],
            "healthy_campaigns": study.nulls.campaigns,
            "not_simulated": study.failed,
            "false_alarms": {
                name: {"evidence": list(found), "required_evidence": required.by_effect[name]}
                for name, found in study.nulls.found.items()
            },
            "detection_limits": [
                {
                    "name": limit.name,
                    "parameter": limit.parameter,
                    "unit": limit.unit,
                    "value": limit.value,
                    "within_factor": limit.factor,
                    "largest_tried": limit.largest,
                    "note": limit.note,
                }
                for limit in study.limits
            ],
        }
    )


def save(rig: Rig, study: Study, path: Path) -> None:
    write_text(path, json_text(answer(rig, study)))


def read_nulls(path: Path) -> tuple[str, NullEvidence]:
    """Digest of the rig that a file belongs to, and what its healthy machines show; InputError."""
    data = json_of_file(path, "a file of `gear-twin detectability`")
    try:
        if data["schema"] != SCHEMA:
            raise InputError(f"{path}: schema = {data['schema']!r} must be {SCHEMA!r}")
        found = {str(n): tuple(float(e) for e in known["evidence"]) for n, known in data["false_alarms"].items()}
        return str(data["rig_digest"]), NullEvidence(campaigns=int(data["healthy_campaigns"]), found=found)
    except (KeyError, TypeError, AttributeError, ValueError):
        raise InputError(f"{path}: not a file of `gear-twin detectability`") from None
