"""The documentation site: what its build makes, and what it asks of others."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


LOADS = re.compile(r"<(?:script|img|link|iframe)[^>]+(?:src|href)=\"?(https?:)?//")


@pytest.mark.slow
def test_the_site_builds_without_a_warning_with_all_that_is_made_for_it_and_loads_nothing_from_elsewhere(
    tmp_path,
):
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path)]
    environment = os.environ | {"NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    pages = {page: page.read_text(encoding="utf-8") for page in tmp_path.rglob("*.html")}
    for name in ("commands", "settings", "json", "rest", "operations", "rig-file", "answers-file", "python"):
        text = pages[tmp_path / "reference" / f"{name}.html"]
        assert "<table>" in text and "make site" not in text, name
    for page, text in pages.items():
        assert not LOADS.search(text), page.name
        for picture in re.findall(r'<img[^>]+src="([^"]+\.png)"', text):
            assert (page.parent / picture).read_bytes().startswith(b"\x89PNG"), picture
    assert len(list((tmp_path / "pictures").glob("explanation-*.png"))) == 6
    index = json.loads((tmp_path / "search" / "search_index.json").read_text(encoding="utf-8"))
    assert len({entry["location"].partition("#")[0] for entry in index["docs"] if "misalignment" in entry["text"]}) > 3
