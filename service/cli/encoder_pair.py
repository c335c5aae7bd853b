"""What two encoders show of a gear pair: the section `pair` in words and in figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from service.cli.figure_style import AFTER, BEFORE, LOOK, MEASURED
from service.cli.show import reason
from service.contract.parts import with_assumed_radii as on_assumed_radii
from service.errors import InputError

MOST_TEETH = 6  # ratios of tooth counts that are named
RADII_MM = (0.5, 5000.0)  # of a wheel
CERTAIN = 2.0  # standard deviations from which a run-out is distinguished from none
TIMES = {1: "once", 2: "twice"}


def with_assumed_radii(answer: Mapping[str, Any], radii_mm: tuple[float, float]) -> dict[str, Any]:
    """The answer with run-out in µm on assumed base radii of pinion and gear [mm].

    Raises InputError where a radius cannot be, the answer has no pair, or the rig file has base radii.
    """
    low, high = RADII_MM
    for shaft, radius in zip(("pinion", "gear"), radii_mm, strict=True):
        if not low <= radius <= high:  # NaN fails too
            raise InputError(
                f"--base-radii-mm: {radius:g} mm of the {shaft} is outside [{low:g}, {high:g}] mm; metres?"
            )
    pair = answer.get("pair")
    if pair is None or "ratio" not in pair:
        why = "the answer has no pair of encoders" if pair is None else reason(pair)
        raise InputError(f"--base-radii-mm: there is no run-out to be given in µm: {why}")
    known = pair["base_radii"]
    if known is not None:
        raise InputError(
            f"--base-radii-mm: the rig file gives {known['pinion_mm']:g} and {known['gear_mm']:g} mm: leave it out"
        )
    return {**answer, "pair": on_assumed_radii(pair, (radii_mm[0] / 1e3, radii_mm[1] / 1e3))}


def sentences(pair: Mapping[str, Any] | None) -> list[str]:
    """The section in words; nothing where there is none."""
    if pair is None:
        return []
    if "ratio" not in pair:
        return [f"Gear pair from its two encoders: {reason(pair)}."]
    ratio, rest = pair["ratio"], pair["rest_urad"]
    share = 100 * ratio["std"] / ratio["value"]
    turns, speed = pair["turns"], pair["speed_hz"]
    out = [
        f"Gear pair from its two encoders, window {pair['window']}: {ratio['value']:.4f} ± {ratio['std']:.4f} turns "
        f"of the pinion for one of the gear ({share:.2f} %). {_teeth(pair['teeth_that_fit'])}",
        f"The pinion turned {turns['pinion']:.2f} times, the gear {turns['gear']:.2f}; pinion speed "
        f"{speed['mean']:.3f} Hz from the first edge to the last, {speed['highest']:.3f} Hz at most.",
    ]
    stated = pair["stated"]
    if stated is not None:
        verdict = "contradicted" if stated["contradicted"] else "not contradicted"
        out.append(
            f"The ratio {stated['ratio']:.4f} of {stated['source']} is {verdict}: {stated['deviations']:.1f} standard "
            "deviations away."
        )
    out += [_run_out(term, pair["base_radii"]) for term in pair["run_out"]]
    out.append(
        f"Transmission error, rms as an angle of the pinion: {rest['before']:,.0f} µrad, "
        f"{rest['after']:,.0f} µrad after removal of the run-out."
    )
    out += [
        f"Counts were missed at {step['time_s']:.2f} s: {step['counts']:+.0f} of the pinion's encoder, or as much of "
        "the gear's."
        for step in pair["missed_counts"]
    ]
    out += [_sharp(step) for step in pair["sharp_steps"]]
    if not pair["missed_counts"]:
        out.append("No missed counts were found.")
    return out


def _sharp(step: Mapping[str, Any]) -> str:
    """A sharp step that is not attributed to missed counts."""
    size = f"{step['counts']:+.0f} counts of the pinion's encoder"
    if step["shaft"] is None:
        return (
            f"A sharp step of {size} at {step['time_s']:.2f} s: missed counts, or a mark on a wheel that was "
            "passed only once."
        )
    return (
        f"A sharp step of {size} comes at {step['turn']:.3f} of the {step['shaft']}'s turn, in each of {step['times']} "
        "turns: a tooth, or a mark on its encoder's disc. If they were counts missed in every turn, the ratio would be "
        f"{step['ratio_if_missed']:.4f}."
    )


def _teeth(fit: Sequence[str]) -> str:
    if not fit:
        return "No tooth counts from 10 to 60 fit."
    more = f" and {len(fit) - MOST_TEETH} more" if len(fit) > MOST_TEETH else ""
    return f"Tooth counts of gear and pinion that fit: {', '.join(fit[:MOST_TEETH])}{more}."


def _run_out(term: Mapping[str, Any], radii: Mapping[str, Any] | None) -> str:
    """One term: how large, on which radius, and what it is indistinguishable from."""
    often = TIMES.get(term["multiple"], f"{term['multiple']} times")
    said = (
        f"Run-out {often} a turn of the {term['shaft']}: {term['amplitude_urad']:,.0f} ± {term['std_urad']:,.0f} µrad "
        "of the pinion"
    )
    if radii is not None:
        kind = "an assumed base radius" if radii["assumed"] else "its base radius"
        radius = radii[f"{term['shaft']}_mm"]
        said += f", {term['amplitude_um']:.0f} ± {term['std_um']:.0f} µm on {kind} of {radius:g} mm"
    none = "; not significant" if term["amplitude_urad"] < CERTAIN * term["std_urad"] else ""
    alike = term["indistinguishable_from"]
    return f"{said}; indistinguishable from that of {' or '.join(alike)}{none}."


def plots(pair: Mapping[str, Any] | None) -> list[Any]:
    """Transmission error over the pinion's turns, run-out of either wheel, speed against time."""
    if pair is None or "ratio" not in pair:
        return []
    return [_transmission_error(pair), _terms(pair), _speed(pair)]


