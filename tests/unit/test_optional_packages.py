"""What the service imports loads no package that an installation may leave out."""

from __future__ import annotations

import subprocess
import sys

import pytest

from service.cli import EXTRAS


@pytest.mark.slow
def test_no_module_that_the_service_runs_loads_an_optional_package():
    modules = ("twin.step", "service.runtime.assess", "service.runtime.serve", "service.cli.commands")
    telemetry = {"opentelemetry.sdk", "opentelemetry.exporter"}
    names = {*EXTRAS, "llvmlite", *telemetry} - {"opentelemetry"}  # FastAPI asks for its interface
    code = (  # one after the other in one process, which takes as long as the largest
        "import importlib, sys\n"
        f"for module in {modules}:\n"
        "    importlib.import_module(module)\n"
        f"    if found := {names} & set(sys.modules): sys.exit(f'{{module}} loads {{found}}')"
    )
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.slow
def test_a_start_of_the_service_loads_nothing_that_only_drawing_or_computing_needs():
    later = {
        "matplotlib", "PIL", "scipy", "pandas", "alembic", "twin.step", "twin.tracing.trace",
        "service.contract.estimate", "service.signals.pictures", "service.report.content",
        "httpx", "tenacity",  # messages about alarms
        "service.results.raw_recordings",  # recordings
        "sqlalchemy.dialects.postgresql",
    }  # fmt: skip
    code = (
        "import sys; from service.runtime import serve; twin = serve.twin_of(serve.Settings());"
        f"loaded = {later} & set(sys.modules); twin.new_state(); sys.exit(' '.join(loaded))"
    )
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True)
    assert done.stderr.strip() == ""


@pytest.mark.slow
def test_a_start_of_the_service_makes_no_model_of_an_answer_ready():
    code = (
        "import sys; from service.runtime import serve; from service.contract.base import AnswerModel\n"
        "def under(model):\n"
        "    for each in model.__subclasses__():\n"
        "        yield from (each, *under(each))\n"
        "sys.exit(' '.join(each.__name__ for each in under(AnswerModel) if each.__pydantic_complete__))"
    )
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True)
    assert done.stderr.strip() == ""


def test_a_rig_file_with_a_table_of_stiffness_is_checked_without_scipy():
    code = (
        "import sys, tomllib; from twin.rig import Rig;"
        "rig = Rig.from_mapping(tomllib.load(open('recordings/rigs/unsw.toml', 'rb')));"
        "sys.exit('scipy' in sys.modules or rig.get('mesh.pair_s') is None)"
    )
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
