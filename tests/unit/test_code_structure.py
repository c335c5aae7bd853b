"""The code keeps its own limits: short functions and files, lines of each room, no import circle anywhere."""

from __future__ import annotations

import ast
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("gear_twin", "twin", "service", "studies", "recordings", "benchmarks")
GENERATED = {"service/stream/wire/gearbox_pb2.py"}
LONGEST_FUNCTION, LONGEST_FILE = 80, 500
WRITTEN = {".py", ".js", ".css", ".html", ".c", ".h"}
# compiled kernels: numba compiles one function, and splitting it costs a call in each of some million steps
KERNELS = {("studies/misalignment/motion.py", "_contacts")}


def files() -> Iterator[Path]:
    for package in PACKAGES:
        for file in sorted((ROOT / package).rglob("*.py")):
            if str(file.relative_to(ROOT)) not in GENERATED:
                yield file


def module_of(file: Path) -> str:
    parts = list(file.relative_to(ROOT).with_suffix("").parts)
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imported(file: Path, known: set[str]) -> set[str]:
    """Modules of the project that a file imports anywhere, also inside functions and for type checking."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            for alias in node.names:
                whole = f"{node.module}.{alias.name}"
                found.add(whole if whole in known else node.module)
    return found & known


def circles(graph: dict[str, set[str]]) -> list[list[str]]:
    """Strongly connected sets of more than one module (Tarjan)."""
    order: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    out: list[list[str]] = []

    def visit(node: str) -> None:
        order[node] = low[node] = len(order)
        stack.append(node)
        for other in graph[node]:
            if other not in order:
                visit(other)
                low[node] = min(low[node], low[other])
            elif other in stack:
                low[node] = min(low[node], order[other])
        if low[node] == order[node]:
            group = []
            while not group or group[-1] != node:
                group.append(stack.pop())
            if len(group) > 1:
                out.append(sorted(group))

    for node in graph:
        if node not in order:
            visit(node)
    return out


@pytest.mark.slow
def test_no_function_is_longer_than_a_screen():
    long = []
    for file in files():
        name = str(file.relative_to(ROOT))
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
                lines = (node.end_lineno or node.lineno) - node.lineno + 1
                if lines > LONGEST_FUNCTION and (name, node.name) not in KERNELS:
                    long.append(f"{name}: {node.name} has {lines} lines")
    assert not long


def test_no_file_is_longer_than_five_hundred_lines():
    counted = {str(f.relative_to(ROOT)): len(f.read_text(encoding="utf-8").splitlines()) for f in files()}
    assert not {name: n for name, n in counted.items() if n > LONGEST_FILE}


def rooms() -> dict[str, int]:
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["gear-twin"]["lines"]


@pytest.mark.parametrize("room", rooms())
def test_a_room_holds_no_more_lines_than_it_may(room):
    """A change that needs more lines makes others unnecessary, or says in its commit why the number rises."""
    written = [f for f in (ROOT / room).rglob("*") if f.suffix in WRITTEN and "vendor" not in f.parts]
    lines = sum(len(f.read_text(encoding="utf-8").splitlines()) for f in written)
    generated = sum(len((ROOT / name).read_text().splitlines()) for name in GENERATED if name.startswith(f"{room}/"))
    assert 0 < lines - generated <= rooms()[room]


@pytest.mark.slow
def test_no_module_imports_itself_by_way_of_others_not_even_inside_functions():
    by_module = {module_of(file): file for file in files()}
    known = set(by_module)
    graph = {module: imported(file, known) - {module} for module, file in by_module.items()}
    assert circles(graph) == []


def test_import_circles_are_found():
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}}) == [["a", "b", "c"]]


@pytest.mark.parametrize("package", ["service/stream", "service/results", "service/files", "service/contract"])
def test_lower_rooms_of_the_service_know_nothing_of_those_above(package):
    above = {
        "service/stream": {"service.runtime", "service.api", "service.cli", "service.results"},
        "service/results": {"service.runtime", "service.api", "service.cli"},
        "service/files": {"service.api", "service.cli"},
        "service/contract": {"service.runtime", "service.api", "service.cli", "service.results", "service.files"},
    }[package]
    known = {module_of(file) for file in files()}
    for file in sorted((ROOT / package).rglob("*.py")):
        for name in imported(file, known):
            assert not any(name == room or name.startswith(f"{room}.") for room in above), f"{file.name}: {name}"
