"""What all tests share."""

from __future__ import annotations

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of reference campaigns and measured sets beside the project; skips where it is absent."""
    beside = Path(__file__).resolve().parents[1].parent / "shared"
    folder = Path(os.environ.get("GEAR_TWIN_SHARED", beside))
    if not (folder / "campaigns").is_dir():
        pytest.skip(f"the reference data are not here: no folder {folder / 'campaigns'} (GEAR_TWIN_SHARED sets it)")
    return folder
