"""The misalignment study in plain words, beside what its authors found."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from twin.multibody.dabrowski_2012 import ESTIMATES, EXPERIMENT_RISE
from twin.multibody.study import CROOKED, DRAWN, POINTS, SHOWN, VARIANTS, Rise, Sensitivity, Study, mean_miss

GIVES = {
    "rigid": "nothing (authors' model)",
    "bearings": "bearings",
    "shafts": "shafts",
    "both": "bearings and shafts",
    "teeth": "teeth",
    "all": "bearings, shafts, teeth",
}
TILTED = {
    "normal": "axis, normal to plane of axes",
    "in_plane": "axis, in plane of axes",
    "turning": "gear on shaft, about mid-face",
    "turning_end": "gear on shaft, about an end",
}
WHAT = {"force": "force between gear and shaft", "acceleration": "its second derivative (support's acceleration)"}
WIDTH = 31


def answered(study: Study) -> dict[str, Any]:
    """The study as numbers."""
    return {
        "source": "Dąbrowski, Adamczyk, Plascencia Mora, Diagnostyka 2(62)/2012",
        "experiment_rise_percent": {f"{speed:g} rpm": rise for speed, rise in EXPERIMENT_RISE.items()},
        "rises": [_rise(r) for r in study.rises],
        "mean_distance_from_experiment": [
            {
                "gives_way": variant,
                "tilt": tilt,
                "force": mean_miss(study.of(variant, tilt)),
                "acceleration": mean_miss(study.of(variant, tilt), "acceleration"),
            }
            for variant in VARIANTS
            for tilt in ("normal", "in_plane")
        ],
        "runs": [
            {
                "gives_way": r.variant,
                "tilt": r.tilt,
                "speed_rpm": r.speed_rpm,
                "torque_nm": r.torque,
                "force_bands_n": r.force_bands,
                "sideband_ratio_1": r.sidebands[0],
                "sideband_ratio_2": r.sidebands[1],
                "back_flanks_touch": r.back_contact,
            }
            for r in study.runs
        ],
        "estimated": [
            {"name": e.name, "value": e.value, "unit": e.unit, "low": e.low, "high": e.high, "reason": e.reason}
            for e in ESTIMATES
        ],
        "sensitivities": [
            {
                "name": s.name,
                "value": s.value,
                "rigid": [_rise(r) for r in s.rigid] if s.rigid else None,
                "both": [_rise(r) for r in s.both],
            }
            for s in study.sensitivities
        ],
        "over_a_state_out_of_line": [
            {"correct_state": state, **_rise(r)} for (_, state), rises in study.residuals.items() for r in rises
        ],
        "without_friction": {v: [_rise(r) for r in rises] for v, rises in study.frictionless.items()},
        "draws": [{v: [_rise(r) for r in rises] for v, rises in draw.items()} for draw in study.draws],
    }


def _rise(r: Rise) -> dict[str, Any]:
    return {
        "gives_way": r.variant,
        "tilt": r.tilt,
        "speed_rpm": r.speed_rpm,
        "torque_nm": r.torque,
        "force_percent": r.force,
        "force_bands_percent": r.bands,
        "acceleration_percent": r.acceleration,
    }


def text(study: Study) -> str:
    """What was found, as the command prints it."""
    parts = [
        "Dąbrowski et al., Diagnostyka 2(62)/2012: pair 29/29, one gear out by 1°\n"
        "rise of the RMS in mesh bands 1–5 ± 2 orders, %; last: mean distance from the experiment, %-points",
        rise_table(study, "normal"),
        rise_table(study, "in_plane"),
        "\n".join(findings(study)),
        sideband_table(study),
        friction_table(study),
        residual_table(study),
        estimate_table(study),
    ]
    if study.draws:
        parts.append(draw_table(study))
    return "\n\n".join(part for part in parts if part)


def rise_table(study: Study, tilt: str) -> str:
    """Rises of force and acceleration, and of the second band, by what gives way."""
    lines = [f"tilt: {TILTED[tilt]}"]
    head = "".join(f"{f'{speed:g}/{torque:g}':>9}" for speed, torque in POINTS)
    for of in ("force", "acceleration"):
        lines.append(f"{WHAT[of]}")
        lines.append(f"  {'gives way  (rpm/N·m)':<{WIDTH}}{head}   from exp.")
        lines.append(f"  {'experiment, about':<{WIDTH}}" + _cells(EXPERIMENT_RISE[speed] for speed, _ in POINTS))
        for variant in VARIANTS:
            rises = study.of(variant, tilt)
            lines.append(
                f"  {GIVES[variant]:<{WIDTH}}{_cells(getattr(r, of) for r in rises)}{mean_miss(rises, of):12.0f}"
            )
    lines.append("mesh harmonic 2 of the force")
    for variant in VARIANTS:
        lines.append(f"  {GIVES[variant]:<{WIDTH}}{_cells(r.bands[1] for r in study.of(variant, tilt))}")
    return "\n".join(lines)


def _cells(values: Iterable[float]) -> str:
    return "".join(f"{value:+9.0f}" for value in values)


def findings(study: Study) -> list[str]:
    """Sentences that the numbers bear."""
    out = []
    for tilt in ("normal", "in_plane"):
        raised = {v: sum(r.bands[1] > 0 for r in study.of(v, tilt)) for v in VARIANTS}
        less = [f"{GIVES[v]}, {n} of {len(POINTS)}" for v, n in raised.items() if n < len(POINTS)]
        every = "in every case" if not less else f"in all cases but of: {'; '.join(less)}"
        out.append(f"Mesh harmonic 2 of the force rises {every} (tilt: {TILTED[tilt]}).")
    for of in ("force", "acceleration"):
        miss = {v: mean_miss(study.of(v, "normal"), of) for v in VARIANTS}
        out.append(
            f"Distance from the experiment, {WHAT[of]}: {miss['rigid']:.0f} %-points where nothing gives way, "
            f"{miss['bearings']:.0f} with bearings alone, {miss['shafts']:.0f} with shafts alone, {miss['both']:.0f} "
            f"with both; {miss['all']:.0f} where teeth bend, too."
        )
    own = study.frictionless["rigid"][-1].bands
    apart = np.abs(study.frictionless["both"][-1].bands - own).max()
    out.append(
        f"Without friction bearings and shafts leave the rise of every band within {apart:.0f} %-points of that where "
        f"nothing gives way ({own.min():.0f} to {own.max():.0f} %; {SHOWN[0]:g} rpm, {SHOWN[1]:g} N·m). With it, "
        "what friction excites as it reverses at the pitch point rings on the shafts, aligned or not: that dilutes the "
        "rise."
    )
    out.append(
        "An axis that is out of line makes no sidebands. A gear that sits crooked on its shaft makes them at twice the "
        "shaft's speed, and at the shaft's speed itself where it is tilted about another place than mid-face."
    )
    return out


def sideband_table(study: Study) -> str:
    """Sidebands over their mesh line, median of the five harmonics."""
    lines = [
        f"sidebands at ± 1 and ± 2 times the shaft's speed, % of their mesh line (median of five), {SHOWN[0]:g} rpm, "
        f"{SHOWN[1]:g} N·m"
    ]
    lines.append(f"  {'what is tilted; gives way':<{WIDTH}}{'nothing':>16}{'bearings, shafts':>20}{'teeth, too':>20}")
    for tilt in ("aligned", *TILTED):
        cells = []
        for variant in CROOKED:
            one, two = 100 * np.median(study.run(variant, tilt, *SHOWN).sidebands, axis=1)
            cells.append(f"{f'{one:.1f}':>{10 if variant == 'rigid' else 14}}{f'{two:.1f}':>6}")
        lines.append(f"  {TILTED.get(tilt, 'nothing'):<{WIDTH}}{''.join(cells)}")
    return "\n".join(lines)


def friction_table(study: Study) -> str:
    """The rise without friction, in every band: what supports leave of the excitation's own."""
    lines = ["without friction: rise of the force, then of its bands 1–5 at 800 rpm and 200 N·m, normal to the plane"]
    for variant, rises in study.frictionless.items():
        lines.append(f"  {GIVES[variant]:<{WIDTH}}{_cells(r.force for r in rises)}   bands{_cells(rises[-1].bands)}")
    return "\n".join(lines)


