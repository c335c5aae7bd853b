"""What users read has no retired word; docs/words.md has those that are used.

That is: README and docs, the text of the page, help and messages of the command line, errors and reasons that the
program gives. Comments, docstrings and names in the code are for developers.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
RETIRED = (
    r"strange(r|rs)?\b",
    r"\bbeside\b(?! a mesh harmonic)",
    r"\btold\b(?! apart)|\btells? (the|what|no|neither|which|how|a|that)\b|\bnot told\b|\bheard\b",
    r"\btaken (in|again)\b|\bretake\b",
    r"\bstands?\b(?! (for|still|out)\b)(?!-in)|\bstanding\b",
    r"\bthe ways?\b (to|of)|\bway of updating\b|\bways\b",
    r"\bswelling\b",
    r"\bfaces?\b (of|of the) (the )?coefficient|\bhas three faces\b",
    r"\bborne in mind\b",
    r"\bno name fits\b",
    r"\bwindow in work\b|\bin work\b",
    r"\bserving on\b",
    r"\bfault of the program\b",
    r"\bpart and strike\b",
    r"\bbelongings?\b",
    r"\bset beside\b|\bwhen it is well\b|\bis well\b",
    r"\bwhat (it|the twin) (leaves|misses|lacks)\b|\bwhat is left\b(?! of)|\bthat (are|is) left\b(?! (of|out|to))",
    r"\bmodel lacks\b|\btwin misses\b|\bwhat no gear makes\b",
    r"\bin view of th(is|ese)\b|\blimits of evidence\b",
    r"\bformulation of its own\b",
    r"\bblames? (?!wear for everything)",
    r"\bsought\b",
    r"\b(run|drawn|written|judged|fitted) anew\b|\bmended\b|\bturn about\b",
    r"\bearns? (its|their) place\b",
    r"\bmaster curve\b",
    r"\bunseen windows\b",
)
PATTERNS = [re.compile(pattern, re.IGNORECASE) for pattern in RETIRED]


def refused(text: str) -> list[str]:
    """The retired words in a text, each with what is around it."""
    plain = " ".join(text.split())
    return [plain[max(m.start() - 40, 0) : m.end() + 30] for p in PATTERNS for m in p.finditer(plain)]


def pages() -> list[Path]:
    own = [ROOT / "README.md", ROOT / "ARCHITECTURE.md", ROOT / "twin" / "effects" / "README.md"]
    return own + sorted((ROOT / "docs").rglob("*.md"))


def test_documentation_has_no_retired_words():
    found = {str(page.relative_to(ROOT)): refused(page.read_text(encoding="utf-8")) for page in pages()}
    assert {page: words for page, words in found.items() if words} == {}


def parts_of_the_page() -> list[Path]:
    own = [*sorted((ROOT / "service" / "page").rglob("*.js")), ROOT / "service" / "page" / "index.html"]
    return [file for file in own if file.parent.name != "vendor"]


def test_the_page_has_no_retired_words():
    for file in parts_of_the_page():
        text = file.read_text(encoding="utf-8")
        if file.suffix == ".js":
            text = re.sub(r"^\s*//.*$", "", text, flags=re.MULTILINE)
            text = "\n".join(re.findall(r'"(?:[^"\\\n]|\\.)*"|`(?:[^`\\]|\\.)*`', text))
            text = re.sub(r"\$\{[^{}]*\}", " ", text)
        assert refused(text) == [], file.name


def strings(file: Path) -> Iterator[tuple[int, str]]:
    """The string literals of a file that could be shown: no docstrings, no names; f-strings without their values."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    silent = {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef))
        and node.body
        and isinstance(node.body[0], ast.Expr)
    }
    inside = {id(part) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for part in node.values}
    for node in ast.walk(tree):
        if id(node) in silent or id(node) in inside:
            continue
        if isinstance(node, ast.JoinedStr):
            parts = [p.value if isinstance(p, ast.Constant) else "0" for p in node.values]
            yield node.lineno, "".join(str(p) for p in parts)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
            yield node.lineno, node.value


def sources(*folders: str) -> list[Path]:
    return [file for folder in folders for file in sorted((ROOT / folder).rglob("*.py"))]


def commands_docstrings(file: Path) -> Iterator[tuple[int, str]]:
    """The docstrings that are help texts or descriptions of REST calls: those of decorated functions."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)) and node.decorator_list:
            yield node.lineno, ast.get_docstring(node) or ""


@pytest.mark.slow
@pytest.mark.parametrize("folder", ["gear_twin", "service", "twin", "studies"])
def test_messages_of_the_program_have_no_retired_words(folder):
    found = {}
    for file in sources(folder):
        texts = list(strings(file))
        if folder == "service":
            texts += commands_docstrings(file)
        for line, text in texts:
            for words in refused(text):
                found[f"{file.relative_to(ROOT)}:{line}"] = words
    assert found == {}


def test_a_retired_word_is_found():
    assert refused("It stands beside it.") and refused("lines of strangers") and not refused("lines of no shaft")
