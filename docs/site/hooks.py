"""Hooks of the documentation site: pages and files of the repository outside docs/ become part of it, links included.

A page of the site keeps its place under docs/; those of EXTERNAL get one. A link to any other file of the repository
leads to a copy of it under `sources/`. What a page encloses by `<!-- table: NAME -->` or `<!-- picture: NAME -->` and
`<!-- end -->`, a sentence for readers of the file, is a table of benchmarks/reference.py or a figure of
benchmarks/explanation_figures.py.
"""

from __future__ import annotations

import posixpath
import re
import sys
from functools import cache
from pathlib import Path

from mkdocs.structure.files import File

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))
EXTERNAL = {
    "README.md": "index.md",
    "ARCHITECTURE.md": "architecture.md",
    "CHANGELOG.md": "changes.md",
    "twin/NOMENCLATURE.md": "reference/symbols.md",
    "twin/effects/README.md": "how-to/add-an-effect.md",
}
PLACES = {place: path for path, place in EXTERNAL.items()}
MADE = re.compile(r"<!-- (table|picture): ([\w-]+) -->\n(.*?)\n<!-- end -->", re.DOTALL)
LINK = re.compile(r"\]\(([^)\s#]+)(#[^)\s]*)?\)")


def on_files(files, config):
    """Adds the pages of EXTERNAL and the files that any page links to."""
    for path, place in EXTERNAL.items():
        files.append(File.generated(config, place, abs_src_path=str(ROOT / path)))
    for page in [f for f in files if f.src_uri.endswith(".md")]:
        source = _repository_path(page.src_uri)
        for kind, name, _ in MADE.findall(page.content_string):
            if kind == "picture":
                files.append(File.generated(config, f"pictures/{name}.png", content=_picture(name)))
        for target in _targets(source, page.content_string):
            place = _site_path(target)
            if place.startswith("sources/") and files.get_file_from_path(place) is None:
                files.append(File.generated(config, place, abs_src_path=str(ROOT / target)))
    return files


def on_page_markdown(markdown, page, config, files):
    """Tables and pictures are put in; links that lead out of docs/ lead to the same thing on the site."""
    source = _repository_path(page.file.src_uri)
    up = "../" * page.file.src_uri.count("/")

    def made(match: re.Match) -> str:
        kind, name, text = match.groups()
        return _table(name) if kind == "table" else f"![{text.strip('*')}]({up}pictures/{name}.png)"

    def rewritten(match: re.Match) -> str:
        path, heading = match[1], match[2] or ""
        if "://" in path or path.startswith("mailto:"):
            return match[0]
        target = posixpath.normpath(posixpath.join(posixpath.dirname(source), path))
        if not (ROOT / target).is_file():
            return match[0]  # the strict build names it
        place = posixpath.relpath(_site_path(target), posixpath.dirname(page.file.src_uri) or ".")
        return f"]({place}{heading})"

    return MADE.sub(made, LINK.sub(rewritten, markdown))


@cache
def _table(name: str) -> str:
    from benchmarks.reference import TABLES

    return TABLES[name]()


def _picture(name: str) -> bytes:
    from benchmarks.explanation_figures import png

    return png(name)


def _targets(source: str, text: str) -> set[str]:
    """The files of the repository that a page links to, by their paths in it."""
    found = set()
    for path, _ in LINK.findall(text):
        target = posixpath.normpath(posixpath.join(posixpath.dirname(source), path))
        if "://" not in path and (ROOT / target).is_file():
            found.add(target)
    return found


def _repository_path(place: str) -> str:
    return PLACES.get(place, f"docs/{place}")


def _site_path(path: str) -> str:
    if path in EXTERNAL:
        return EXTERNAL[path]
    return path.removeprefix("docs/") if path.startswith("docs/") else f"sources/{path}"
