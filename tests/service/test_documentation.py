"""The documentation can be followed: its commands run and print what it shows, its links lead somewhere."""

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


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_the_links_of_a_page_lead_to_files_and_headings_that_exist(page):
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if "://" in target:
            continue
        path, _, heading = target.partition("#")
        other = (page.parent / path).resolve() if path else page
        assert other.exists(), f"{name_of(page)}: {target}"
        if heading:
            headings = re.findall(r"^#+ (.+)$", other.read_text(encoding="utf-8"), re.MULTILINE)
            assert heading in {anchor(h) for h in headings}, f"{name_of(page)}: {target}"


def anchor(heading: str) -> str:
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


def test_every_page_of_the_documentation_is_linked_from_another():
    linked = set()
    for page in PAGES:
        for target in re.findall(r"\]\(([^)\s#]+)[^)]*\)", page.read_text(encoding="utf-8")):
            if "://" not in target:
                linked.add((page.parent / target).resolve())
    for page in (ROOT / "docs").rglob("*.md"):
        assert page.resolve() in linked, name_of(page)


def test_a_command_that_is_not_run_says_why():
    for page in PAGES:
        for block in blocks_of(page.read_text(encoding="utf-8")):
            assert block.is_run or len(block.marks["not run"].split()) >= 2, f"{name_of(page)}: {block.commands}"


def test_the_mapping_file_of_the_tutorial_is_the_example():
    text = (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")
    (shown,) = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    path = ROOT / "docs" / "examples" / "mapping.toml"
    assert shown == path.read_text(encoding="utf-8")
    assert checked_mapping(tomllib.loads(shown), path).asset == "pump-drive"


def test_the_readme_is_short():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 120


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not installed")
def test_the_commands_of_all_pages_are_valid_shell():
    for page in PAGES:
        for block in blocks_of(page.read_text(encoding="utf-8")):
            checked = subprocess.run(["bash", "-n", "-c", block.commands], capture_output=True, text=True)
            assert checked.returncode == 0, f"{name_of(page)}: {checked.stderr}"
