"""Figures of diagnoses and relations, by plotly; each is None where there is nothing to draw."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from service.report.findings import effect_label
from service.report.lines import TIMES
from service.report.words import label

BEFORE, AFTER, MEASURED, SPLINE = "#d62728", "#1f77b4", "#444444", "#2ca02c"
COLOURS = (AFTER, BEFORE, SPLINE, "#9467bd", "#ff7f0e", "#8c564b")
LOOK: dict[str, Any] = {
    "template": "plotly_white",
    "height": 400,
    "margin": {"t": 100},
    "legend": {"orientation": "h", "y": 1, "yanchor": "bottom"},
}
FLOOR = 1e-6  # amplitude below which nothing is drawn [m/s²]
LEAST_DRAWN = 0.05  # share of the energy [%]
SPECTRUM_FLOOR = 1e-4  # of the highest line shown


def figure(title: str, x: str | None = None, y: str | None = None, **layout: Any) -> Any:
    """An empty figure with its title and what its axes show."""
    import plotly.graph_objects as go

    return go.Figure(layout={**LOOK, "title": title, "xaxis_title": x, "yaxis_title": y, **layout})


def panels(rows: int, columns: int, title: str, **given: Any) -> Any:
    """A figure of several panels."""
    from plotly.subplots import make_subplots

    return make_subplots(rows=rows, cols=columns, **given).update_layout(**LOOK, title=title)


# -- diagnosis -------------------------------------------------------------------------------------------


def diagnosis_plots(answer: Mapping[str, Any]) -> list[Any]:
    """All figures of a diagnosis."""
    strange, breakdown = answer.get("unattributed_lines", ()), answer.get("energy_breakdown")
    residual = answer["tracing"].get("residual")
    own = [_by_band(residual), _by_order(residual)] if residual else []
    energies = [energy_plot(breakdown)] if isinstance(breakdown, list) and breakdown else []
    return [*own, _depths(answer), *spacing_plots(strange), *pair_plots(answer.get("pair")), *energies]


def _by_band(residual: Mapping[str, Any]) -> Any:
    title = f"Held-out window {residual['window']} by mesh harmonic"
    plot = figure(title, "mesh harmonic ± 2 shaft orders", "RMS [m/s²]")
    harmonics = [f"{b['harmonic']} · {b['frequency_hz']:.0f} Hz" for b in residual["bands"]]
    for name, key, colour in (
        ("measured", "measured", MEASURED),
        ("model with wear alone", "before", BEFORE),
        ("model with the effects", "after", AFTER),
    ):
        plot.add_bar(x=harmonics, y=[b[key] for b in residual["bands"]], name=name, marker_color=colour)
    return plot


def _by_order(residual: Mapping[str, Any]) -> Any:
    title = "The same window by order: measured lines and their residuals"
    plot = figure(title, "order of the pinion's rotation", "amplitude [m/s²]", yaxis_type="log", yaxis_dtick=1)
    levels = [o[key] for o in residual["orders"] for key in ("measured", "before", "after")]
    lowest = max(min((v for v in levels if v > 0), default=FLOOR), FLOOR) / 2
    stems: list[tuple[Any, Any]] = []
    for o in residual["orders"]:
        stems += [(o["order"], lowest), (o["order"], max(o["measured"], o["before"])), (None, None)]
    plot.add_scatter(
        x=[x for x, _ in stems], y=[y for _, y in stems], mode="lines", line={"color": "#bbbbbb", "width": 1},
        hoverinfo="skip", showlegend=False,
    )  # fmt: skip
    for name, key, colour, symbol in (
        ("measured", "measured", MEASURED, "circle-open"),
        ("residual without the effects", "before", BEFORE, "triangle-up"),
        ("residual with the effects", "after", AFTER, "triangle-down"),
    ):
        plot.add_scatter(
            x=[o["order"] for o in residual["orders"]],
            y=[max(o[key], lowest) for o in residual["orders"]],
            mode="markers",
            name=name,
            marker={"color": colour, "symbol": symbol, "size": 8},
        )
    return plot


def _depths(answer: Mapping[str, Any]) -> Any:
    rows = answer["tracing"].get("depths") or []
    if not rows or not answer["effects"]:
        return None
    plot = figure("Wear depth, whole history re-evaluated", "pinion revolutions", "largest wear depth [µm]")
    for name, key, colour in (
        ("wear alone", "wear_depth_um_before", BEFORE),
        ("with the effects", "wear_depth_um_after", AFTER),
    ):
        plot.add_scatter(
            x=[r["revolutions"] for r in rows], y=[r[key] for r in rows], name=name, line_color=colour,
            mode="lines+markers",
        )  # fmt: skip
    for effect in answer["effects"]:
        if effect["onset_revolutions"]:
            plot.add_vline(x=effect["onset_revolutions"], line_dash="dot", annotation_text=label(effect["name"]))
    return plot


def energy_plot(breakdown: Sequence[Mapping[str, Any]]) -> Any:
    """The shares of the energy by their source, stacked."""
    title = "Energy by source (the rest is in no line of these)"
    plot = figure(title, y="share of the energy [%]", barmode="stack", yaxis_range=[0, 100])
    for name in dict.fromkeys(b["family"] for b in breakdown):
        own = [b for b in breakdown if b["family"] == name]
        if max(b["share_percent"] for b in own) >= LEAST_DRAWN:
            plot.add_bar(x=[b["channel"] for b in own], y=[b["share_percent"] for b in own], name=name)
    return plot


def spacing_plots(strange: Sequence[Mapping[str, Any]]) -> list[Any]:
    """The spectrum around the mesh lines and the modulation's depth, for each spacing."""
    return [plot for found in strange for plot in (_spectrum(found), _depth(found))]


