"""The relation of level and wear depth: fitted to a series of cases, kept in a file, and described as plain data.

A relation file is JSON: the curve of every operating condition, gains, backgrounds and scatters, the depths that they
hold for, and what they are of: asset, causes beside the twin, and sensor and band where the series states them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from service.errors import InputError
from service.file_faults import json_of_file
from service.files.series import Series
from service.json_text import json_text, plain, write_text
from twin.errors import ParameterError
from twin.levels.left_out import Errors, spline
from twin.levels.relation import MODEL, Z95, Origin, Relation, common_variance, falling_region, fit
from twin.levels.trials import Progress, Tried, try_all
from twin.levels.wear_by_level import bounds_reason, not_stated

SCHEMA = "gear-relation/1"
DRAWN = 200  # points of a drawn curve


def tried_on(series: Series, draws: int, progress: Progress = lambda share, doing: None) -> Tried:
    """Every cause of the model's errors, and the cases alone, on a series; errors as `try_all`."""
    return try_all(
        series.rig,
        series.conditions,
        series.cases,
        quantities=series.quantities,
        stated=series.stated,
        spreads=series.estimated,
        draws=draws,
        progress=progress,
    )


def answer(series: Series, tried: Tried) -> dict[str, Any]:
    """The causes that were tried, what was chosen, and the relation, as plain data."""
    return plain(
        {
            "asset": series.asset,
            "description": series.description,
            "notes": series.notes,
            "records": series.records,
            "estimated": {k: {"value": series.rig.get(k), "factor": f} for k, f in series.estimated.items()},
            "conditions": {
                k: {"speed_hz": c.speed_hz, "torque_nm": c.torque}
                for k, c in series.conditions.items()
                if k in tried.cases.level
            },
            "sensor": {"name": series.sensor, "band_hz": series.band, "note": not_stated(_origin(series, tried))},
            "cases": [_case(tried, i) for i in range(len(tried.cases.name))],
            "trials": [
                {"name": t.name, "said": t.said, "log_evidence": t.gain, "cause": t.cause} | _errors(t.errors)
                for t in tried.trials
            ],
            "chosen": _chosen(tried),
            "basis": _basis(tried),
            "judged": {name: _errors(e) for name, e in tried.judged.items()},
            "few": {name: {k: 100 * v for k, v in e.items()} for name, e in tried.few.items()},
            "estimated_spread": {k: [100 * x for x in v] for k, v in tried.spread.items()},
            "draws": tried.draws,
            "floor": {k: _floor(tried, k) for k in tried.cases.level},
            "relation": _relation(tried),
            "assembly_std_percent": 100
            * float(np.sqrt(common_variance(tried.relation.covariance([*tried.cases.level])))),
            "depths": _depths(tried),
            "curves": _curves(tried),
        }
    )


def _case(tried: Tried, i: int) -> dict[str, Any]:
    """One assembly with its levels, and the error that the relation of all others makes where it is worn."""
    cases = tried.cases
    errors: dict[str, float | None] = dict.fromkeys(cases.level)
    if cases.worn[i]:
        place = int(cases.worn[:i].sum())
        errors = {k: 100 * float(e[place]) for k, e in tried.left.relative.items()}
    return {
        "name": cases.name[i],
        "depth_um": 1e6 * cases.depth[i],
        "level": {k: v[i] for k, v in cases.level.items()},
        "scatter": {k: v[i] for k, v in cases.scatter.items()},
        "error_percent": errors,
    }


def _chosen(tried: Tried) -> dict[str, Any]:
    """The causes that were chosen, and how often they are chosen without one of the cases."""
    return {
        "causes": ["background", *tried.choice.causes],
        "best_combination": ["background", *tried.best.causes],
        "log_evidence": tried.gain,
        "without_a_case": {
            "cases": len(tried.choices),
            "same": sum(c.causes == tried.choice.causes for c in tried.choices),
        },
    } | _errors(tried.errors)


def _basis(tried: Tried) -> dict[str, Any]:
    """What the relation rests on: the model, or a monotone cubic through the cases, and the errors of both."""
    indicators = [k for k in tried.every.level if k not in tried.cases.level]
    return {
        "curve": tried.basis,
        "cubic_over_model_nat": tried.cubic.errors.log_density - tried.modelled.log_density,
        "model": _errors(tried.modelled),
        "cubic": _errors(tried.cubic.errors),
        "indicators": {k: tried.cubic.indicators.get(k) for k in indicators},
    }


