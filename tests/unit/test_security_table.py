"""SECURITY.md names tests: each is there, and every kind of attack and credential is named."""

from __future__ import annotations

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "SECURITY.md").read_text(encoding="utf-8")
NAMED = re.findall(r"`(tests/[\w/]+\.py)(?:::(\w+))?`", TEXT)


def defined_in(path):
    return {node.name for node in ast.parse((ROOT / path).read_text(encoding="utf-8")).body if hasattr(node, "name")}


def test_every_test_that_the_table_names_is_there():
    assert len(NAMED) > 30
    absent = [f"{path}::{name}" for path, name in NAMED if name and name not in defined_in(path)]
    assert absent == [] and all((ROOT / path).is_file() for path, _ in NAMED)


def test_every_row_of_the_table_names_a_test():
    rows = [line for line in TEXT.splitlines() if line.startswith("| ") and "---" not in line][1:]
    assert len(rows) > 15 and all("`tests/" in row for row in rows)
    for attack in ("rebinding", "CSRF", "paths", "headers", "slow", "compressed", "unpack", "certificates", "tokens"):
        assert any(attack in row for row in rows), attack