def residual_table(study: Study) -> str:
    """The rise over a state that is called correct and is itself a little out."""
    lines = ["rise where the state called correct is itself out, normal to the plane of the axes: force; acceleration"]
    for (variant, state), rises in study.residuals.items():
        cells = (_cells(getattr(r, of) for r in rises) for of in ("force", "acceleration"))
        miss = (f"{mean_miss(rises, of):.0f}" for of in ("force", "acceleration"))
        lines.append(f"  {GIVES[variant]:<26}{state:<13}{';  '.join(cells)}   from exp. {'; '.join(miss)}")
    return "\n".join(lines)


def estimate_table(study: Study) -> str:
    """What was estimated, and the rise of the force where it is something else."""
    lines = [
        "estimated, not in the paper; rise of the force at either end of the range, normal to the plane of the axes"
    ]
    by_name: dict[str, list[Sensitivity]] = {}
    for s in study.sensitivities:
        by_name.setdefault(s.name, []).append(s)
    for e in ESTIMATES:
        lines.append(f"  {e.name} {_amount(e.value, e.unit)}: {e.reason}")
        lines += [_sensitivity(s, _amount(s.value, e.unit)) for s in by_name.pop(e.name, [])]
    if by_name:
        lines.append("  reading of K: the number with exponent 1.3, N/mm^1.3, as a solver takes it")
        lines += [_sensitivity(s, name) for name, others in by_name.items() for s in others]
    return "\n".join(lines)


