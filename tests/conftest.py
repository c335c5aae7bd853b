"""What all tests share."""

from __future__ import annotations

from pathlib import Path

import pytest

import service  # noqa: F401 - one thread for linear algebra, as in the program; before numpy is imported
from tests.rules import (  # noqa: F401 - the rules of a run, as hooks
    pytest_collection_finish,
    pytest_collection_modifyitems,
    pytest_make_collect_report,
    pytest_runtest_makereport,
    pytest_runtest_protocol,
    pytest_runtest_setup,
    pytest_terminal_summary,
    pytest_xdist_node_collection_finished,
    shared_folder,
)


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of reference campaigns and measured sets beside the project."""
    return shared_folder()
