"""The diagnosis as one page with figures that needs nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

from service.cli import encoder_pair as pair
from service.cli import non_gear as strange
from service.cli.answer import summary_lines
from service.cli.diagnosis import change, figure, label, nats, sentences, turns
from service.cli.figure_style import AFTER, BEFORE, LOOK, MEASURED, STYLE, as_html
from service.cli.show import number

FLOOR = 1e-6  # amplitude below which nothing is drawn [m/s²]


def page(answer: Mapping[str, Any]) -> str:
    """HTML with the sentences, the evidence and the figures."""
    title = f"Diagnosis of {escape(answer['asset'])}"
    shown = "".join(f"<p>{escape(line)}</p>" for line in sentences(answer))
    summary = "".join(f"<li>{escape(line)}</li>" for line in summary_lines(answer))
    causes = strange.tables(answer.get("unattributed_lines", ()))
    log = "".join(f"<li>{escape(change(e))}</li>" for e in answer["tracing"].get("log") or [])
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{title}</title>'
        f'<meta name="viewport" content="width=device-width"><style>{STYLE}</style>'
        f"<h1>{title}</h1>{shown}{effects_part(answer)}{causes}{figures(answer)}"
        f"<h2>Wear and life</h2><ul>{summary}</ul>" + (f"<h2>Changes of the model</h2><ul>{log}</ul>" if log else "")
    )


def effects_part(answer: Mapping[str, Any]) -> str:
    """The table of effects; empty where there are none."""
    rows = []
    for e in answer["effects"]:
        evidence = e["evidence"]
        sizes = "<br>".join(escape(f"{name} {figure(value)}") for name, value in e["parameters"].items())
        cells = (
            escape(label(e["name"])),
            sizes,
            turns(e["onset_revolutions"]),
            nats(evidence["log_evidence"]),
            escape(f"{evidence.get('runner_up') or '–'} {number(evidence.get('over_runner_up'), 3)}"),
            f"{number(e['error_before'].get('waveform_percent'), 3)} → "
            f"{number(e['error_after'].get('waveform_percent'), 3)}",
            f"{number(e['error_before'].get('rms_percent'), 3)} → {number(e['error_after'].get('rms_percent'), 3)}",
            f"{number(e['wear_depth_um_before'], 4)} → {number(e['wear_depth_um_after'], 4)}",
        )
        rows.append("<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>")
    if not rows:
        return ""
    head = (
        "effect", "parameters", "since rev.", "ln evidence", "runner-up, lower by", "waveform error %", "RMS error %",
        "depth µm",
    )  # fmt: skip
    table = f"<table><tr>{''.join(f'<th>{h}</th>' for h in head)}</tr>{''.join(rows)}</table>"
    return f'<h2>Effects</h2><div style="overflow-x:auto">{table}</div>'


def figures(answer: Mapping[str, Any]) -> str:
    """The figures as HTML; empty where there is nothing to draw."""
    others = [*strange.plots(answer.get("unattributed_lines", ())), *pair.plots(answer.get("pair"))]
    breakdown = answer.get("energy_breakdown")
    others.append(strange.energy_plot(breakdown if isinstance(breakdown, list) else ()))
    return as_html((_by_band(answer), _by_order(answer), _depths(answer), *others))


def _by_band(answer: Mapping[str, Any]) -> Any:
    import plotly.graph_objects as go

    residual = answer["tracing"].get("residual")
    if not residual:
        return None
    harmonics = [f"{b['harmonic']} · {b['frequency_hz']:.0f} Hz" for b in residual["bands"]]
    plot = go.Figure()
    for name, key, colour in (
        ("measured", "measured", MEASURED),
        ("model with wear alone", "before", BEFORE),
        ("model with the effects", "after", AFTER),
    ):
        plot.add_bar(x=harmonics, y=[b[key] for b in residual["bands"]], name=name, marker_color=colour)
    plot.update_layout(
        title=f"Held-out window {residual['window']} by mesh harmonic",
        xaxis_title="mesh harmonic ± 2 shaft orders",
        yaxis_title="RMS [m/s²]",
        **LOOK,
    )
    return plot


def _by_order(answer: Mapping[str, Any]) -> Any:
    import plotly.graph_objects as go

    residual = answer["tracing"].get("residual")
    if not residual:
        return None
    plot = go.Figure()
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
    plot.update_layout(
        title="The same window by order: measured lines and their residuals",
        xaxis_title="order of the pinion's rotation",
        yaxis_title="amplitude [m/s²]",
        yaxis_type="log",
        yaxis_dtick=1,
        **LOOK,
    )
    return plot


def _depths(answer: Mapping[str, Any]) -> Any:
    import plotly.graph_objects as go

    rows = answer["tracing"].get("depths") or []
    if not rows or not answer["effects"]:
        return None
    plot = go.Figure()
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
    plot.update_layout(
        title="Wear depth, whole history re-evaluated",
        xaxis_title="pinion revolutions",
        yaxis_title="largest wear depth [µm]",
        **LOOK,
    )
    return plot
