"""How the pages with figures look, and how their figures become HTML."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

BEFORE, AFTER, MEASURED = "#d62728", "#1f77b4", "#444444"
STYLE = (
    "body{font:15px/1.5 system-ui,sans-serif;max-width:70rem;margin:2rem auto;padding:0 1rem;color:#222}"
    "table{border-collapse:collapse;font-size:13px}td,th{border-bottom:1px solid #ccc;padding:3px 8px;text-align:left}"
)
LOOK: dict[str, Any] = {
    "template": "plotly_white",
    "height": 400,
    "margin": {"t": 100},
    "legend": {"orientation": "h", "y": 1, "yanchor": "bottom"},
}


CONFIG = {"showSendToCloud": False, "displaylogo": False}  # no button that uploads a chart anywhere


def as_html(plots: Iterable[Any]) -> str:
    """The figures as HTML, Plotly's script once; empty where there is none. None among them is left out."""
    drawn = [plot for plot in plots if plot is not None]
    return "".join(
        plot.to_html(full_html=False, include_plotlyjs="inline" if i == 0 else False, config=CONFIG)
        for i, plot in enumerate(drawn)
    )
