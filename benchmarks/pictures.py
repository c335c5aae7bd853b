"""Draws the figures of docs/validation.md anew: each is one plot of a page that a command writes.

    python -m benchmarks.pictures [NAME …]

Needs Chromium (GEAR_TWIN_CHROMIUM names it) and, for measured machines, their data beside the project
(GEAR_TWIN_SHARED sets where).
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.measured import DRAWS, LOADS, MAPPINGS, MEASURED, imported
from service.cli import run
from service.errors import InputError

DOCS = Path(__file__).parents[1] / "docs" / "pictures"
CHROMIUM = os.environ.get("GEAR_TWIN_CHROMIUM", "/usr/bin/chromium")
WIDTH = 1150  # of the page [px]
KEPT_BACK = 40  # load of the broken tooth that is drawn, in no baseline [%]


def command(*arguments: str | Path) -> None:
    """Runs a command of gear-twin; InputError where it fails."""
    given = [str(a) for a in arguments]
    if run(given) != 0:
        raise InputError(f"gear-twin {' '.join(given)} failed")


def broken_tooth(folder: Path) -> Path:
    data = MEASURED / "spectraquest-broken-tooth"
    healthy = [imported(data.name, data / f"h30hz{p}.csv.gz", folder) for p in LOADS if p != KEPT_BACK]
    broken = imported(data.name, data / f"b30hz{KEPT_BACK}.csv.gz", folder)
    command("baseline", *healthy, "--out", folder / "healthy.baseline")
    command("diagnose", broken, "--baseline", folder / "healthy.baseline", "--out", folder / "page.html")
    return folder / "page.html"


def modulation(folder: Path) -> Path:
    data = MEASURED / "spur-rig-28ch-2000rpm"
    command("diagnose", imported(data.name, data / "channels.npz", folder), "--out", folder / "page.html")
    return folder / "page.html"


def encoders(folder: Path) -> Path:
    data = MEASURED / "spur-pair-dual-encoder"
    command("diagnose", imported(data.name, data / "encoders.npz", folder), "--out", folder / "page.html")
    return folder / "page.html"


def wear(folder: Path) -> Path:
    name = "bgu-spur-wear-35"
    source = MEASURED / name / "records.csv"
    page = folder / "page.html"
    command("relate", MAPPINGS / f"{name}.toml", "--source", source, "--draws", str(DRAWS), "--out", page)
    return page


def misalignment(folder: Path) -> Path:
    command("example", "misalignment", "--draws", "40", "--out", folder / "page.html")
    return folder / "page.html"


PICTURES: dict[str, tuple[Callable[[Path], Path], tuple[int, ...]]] = {  # page, plots of it from the first as 0
    "broken-tooth": (broken_tooth, (1, 2)),
    "modulation": (modulation, (0, 1)),
    "encoders": (encoders, (0, 2)),
    "wear": (wear, (0, 1)),
    "misalignment": (misalignment, (0, 1)),
}


def main() -> None:
    from playwright.sync_api import sync_playwright

    wanted = sys.argv[1:] or list(PICTURES)
    unknown = [name for name in wanted if name not in PICTURES]
    if unknown:
        raise SystemExit(f"no such picture: {', '.join(unknown)}; there are {', '.join(PICTURES)}")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        for name in wanted:
            make, plots = PICTURES[name]
            with TemporaryDirectory() as folder:
                view = browser.new_page(viewport={"width": WIDTH, "height": 900})
                view.goto(make(Path(folder)).as_uri())
                for number in plots:
                    view.locator(".plotly-graph-div").nth(number).screenshot(path=DOCS / f"{name}-{number}.png")
                view.close()
        browser.close()


if __name__ == "__main__":
    main()
