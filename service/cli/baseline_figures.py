"""A comparison with a healthy baseline, as one page with figures that needs nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

from service.cli import non_gear as strange
from service.cli.baseline_report import baseline_label, text
from service.cli.figure_style import AFTER, BEFORE, LOOK, MEASURED, STYLE, as_html

LINES = ("Error on turns", "Mesh bands")  # of the text, from which the figures say the same


def page(answer: Mapping[str, Any]) -> str:
    """HTML with the sentences and the figures."""
    title = f"Diagnosis of {escape(answer['asset'])} compared with its healthy baseline"
    parts = text(answer).split("\n\n")[1:]
    shown = "".join(
        f"<p>{escape(line)}</p>" for part in parts if not part.startswith(LINES) for line in part.splitlines() if line
    )
    errors = next((part for part in parts if part.startswith(LINES[0])), "")
    figures = as_html((_bands(answer), _paths(answer), _turns(answer), *strange.plots(answer["unattributed_lines"])))
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{title}</title>'
        f'<meta name="viewport" content="width=device-width"><style>{STYLE}</style>'
        f"<h1>{title}</h1>{shown}<pre>{escape(errors)}</pre>{strange.tables(answer['unattributed_lines'])}{figures}"
    )


def _bands(answer: Mapping[str, Any]) -> Any:
    """RMS of the mesh bands, one panel a channel."""
    from plotly.subplots import make_subplots

    bands = answer["residual"]["bands"]
    channels = list(dict.fromkeys(b["channel"] for b in bands))
    if not channels:
        return None
    rows = -(-len(channels) // 2)
    plot = make_subplots(rows=rows, cols=2, subplot_titles=channels, vertical_spacing=0.45 / rows)
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
    plot.update_layout(
        title="RMS of the mesh bands, on turns that no fit used",
        **LOOK
        | {
            "height": 160 + 280 * rows,
            "margin": {"t": 130},
            "legend": {"orientation": "h", "y": 1.0 + 0.16 / rows, "yanchor": "bottom"},
        },
    )
    return plot


def _paths(answer: Mapping[str, Any]) -> Any:
    """Gain of every changed transfer path against frequency."""
    import plotly.graph_objects as go

    changed = [e for e in answer["effects"] if "gain" in e["curves"]]
    if not changed:
        return None
    plot = go.Figure()
    colours = ("#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#ff7f0e", "#8c564b")
    for i, effect in enumerate(changed):
        curves, colour, channel = effect["curves"], colours[i % len(colours)], effect["channels"][0]
        plot.add_scatter(
            x=curves["frequency_hz"], y=curves["gain"], mode="markers", name=f"{channel}, lines of all shafts",
            marker_color=colour,
        )  # fmt: skip
        if curves["fitted"]:
            plot.add_scatter(
                x=curves["frequency_hz"], y=curves["fitted"], mode="lines", line_color=colour,
                name=f"{channel}, {baseline_label(effect['name'])}",
            )  # fmt: skip
    plot.add_hline(y=1.0, line_dash="dot", line_color="#888888")
    plot.update_layout(
        title="Changed transfer paths to the sensors: gain relative to the baseline",
        xaxis_title="frequency [Hz]",
        yaxis_title="gain",
        yaxis_type="log",
        yaxis_dtick=1,
        **LOOK,
    )
    return plot


def _turns(answer: Mapping[str, Any]) -> Any:
    """What shafts add to the baseline, over one turn."""
    import plotly.graph_objects as go

    changed = [e for e in answer["effects"] if "turn" in e["curves"]]
    if not changed:
        return None
    plot = go.Figure()
    for effect in changed:
        order = effect["parameters"]["shaft_order"]["value"]
        plot.add_scatter(
            x=effect["curves"]["turn"], y=effect["curves"]["added"], mode="lines",
            name=f"{baseline_label(effect['name'])}, order {order:g}, {effect['channels'][0]}",
        )  # fmt: skip
    plot.update_layout(
        title="Added to the baseline over one turn of the shaft",
        xaxis_title="angle of the shaft [turns]",
        yaxis_title="signal, in the channel's unit",
        showlegend=True,
        **LOOK,
    )
    return plot
