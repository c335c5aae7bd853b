"""Diagnoses and relations as one page with figures that needs nothing else."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from html import escape
from typing import Any

from service.report.baseline import comparison_sentences, error_lines
from service.report.content import report_of
from service.report.html import bullets, page, paragraphs, table
from service.report.plots import comparison_plots, diagnosis_plots, relation_plots
from service.report.relation import TABLE, relation_sentences, relation_text
from service.report.text import EFFECT_COLUMNS, change, diagnosis_sentences, effect_rows, summary_lines

STYLE = (
    "body{font:15px/1.5 system-ui,sans-serif;max-width:70rem;margin:2rem auto;padding:0 1rem;color:#222}"
    "table{border-collapse:collapse;font-size:13px}td,th{border-bottom:1px solid #ccc;padding:3px 8px;text-align:left}"
)
CONFIG = {"showSendToCloud": False, "displaylogo": False}  # no button that uploads a chart anywhere


def diagnosis_page(answer: Mapping[str, Any]) -> str:
    """The sentences, the evidence and the figures of a diagnosis."""
    causes = _causes(answer.get("unattributed_lines", ()))
    effects = table("Effects", effect_rows(answer["effects"]), [EFFECT_COLUMNS])
    log = bullets("Changes of the model", (change(entry) for entry in answer["tracing"].get("log") or ()))
    return page(
        f"Diagnosis of {answer['asset']}",
        STYLE,
        f"{paragraphs(diagnosis_sentences(answer))}{effects}{causes}{_drawn(diagnosis_plots(answer))}"
        f"{bullets('Wear and life', summary_lines(report_of(answer), answer))}{log}",
    )


def comparison_page(answer: Mapping[str, Any]) -> str:
    """The sentences, the errors and the figures of a comparison with a healthy baseline."""
    errors = "\n".join(error_lines(answer["residual"]))
    return page(
        f"Diagnosis of {answer['asset']} compared with its healthy baseline",
        STYLE,
        f"{paragraphs(comparison_sentences(answer))}<pre>{escape(errors)}</pre>"
        f"{_causes(answer['unattributed_lines'])}{_drawn(comparison_plots(answer))}",
    )


def relation_page(answer: Mapping[str, Any]) -> str:
    """The sentences, the table and the figures of a relation of level and depth."""
    _, head, tested = relation_text(answer).partition(TABLE)
    return page(
        f"Level against wear depth of {answer['asset']}",
        STYLE,
        f"{paragraphs([answer['description'], *relation_sentences(answer)])}{_drawn(relation_plots(answer))}"
        f'<pre style="overflow-x:auto">{escape(head + tested)}</pre>',
    )


def _drawn(plots: Iterable[Any]) -> str:
    """The figures as HTML, Plotly's script once; what is None is left out."""
    return "".join(
        plot.to_html(full_html=False, include_plotlyjs="inline" if i == 0 else False, config=CONFIG)
        for i, plot in enumerate(plot for plot in plots if plot is not None)
    )


def _causes(strange: Iterable[Mapping[str, Any]]) -> str:
    """The causes tested on each spacing of lines."""
    out = ""
    for found in strange:
        causes = sorted(found["causes"], key=lambda c: not c["possible"])
        rows = [(c["name"], "possible" if c["possible"] else "fails", c["detail"]) for c in causes]
        title = f"Causes tested for {found['frequency_hz'] / found['part']:.3f} Hz"
        out += table(title, rows, [("cause", "", "reason")])
    return out
