"""A report as a PDF of two A4 pages: the conclusion, then the appendix; by reportlab."""

from __future__ import annotations

import io
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

from reportlab.lib import colors
from reportlab.lib.pagesizes import A4
from reportlab.lib.styles import ParagraphStyle
from reportlab.lib.units import mm
from reportlab.pdfbase import pdfmetrics
from reportlab.pdfbase.ttfonts import TTFont
from reportlab.platypus import Flowable, Image, KeepInFrame, PageBreak, Paragraph, SimpleDocTemplate, Spacer, Table

from service.report.content import LEVELS, Report, Row
from service.report.html import COLOURS
from service.report.trends import SIZE, as_png, trends

MARGIN = 16 * mm
WIDTH, HEIGHT = A4[0] - 2 * MARGIN, A4[1] - 2 * MARGIN - 4 * mm
GREY = colors.HexColor("#57606a")
LINE = colors.HexColor("#d0d7de")


def pdf(report: Report) -> bytes:
    """The file's bytes. What does not fit a page is made smaller, so that there are always two."""
    styles = _styles()
    out = io.BytesIO()
    document = SimpleDocTemplate(
        out, pagesize=A4, leftMargin=MARGIN, rightMargin=MARGIN, topMargin=MARGIN, bottomMargin=MARGIN,
        title=f"Report on {report.asset}", author="gear-twin", subject=LEVELS[report.level],
    )  # fmt: skip
    pages = [
        KeepInFrame(WIDTH, HEIGHT, page, mode="shrink") for page in (_first(report, styles), _second(report, styles))
    ]

    def footer(canvas: Any, _: Any) -> None:
        canvas.setFont("DejaVu", 7)
        canvas.setFillColor(GREY)
        canvas.drawString(MARGIN, 9 * mm, f"{report.asset}; gear-twin {report.versions[0][1]}; {report.made}")
        canvas.drawRightString(A4[0] - MARGIN, 9 * mm, f"page {canvas.getPageNumber()} of 2")

    document.build([pages[0], PageBreak(), pages[1]], onFirstPage=footer, onLaterPages=footer)
    return out.getvalue()


def _first(report: Report, styles: dict[str, ParagraphStyle]) -> list[Flowable]:
    """Conclusion and action, the figures that matter, trends, other findings and limits."""
    flow: list[Flowable] = [
        _text(f"Report on {report.asset}", styles["title"]),
        _text(f"State as of {report.latest}; made {report.made}.", styles["small"]),
        Spacer(0, 2 * mm),
        _state(report, styles),
        Spacer(0, 3 * mm),
    ]
    if report.figures:
        flow += [_cards(report, styles), Spacer(0, 2 * mm)]
    for _, figure in trends(report):
        flow.append(Image(as_png(figure), width=WIDTH, height=WIDTH * SIZE[1] / SIZE[0]))
    flow.append(_text("What else was found, and how sure", styles["heading"]))
    flow += [_text(line, styles["body"]) for line in report.conclusions]
    for finding in report.findings:
        flow.append(Paragraph(f"<b>{escape(finding.title)}.</b> {escape(' '.join(finding.sentences))}", styles["body"]))
    return flow + _list("What cannot be said yet", report.limits, styles)


def _second(report: Report, styles: dict[str, ParagraphStyle]) -> list[Flowable]:
    """Method, data quality, machine, latest measurements and versions."""
    flow: list[Flowable] = [_text("Appendix", styles["title"]), _text("Method", styles["heading"])]
    flow += [_text(line, styles["body"]) for line in report.method]
    for title, rows, head in (
        ("Data quality", report.quality, False),
        ("Machine", report.machine, False),
        ("Latest measurements", report.windows, True),
        ("Versions", report.versions, False),
    ):
        if rows:
            flow += [_text(title, styles["heading"]), _table(rows, head, styles)]
    return flow


