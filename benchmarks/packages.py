"""What the program is made of: a bill of materials (CycloneDX), the licences, and known weaknesses of the packages.

    python -m benchmarks.packages sbom [FOLDER]    writes gear-twin.cdx.json and licences.md; default folder: build/sbom
    python -m benchmarks.packages audit            status 1 where a package has a known weakness

The packages are those of requirements.lock, which the service is installed with; licences are read from the installed
packages. `audit` asks a source of advisories over the network and says so where none can be reached.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
LOCK = ROOT / "requirements.lock"
WAIT = 120  # for the source of advisories [s]


def locked(text: str) -> dict[str, str]:
    """Name and version of every package of a lock."""
    return dict(re.findall(r"^([\w.\-]+)==([^\s;\\]+)", text, re.MULTILINE))


def write_bill(folder: Path) -> None:
    """The bill of materials and the licences, as files of a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    bill = folder / "gear-twin.cdx.json"
    command = ["-m", "cyclonedx_py", "requirements", str(LOCK), "--pyproject", str(ROOT / "pyproject.toml")]
    _run([*command, "--output-reproducible", "--output-format", "JSON", "--output-file", str(bill)])
    names = sorted(locked(LOCK.read_text(encoding="utf-8")))
    found = json.loads(_run(["-m", "piplicenses", "--format", "json", "--with-urls", "--packages", *names]))
    (folder / "licences.md").write_text(licence_table(found), encoding="utf-8")


def licence_table(found: Sequence[Mapping[str, str]]) -> str:
    """The licences as a table."""
    rows = [f"| {one['Name']} | {one['Version']} | {' '.join(one['License'].split())} |" for one in found]
    head = "Licences of the packages that gear-twin is installed with (requirements.lock), as they state them."
    return "\n".join([head, "", "| package | version | licence |", "| --- | --- | --- |", *rows]) + "\n"


def audit() -> int:
    """Prints known weaknesses of the locked packages; the exit status."""
    command = ["-m", "pip_audit", "-r", str(LOCK), "--require-hashes", "--disable-pip", "--progress-spinner", "off"]
    try:
        done = subprocess.run(
            [sys.executable, *command, "--format", "json"], capture_output=True, text=True, timeout=WAIT, check=False
        )
        found = json.loads(done.stdout)["dependencies"]
    except (subprocess.TimeoutExpired, ValueError, KeyError):
        print("packages: not audited: no source of advisories can be reached")
        return 0
    lines, status = verdict(found)
    print("\n".join(lines))
    return status


def verdict(found: Sequence[Mapping[str, Any]]) -> tuple[list[str], int]:
    """What an audit says, and the exit status: 1 where a package has a known weakness."""
    known = [one for one in found if "vulns" in one]
    lines = [
        f"{one['name']} {one['version']}: {weakness['id']}, mended in {', '.join(weakness['fix_versions']) or 'none'}"
        for one in known
        for weakness in one["vulns"]
    ]
    if not known:
        return ["packages: not audited: no source of advisories can be reached"], 0
    left = len(found) - len(known)
    missing = f"; {left} are not known to the source of advisories" if left else ""
    return [*lines, f"packages: {len(known)} audited, {len(lines)} known weaknesses{missing}"], 1 if lines else 0


def _run(arguments: Sequence[str]) -> str:
    return subprocess.run([sys.executable, *arguments], cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True).stdout


def main(arguments: Sequence[str]) -> int:
    match list(arguments):
        case ["sbom", *folder] if len(folder) <= 1:
            write_bill(Path(folder[0]) if folder else ROOT / "build" / "sbom")
            return 0
        case ["audit"]:
            return audit()
    print(__doc__, file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
