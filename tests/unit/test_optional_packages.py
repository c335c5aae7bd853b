"""What the service imports loads no package that an installation may leave out."""

from __future__ import annotations

import subprocess
import sys

import pytest

from service.cli import EXTRAS


@pytest.mark.parametrize(
    "module", ["twin.step", "service.runtime.serve", "service.runtime.assess", "service.cli.commands"]
)
def test_a_module_that_the_service_runs_loads_no_optional_package(module):
    names = {*EXTRAS, "llvmlite", "opentelemetry.sdk"} - {"opentelemetry"}  # FastAPI asks for its interface
    code = f"import sys, {module}; sys.exit(' '.join({names} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True)
    assert done.stderr.strip() == ""
