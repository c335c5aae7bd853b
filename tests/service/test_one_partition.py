"""The tests of `gear-twin serve` hold for a fleet of one partition: they are run again with one in its place."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from service.errors import InputError
from service.fleet.layout import Layout
from service.fleet.up import prepared
from service.settings import Settings
from tests.rules import FLEET

HERE = Path(__file__).parent
AGAIN = (
    "asset_baseline", "asset_life", "decisions", "inspections_applied", "rig_proposals", "serve", "spool",
    "unknown_assets", "unknown_outcome", "workers",
)  # fmt: skip


@pytest.mark.engine
@pytest.mark.skipif(
    not os.environ.get("GEAR_TWIN_TEST_ENGINE"), reason="GEAR_TWIN_TEST_ENGINE is not set: see the marker `engine`"
)
@pytest.mark.serve_only("runs tests with a fleet itself")
@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_tests_of_serve_pass_with_a_fleet_of_one_partition():
    files = [str(HERE / f"test_{name}.py") for name in AGAIN]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--tb=short", *files],
        cwd=HERE.parents[1], env=os.environ | {FLEET: "1"}, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout


def test_a_fleet_of_one_partition_has_the_keys_of_serve_and_another_has_its_own():
    assert Layout(1).prefix_of(0) == "gearbox" and Layout(1, "plant/gears").prefix_of(0) == "plant/gears"
    assert [Layout(2).prefix_of(partition) for partition in Layout(2).all] == [
        "fleet/000/gearbox", "fleet/001/gearbox"
    ]  # fmt: skip


@pytest.mark.parametrize("given", [{"mqtt": "mqtt://127.0.0.1"}, {"opcua": "opc.tcp://127.0.0.1:4840"}])
def test_bridges_that_a_fleet_does_not_have_are_refused(given):
    with pytest.raises(InputError, match="a fleet has no bridges"):
        prepared(Settings(database="postgresql://127.0.0.1/none", **given))