def _amount(value: float | None, unit: str) -> str:
    return f"{value:g} {unit}".strip()


def _sensitivity(s: Sensitivity, label: str) -> str:
    rigid = "rigid" + _cells(r.force for r in s.rigid) if s.rigid else ""
    lead = f"    {label:<14}" if len(label) < 15 else f"    {label}\n{'':18}"
    return f"{lead}{rigid:<44}both{_cells(r.force for r in s.both)}"


def draw_table(study: Study) -> str:
    """Over all sets of estimates drawn: medians, and how often nearer to the experiment than the rigid model."""
    n = len(study.draws)
    lines = [
        f"all estimates drawn from their ranges, {n} sets, axis normal to the plane: median (10 … 90 %) of the rise"
    ]
    for of in ("force", "acceleration"):
        lines.append(WHAT[of])
        rigid = _misses(study.draws, "rigid", of)
        for variant in DRAWN:
            rises = np.array([[getattr(r, of) for r in draw[variant]] for draw in study.draws])
            low, middle, high = np.quantile(rises, (0.1, 0.5, 0.9), axis=0)
            cells = "".join(f"{f'{m:+.0f} ({a:.0f} … {b:.0f})':>22}" for m, a, b in zip(middle, low, high, strict=True))
            miss = _misses(study.draws, variant, of)
            nearer = "" if variant == "rigid" else f", nearer in {100 * np.mean(miss < rigid):.0f} %"
            lines.append(f"  {GIVES[variant]:<26}{cells}   from exp. {np.median(miss):.0f}{nearer}")
    raised = {v: np.mean([all(r.bands[1] > 0 for r in draw[v]) for draw in study.draws]) for v in DRAWN}
    lines.append(
        "harmonic 2 rises in all four cases: " + ", ".join(f"{GIVES[v]} {100 * x:.0f} %" for v, x in raised.items())
    )
    return "\n".join(lines)


def _misses(draws: Sequence[Mapping[str, Sequence[Rise]]], variant: str, of: str) -> np.ndarray:
    return np.array([mean_miss(draw[variant], of) for draw in draws])
