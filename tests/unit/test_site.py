"""The documentation site: builds without a warning, can be searched, and asks nothing of other hosts."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The site, built with warnings as errors."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(folder)]
    environment = os.environ | {"NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    return folder


def test_every_page_of_the_documentation_is_on_the_site(site):
    for page in (ROOT / "docs").rglob("*.md"):
        name = page.relative_to(ROOT / "docs").with_suffix(".html")
        assert (site / name.with_name(name.name.replace("README", "index"))).is_file(), page
    for name in ("index", "architecture", "changes", "reference/symbols", "how-to/add-an-effect"):
        assert (site / f"{name}.html").is_file(), name


def test_tables_of_the_code_and_figures_of_the_twin_are_on_the_site(site):
    for name in ("commands", "settings", "json", "rest", "operations", "rig-file", "answers-file", "python"):
        text = (site / "reference" / f"{name}.html").read_text(encoding="utf-8")
        assert "<table>" in text and "make site" not in text, name
    for page in (site / "explanation").glob("*.html"):
        for picture in re.findall(r'<img[^>]+src="([^"]+)"', page.read_text(encoding="utf-8")):
            assert (page.parent / picture).read_bytes().startswith(b"\x89PNG"), picture
    assert len(list((site / "pictures").glob("explanation-*.png"))) == 6


def test_the_site_can_be_searched(site):
    index = json.loads((site / "search" / "search_index.json").read_text(encoding="utf-8"))
    found = {entry["location"].partition("#")[0] for entry in index["docs"] if "misalignment" in entry["text"]}
    assert len(found) > 3


def test_no_page_loads_anything_from_another_host(site):
    loads = re.compile(r"<(?:script|img|link|iframe)[^>]+(?:src|href)=\"?(https?:)?//")
    for page in site.rglob("*.html"):
        assert not loads.search(page.read_text(encoding="utf-8")), page.name
