"""A report of one answer: plain text, or one HTML page that needs nothing else."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from html import escape
from math import ceil, floor, log10
from pathlib import Path
from typing import Any

from service.cli import encoder_pair as pair
from service.cli.answer import WINDOW_COLUMNS, answer_text, summary_lines, window_rows
from service.cli.diagnosis import sentence
from service.cli.diagnosis_figures import effects_part, figures
from service.contract.base import not_available
from service.errors import InputError

_STYLE = (
    "body{font:15px/1.5 system-ui,sans-serif;max-width:70rem;margin:2rem auto;padding:0 1rem;color:#222}"
    "table{border-collapse:collapse;font-size:13px}"
    "td,th{border-bottom:1px solid #ccc;padding:3px 8px;text-align:right}"
    "svg.chart{background:#fafafa;border:1px solid #ddd;margin:.5rem 0;max-width:100%;height:auto}"
)
_WIDTH, _HEIGHT, _EDGE = 640, 280, 50  # of a chart [px]


def load_answer(path: Path) -> dict[str, Any]:
    """The answer that `assess --json` wrote."""
    try:
        answer = json.loads(path.read_text(encoding="utf-8"))
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not an answer of gear-twin assess --json: {error}") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {(error.strerror or 'fault').lower()}") from None
    needed = ("asset", "windows", "wear", "rul", "effects", "data_quality")
    missing = [key for key in needed if key not in answer] if isinstance(answer, dict) else list(needed)
    if missing:
        raise InputError(f"{path}: not an answer of gear-twin assess --json: {', '.join(missing)} missing")
    # what answers of before the tracing do not have
    unknown = not_available("the answer was written without it")
    return {"tracing": unknown, "unexplained": unknown} | answer


def text_report(answer: Mapping[str, Any]) -> str:
    """The answer as plain text."""
    effects = [f"  {sentence(effect)}" for effect in answer["effects"]]
    return "\n".join([answer_text(answer), *(["", "Effects", *effects] if effects else [])])


def html_report(answer: Mapping[str, Any]) -> str:
    """The answer as one self-contained page."""
    head = "".join(f"<th>{escape(title)}</th>" for title, *_ in WINDOW_COLUMNS)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in window_rows(answer["windows"])
    )
    said = (*summary_lines(answer), *pair.sentences(answer.get("pair")))
    summary = "".join(f"<li>{escape(line)}</li>" for line in said)
    title = f"Gear wear of {escape(answer['asset'])}"
    rms = _chart(answer["windows"], {"measured": "rms_measured", "model": "rms_predicted"}, "RMS [m/s²]")
    depth = _chart(answer["windows"], {"model": "wear_depth_um"}, "largest wear depth [µm]")
    drawn = answer["effects"] or answer.get("pair") or answer.get("unattributed_lines")
    effects = f"{effects_part(answer)}{figures(answer)}" if drawn else ""
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{title}</title><style>{_STYLE}</style>'
        f"<h1>{title}</h1><ul>{summary}</ul><h2>RMS against revolutions</h2>{rms}"
        f"<h2>Wear depth against revolutions</h2>{depth}{effects}<h2>Windows</h2>"
        f"<table><tr>{head}</tr>{body}</table></html>"
    )


COLOURS = {"measured": "#444444", "model": "#1f77b4"}  # as on the service's page


def _chart(records: Sequence[Mapping[str, Any]], series: Mapping[str, str], unit: str) -> str:
    """Lines over the revolutions with labelled axes, as SVG."""
    points = {
        name: [
            (r["revolutions"], r[key])
            for r in records
            if r.get("kind") == "measurement" and r.get("revolutions") is not None and r.get(key) is not None
        ]
        for name, key in series.items()
    }
    flat = [point for line in points.values() for point in line]
    if not flat:
        return "<p>not available</p>"
    across, up = _ticks(max(x for x, _ in flat)), _ticks(max(y for _, y in flat))

    def place(x: float, y: float) -> tuple[float, float]:
        width, height = _WIDTH - 2 * _EDGE, _HEIGHT - 2 * _EDGE
        return round(_EDGE + x / across[-1] * width, 1), round(_HEIGHT - _EDGE - y / up[-1] * height, 1)

    parts = []
    for value in across:
        x, y = place(value, 0.0)
        parts.append(f'<text x="{x}" y="{y + 16}" text-anchor="middle" font-size="11">{value:g}</text>')
    for value in up:
        x, y = place(0.0, value)
        parts.append(f'<path d="M{x},{y} H{_WIDTH - _EDGE}" stroke="#ddd" fill="none"/>')
        parts.append(f'<text x="{x - 5}" y="{y + 4}" text-anchor="end" font-size="11">{value:g}</text>')
    for row, (name, line) in enumerate(points.items()):
        colour = COLOURS[name]
        marks = " ".join("{},{}".format(*place(x, y)) for x, y in line)
        parts.append(f'<polyline points="{marks}" fill="none" stroke="{colour}" stroke-width="2"/>')
        parts += ['<circle cx="{}" cy="{}" r="3" fill="{}"/>'.format(*place(x, y), colour) for x, y in line]
        parts.append(f'<text x="{_EDGE + 10}" y="{_EDGE + 18 * (row + 1)}" fill="{colour}">{escape(name)}</text>')
    base = _HEIGHT - _EDGE
    parts.append(f'<path d="M{_EDGE},{_EDGE} V{base} H{_WIDTH - _EDGE}" stroke="#888" fill="none"/>')
    parts.append(f'<text x="8" y="{_EDGE - 14}">{escape(unit)}</text>')
    parts.append(f'<text x="{_WIDTH - _EDGE}" y="{_HEIGHT - 10}" text-anchor="end">pinion revolutions</text>')
    return f'<svg class="chart" viewBox="0 0 {_WIDTH} {_HEIGHT}" width="{_WIDTH}" role="img">{"".join(parts)}</svg>'


def _ticks(top: float) -> list[float]:
    """Round values from 0 to at least `top`, some five of them."""
    if not top > 0:
        return [0.0, 1.0]
    power = 10.0 ** floor(log10(top / 4))
    step = next(m * power for m in (1, 2, 2.5, 5, 10) if m * power >= top / 4)
    return [i * step for i in range(ceil(round(top / step, 9)) + 1)]
