"""The relation of level and wear depth: made of a series of cases, kept in a file, and said in plain data.

A relation file is JSON: the curve of every operating condition, gains, backgrounds and scatters, the depths that they
hold for, and what they are of: asset, causes beside the twin, and sensor and band where the series states them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from service.errors import InputError
from service.files.series import Series
from service.json_text import json_text, plain, write_text
from twin.errors import ParameterError
from twin.levels.left_out import Errors, spline
from twin.levels.relation import Z95, Origin, Relation, falling_region, fit
from twin.levels.reporting import not_stated
from twin.levels.trials import Tried

SCHEMA = "gear-relation/1"
DRAWN = 200  # points of a drawn curve


def answer(series: Series, tried: Tried) -> dict[str, Any]:
    """What was tried and what holds, as plain data."""
    cases, relation = tried.cases, tried.relation
    worn = cases.only(cases.worn)
    return plain(
        {
            "asset": series.asset,
            "description": series.description,
            "notes": series.notes,
            "records": series.records,
            "estimated": {k: {"value": series.rig.get(k), "factor": f} for k, f in series.estimated.items()},
            "conditions": {k: {"speed_hz": c.speed_hz, "torque_nm": c.torque} for k, c in series.conditions.items()},
            "sensor": {"name": series.sensor, "band_hz": series.band, "note": not_stated(_origin(series, tried))},
            "cases": [
                {
                    "name": name,
                    "depth_um": 1e6 * cases.depth[i],
                    "level": {k: v[i] for k, v in cases.level.items()},
                    "scatter": {k: v[i] for k, v in cases.scatter.items()},
                    "error_percent": {k: None for k in cases.level},
                }
                | (
                    {"error_percent": {k: 100 * e[int(cases.worn[:i].sum())] for k, e in tried.errors.relative.items()}}
                    if cases.worn[i]
                    else {}
                )
                for i, name in enumerate(cases.name)
            ],
            "trials": [
                {"name": t.name, "said": t.said, "log_evidence": t.gain, "cause": t.cause} | _errors(t.errors)
                for t in tried.trials
            ],
            "chosen": {
                "causes": ["background", *tried.choice.causes],
                "log_evidence": tried.gain,
                "without_a_case": {
                    "cases": len(tried.choices),
                    "same": sum(c.causes == tried.choice.causes for c in tried.choices),
                },
            }
            | _errors(tried.errors),
            "judged": {name: _errors(e) for name, e in tried.judged.items()},
            "few": {name: {k: 100 * v for k, v in e.items()} for name, e in tried.few.items()},
            "estimated_spread": {k: [100 * x for x in v] for k, v in tried.spread.items()},
            "draws": tried.draws,
            "floor": {
                k: {
                    "within_case_percent": _within(worn.scatter[k] / worn.level[k]),
                    "spline_through_all_percent": 100
                    * float(
                        np.mean(
                            [
                                abs(spline(worn.depth, worn.level[k], float(d)) / r - 1)
                                for d, r in zip(worn.depth, worn.level[k], strict=True)
                            ]
                        )
                    ),
                    "unworn_days_percent": 100 * float(np.log(cases.level[k][~cases.worn]).std(ddof=1))
                    if (~cases.worn).sum() > 1
                    else None,
                }
                for k in cases.level
            },
            "relation": {
                k: {
                    "gain": relation.gain[k],
                    "background": relation.background[k],
                    "std_percent": 100 * relation.std(k),
                    "told_to_um": 1e6 * relation.told_to(k),
                    "curve_scatter_percent": 100 * float((curve.scatter / curve.level).max()),
                    "not_rising": _falling(worn.depth, worn.level[k]),
                }
                for k, curve in relation.curves.items()
            },
            "assembly_std_percent": 100 * relation.assembly_std,
            "depths": _depths(tried),
            "curves": _curves(tried),
        }
    )


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
    out, cases = [], tried.cases
    for i, relation in zip(np.flatnonzero(cases.worn), tried.relations, strict=True):
        found = relation.depth({k: float(v[i]) for k, v in cases.level.items()})
        out.append(
            {
                "name": tried.cases.name[i],
                "true_um": 1e6 * tried.cases.depth[i],
                "median_um": 1e6 * found.median,
                "p05_um": 1e6 * found.p05,
                "p95_um": 1e6 * found.p95 if found.bounded else None,
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
    return Origin(asset=series.asset, causes=tried.choice.causes, sensor=series.sensor, band=series.band)


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
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {(error.strerror or 'fault').lower()}") from None
    except (ValueError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not a relation of `gear-twin relate`: {error}") from None
    if not isinstance(data, Mapping) or data.get("schema") != SCHEMA:
        raise InputError(f"{path}: not a relation of `gear-twin relate`: its schema is not {SCHEMA!r}")
    try:
        return Relation.from_dict(data["relation"])
    except (AttributeError, IndexError, KeyError, TypeError, ValueError, ParameterError) as error:
        raise InputError(f"{path}: the relation cannot be read: {error}") from None
