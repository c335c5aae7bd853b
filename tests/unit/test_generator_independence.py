"""The generator and the twin are two formulations: neither knows the other."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def imported_packages(file: Path) -> set[str]:
    """First names of everything that a file imports, at its top or inside a function."""
    found = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            found.add(node.module.split(".")[0])
    return found


@pytest.mark.slow
@pytest.mark.parametrize(("one", "other"), [("recordings", "twin"), ("twin", "recordings")])
def test_neither_generator_nor_twin_imports_the_other(one, other):
    files = sorted((ROOT / one).rglob("*.py"))
    assert files
    assert not [str(f) for f in files if other in imported_packages(f)]


def test_the_service_alone_is_used_for_the_wire_format():
    for file in sorted((ROOT / "recordings").rglob("*.py")):
        text = file.read_text(encoding="utf-8")
        if "service" in imported_packages(file):
            assert "from service.stream.wire import" in text and text.count("service.") == 1, file