def _state(report: Report, styles: dict[str, ParagraphStyle]) -> Table:
    colour = colors.HexColor(COLOURS[report.level])
    heading = ParagraphStyle("state", parent=styles["title"], textColor=colour)
    inside = [Paragraph(f"{escape(LEVELS[report.level])} <font size=8>{escape(report.since)}</font>", heading)]
    if report.action:
        inside.append(Paragraph(f"<b>{escape(report.action)}</b>", styles["body"]))
    inside += [_text(reason, styles["body"]) for reason in report.reasons]
    inside.append(_text(f"Data quality: {report.data}", styles["small"]))
    table = Table([["", inside]], colWidths=[2.5 * mm, WIDTH - 2.5 * mm])
    table.setStyle([("BACKGROUND", (0, 0), (0, 0), colour), ("BACKGROUND", (1, 0), (1, 0), colors.HexColor("#f6f8fa"))])
    return table


def _cards(report: Report, styles: dict[str, ParagraphStyle]) -> Table:
    cells = [
        [_text(name, styles["small"]), _text(value, styles["value"]), _text(detail, styles["small"])]
        for name, value, detail in report.figures
    ]
    table = Table([cells], colWidths=[WIDTH / len(cells)] * len(cells))
    table.setStyle(
        [
            ("BOX", (0, 0), (-1, -1), 0.5, LINE),
            ("INNERGRID", (0, 0), (-1, -1), 0.5, LINE),
            ("VALIGN", (0, 0), (-1, -1), "TOP"),
        ]
    )
    return table


def _table(rows: Sequence[Row], head: bool, styles: dict[str, ParagraphStyle]) -> Table:
    columns = len(rows[0])
    first = 0.34 if columns == 2 else 0.17
    widths = [first * WIDTH, *[(1 - first) * WIDTH / (columns - 1)] * (columns - 1)]
    table = Table(
        [
            [_text(cell, styles["head"] if head and not i else styles["cell"]) for cell in row]
            for i, row in enumerate(rows)
        ],
        colWidths=widths,
        repeatRows=int(head),
    )
    table.setStyle(
        [
            ("LINEBELOW", (0, 0), (-1, -1), 0.4, LINE),
            ("TOPPADDING", (0, 0), (-1, -1), 1),
            ("BOTTOMPADDING", (0, 0), (-1, -1), 1),
            ("VALIGN", (0, 0), (-1, -1), "TOP"),
        ]
    )
    return table


def _list(title: str, lines: Sequence[str], styles: dict[str, ParagraphStyle]) -> list[Flowable]:
    if not lines:
        return []
    return [_text(title, styles["heading"]), *(_text(f"• {line}", styles["body"]) for line in lines)]


def _text(text: str, style: ParagraphStyle) -> Paragraph:
    return Paragraph(escape(text), style)


@cache
def _styles() -> dict[str, ParagraphStyle]:
    """The styles, in a font that has every sign of the texts: the one that matplotlib carries."""
    import matplotlib

    fonts = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
    pdfmetrics.registerFont(TTFont("DejaVu", fonts / "DejaVuSans.ttf"))
    pdfmetrics.registerFont(TTFont("DejaVu-Bold", fonts / "DejaVuSans-Bold.ttf"))
    pdfmetrics.registerFontFamily(
        "DejaVu", normal="DejaVu", bold="DejaVu-Bold", italic="DejaVu", boldItalic="DejaVu-Bold"
    )
    body = ParagraphStyle("body", fontName="DejaVu", fontSize=8.5, leading=12, spaceAfter=2)
    return {
        "body": body,
        "small": ParagraphStyle("small", parent=body, fontSize=7, leading=9, textColor=GREY),
        "cell": ParagraphStyle("cell", parent=body, fontSize=7, leading=9, spaceAfter=0),
        "head": ParagraphStyle("head", parent=body, fontName="DejaVu-Bold", fontSize=7, leading=9, spaceAfter=0),
        "value": ParagraphStyle("value", parent=body, fontName="DejaVu-Bold", fontSize=13, leading=17),
        "title": ParagraphStyle("title", parent=body, fontName="DejaVu-Bold", fontSize=14, leading=18),
        "heading": ParagraphStyle(
            "heading", parent=body, fontName="DejaVu-Bold", fontSize=9.5, leading=14, spaceBefore=5
        ),
    }
