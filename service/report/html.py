"""A report as one HTML page that needs nothing else, for screen and print."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

from service.report.content import LEVELS, Report

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
figure svg{max-width:100%;height:auto}dt{font-weight:600}dd{margin:0 0 .6rem 0}
@media print{body{margin:0;max-width:none;font-size:11px}.appendix{break-before:page}
figure,.card,dl>div{break-inside:avoid}}
"""


def html(report: Report) -> str:
    """The page."""
    from service.report.trends import as_svg, trends

    title = f"Report on {report.asset}"
    figures = "".join(
        f'<figure role="img" aria-label="{escape(text)}">{as_svg(f)}</figure>' for text, f in trends(report)
    )
    return page(
        title,
        _STYLE,
        f'<p class="sub">State as of {escape(report.latest)}; made {escape(report.made)}.</p>'
        f"{_state(report)}{_cards(report)}{'<h2>Trends</h2>' + figures if figures else ''}{_findings(report)}"
        f"{bullets('What cannot be said yet', report.limits)}"
        f'<section class="appendix"><h2>Appendix: method</h2>{paragraphs(report.method)}'
        f"{table('Appendix: data quality', report.quality)}{table('Appendix: machine', report.machine)}"
        f"{table('Appendix: latest measurements', report.windows[1:], report.windows[:1])}"
        f"{table('Appendix: versions', report.versions)}</section>",
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
    return f"<h2>What else was found, and how sure</h2>{paragraphs(report.conclusions)}{found}"


# -- what every page is made of --------------------------------------------------------------------------


def page(title: str, style: str, content: str) -> str:
    """A page that needs nothing else."""
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        f'<meta name="viewport" content="width=device-width"><style>{style}</style></head>'
        f"<body><h1>{escape(title)}</h1>{content}</body></html>"
    )


def bullets(title: str, lines: Iterable[str]) -> str:
    """A list under its title; empty where there is nothing."""
    items = "".join(f"<li>{escape(line)}</li>" for line in lines)
    return f"<h2>{escape(title)}</h2><ul>{items}</ul>" if items else ""


def paragraphs(lines: Iterable[str]) -> str:
    """Each line as a paragraph."""
    return "".join(f"<p>{escape(line)}</p>" for line in lines)


def table(title: str, rows: Iterable[Sequence[str]], heads: Iterable[Sequence[str]] = ()) -> str:
    """A table under its title; empty where it has no row."""
    head, body = (
        "".join(f"<tr>{''.join(f'<{tag}>{escape(cell)}</{tag}>' for cell in row)}</tr>" for row in part)
        for tag, part in (("th", heads), ("td", rows))
    )
    shown = f'<div style="overflow-x:auto"><table>{head}{body}</table></div>'
    return f"<h2>{escape(title)}</h2>{shown}" if body else ""