def _spectrum(found: Mapping[str, Any]) -> Any:
    parts, spacing = found.get("spectrum") or [], found["frequency_hz"]
    if not parts:
        return None
    title = f"{parts[0]['channel']}: spectrum around the mesh lines, marked at mesh ± n·{spacing:.3f} Hz"
    plot = panels(len(parts), 1, title, vertical_spacing=0.3 / len(parts))
    for i, part in enumerate(parts):
        frequency = [part["from_hz"] + j * part["step_hz"] for j in range(len(part["amplitude"]))]
        highest = max(part["amplitude"])
        middle = (frequency[0] + frequency[-1]) / 2
        near = {"row": i + 1, "col": 1}
        plot.add_scatter(
            x=frequency, y=[max(a, highest * SPECTRUM_FLOOR) for a in part["amplitude"]], mode="lines",
            line={"color": MEASURED, "width": 1}, name="spectrum", showlegend=False, **near,
        )  # fmt: skip
        for m in (-3, -2, -1, 1, 2, 3):
            plot.add_vline(
                x=middle + m * spacing, line={"color": BEFORE, "width": 1, "dash": "dot"}, **near,
                annotation={"text": f"{m:+d}×", "font": {"color": BEFORE, "size": 11}},
            )  # fmt: skip
        plot.update_xaxes(title=f"around mesh harmonic {part['harmonic']} [Hz]", **near)
        plot.update_yaxes(type="log", title="in the channel's unit", exponentformat="power", dtick=1, **near)
    return plot.update_layout(height=90 + 260 * len(parts), margin={"t": 90})


def _depth(found: Mapping[str, Any]) -> Any:
    sides = [s for s in found["sidebands"] if s["depth"] is not None]
    if not sides:
        return None
    channels = sorted({s["channel"] for s in sides}, reverse=True)
    columns = sorted({(s["harmonic"], s["multiple"]) for s in sides})
    depth = {(s["channel"], s["harmonic"], s["multiple"]): 100 * s["depth"] for s in sides}
    values = [[depth.get((c, h, m)) for h, m in columns] for c in channels]
    title = f"Depth of the modulation at n·{found['frequency_hz']:.3f} Hz: both side lines over the mesh line [%]"
    plot = figure(title, height=160 + 32 * len(channels))
    return plot.add_heatmap(
        x=[f"mesh {h} ± {m}×" for h, m in columns], y=channels, z=values, colorscale="Blues", zmin=0,
        text=[["" if v is None else f"{v:.0f}" for v in row] for row in values], texttemplate="%{text}",
        colorbar={"title": "%"}, hoverongaps=False, xgap=2, ygap=2,
    )  # fmt: skip


