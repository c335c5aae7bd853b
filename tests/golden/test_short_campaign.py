"""The twin's own figures, pinned: a change of them must be meant.

Written by   python -m tests.golden.short_campaign
Tolerance    1e-4 of each figure: the calibration stops at 1e-3 of its prior's spread, and machines round differently
"""

import pytest

from tests.golden.pinned import pinned_and_now
from tests.golden.short_campaign import FILE, figures


@pytest.mark.slow
def test_figures_of_the_short_campaign_are_those_of_the_last_deliberate_change():
    pinned, now = pinned_and_now(FILE, figures())
    assert now.keys() == pinned.keys()
    moved = {
        path: (now[path], value)
        for path, value in pinned.items()
        if now[path] != pytest.approx(value, rel=1e-4, abs=1e-3 if path.endswith("wear_depth_um") else 1e-15)
    }
    assert not moved, "moved (now, pinned); if it was meant: python -m tests.golden.short_campaign"
