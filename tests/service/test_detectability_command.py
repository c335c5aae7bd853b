"""`gear-twin detectability`: a short study of the bundled rig, its file, and what `assess` makes of it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
RIG = ROOT / "recordings" / "rigs" / "unsw.toml"


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "service", *arguments], cwd=ROOT, capture_output=True, text=True, check=False
    )


@pytest.mark.slow
def test_wrong_options_are_one_clear_error(tmp_path: Path):
    wrong = run("detectability", str(RIG), "--without", "encoder/third")
    assert wrong.returncode == 2 and "must be one of torque, encoder/pinion, encoder/gear" in wrong.stderr
    rate = run("assess", str(ROOT / "recordings" / "short-campaign.mcap"), "--false-alarm-rate", "2")
    assert rate.returncode == 2 and "between 0 and 1" in rate.stderr
    other = tmp_path / "other.json"
    other.write_text("{}", encoding="utf-8")
    named = run("assess", str(ROOT / "recordings" / "short-campaign.mcap"), "--detectability", str(other))
    assert named.returncode == 2 and "not a file of `gear-twin detectability`" in named.stderr


@pytest.mark.slow
def test_a_short_study_and_its_file(tmp_path: Path):
    out = tmp_path / "unsw.json"
    done = run(
        "detectability", str(RIG), "--healthy", "20", "--machines", "1", "--windows", "4", "--seconds", "2",
        "--depth-um", "40", "--speed-hz", "12", "--torque-nm", "11", "--out", str(out), "--json", "-",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    said, kept = json.loads(done.stdout), json.loads(out.read_text(encoding="utf-8"))
    assert said == kept and said["healthy_campaigns"] + said["not_simulated"] == 20
    limits = {limit["name"]: limit for limit in said["detection_limits"]}
    assert limits["misalignment"]["value"] < 60e-6  # twice the prior spread of real machines
    assert "not simulated" in limits["bearing_defect"]["note"]
    assessed = run(
        "assess", str(ROOT / "recordings" / "short-campaign.mcap"), "--detectability", str(out),
        "--false-alarm-rate", "0.001", "--json", "-",
    )  # fmt: skip
    assert assessed.returncode == 0, assessed.stderr