def pair_plots(pair: Mapping[str, Any] | None) -> list[Any]:
    """Transmission error over the pinion's turns, run-out of either wheel, speed against time."""
    if pair is None or "ratio" not in pair:
        return []
    return [_transmission_error(pair), _run_out(pair), _speed(pair)]


def _transmission_error(pair: Mapping[str, Any]) -> Any:
    curve, rest = pair["transmission_error"], pair["rest_urad"]
    title = "Transmission error from the two encoders"
    plot = figure(title, "pinion turns", "angle of the pinion [µrad]", yaxis_tickformat=",")
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
    return plot


def _run_out(pair: Mapping[str, Any]) -> Any:
    radii, own = pair["base_radii"], pair["run_out"]
    unit, key, on = "µrad of the pinion", "urad", ""
    if radii is not None:
        unit, key = "µm", "um"
        kind = "assumed base radii" if radii["assumed"] else "base radii"
        on = f" on {kind} of {radii['pinion_mm']:g} and {radii['gear_mm']:g} mm"
    title = f"Run-out of wheel or disc{on}, with one standard deviation"
    plot = figure(title, y=f"amplitude [{unit}]", yaxis_tickformat=",", height=330)
    return plot.add_bar(
        x=[f"{TIMES.get(t['multiple'], t['multiple'])} a turn of the {t['shaft']}" for t in own],
        y=[t[f"amplitude_{key}"] for t in own],
        error_y={"type": "data", "array": [t[f"std_{key}"] for t in own], "color": MEASURED},
        marker_color=AFTER,
    )


def _speed(pair: Mapping[str, Any]) -> Any:
    speed = pair["speed"]
    title = "Speed of either wheel, from its encoder"
    plot = figure(title, "time after the window's start [s]", "speed [Hz]", height=330)
    for shaft, colour in (("pinion", AFTER), ("gear", MEASURED)):
        plot.add_scatter(x=speed["time_s"], y=speed[f"{shaft}_hz"], mode="lines", name=shaft, line_color=colour)
    return plot


# -- comparison with a baseline --------------------------------------------------------------------------


def comparison_plots(answer: Mapping[str, Any]) -> list[Any]:
    """All figures of a comparison with a healthy baseline."""
    return [_bands(answer), _paths(answer), _turns(answer), *spacing_plots(answer["unattributed_lines"])]


