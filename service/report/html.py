"""A report as one HTML page that needs nothing else, for screen and print."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from service.report.content import LEVELS, Report, Row
from service.report.trends import as_svg, trends

COLOURS = {
    "normal": "#1a7f37",
    "no_verdict": "#57606a",
    "watch": "#9a6700",
    "alarm": "#c62828",
    "end_of_life": "#c62828",
}
_STYLE = """
body{font:15px/1.5 system-ui,sans-serif;max-width:54rem;margin:2rem auto;padding:0 1rem;color:#1f2328;background:#fff}
h1{font-size:1.5rem;margin:0}h2{font-size:1.1rem;margin:1.6rem 0 .4rem;border-bottom:1px solid #d0d7de}
.sub{color:#57606a;margin:.2rem 0 1rem}.state{border-left:8px solid;padding:.6rem 1rem;background:#f6f8fa}
.state b{font-size:1.25rem}.state ul{margin:.4rem 0;padding-left:1.2rem}
.cards{display:grid;grid-template-columns:repeat(auto-fit,minmax(13rem,1fr));gap:.8rem;margin:1rem 0}
.card{border:1px solid #d0d7de;border-radius:6px;padding:.6rem .8rem}.card .value{font-size:1.4rem;font-weight:600}
.card .detail,.more{color:#57606a;font-size:.9rem}table{border-collapse:collapse;font-size:.85rem;width:100%}
td,th{border-bottom:1px solid #d0d7de;padding:3px 8px;text-align:left}figure{margin:.8rem 0}
figure svg{max-width:100%;height:auto}.scroll{overflow-x:auto}dt{font-weight:600}dd{margin:0 0 .6rem 0}
@media print{body{margin:0;max-width:none;font-size:11px}.appendix{break-before:page}
figure,.card,dl>div{break-inside:avoid}}
"""


def html(report: Report) -> str:
    """The page."""
    title = f"Report on {escape(report.asset)}"
    figures = "".join(
        f'<figure role="img" aria-label="{escape(text)}">{as_svg(f)}</figure>' for text, f in trends(report)
    )
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{title}</title>'
        f'<meta name="viewport" content="width=device-width"><style>{_STYLE}</style></head><body>'
        f'<h1>{title}</h1><p class="sub">State as of {escape(report.latest)}; made {escape(report.made)}.</p>'
        f"{_state(report)}{_cards(report)}{'<h2>Trends</h2>' + figures if figures else ''}{_findings(report)}"
        f"{_list('What cannot be said yet', report.limits)}"
        f'<section class="appendix"><h2>Appendix: method</h2>{_paragraphs(report.method)}'
        f"{_table('Appendix: data quality', report.quality)}{_table('Appendix: machine', report.machine)}"
        f"{_table('Appendix: latest measurements', report.windows, head=True)}"
        f"{_table('Appendix: versions', report.versions)}</section></body></html>"
    )


def _state(report: Report) -> str:
    reasons = "".join(f"<li>{escape(reason)}</li>" for reason in report.reasons)
    action = f"<p><strong>{escape(report.action)}</strong></p>" if report.action else ""
    since = f" <span class='more'>{escape(report.since)}</span>" if report.since else ""
    return (
        f'<section class="state" style="border-color:{COLOURS[report.level]}"><b>{LEVELS[report.level]}</b>{since}'
        f"{action}<ul>{reasons}</ul><p class='more'>Data quality: {escape(report.data)}</p></section>"
    )


def _cards(report: Report) -> str:
    cards = "".join(
        f'<div class="card"><div>{escape(name)}</div><div class="value">{escape(value)}</div>'
        f'<div class="detail">{escape(detail)}</div></div>'
        for name, value, detail in report.figures
    )
    return f'<section class="cards">{cards}</section>' if cards else ""


def _findings(report: Report) -> str:
    rows = "".join(
        f"<div><dt>{escape(f.title)}</dt><dd>{escape(' '.join(f.sentences))}</dd></div>" for f in report.findings
    )
    found = f"<dl>{rows}</dl>" if rows else ""
    return f"<h2>What else was found, and how sure</h2>{_paragraphs(report.conclusions)}{found}"


def _list(title: str, lines: Sequence[str]) -> str:
    if not lines:
        return ""
    return f"<h2>{escape(title)}</h2><ul>" + "".join(f"<li>{escape(line)}</li>" for line in lines) + "</ul>"


def _paragraphs(lines: Sequence[str]) -> str:
    return "".join(f"<p>{escape(line)}</p>" for line in lines)


def _table(title: str, rows: Sequence[Row], head: bool = False) -> str:
    if not rows:
        return ""
    tags = ["th" if head and not i else "td" for i in range(len(rows))]
    body = "".join(
        "<tr>" + "".join(f"<{tag}>{escape(cell)}</{tag}>" for cell in row) + "</tr>"
        for tag, row in zip(tags, rows, strict=True)
    )
    return f'<h2>{escape(title)}</h2><div class="scroll"><table>{body}</table></div>'
