"""Writes the tables of the documentation anew, each from the command that it names.

    python -m benchmarks.figures [PART …]

A table is enclosed by `<!-- figures: COMMAND -->` and `<!-- end of figures -->`; COMMAND begins with `python -m`. Of
`<!-- last figures: COMMAND -->` only what follows the last empty line is shown. With PARTs only the commands that
contain one of them are run. Tables of the code and its figures are made with the site: docs/site/hooks.py.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
TABLE = re.compile(
    r"<!-- (?P<kind>(?:last )?figures): (?P<command>python -m .+?) -->\n.*?<!-- end of figures -->", re.DOTALL
)


def printed(command: str) -> str:
    """What a command prints on its standard output; its fault where it fails."""
    arguments = shlex.split(command)
    done = subprocess.run(
        [sys.executable, *arguments[1:]],
        cwd=ROOT,
        env=os.environ | {"COLUMNS": "160"},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    return "\n".join(line.rstrip() for line in done.stdout.strip().splitlines())


def with_figures(text: str, parts: Sequence[str]) -> str:
    """The text with its tables written anew."""

    def anew(table: re.Match[str]) -> str:
        command = table["command"]
        if parts and not any(part in command for part in parts):
            return table[0]
        print(command, file=sys.stderr)
        return enclosed(table["kind"], command, printed(command))

    return TABLE.sub(anew, text)


def enclosed(kind: str, command: str, said: str) -> str:
    """A table as it is written into a page."""
    shown = said.rpartition("\n\n")[2] if kind.startswith("last") else said
    return f"<!-- {kind}: {command} -->\n```\n{shown}\n```\n<!-- end of figures -->"


def main() -> None:
    for page in PAGES:
        before = page.read_text(encoding="utf-8")
        after = with_figures(before, sys.argv[1:])
        if after != before:
            page.write_text(after, encoding="utf-8")


if __name__ == "__main__":
    main()
