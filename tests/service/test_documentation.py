"""The documentation can be followed: its commands run and print what it shows (links: tests/unit/test_site.py)."""

from __future__ import annotations

import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest

from service.files.import_mapping import checked_mapping
from tests.documentation import PAGES, ROOT, blocks_of, is_slow, run_page


def name_of(page: Path) -> str:
    return str(page.relative_to(ROOT))


def texts() -> list:
    found = []
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        if any(block.is_run for block in blocks_of(text)):
            marks = [pytest.mark.slow] if is_slow(text) else []
            found.append(pytest.param(text, id=name_of(page), marks=marks))
    return found


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("text", texts())
def test_the_commands_of_a_page_run_and_print_what_it_shows(text, tmp_path):
    run_page(text, tmp_path)


def test_the_mapping_file_of_the_tutorial_is_the_example():
    text = (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")
    (shown,) = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    path = ROOT / "docs" / "examples" / "mapping.toml"
    assert shown == path.read_text(encoding="utf-8")
    assert checked_mapping(tomllib.loads(shown), path).asset == "pump-drive"


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not installed")
def test_the_commands_of_all_pages_are_valid_shell():
    for page in PAGES:
        for block in blocks_of(page.read_text(encoding="utf-8")):
            checked = subprocess.run(["bash", "-n", "-c", block.commands], capture_output=True, text=True)
            assert checked.returncode == 0, f"{name_of(page)}: {checked.stderr}"
