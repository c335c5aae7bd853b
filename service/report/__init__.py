"""The report about one machine for people who decide: one self-contained HTML page, or a PDF of two pages.

report = report_of(answer, machine)      # what is said, from the contract's answer
rendered(report, "pdf")                  # the bytes of the file
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from service.report.content import Report, report_of
from service.report.html import html
from service.report.pdf import pdf

FORMATS: Mapping[str, tuple[str, Callable[[Report], bytes]]] = {
    "html": ("text/html; charset=utf-8", lambda report: html(report).encode()),
    "pdf": ("application/pdf", pdf),
}
"""Format → media type and what writes it."""


def rendered(report: Report, kind: str) -> bytes:
    """The file of a report in a format of `FORMATS`."""
    _, write = FORMATS[kind]
    return write(report)


__all__ = ["FORMATS", "Report", "rendered", "report_of"]
