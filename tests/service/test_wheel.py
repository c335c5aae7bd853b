"""The package as others install it: a wheel of the tracked files runs the demo away from the checkout."""

import os
import subprocess
import sys
import tomllib

import pytest
from service_streams import ROOT

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]


def done(*command, **how):
    ended = subprocess.run(command, capture_output=True, text=True, check=False, **how)
    assert ended.returncode == 0, ended.stdout[-2000:] + ended.stderr[-2000:]
    return ended.stdout


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """A folder with the contents of a wheel that is built from the tracked files alone."""
    folder = tmp_path_factory.mktemp("wheel")
    source, target = folder / "source", folder / "installed"
    source.mkdir()
    archive = subprocess.run(["git", "-C", ROOT, "archive", "HEAD"], capture_output=True, check=True).stdout
    subprocess.run(["tar", "-x", "-C", source], input=archive, check=True)
    pip = (sys.executable, "-m", "pip", "--disable-pip-version-check", "-q")
    done(*pip, "wheel", "--no-deps", "-w", str(folder), str(source))
    (wheel,) = folder.glob("*.whl")
    done(*pip, "install", "--no-deps", "--target", str(target), str(wheel))
    return target


def test_a_wheel_runs_the_demo_from_an_empty_folder(installed, tmp_path):
    environment = {**os.environ, "PYTHONPATH": str(installed)}
    said = done(sys.executable, "-P", "-m", "service", "demo", "--exit", cwd=tmp_path, env=environment)
    assert "faulty-campaign.mcap" in said and "A cracked tooth was found" in said
    where = done(sys.executable, "-P", "-c", "import service; print(service.__file__)", cwd=tmp_path, env=environment)
    assert where.startswith(str(installed))


def test_a_wheel_carries_its_licence(installed):
    (licence,) = installed.glob("gear_twin-*.dist-info/licenses/LICENSE")
    assert licence.read_text(encoding="utf-8") == (ROOT / "LICENSE").read_text(encoding="utf-8")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    (metadata,) = installed.glob("gear_twin-*.dist-info/METADATA")
    assert f"License-Expression: {project['license']}" in metadata.read_text(encoding="utf-8")
