"""What a measured depth has changed of an estimate."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import Field

from service.contract.base import ContractModel
from service.contract.overview import is_available
from service.contract.parts import Band

BY_LEVEL = (
    "the depth of this machine comes from a relation of vibration level and depth: add the inspection to the series "
    "that the relation is learned from, and learn it again (gear-twin relate)"
)


class Change(ContractModel):
    """A quantity before and after an inspection; null where it was not available."""

    before: Band | None
    after: Band | None


class CoefficientChange(ContractModel):
    """The wear coefficient before and after an inspection [1/N]."""

    before: float | None
    after: float | None


class Changes(ContractModel):
    """What an inspection changed."""

    depth_um: Change = Field(description="combined depth now")
    k_wear_per_n: CoefficientChange
    rul_hours: Change
    rul_revolutions: Change


def refusal(reason: str) -> dict[str, Any]:
    """The keys of an inspection that changed nothing."""
    return {"applied": False, "reason": reason, "changed": None, "contradiction": None}


def outcome_of(
    inspection: Mapping[str, Any], before: Mapping[str, Any] | None, after: Mapping[str, Any]
) -> dict[str, Any]:
    """What an inspection changed, as keys of its answer: `applied`, `reason`, `changed` and `contradiction`.

    before, after  reports of the asset
    """
    wear = after.get("wear")
    result = wear.get("inspections") if isinstance(wear, Mapping) else None
    if not result:
        reason = BY_LEVEL
        if not is_available(wear):
            why = (wear or {}).get("reason", "no window has been assessed yet")
            reason = f"kept, and used from the first window that gives a depth by the model; until now {why}"
        return refusal(reason)
    own = next(
        (
            sentence
            for sentence, one in zip(
                result["contradictions"], [c for c in result["compared"] if c["contradicts"]], strict=True
            )
            if all(one[key] == inspection[key] for key in ("revolutions", "flank", "max_depth_um", "std_um"))
        ),
        None,
    )
    return {"applied": True, "reason": None, "changed": _changes(before or {}, after), "contradiction": own}


def _changes(before: Mapping[str, Any], after: Mapping[str, Any]) -> dict[str, Any]:
    def pair(part: str, *keys: str) -> dict[str, Any]:
        return {"before": _value(before, part, *keys), "after": _value(after, part, *keys)}

    return {
        "depth_um": pair("wear", "max_depth_um", "combined"),
        "k_wear_per_n": pair("wear", "k_wear_per_n"),
        "rul_hours": pair("rul", "hours"),
        "rul_revolutions": pair("rul", "revolutions"),
    }


def _value(report: Mapping[str, Any], *keys: str) -> Any:
    value: Any = report
    for key in keys:
        value = value.get(key) if isinstance(value, Mapping) else None
    return value