def _bands(answer: Mapping[str, Any]) -> Any:
    """RMS of the mesh bands, one panel a channel."""
    bands = answer["residual"]["bands"]
    channels = list(dict.fromkeys(b["channel"] for b in bands))
    if not channels:
        return None
    rows = -(-len(channels) // 2)
    title = "RMS of the mesh bands, on turns that no fit used"
    plot = panels(rows, 2, title, subplot_titles=channels, vertical_spacing=0.45 / rows)
    for i, channel in enumerate(channels):
        own = [b for b in bands if b["channel"] == channel]
        for name, key, colour in (
            ("measured", "measured", MEASURED),
            ("baseline", "predicted_before", BEFORE),
            ("with the effects found", "predicted", AFTER),
        ):
            plot.add_bar(
                x=[b["harmonic"] for b in own], y=[b[key] for b in own], name=name, marker_color=colour,
                legendgroup=name, showlegend=i == 0, row=i // 2 + 1, col=i % 2 + 1,
            )  # fmt: skip
    plot.update_xaxes(title="mesh harmonic ± 2 orders", dtick=1)
    return plot.update_layout(height=160 + 280 * rows, margin={"t": 130}, legend_y=1.0 + 0.16 / rows)


def _paths(answer: Mapping[str, Any]) -> Any:
    """Gain of every changed transfer path against frequency."""
    changed = [e for e in answer["effects"] if "gain" in e["curves"]]
    if not changed:
        return None
    title = "Changed transfer paths to the sensors: gain relative to the baseline"
    plot = figure(title, "frequency [Hz]", "gain", yaxis_type="log", yaxis_dtick=1)
    for i, effect in enumerate(changed):
        curves, colour, channel = effect["curves"], COLOURS[i % len(COLOURS)], effect["channels"][0]
        plot.add_scatter(
            x=curves["frequency_hz"], y=curves["gain"], mode="markers", name=f"{channel}, lines of all shafts",
            marker_color=colour,
        )  # fmt: skip
        if curves["fitted"]:
            plot.add_scatter(
                x=curves["frequency_hz"], y=curves["fitted"], mode="lines", line_color=colour,
                name=f"{channel}, {effect_label(effect)}",
            )  # fmt: skip
    return plot.add_hline(y=1.0, line_dash="dot", line_color="#888888")


def _turns(answer: Mapping[str, Any]) -> Any:
    """What shafts add to the baseline, over one turn."""
    changed = [e for e in answer["effects"] if "turn" in e["curves"]]
    if not changed:
        return None
    title = "Added to the baseline over one turn of the shaft"
    plot = figure(title, "angle of the shaft [turns]", "signal, in the channel's unit", showlegend=True)
    for effect in changed:
        order = effect["parameters"]["shaft_order"]["value"]
        plot.add_scatter(
            x=effect["curves"]["turn"], y=effect["curves"]["added"], mode="lines",
            name=f"{effect_label(effect)}, order {order:g}, {effect['channels'][0]}",
        )  # fmt: skip
    return plot


# -- relation of level and depth -------------------------------------------------------------------------


def relation_plots(answer: Mapping[str, Any]) -> list[Any]:
    """All figures of a relation of level and depth."""
    return [_levels(answer), _causes(answer), _apart(answer)]


def _levels(answer: Mapping[str, Any]) -> Any:
    """Cases and curves, one panel a condition."""
    conditions = list(answer["conditions"])
    plot = panels(1, len(conditions), "Level against wear depth", subplot_titles=conditions)
    for i, k in enumerate(conditions, 1):
        curve, cases = answer["curves"][k], answer["cases"]

        def drawn(name: str, x: Any, y: Any, at: int = i, **given: Any) -> None:
            plot.add_scatter(
                **{"mode": "lines", "name": name, "legendgroup": name, "showlegend": at == 1, **given},
                x=x, y=y, row=1, col=at,
            )  # fmt: skip

        band = "5–95 % of a new assembly"
        drawn(band, curve["depth_um"], curve["high"], line_width=0, showlegend=False, hoverinfo="skip")
        drawn(band, curve["depth_um"], curve["low"], line_width=0, fill="tonexty", fillcolor="rgba(31,119,180,0.15)")
        drawn("chosen relation", curve["depth_um"], curve["level"], line_color=AFTER)
        drawn("model with background", curve["depth_um"], curve["twin"], line={"color": BEFORE, "dash": "dash"})
        drawn("spline", curve["spline_depth_um"], curve["spline"], line={"color": SPLINE, "dash": "dot"})
        drawn(
            "measured, one an assembly", [c["depth_um"] for c in cases], [c["level"][k] for c in cases], mode="markers",
            error_y={"array": [c["scatter"][k] for c in cases], "thickness": 1}, marker_color=MEASURED,
            text=[c["name"] for c in cases],
        )  # fmt: skip
    plot.update_xaxes(title="largest wear depth [µm]")
    plot.update_yaxes(title="RMS [m/s²]", rangemode="tozero")
    return plot.update_layout(height=500, margin={"t": 140}, legend_y=1.1)


def _causes(answer: Mapping[str, Any]) -> Any:
    """Mean errors on cases left out, by what was tried."""
    rows = [t for t in answer["trials"] if t["name"] != "twin"]  # without a background its bar hides all others
    rows = [*rows, {"name": "chosen", **answer["chosen"]}]
    title = "Error on left-out worn cases (the model with a gain alone is beyond the scale)"
    plot = figure(title, y="mean |error| [%]")
    for k, colour in zip(answer["conditions"], COLOURS, strict=False):
        errors = [r["mean_error_percent"][k] for r in rows]
        plot.add_bar(x=[r["name"] for r in rows], y=errors, name=k, marker_color=colour)
    return plot


def _apart(answer: Mapping[str, Any]) -> Any:
    """How much of the time no tooth touches."""
    title = "Time without contact, modelled with the values of the rig file"
    plot = figure(title, "largest wear depth [µm]", "share of the time [%]")
    for k, colour in zip(answer["conditions"], COLOURS, strict=False):
        apart = answer["curves"][k]["apart"]
        share = [100 * s for s in apart["share"]]
        plot.add_scatter(x=apart["depth_um"], y=share, mode="lines", name=k, line_color=colour)
    return plot
