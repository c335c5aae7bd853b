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


def test_a_start_of_the_service_loads_nothing_that_only_drawing_or_computing_needs():
    later = {
        "matplotlib", "PIL", "scipy.stats", "scipy.signal", "pandas", "alembic", "twin.step", "twin.tracing.trace",
        "service.contract.estimate", "service.signals.pictures", "service.report.content",
    }  # fmt: skip
    code = (
        "import sys; from service.runtime import serve; twin = serve._twin_of(serve.Settings());"
        f"loaded = {later} & set(sys.modules); twin.new_state(); sys.exit(' '.join(loaded))"
    )
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True)
    assert done.stderr.strip() == ""
