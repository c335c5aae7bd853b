"""Every deciding number of the updating has a unit or a reference, a meaning and a source."""

from __future__ import annotations

import importlib
import pkgutil
from dataclasses import is_dataclass

import pytest

import twin.levels
import twin.updating
from twin.thresholds import KEY, rows_of

MODULES = [
    importlib.import_module(f"{package.__name__}.{found.name}")
    for package in (twin.updating, twin.levels)
    for found in pkgutil.iter_modules(package.__path__)
]
SETS = [
    kind
    for module in MODULES
    for kind in vars(module).values()
    if isinstance(kind, type) and is_dataclass(kind) and kind.__module__ == module.__name__
    if any(KEY in f.metadata for f in kind.__dataclass_fields__.values())
]


def test_the_updating_has_its_numbers_in_sets():
    assert len(SETS) >= 15


@pytest.mark.parametrize("kind", SETS, ids=lambda kind: kind.__name__)
def test_every_number_of_a_set_says_what_it_means_and_where_it_comes_from(kind):
    for row in rows_of(kind):
        assert row.about.meaning and row.about.source, row.name
        assert not (row.about.unit and row.about.of), f"{row.name}: a share has no unit"
