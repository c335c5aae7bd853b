"""What is kept of assets does not grow with every name that was ever asked for."""

import subprocess
import sys
from pathlib import Path

from service.runtime.reception import Reception

ROOT = Path(__file__).parents[2]


def test_what_is_asked_of_an_asset_without_frames_is_not_kept_and_looks_no_rig_up():
    looked = []
    reception = Reception(looked.append, lambda window: None, host_clock=lambda: 7)
    assert not list(reception.channels("a")) and reception.last_arrival_ns("a") is None
    assert reception.ended_ns("a") == 7
    assert not looked and reception.assets == []


def test_a_command_of_tests_says_nothing_that_the_command_itself_does_not():
    """It began with a RuntimeWarning of runpy: the module was loaded ahead."""
    program = "from tests.service.forked_processes import _run; import service.__main__; "
    program += "_run({'module': 'service', 'arguments': ['--version'], 'folder': '.'})"
    found = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    assert found.stdout and not found.stderr
