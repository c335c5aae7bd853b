"""What tracing found, in the names of the interface contract; JSON-safe data."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from twin.tracing.state import Tracing, TwinStage, parameters_of, relevant

MICRO = 1e6
STRONGEST = 8


def effects_report(tracing: Tracing) -> list[dict[str, Any]]:
    """`effects[]`: each with its parameters, evidence, and errors, depth and life without and with it."""
    out = []
    for i, item in enumerate(tracing.found):
        without, present = (_stage(tracing, n) for n in (i, i + 1))
        before, after = (
            tracing.errors[n] if n < len(tracing.errors) else {"rms_percent": None, "waveform_percent": None}
            for n in (i, i + 1)
        )
        out.append(
            {
                "name": item.name,
                "status": tracing.decisions.get(item.name, "found"),
                "parameters": parameters_of(item),
                "evidence": {
                    "log_evidence": item.log_evidence,
                    "over_runner_up": item.over_runner_up,
                    "runner_up": item.runner_up,
                    "not_told_from": list(item.alike),
                    "detail": item.detail,
                },
                "error_before": dict(before),
                "error_after": dict(after),
                "wear_depth_um_before": None if without is None else without.depth * MICRO,
                "wear_depth_um_after": None if present is None else present.depth * MICRO,
                "rul_revolutions_before": None if without is None else without.life,
                "rul_revolutions_after": None if present is None else present.life,
                "onset_revolutions": item.addition.onset_revolutions,
            }
        )
    return out


def _stage(tracing: Tracing, count: int) -> TwinStage | None:
    """The twin with so many of the effects; None where no twin can be built."""
    return tracing.stages[len(relevant(tracing.found[:count]))] if tracing.stages else None


def tracing_report(tracing: Tracing) -> dict[str, Any]:
    """`tracing`: what the effects rest on, and what the twin would say without them."""
    standing = tracing.standing
    alone = tracing.stages[0].depths if tracing.stages else {}
    now = tracing.stages[-1].depths if tracing.stages else {}
    turns = {t.index: t.features.revolutions for t in tracing.history}
    return {
        "reason": standing.get("reason"),
        "candidates": [{"name": name, "log_evidence": gain} for name, gain in standing.get("candidates", [])],
        "misfit_before": standing.get("misfit_before"),
        "misfit_after": standing.get("misfit_after"),
        "other_structure": standing.get("other_structure", False),
        "held_out": list(standing.get("held_out", [])),
        "fitted": list(standing.get("fitted", [])),
        "not_confirmed": sorted(standing.get("unbelieved", {})),
        "rejected": list(tracing.rejected),
        "depths": [
            {
                "index": i,
                "revolutions": turns[i],
                "wear_depth_um_before": alone[i] * MICRO,
                "wear_depth_um_after": now[i] * MICRO,
            }
            for i in now
            if i in alone and i in turns
        ],
        "residual": tracing.residual,
        "unknown": tracing.unknown,
        "log": [dict(entry) for entry in tracing.log],
    }


def unexplained_with(tracing: Tracing, plain: Mapping[str, Any]) -> dict[str, Any]:
    """`unexplained` with what no effect of the table explains; `plain` is what is said without tracing."""
    if not tracing.unknown:
        return dict(plain)
    strange = [dict(line) for line in tracing.strange]
    share = sum(line["share_percent"] for line in strange)
    orders = [*strange, *(plain.get("orders") or [])][: max(len(strange), STRONGEST)]
    return {
        **plain,
        "share_percent": max(share, plain.get("share_percent") or 0.0),
        "orders": orders,
        "verdict": "unknown_effect",
        "reason": "; ".join(part for part in (tracing.unknown, plain.get("reason")) if part),
    }
