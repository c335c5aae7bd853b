"""Diagnoses and relations as one page with figures that needs nothing else."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from html import escape
from typing import Any

from service.report.baseline import comparison_sentences, error_lines
from service.report.content import report_of
from service.report.plots import comparison_plots, diagnosis_plots, relation_plots
from service.report.relation import TABLE, relation_sentences, relation_text
from service.report.text import change, diagnosis_sentences, rival, summary_lines, turns
from service.report.words import label, number, size

STYLE = (
    "body{font:15px/1.5 system-ui,sans-serif;max-width:70rem;margin:2rem auto;padding:0 1rem;color:#222}"
    "table{border-collapse:collapse;font-size:13px}td,th{border-bottom:1px solid #ccc;padding:3px 8px;text-align:left}"
)
CONFIG = {"showSendToCloud": False, "displaylogo": False}  # no button that uploads a chart anywhere
EFFECT_HEADS = (
    "effect", "parameters", "since rev.", "ln evidence", "runner-up, lower by", "waveform error %", "RMS error %",
    "depth µm",
)  # fmt: skip


def diagnosis_page(answer: Mapping[str, Any]) -> str:
    """The sentences, the evidence and the figures of a diagnosis."""
    causes = _causes(answer.get("unattributed_lines", ()))
    log = _list("Changes of the model", (change(entry) for entry in answer["tracing"].get("log") or ()))
    return _page(
        f"Diagnosis of {answer['asset']}",
        f"{_paragraphs(diagnosis_sentences(answer))}{_effects(answer)}{causes}{_drawn(diagnosis_plots(answer))}"
        f"{_list('Wear and life', summary_lines(report_of(answer), answer))}{log}",
    )


def comparison_page(answer: Mapping[str, Any]) -> str:
    """The sentences, the errors and the figures of a comparison with a healthy baseline."""
    errors = "\n".join(error_lines(answer["residual"]))
    return _page(
        f"Diagnosis of {answer['asset']} compared with its healthy baseline",
        f"{_paragraphs(comparison_sentences(answer))}<pre>{escape(errors)}</pre>"
        f"{_causes(answer['unattributed_lines'])}{_drawn(comparison_plots(answer))}",
    )


def relation_page(answer: Mapping[str, Any]) -> str:
    """The sentences, the table and the figures of a relation of level and depth."""
    _, head, table = relation_text(answer).partition(TABLE)
    return _page(
        f"Level against wear depth of {answer['asset']}",
        f"{_paragraphs([answer['description'], *relation_sentences(answer)])}{_drawn(relation_plots(answer))}"
        f'<pre style="overflow-x:auto">{escape(head + table)}</pre>',
    )


def _page(title: str, content: str) -> str:
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{escape(title)}</title>'
        f'<meta name="viewport" content="width=device-width"><style>{STYLE}</style>'
        f"<h1>{escape(title)}</h1>{content}"
    )


def _drawn(plots: Iterable[Any]) -> str:
    """The figures as HTML, Plotly's script once; what is None is left out."""
    return "".join(
        plot.to_html(full_html=False, include_plotlyjs="inline" if i == 0 else False, config=CONFIG)
        for i, plot in enumerate(plot for plot in plots if plot is not None)
    )


def _paragraphs(lines: Iterable[str]) -> str:
    return "".join(f"<p>{escape(line)}</p>" for line in lines)


def _list(title: str, lines: Iterable[str]) -> str:
    items = "".join(f"<li>{escape(line)}</li>" for line in lines)
    return f"<h2>{title}</h2><ul>{items}</ul>" if items else ""


def _table(title: str, heads: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A table of cells that are text; empty where there is no row."""
    body = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows)
    head = "".join(f"<th>{head}</th>" for head in heads)
    table = f'<div style="overflow-x:auto"><table><tr>{head}</tr>{body}</table></div>'
    return f"<h2>{title}</h2>{table}" if body else ""


def _effects(answer: Mapping[str, Any]) -> str:
    rows = []
    for e in answer["effects"]:
        before, after = e["error_before"], e["error_after"]
        errors = [
            f"{number(before.get(key))} → {number(after.get(key))}" for key in ("waveform_percent", "rms_percent")
        ]
        sizes = "; ".join(f"{name} {size(value)}" for name, value in e["parameters"].items())
        depth = f"{number(e['wear_depth_um_before'], 4)} → {number(e['wear_depth_um_after'], 4)}"
        gain = turns(e["evidence"]["log_evidence"])
        rows.append(
            (label(e["name"]), sizes, turns(e["onset_revolutions"]), gain, rival(e["evidence"]), *errors, depth)
        )
    return _table("Effects", EFFECT_HEADS, rows)


def _causes(strange: Iterable[Mapping[str, Any]]) -> str:
    """The causes tested on each spacing of lines."""
    out = ""
    for found in strange:
        causes = sorted(found["causes"], key=lambda c: not c["possible"])
        rows = [(c["name"], "possible" if c["possible"] else "fails", c["detail"]) for c in causes]
        title = f"Causes tested for {found['frequency_hz'] / found['part']:.3f} Hz"
        out += _table(title, ("cause", "", "reason"), rows)
    return out
