"""The answer about one asset, by the contract's section 4: the same from `assess` and from the service."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from typing import Any

from pydantic import Field

from service.contract.alarms import AlarmCount
from service.contract.base import ContractModel, not_available
from service.contract.parts import NotAvailable, Tracing, Unexplained, Wear, json_of
from service.contract.shape import Made, made_of
from service.contract.status import (
    Added,
    Backlog,
    DataStatus,
    Question,
    Retired,
    Status,
    Unstored,
    asked,
    data_of,
    none_yet,
    of_wear_alone,
    shown,
    shown_question,
)
from service.contract.window import WindowRecord
from twin import assessment
from twin.rig import Rig

SCHEMA_VERSION = 2
SECTIONS = ("wear", "rul", "residual", "effects", "unexplained", "calibration", "tracing")
NO_WINDOW = "no window has been assessed by the twin yet"
NO_WHOLE_WINDOW = "no whole measurement window has been received yet"


class RigSummary(ContractModel):
    """The rig file in use, in short."""

    name: str
    mesh_stiffness: str = Field(description="potential-energy method, or given in the rig file")
    notes: list[str] = Field(description="values that the file states twice and differently, a sentence each")

    @classmethod
    def of(cls, rig: Rig) -> RigSummary:
        return _summary(rig.text)


@lru_cache(maxsize=16)
def _summary(text: str) -> RigSummary:
    """Kept by the file's values: the notes on wear take half a second."""
    from twin.rig_notes import rig_notes

    rig = Rig.from_mapping(json.loads(text))
    return RigSummary(name=rig.name, mesh_stiffness=rig.mesh_stiffness_source, notes=list(rig_notes(rig)))


@made_of(assessment.Assessment)
class Asset(Made):
    """The whole state of one asset, the same as `gear-twin assess` writes."""

    schema_version: int
    asset: str
    status: Status
    data: DataStatus = Field(description="whether usable data come; separate from the machine's health")
    question: Question | None = Field(default=None, description="that people have to answer; windows may wait for it")
    epoch: int = Field(default=0, description="number of the present gears: from 0, up by one when they are replaced")
    retired: Retired | None = Field(default=None, description="null while the asset is in use")
    storage: Unstored | None = Field(default=None, description="null while results can be stored")
    last_seen: str | None = Field(
        default=None, description="when the newest frame or window came, ISO 8601, by the service's clock"
    )
    windows: list[WindowRecord] = Field(description="the service carries the latest 100; `assess` all of them")
    windows_total: int
    wear: Wear | NotAvailable
    unexplained: Unexplained | NotAvailable
    tracing: Tracing | NotAvailable
    alarms: AlarmCount | None = Field(default=None, description="open alarms; of the service")
    data_quality: dict[str, Any]
    rig: RigSummary | None = Field(default=None, description="the rig file in short; of `gear-twin assess`")


def report_of(found: assessment.Assessment, status: Status) -> dict[str, Any]:
    """The parts of the answer that an assessment gives, as JSON data."""
    return {"status": status.as_json(), **json_of(found)}


def health_of(
    report: Mapping[str, Any] | None,
    records: Sequence[Mapping[str, Any]],
    stale: tuple[str, str] | None = None,
    added: Sequence[Added] = (),
    backlog: Backlog | None = None,
) -> tuple[dict[str, Any], dict[str, Any]]:
    """`status` and `data` as they are shown; the arguments are those of `assemble`."""
    data = data_of(records, stale, NO_WHOLE_WINDOW, backlog)
    status = (report or {}).get("status") or none_yet(NO_WINDOW, backlog)
    return shown(status, data, added, records), data.as_json()


def assemble(
    asset: str,
    records: Iterable[Mapping[str, Any]],
    report: Mapping[str, Any] | None,
    quality: Mapping[str, Any],
    windows_total: int | None = None,
    stale: tuple[str, str] | None = None,
    added: Sequence[Added] = (),
    question: Mapping[str, Any] | None = None,
    epoch: int = 0,
    retired: Mapping[str, Any] | None = None,
    backlog: Backlog | None = None,
) -> dict[str, Any]:
    """The whole answer: window records, the twin's newest report and the data quality.

    windows_total  how many windows there are, where `records` are the latest of them only
    stale          why no whole window has come for longer than the service allows, and since when; None where one has
    added          what the service found besides the assessment: active alarms
    question       that people have to answer; None where none is open
    epoch          number of the present gears, from 0
    retired        since when the asset is out of use, and by whom; None while it is in use
    backlog        the windows that wait to be assessed; None where none does
    """
    blank = {name: [] if name == "effects" else not_available(NO_WINDOW) for name in SECTIONS}
    if report is not None:
        blank["tracing"] = not_available("no search for effects has been made in this asset's windows")
    windows = list(records)
    parts = {**blank, **(report or {})}
    parts.pop("status", None)
    status, data = health_of(report, windows, stale, (*added, *asked(question)), backlog)
    if "hours" in parts["rul"] and of_wear_alone(status):
        parts["rul"] = {**parts["rul"], "of_wear_alone": True}
    return {
        "schema_version": SCHEMA_VERSION,
        "asset": asset,
        "status": status,
        "data": data,
        "question": shown_question(question),
        "epoch": epoch,
        "retired": None if retired is None else dict(retired),
        "windows": windows,
        "windows_total": len(windows) if windows_total is None else windows_total,
        **parts,
        "data_quality": dict(quality),
    }
