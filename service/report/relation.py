"""What `gear-twin relate` and `depths` found, in sentences and tables."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from service.files.series import FOUND
from service.report.words import number

TABLE = "What was tested"
NAME = 26  # characters of a name
SCALE = (
    ("within a case", "within_case_percent"),
    ("spline, all cases", "spline_through_all_percent"),
    ("unworn days", "unworn_days_percent"),
)


def relation_text(answer: Mapping[str, Any]) -> str:
    """Sentences and tables as plain text."""
    conditions, chosen = list(answer["conditions"]), answer["chosen"]
    without = chosen["without_a_case"]
    said = f"for each case by the others: {' + '.join(chosen['causes'])} for {without['same']} of {without['cases']}"
    lines = [
        f"Level against wear depth of {answer['asset']}: {answer['description']}",
        "",
        *relation_sentences(answer),
        "",
        f"{TABLE}: error on worn cases left out, each in turn, mean (worst) %; ln evidence over the background",
        _row("", (f"{k:>18}" for k in conditions)),
    ]
    for t in [*answer["trials"], chosen | {"name": "chosen", "said": said}]:
        lines.append(_row(t["name"], (*_errors(t, conditions), f"{t['log_evidence']:+8.1f} nat   {t['said']}")))
    lines += ["", "Chosen and fitted on every other case, error on the rest, and vice versa:"]
    lines += [_row(name, _errors(e, conditions)) for name, e in answer["judged"].items()]
    lines += ["", "Fitted on the unworn and four worn cases, error on the rest:"]
    lines += [_row(name, (f"{e[k]:>12.1f}      " for k in conditions)) for name, e in answer["few"].items()]
    if spread := answer["estimated_spread"]:
        title = f"Estimated values: mean error of the model with its background over {answer['draws']} draws of them"
        cells = (f"{' '.join(f'{x:.0f}' for x in spread[k]):>18}" for k in conditions)
        lines += ["", title, _row("10, 50, 90 %", cells)]
    lines += ["", "For scale, mean scatter or error %:"]
    for name, key in SCALE:
        lines.append(_row(name, (f"{number(answer['floor'][k][key], 3):>12}      " for k in conditions)))
    lines += ["", "Depth from the levels of all conditions together, by the relation of all other cases (5–95 %):"]
    lines += [f"  {d['name']:<8} {d['true_um']:6.0f} µm   found {depth_band(d)}" for d in answer["depths"]]
    return "\n".join(lines)


def _row(name: str, cells: Iterable[str]) -> str:
    return f"{name:<{NAME}}{''.join(cells)}"


def depth_band(found: Mapping[str, Any]) -> str:
    """Median and band of a depth [µm]; of the median nothing where no upper bound is known."""
    if found["p95_um"] is None:
        return f"at least {found['p05_um']:.0f}".rjust(32) if found["p05_um"] else "any depth".rjust(32)
    return f"{found['median_um']:6.0f}   {found['p05_um']:6.0f} … {found['p95_um']:6.0f}".rjust(32)


def _errors(errors: Mapping[str, Any], conditions: list[str]) -> list[str]:
    mean, worst = errors["mean_error_percent"], errors["worst_error_percent"]
    return [f"{mean[k]:>12.1f} ({worst[k]:3.0f})" for k in conditions]


def kept_combination(chosen: Mapping[str, Any]) -> str:
    """Which combination of causes is kept, and why none where none is."""
    kept, best = ([c for c in chosen[k] if c != "background"] for k in ("causes", "best_combination"))
    if kept:
        return f"The best combination has {' and '.join(kept)}."
    if not best:
        return "No combination improves it by 3 nat per cause: the model with its background is kept."
    return (
        f"The combination with {' and '.join(best)} fits best but is not kept: chosen anew without each case, "
        f"combinations change the evidence of the case left out by {chosen['log_evidence']:+.1f} nat; 3 nat are needed."
    )


def basis_sentences(basis: Mapping[str, Any]) -> list[str]:
    """Whether the relation is the model's or a cubic through the cases, and what indicators add."""
    errors = " and ".join(
        f"{name} {', '.join(f'{e:.1f}' for e in basis[key]['mean_error_percent'].values())} %"
        for name, key in (("the cubic", "cubic"), ("the model", "model"))
    )
    gain = basis["cubic_over_model_nat"]
    if basis["curve"] == "model":
        lines = [f"The relation is the model's: it predicts left-out cases better than a monotone cubic ({errors})."]
    else:
        lines = [
            f"The relation is a monotone cubic through the cases, which predicts left-out cases better than the model: "
            f"mean error of {errors}, evidence {gain:+.1f} nat. It holds for this machine alone."
        ]
    for name, added in basis["indicators"].items():
        if basis["curve"] == "model":
            lines.append(f"{name} is not used: the model does not predict it.")
        elif added is None:
            lines.append(f"{name} is not used: it does not improve the depths of left-out cases by 3 nat.")
        else:
            lines.append(f"{name} is used as well: the depths of left-out cases gain {added:.1f} nat.")
    return lines


def relation_sentences(answer: Mapping[str, Any]) -> list[str]:
    """What came out, in words."""
    worn = sum(c["depth_um"] > 0 for c in answer["cases"])
    unworn = len(answer["cases"]) - worn
    lines = [
        f"{worn} worn and {unworn} unworn assemblies of {answer['records']} records; "
        f"{len(answer['estimated'])} numbers of the rig file are estimated."
    ]
    earned = [t for t in answer["trials"] if t["cause"]]
    single = [t["name"] for t in earned if t["log_evidence"] >= 3]
    lines.append(
        f"Of {len(earned)} causes tested one at a time in addition to the background, "
        + (
            f"{', '.join(single)} improve the prediction of left-out cases by 3 nat or more."
            if single
            else "none improves the prediction of left-out cases by 3 nat."
        )
    )
    lines.append(kept_combination(answer["chosen"]))
    lines += basis_sentences(answer["basis"])
    for k, r in answer["relation"].items():
        falling = r["not_rising"]
        line = f"{k}: a level scatters by {number(r['std_percent'], 3)} % from assembly to assembly; "
        line += f"it distinguishes depths up to some {number(r['told_to_um'], 3)} µm from the deepest"
        if falling:
            line += f"; over the cases from {number(falling['from_um'], 3)} µm on it does not rise with depth "
            line += f"(Spearman {falling['spearman']:+.2f}, p = {number(falling['p'], 2)} of a rising level)"
        else:
            line += "; a plateau is not shown"
        if r["curve_scatter_percent"] >= 1:
            line += (
                f"; where the motion does not repeat, the modelled level scatters by {r['curve_scatter_percent']:.0f} %"
            )
        lines.append(line + ".")
    notes = [*answer["notes"], *([answer["sensor"]["note"]] if answer["sensor"]["note"] else [])]
    lines += [f"Note: {n}." for n in notes]
    return lines


def depths_text(rows: list[dict[str, Any]]) -> str:
    """The depths of a table of levels as plain text, each with the first of its other columns."""
    lines = ["largest wear depth of both flanks together [µm]: median, 5–95 %"]
    for place, row in enumerate(rows, start=1):
        name = str(next((v for k, v in row.items() if k not in FOUND), place))
        band = "not available".rjust(32) if row["p05_um"] is None else depth_band(row)
        lines.append(f"{name:<20}{band}{'   ' + row['reason'] if row['reason'] else ''}".rstrip())
    return "\n".join(lines)
