"""What is said of one machine, once: as text, as one self-contained HTML page, or as a PDF of two pages.

report = content.report_of(answer, machine)  # what is said, from the contract's answer
rendered(report, "pdf")                      # the bytes of the file
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from service.errors import InputError
from service.json_text import write_bytes

if TYPE_CHECKING:
    from service.report.content import Report

FORMATS = {"html": "text/html; charset=utf-8", "pdf": "application/pdf"}
"""Format → media type."""


def rendered(report: Report, kind: str) -> bytes:
    """The file of a report in a format of `FORMATS`."""
    if kind == "html":
        from service.report.html import html

        return html(report).encode()
    from service.report.pdf import pdf

    return pdf(report)


def write_report(answer: Mapping[str, Any], path: Path, machine: Mapping[str, Any] | None = None) -> None:
    """Writes the report about the asset of an answer: HTML or PDF, by the file's name.

    machine  mapping of the rig file, where it is known
    """
    from service.report.content import report_of

    kind = path.suffix.lower().lstrip(".")
    if kind not in FORMATS:
        raise InputError(f"{path}: a report is written as {' or '.join(f'.{name}' for name in FORMATS)}")
    write_bytes(path, rendered(report_of(answer, machine), kind))