def _floor(tried: Tried, condition: str) -> dict[str, float | None]:
    """The error that no relation can fall below at one operating condition [%]."""
    cases = tried.cases
    worn, level = cases.only(cases.worn), cases.level[condition]
    off = [
        abs(spline(worn.depth, worn.level[condition], float(d)) / r - 1)
        for d, r in zip(worn.depth, worn.level[condition], strict=True)
    ]
    unworn = level[~cases.worn]
    return {
        "within_case_percent": _within(worn.scatter[condition] / worn.level[condition]),
        "spline_through_all_percent": 100 * float(np.mean(off)),
        "unworn_days_percent": 100 * float(np.log(unworn).std(ddof=1)) if unworn.size > 1 else None,
    }


def _relation(tried: Tried) -> dict[str, Any]:
    """The relation at every operating condition."""
    relation, worn = tried.relation, tried.cases.only(tried.cases.worn)
    return {
        k: {
            "gain": relation.gain[k],
            "background": relation.background[k],
            "std_percent": 100 * relation.std(k),
            "told_to_um": 1e6 * relation.told_to(k),
            "curve_scatter_percent": 100 * float((curve.scatter / curve.level).max()),
            "not_rising": _falling(worn.depth, worn.level[k]),
        }
        for k, curve in relation.curves.items()
        if k in worn.level
    }


def _errors(errors: Errors) -> dict[str, Any]:
    return {
        "mean_error_percent": {k: 100 * errors.mean(k) for k in errors.relative},
        "worst_error_percent": {k: 100 * errors.worst(k) for k in errors.relative},
    }


def _within(scatter: np.ndarray) -> float | None:
    """Mean relative scatter within the cases of several records [%], None where there are none."""
    known = scatter[np.isfinite(scatter)]
    return 100 * float(known.mean()) if known.size else None


def _falling(depth: np.ndarray, level: np.ndarray) -> dict[str, float] | None:
    found = falling_region(depth, level)
    return None if found is None else {"from_um": 1e6 * found.start, "spearman": found.spearman, "p": found.p}


def _depths(tried: Tried) -> list[dict[str, Any]]:
    """Depth of every worn case from its levels, by the relation of all other cases."""
    out, cases = [], tried.every
    for i, relation in zip(np.flatnonzero(cases.worn), tried.relations, strict=True):
        found = relation.depth({k: float(cases.level[k][i]) for k in relation.curves})
        out.append(
            {
                "name": tried.cases.name[i],
                "true_um": 1e6 * tried.cases.depth[i],
                "median_um": 1e6 * found.median,
                "p05_um": 1e6 * found.p05,
                "p95_um": 1e6 * found.p95 if found.bounded else None,
                "reason": bounds_reason(found),
            }
        )
    return out


def _curves(tried: Tried) -> dict[str, Any]:
    """Curves to be drawn, of every condition."""
    cases, relation = tried.cases, tried.relation
    grid = np.linspace(0, relation.deepest, DRAWN)
    worn = cases.only(cases.worn)
    inside = grid[grid >= worn.depth.min()]
    twin = fit(cases, tried.curves["twin"])
    return {
        k: {
            "depth_um": 1e6 * grid,
            "level": relation.level(k, grid),
            "low": relation.level(k, grid) * np.exp(-Z95 * relation.std(k)),
            "high": relation.level(k, grid) * np.exp(Z95 * relation.std(k)),
            "spline_depth_um": 1e6 * inside,
            "spline": [spline(worn.depth, worn.level[k], float(d)) for d in inside],
            "twin": twin.level(k, grid),
            "apart": {
                "depth_um": 1e6 * tried.curves["twin"][k].depth,
                "share": tried.curves["twin"][k].apart,
            },
        }
        for k in cases.level
    }


def _origin(series: Series, tried: Tried) -> Origin:
    causes = tried.choice.causes if tried.basis == MODEL else ()
    return Origin(asset=series.asset, curve=tried.basis, causes=causes, sensor=series.sensor, band=series.band)


def save_relation(series: Series, tried: Tried, path: Path) -> None:
    """Writes a relation file; InputError where it cannot be written."""
    write_text(
        path,
        json_text(
            {
                "schema": SCHEMA,
                "relation": replace(tried.relation, origin=_origin(series, tried)).to_dict(),
            }
        ),
    )


def read_relation(path: Path) -> Relation:
    """A relation from its file; InputError where it is none."""
    data = json_of_file(path, "a relation of `gear-twin relate`")
    if not isinstance(data, Mapping) or data.get("schema") != SCHEMA:
        raise InputError(f"{path}: not a relation of `gear-twin relate`: its schema is not {SCHEMA!r}")
    try:
        return Relation.from_dict(data["relation"])
    except (AttributeError, IndexError, KeyError, TypeError, ValueError, ParameterError) as error:
        raise InputError(f"{path}: the relation cannot be read: {error}") from None
