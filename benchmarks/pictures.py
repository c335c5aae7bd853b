"""Draws the pictures of the documentation anew: plots of pages that commands write (docs/validation.md), and the page
of the service as `gear-twin demo` fills it (`page`, README.md).

    python -m benchmarks.pictures [NAME …]

Needs Chromium (GEAR_TWIN_CHROMIUM names it) and, for measured machines, their data beside the project
(GEAR_TWIN_SHARED sets where).
"""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from benchmarks.measured import DRAWS, LOADS, MAPPINGS, MEASURED, imported
from service.cli import run
from service.errors import InputError

DOCS = Path(__file__).parents[1] / "docs" / "pictures"
CHROMIUM = os.environ.get("GEAR_TWIN_CHROMIUM", "/usr/bin/chromium")
WIDTH = 1150  # of the page [px]
SCREEN = {"width": 1360, "height": 1060}  # of the picture of the service's page [px]
FAULTY = "unsw-cracked"  # machine of the demo that it shows
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


def page_picture(browser: Any, out: Path) -> None:
    """The page of the demo's faulty machine, once both machines have been replayed."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{probe.getsockname()[1]}"
    demo = subprocess.Popen(
        [sys.executable, "-m", "service", "demo", "--no-browser", "--http", address], stdout=subprocess.PIPE, text=True
    )
    try:
        assert demo.stdout is not None
        if not any("Service is running" in line for line in demo.stdout):
            raise InputError("gear-twin demo failed")
        view = browser.new_page(viewport=SCREEN)
        view.goto(f"http://{address}/#/asset/{FAULTY}")
        view.wait_for_selector("#rms canvas")
        view.wait_for_selector("#link[data-state=live]")
        view.screenshot(path=out)
        view.close()
    finally:
        demo.send_signal(signal.SIGTERM)
        demo.communicate()


def main() -> None:
    from playwright.sync_api import sync_playwright

    known = [*PICTURES, "page"]
    wanted = sys.argv[1:] or known
    unknown = [name for name in wanted if name not in known]
    if unknown:
        raise SystemExit(f"no such picture: {', '.join(unknown)}; there are {', '.join(known)}")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        if "page" in wanted:
            page_picture(browser, DOCS / "page.png")
        for name in [name for name in wanted if name in PICTURES]:
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
