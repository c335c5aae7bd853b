"""Fixtures of the answering side: a store and a board in a directory of their own."""

from __future__ import annotations

import pytest

from service.board import Board
from service.store import Store


@pytest.fixture
def store(tmp_path):
    with Store(tmp_path / "twin.sqlite") as opened:
        yield opened


@pytest.fixture
def board():
    shown = Board()
    yield shown
    shown.close()