def _transmission_error(pair: Mapping[str, Any]) -> Any:
    import plotly.graph_objects as go

    curve, rest = pair["transmission_error"], pair["rest_urad"]
    plot = go.Figure()
    for name, key, colour in (
        (f"as measured, {rest['before']:,.0f} µrad rms", "before_urad", BEFORE),
        (f"after removal of the run-out of both wheels, {rest['after']:,.0f} µrad rms", "after_urad", AFTER),
    ):
        plot.add_scatter(x=curve["pinion_turns"], y=curve[key], mode="lines", name=name, line_color=colour)
    for step in (*pair["missed_counts"], *pair["sharp_steps"]):
        again = f" each turn of the {step['shaft']}" if step.get("shaft") else ""
        plot.add_vline(
            x=step["pinion_turns"], line={"dash": "dot", "color": MEASURED, "width": 1},
            annotation_text=f"{step['counts']:+.0f} counts{again}",
        )  # fmt: skip
    plot.update_layout(
        title="Transmission error from the two encoders",
        xaxis_title="pinion turns",
        yaxis_title="angle of the pinion [µrad]",
        yaxis_tickformat=",",
        **LOOK,
    )
    return plot


def _terms(pair: Mapping[str, Any]) -> Any:
    import plotly.graph_objects as go

    radii = pair["base_radii"]
    unit, key = ("µrad of the pinion", "urad") if radii is None else ("µm", "um")
    own = pair["run_out"]
    plot = go.Figure()
    plot.add_bar(
        x=[f"{TIMES.get(t['multiple'], t['multiple'])} a turn of the {t['shaft']}" for t in own],
        y=[t[f"amplitude_{key}"] for t in own],
        error_y={"type": "data", "array": [t[f"std_{key}"] for t in own], "color": MEASURED},
        marker_color=AFTER,
    )
    on = "" if radii is None else f" on {'assumed ' if radii['assumed'] else ''}base radii of "
    on += "" if radii is None else f"{radii['pinion_mm']:g} and {radii['gear_mm']:g} mm"
    plot.update_layout(
        title=f"Run-out of wheel or disc{on}, with one standard deviation",
        yaxis_title=f"amplitude [{unit}]",
        yaxis_tickformat=",",
        **LOOK | {"height": 330},
    )
    return plot


def _speed(pair: Mapping[str, Any]) -> Any:
    import plotly.graph_objects as go

    speed = pair["speed"]
    plot = go.Figure()
    for shaft, colour in (("pinion", AFTER), ("gear", MEASURED)):
        plot.add_scatter(x=speed["time_s"], y=speed[f"{shaft}_hz"], mode="lines", name=shaft, line_color=colour)
    plot.update_layout(
        title="Speed of either wheel, from its encoder",
        xaxis_title="time after the window's start [s]",
        yaxis_title="speed [Hz]",
        **LOOK | {"height": 330},
    )
    return plot
