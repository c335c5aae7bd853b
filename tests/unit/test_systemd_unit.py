"""The systemd unit of the documentation: systemd understands it, and it lets the service do little."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from service.cli.commands import app
from service.configuration.tables import places
from service.settings import Settings

UNIT = Path(__file__).parents[2] / "docs" / "examples" / "gear-twin.service"
MOST_EXPOSURE = 20  # of 100, by `systemd-analyze security`


@pytest.fixture
def unit(tmp_path):
    """The unit with a command that is there."""
    if shutil.which("systemd-analyze") is None:
        pytest.skip("systemd-analyze is not installed")
    path = tmp_path / "gear-twin.service"
    path.write_text(re.sub(r"^ExecStart=\S+", f"ExecStart={shutil.which('true')}", UNIT.read_text(), flags=re.M))
    return path


def test_systemd_accepts_the_unit(unit):
    done = subprocess.run(["systemd-analyze", "verify", "--man=no", unit], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


def test_unit_exposes_little(unit):
    command = ["systemd-analyze", "security", "--offline=true", f"--threshold={MOST_EXPOSURE}", "--no-pager", unit]
    done = subprocess.run(command, capture_output=True, text=True)
    if "unrecognized option" in done.stderr:
        pytest.skip("this systemd-analyze does not look at files")
    assert done.returncode == 0, done.stdout[-500:]


def test_unit_starts_a_command_with_settings_that_exist_and_ends_it_in_time():
    text = UNIT.read_text()
    assert "serve" in {command.name or command.callback.__name__ for command in app.registered_commands}
    known = {place.variable for place in places(Settings).values()}
    assert set(re.findall(r"GEAR_TWIN_[A-Z_]+", text)) <= known
    for line in ("NoNewPrivileges=yes", "ProtectSystem=strict", "StateDirectory=gear-twin", "TimeoutStopSec=15"):
        assert f"\n{line}\n" in text
    assert "\nType=notify\nWatchdogSec=180\n" in text and Settings.model_fields["loop_limit"].default < 180  # [s]
