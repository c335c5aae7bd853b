"""What the service imports does not load the compiler of the time integration."""

from __future__ import annotations

import subprocess
import sys

import pytest


@pytest.mark.parametrize("module", ["twin.step", "service.runtime.serve", "service.runtime.assess"])
def test_a_module_that_the_service_runs_loads_no_numba(module):
    code = f"import sys, {module}; sys.exit('numba' in sys.modules or 'llvmlite' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
