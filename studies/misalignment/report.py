"""Tables, findings and numbers of the misalignment study, compared with what its authors measured."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from studies.misalignment.bands import HARMONICS
from studies.misalignment.dabrowski_2012 import ESTIMATES, EXPERIMENT_RISE, MOST_AT, SPEEDS_RPM
from studies.misalignment.study import (
    CROOKED,
    DRAWN,
    POINTS,
    SHOWN,
    SIGNALS,
    VARIANTS,
    Rise,
    Sensitivity,
    Study,
    mean_miss,
)

COMPLIANT = {  # name of every variant
    "rigid": "rigid (authors' model)",
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
SHORT = {"rigid": "rigid", "bearings": "bearings", "shafts": "shafts", "both": "both", "all": "with teeth"}
WHAT = {  # of `SIGNALS`
    "acceleration": "acceleration of the support (second derivative of the force)",
    "force": "force between gear and shaft",
}
NAMED = f"{MOST_AT[0]}–{MOST_AT[-1]}"  # harmonics that rose most in the experiment, at the higher speed
FAST = [i for i, (speed, _) in enumerate(POINTS) if speed == SPEEDS_RPM[1]]  # the points at that speed
NEAR = 10  # of "about 20 %" and "about 30 %" [%-points]
WIDTH = 31


def as_numbers(study: Study) -> dict[str, Any]:
    """The study as numbers."""
    return {
        "source": "Dąbrowski, Adamczyk, Plascencia Mora, Diagnostyka 2(62)/2012",
        "experiment_rise_percent": {f"{speed:g} rpm": rise for speed, rise in EXPERIMENT_RISE.items()},
        "rises": [_rise(r) for r in study.rises],
        "mean_distance_from_experiment": [
            {
                "compliant": variant,
                "tilt": tilt,
                **{of: mean_miss(study.of(variant, tilt), of) for of in (*SIGNALS, *(f"{of}_along" for of in SIGNALS))},
            }
            for variant in VARIANTS
            for tilt in ("normal", "in_plane")
        ],
        "runs": [
            {
                "compliant": r.variant,
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
        "as_estimated_on_their_grid": {v: [_rise(r) for r in rises] for v, rises in study.coarse.items()},
        "sensitivities": [
            {
                "name": s.name,
                "value": s.value,
                "rigid": [_rise(r) for r in s.rigid] if s.rigid else None,
                "both": [_rise(r) for r in s.both],
            }
            for s in study.sensitivities
        ],
        "relative_to_a_misaligned_state": [
            {"reference_state": state, **_rise(r)} for (_, state), rises in study.residuals.items() for r in rises
        ],
        "without_friction": {v: [_rise(r) for r in rises] for v, rises in study.frictionless.items()},
        "draws": [{v: [_rise(r) for r in rises] for v, rises in draw.items()} for draw in study.draws],
    }


def _rise(r: Rise) -> dict[str, Any]:
    return {
        "compliant": r.variant,
        "tilt": r.tilt,
        "speed_rpm": r.speed_rpm,
        "torque_nm": r.torque,
        "acceleration_percent": r.acceleration,
        "force_percent": r.force,
        "bands_percent": r.bands,
        "acceleration_gains_percent": r.gains,
        "along_centres": {"acceleration_percent": r.acceleration_along, "force_percent": r.force_along},
    }


def text(study: Study) -> str:
    """The report as the command prints it: over the estimates drawn, then at the nominal ones."""
    parts = [
        "Dąbrowski et al., Diagnostyka 2(62)/2012: pair 29/29, one gear misaligned by 1°\n"
        "rise of the RMS in mesh bands 1–5 ± 2 orders, %\n"
        "from exp.: mean distance of the four rises from the experiment's, %-points",
        *tables(study),
    ]
    return "\n\n".join(parts)


def tables(study: Study) -> list[str]:
    """All parts of the report, in their order."""
    over_draws = [draw_table(study), draw_band_table(study), draw_findings(study)] if study.draws else []
    return [
        *over_draws,
        "at the nominal estimates\n" + "\n".join(findings(study)),
        rise_table(study, "normal"),
        rise_table(study, "in_plane"),
        band_table(study),
        direction_table(study),
        sideband_table(study),
        friction_table(study),
        residual_table(study),
        estimate_table(study),
    ]


def rise_table(study: Study, tilt: str) -> str:
    """Rises of acceleration and force, and of the second band, for every variant of compliance."""
    lines = [f"nominal estimates; tilt: {TILTED[tilt]}"]
    for of in SIGNALS:
        lines.append(f"{WHAT[of]}")
        lines.append(f"  {'compliant  (rpm/N·m)':<{WIDTH}}{_HEAD}   from exp.")
        lines.append(f"  {'experiment, about':<{WIDTH}}" + _cells(EXPERIMENT_RISE[speed] for speed, _ in POINTS))
        for variant in VARIANTS:
            rises = study.of(variant, tilt)
            lines.append(
                f"  {COMPLIANT[variant]:<{WIDTH}}{_cells(getattr(r, of) for r in rises)}{mean_miss(rises, of):12.0f}"
            )
    lines.append("mesh harmonic 2")
    for variant in VARIANTS:
        lines.append(f"  {COMPLIANT[variant]:<{WIDTH}}{_cells(r.bands[1] for r in study.of(variant, tilt))}")
    return "\n".join(lines)


_HEAD = "".join(f"{f'{speed:g}/{torque:g}':>9}" for speed, torque in POINTS)
_BANDS = "".join(f"{f'GMF{n}':>9}" for n in range(1, HARMONICS + 1))


def band_table(study: Study) -> str:
    """Rise of each band, which the sum over the bands hides, and its contribution to the RMS of the acceleration."""
    lines = [
        "nominal estimates, normal to the plane of the axes: rise of each band, of force and acceleration alike;",
        "then the contribution of each to the acceleration's RMS, relative to the aligned RMS in all bands",
        f"the experiment rose at {SPEEDS_RPM[1]:g} rpm especially at GMF{NAMED}",
        f"  {'compliant  (rpm/N·m)':<{WIDTH}}{'':8}{_BANDS}{_BANDS}",
    ]
    for variant in ("rigid", "bearings", "shafts", "both"):
        lines += [
            f"  {COMPLIANT[variant]:<{WIDTH}}{f'{r.speed_rpm:g}/{r.torque:g}':>8}{_cells(r.bands)}{_cells(r.gains)}"
            for r in study.of(variant, "normal")
        ]
    return "\n".join(lines)


def direction_table(study: Study) -> str:
    """The same along the line of centres, for the other reading of 'vertical'."""
    lines = [
        "reading of 'vertical': across the line of centres, as where the axes lie side by side; the paper does not "
        "say. Along it:"
    ]
    for of in SIGNALS:
        lines.append(WHAT[of])
        lines.append(f"  {'compliant  (rpm/N·m)':<{WIDTH}}{_HEAD}   from exp.")
        for variant in VARIANTS:
            rises, key = study.of(variant, "normal"), f"{of}_along"
            lines.append(
                f"  {COMPLIANT[variant]:<{WIDTH}}{_cells(getattr(r, key) for r in rises)}{mean_miss(rises, key):12.0f}"
            )
        if study.draws:
            medians = (f"{COMPLIANT[v]} {np.median(study.misses(v, f'{of}_along')):.0f}" for v in DRAWN)
            lines.append(f"  from exp., median over the {len(study.draws)} sets: {'; '.join(medians)}")
    return "\n".join(lines)


def _cells(values: Iterable[float]) -> str:
    return "".join(f"{value:+9.0f}" for value in values)


def draw_findings(study: Study) -> str:
    """In how many sets of estimates each finding of the experiment is reproduced."""
    draws = study.draws
    wanted = np.array([EXPERIMENT_RISE[speed] for speed, _ in POINTS])
    lines = [f"{f'of {len(draws)} sets of estimates those in which':<65}" + "".join(f"{SHORT[v]:>11}" for v in DRAWN)]

    def row(claim: str, holds: Mapping[str, Any]) -> None:
        """By variant, whether it holds in each set (draws,)."""
        lines.append(f"  {claim:<63}" + "".join(f"{np.sum(holds[v]) if v in holds else '':>11}" for v in DRAWN))

    row("mesh harmonic 2 rises in every case", {v: [all(r.bands[1] > 0 for r in d[v]) for d in draws] for v in DRAWN})
    for of in SIGNALS:
        rises = {v: np.array([[getattr(r, of) for r in d[v]] for d in draws]) for v in DRAWN}
        miss = {v: study.misses(v, of) for v in DRAWN}
        near = f"is within {NEAR} %-points of the experiment in every case"
        lines.append(f"{WHAT[of]}")
        row("rises by more than the experiment in every case", {v: (x > wanted).all(1) for v, x in rises.items()})
        row("falls in a case", {v: (x < 0).any(1) for v, x in rises.items()})
        row(near, {v: (abs(x - wanted) <= NEAR).all(1) for v, x in rises.items()})
        row("is nearer to the experiment than the rigid model", {v: miss[v] < miss["rigid"] for v in DRAWN[1:]})
        row("is farther from it than with both compliant", {v: miss[v] > miss["both"] for v in ("bearings", "shafts")})
    lines.append(f"at {SPEEDS_RPM[1]:g} rpm, in both cases")
    most = {v: np.array([[d[v][k].most_at for k in FAST] for d in draws]) for v in DRAWN}
    for i, other in enumerate((1, HARMONICS)):
        row(
            f"harmonics {NAMED} all rise by more than harmonic {other}", {v: x[:, :, i].all(1) for v, x in most.items()}
        )
    gained = {v: [all(np.argmax(d[v][k].gains) + 1 in MOST_AT for k in FAST) for d in draws] for v in DRAWN}
    row(f"one of harmonics {NAMED} adds most to the acceleration's RMS", gained)
    return "\n".join(lines)


def findings(study: Study) -> list[str]:
    """Findings at the nominal estimates, as sentences."""
    out = []
    for tilt in ("normal", "in_plane"):
        raised = {v: sum(r.bands[1] > 0 for r in study.of(v, tilt)) for v in VARIANTS}
        less = [f"{COMPLIANT[v]}, {n} of {len(POINTS)}" for v, n in raised.items() if n < len(POINTS)]
        every = "in every case" if not less else f"in all cases but of: {'; '.join(less)}"
        out.append(f"Mesh harmonic 2 rises {every} (tilt: {TILTED[tilt]}).")
    for i, other in enumerate((1, HARMONICS)):
        most = "; ".join(
            f"{COMPLIANT[v]} {sum(study.of(v, 'normal')[k].most_at[i] for k in FAST)} of {len(FAST)}"
            for v in ("rigid", "both")
        )
        out.append(
            f"Harmonics {NAMED} rise by more than harmonic {other}, as in the experiment, in these of the cases at "
            f"{SPEEDS_RPM[1]:g} rpm: {most}."
        )
    for variant in ("rigid", "both"):
        most = ", ".join(f"GMF{np.argmax(study.of(variant, 'normal')[k].gains) + 1}" for k in FAST)
        out.append(f"The band that adds most to the acceleration's RMS there, {COMPLIANT[variant]}: {most}.")
    for of in SIGNALS:
        miss = {v: mean_miss(study.of(v, "normal"), of) for v in VARIANTS}
        ends = [mean_miss(s.both, of) for s in study.sensitivities if s.value is not None]
        here = mean_miss(study.coarse["both"], of)
        out.append(
            f"Distance from the experiment, {WHAT[of]}: {miss['rigid']:.0f} %-points with everything rigid, "
            f"{miss['bearings']:.0f} with bearings alone, {miss['shafts']:.0f} with shafts alone, {miss['both']:.0f} "
            f"with both; {miss['all']:.0f} with elastic teeth as well."
            + (
                f" With both, on the coarser grid, {here:.0f}, and {min(ends):.0f} to {max(ends):.0f} with one "
                f"estimate at an end of its range: further off in {sum(x > here for x in ends)} of {len(ends)}."
                if ends
                else ""
            )
        )
    own = study.frictionless["rigid"][-1].bands
    apart = np.abs(study.frictionless["both"][-1].bands - own).max()
    out.append(
        f"Without friction compliant bearings and shafts change the rise of every band by at most {apart:.0f} %-points "
        f"against the rigid model ({own.min():.0f} to {own.max():.0f} %; {SHOWN[0]:g} rpm, {SHOWN[1]:g} N·m). With it, "
        "the reversal of friction at the pitch point excites vibration of the shafts, aligned or not."
    )
    out.append(
        "A misaligned axis produces no sidebands. A gear mounted at an angle on its shaft produces them at twice the "
        "shaft speed, and at the shaft speed itself where it is tilted about another place than mid-face."
    )
    return out


def sideband_table(study: Study) -> str:
    """Sidebands over their mesh line, median of the five harmonics."""
    lines = [
        f"sidebands at ± 1 and ± 2 times the shaft's speed, % of their mesh line (median of five), {SHOWN[0]:g} rpm, "
        f"{SHOWN[1]:g} N·m"
    ]
    lines.append(f"  {'what is tilted; compliant':<{WIDTH}}{'rigid':>16}{'bearings, shafts':>20}{'with teeth':>20}")
    for tilt in ("aligned", *TILTED):
        cells = []
        for variant in CROOKED:
            one, two = 100 * np.median(study.run(variant, tilt, *SHOWN).sidebands, axis=1)
            cells.append(f"{f'{one:.1f}':>{10 if variant == 'rigid' else 14}}{f'{two:.1f}':>6}")
        lines.append(f"  {TILTED.get(tilt, 'nothing'):<{WIDTH}}{''.join(cells)}")
    return "\n".join(lines)


def friction_table(study: Study) -> str:
    """The rise without friction, in every band."""
    lines = ["without friction: rise of the force, then of its bands 1–5 at 800 rpm and 200 N·m, normal to the plane"]
    for variant, rises in study.frictionless.items():
        lines.append(
            f"  {COMPLIANT[variant]:<{WIDTH}}{_cells(r.force for r in rises)}   bands{_cells(rises[-1].bands)}"
        )
    return "\n".join(lines)


def residual_table(study: Study) -> str:
    """The rise relative to a reference state that is itself slightly misaligned."""
    lines = [
        "rise relative to a reference state that is itself misaligned, normal to the plane of the axes: acceleration; "
        "force"
    ]
    for (variant, state), rises in study.residuals.items():
        cells = (_cells(getattr(r, of) for r in rises) for of in SIGNALS)
        miss = (f"{mean_miss(rises, of):.0f}" for of in SIGNALS)
        lines.append(f"  {COMPLIANT[variant]:<26}{state:<13}{';  '.join(cells)}   from exp. {'; '.join(miss)}")
    return "\n".join(lines)


def estimate_table(study: Study) -> str:
    """The estimated parameters, and the distance from the experiment at either end of their ranges."""
    lines = [
        "estimated, not in the paper; rise of the acceleration at either end of the range, normal to the plane of the "
        "axes; last: from exp.,",
        "acceleration and force",
    ]
    lines.append(_row("  as estimated", study.coarse["rigid"], study.coarse["both"]))
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
    return _row(f"    {label:<14}" if len(label) < 15 else f"    {label}\n{'':18}", s.rigid, s.both)


def _row(lead: str, rigid: Sequence[Rise] | None, both: Sequence[Rise]) -> str:
    return f"{lead:<18}{f'rigid{_at_end(rigid)}' if rigid else '':<59}both{_at_end(both)}"


def _at_end(rises: Sequence[Rise]) -> str:
    miss = "; ".join(f"{mean_miss(rises, of):.0f}" for of in SIGNALS)
    return f"{_cells(r.acceleration for r in rises)}   {miss}"


def draw_table(study: Study) -> str:
    """Over all sets of estimates drawn: medians, and how often nearer to the experiment than the rigid model."""
    n = len(study.draws)
    lines = [
        f"all estimates drawn from their ranges, {n} sets, axis normal to the plane: median (10 … 90 %) of the rise; "
        "last: sets nearer than rigid",
        "(of backlash no less than the drawn face needs to turn free)",
    ]
    for of in SIGNALS:
        lines.append(WHAT[of])
        lines.append(
            f"  {'compliant  (rpm/N·m)':<26}" + "".join(f"{f'{s:g}/{t:g}':>20}" for s, t in POINTS) + "   from exp."
        )
        lines.append(f"  {'experiment, about':<26}" + "".join(f"{f'+{EXPERIMENT_RISE[s]:.0f}':>20}" for s, _ in POINTS))
        for variant in DRAWN:
            cells = _spread([[getattr(r, of) for r in draw[variant]] for draw in study.draws])
            miss = study.misses(variant, of)
            nearer = "" if variant == "rigid" else f"{(miss < study.misses('rigid', of)).sum():10d}"
            lines.append(f"  {COMPLIANT[variant]:<26}{cells}{np.median(miss):12.0f}{nearer}")
    return "\n".join(lines)


def draw_band_table(study: Study) -> str:
    """Over all sets drawn: the rise of each band at the higher speed, which the sum over the bands hides."""
    lines = [f"the same by bands at {SPEEDS_RPM[1]:g} rpm (of force and acceleration alike)"]
    lines.append(f"  {'compliant  (N·m)':<32}" + "".join(f"{f'GMF{n}':>20}" for n in range(1, HARMONICS + 1)))
    for variant in DRAWN:
        for k in FAST:
            cells = _spread([draw[variant][k].bands for draw in study.draws])
            lines.append(f"  {COMPLIANT[variant]:<26}{POINTS[k][1]:>6g}{cells}")
    return "\n".join(lines)


def _spread(values: Any) -> str:
    """Median (10 … 90 %) of every column of (draws, n), 20 wide."""
    low, middle, high = np.quantile(np.array(values), (0.1, 0.5, 0.9), axis=0)
    return "".join(f"{f'{m:+.0f} ({a:.0f} … {b:.0f})':>20}" for m, a, b in zip(middle, low, high, strict=True))
