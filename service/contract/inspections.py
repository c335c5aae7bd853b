"""`wear.inspections`: measured depths that are part of the estimate, and what one more of them changed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from pydantic import Field

from service.contract.base import ContractModel
from service.contract.parts import Band
from service.contract.trend import is_available
from twin.assessment.key import MICROMETRE, PERCENT

if TYPE_CHECKING:  # a start of the service loads no part of the twin that computes
    from twin import assessment


class InspectedDepth(ContractModel):
    """A measured depth, and what the windows alone say of it."""

    revolutions: float
    flank: str
    max_depth_um: float
    std_um: float
    by_windows_um: Band = Field(description="of the same flank at the same revolutions")
    difference_in_std: float = Field(description="windows less inspection, in joint standard deviations")
    contradicts: bool = Field(description="whether they differ by more than their uncertainties allow")

    @classmethod
    def of(cls, compared: assessment.InspectedDepth) -> InspectedDepth:
        return cls(
            revolutions=compared.revolutions,
            flank=compared.flank,
            max_depth_um=compared.depth / MICROMETRE,
            std_um=compared.std / MICROMETRE,
            by_windows_um=Band.of(compared.by_windows, MICROMETRE),
            difference_in_std=compared.difference_in_std,
            contradicts=compared.contradicts,
        )


class Inspections(ContractModel):
    """Inspections that are part of the estimate."""

    depth_by_windows_um: Band = Field(description="combined depth now, without the inspections")
    k_by_windows_per_n: float | None = Field(description="Archard coefficient K without the inspections [1/N]")
    windows_wrong_percent: float = Field(
        description="probability that the windows' depths are off by more than their band says"
    )
    contradictions: list[str] = Field(description="one sentence for each inspection that contradicts the windows")
    compared: list[InspectedDepth]

    @classmethod
    def of(cls, result: assessment.InspectionResult) -> Inspections:
        return cls(
            depth_by_windows_um=Band.of(result.depth_by_windows, MICROMETRE),
            k_by_windows_per_n=result.coefficient_by_windows,
            windows_wrong_percent=result.windows_wrong / PERCENT,
            contradictions=[contradiction(c) for c in result.compared if c.contradicts],
            compared=[InspectedDepth.of(c) for c in result.compared],
        )


def contradiction(compared: assessment.InspectedDepth) -> str:
    """One inspection that contradicts the windows, as a sentence."""
    windows = compared.by_windows
    flank = "both flanks together" if compared.flank == "combined" else f"the {compared.flank}"
    median = 0.0 if windows.median is None else windows.median / MICROMETRE
    high = median if windows.p95 is None else windows.p95 / MICROMETRE
    return (
        f"The inspection at {compared.revolutions:,.0f} revolutions ({compared.depth / MICROMETRE:.1f} ± "
        f"{compared.std / MICROMETRE:.1f} µm on {flank}) contradicts the windows, which give {median:.1f} µm "
        f"({windows.p05 / MICROMETRE:.1f}–{high:.1f} µm) there: they differ by {abs(compared.difference_in_std):.1f} "
        "standard deviations. Either an effect that the twin lacks shifts its depths, or the inspection is of another "
        "tooth, flank or count. Both are kept, and the band covers both."
    )


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
