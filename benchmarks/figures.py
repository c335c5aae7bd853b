"""Writes the tables of figures in the README and docs/validation.md anew, each from the command it names.

    python -m benchmarks.figures [PART …]

A table stands between `<!-- figures: COMMAND -->` and `<!-- end of figures -->`; COMMAND begins with `python -m`. Of
`<!-- last figures: COMMAND -->` only what follows the last empty line is shown. With PARTs only the commands that
hold one of them are run.
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
PAGES = (ROOT / "README.md", ROOT / "docs" / "validation.md")
TABLE = re.compile(
    r"<!-- (?P<last>last )?figures: (?P<command>python -m .+?) -->\n.*?<!-- end of figures -->", re.DOTALL
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
        last = table["last"] or ""
        said = printed(command)
        shown = said.rpartition("\n\n")[2] if last else said
        return f"<!-- {last}figures: {command} -->\n```\n{shown}\n```\n<!-- end of figures -->"

    return TABLE.sub(anew, text)


def main() -> None:
    for page in PAGES:
        page.write_text(with_figures(page.read_text(encoding="utf-8"), sys.argv[1:]), encoding="utf-8")


if __name__ == "__main__":
    main()
