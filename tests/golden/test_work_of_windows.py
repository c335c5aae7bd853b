"""The work of a window, pinned in counts: what became slower unseen cannot hide behind a busy machine.

Written by   python -m tests.golden.work_of_windows
Tolerance    none on the Python and processor that wrote them; 5 % elsewhere, where libraries round differently
"""

import json
import subprocess
import sys

import pytest

from tests.golden.pinned import pinned_and_now
from tests.golden.work_of_windows import FILE, ROOT


def moved(pinned, now, own):
    """Which counts have moved: from what, to what."""
    return {
        path: (value, now[path])
        for path, value in pinned.items()
        if not path.startswith(".python") and now[path] != (value if own else pytest.approx(value, rel=0.05, abs=3))
    }


def test_a_window_costs_the_calls_solutions_products_and_bytes_that_it_cost():
    program = [sys.executable, "-m", "tests.golden.work_of_windows", "--print"]
    out = subprocess.run(program, cwd=ROOT, capture_output=True, text=True, check=True)
    pinned, now = pinned_and_now(FILE, json.loads(out.stdout))
    assert now.keys() == pinned.keys()
    own = all(now[path] == value for path, value in pinned.items() if path.startswith(".python"))
    found = moved(pinned, now, own)
    assert not found, f"moved (pinned, now); if it was meant: python -m tests.golden.work_of_windows: {found}"


@pytest.mark.parametrize("own", [True, False])
def test_a_count_that_doubles_has_moved(own):
    pinned = {".python[2]": "a processor", ".a.bytes": 1000, ".a.windows[0].solves": 8}
    assert moved(pinned, {**pinned, ".a.windows[0].solves": 16}, own) == {".a.windows[0].solves": (8, 16)}
    assert not moved(pinned, {**pinned, ".python[2]": "another"}, own)
