"""The logger of the documentation: what it has published is stored, though the service is killed under it."""

from __future__ import annotations

import itertools
import os
import signal
import subprocess
import sys
from datetime import datetime

import pytest
from service_streams import ROOT, Service, wait_until

LOGGER = ROOT / "docs" / "examples" / "logger.py"


@pytest.mark.slow
def test_a_logger_that_keeps_its_frames_loses_none_by_a_kill_of_the_service(tmp_path):
    running = Service(tmp_path, WINDOW_LENGTH="4", TRACE="false").start()
    logger = subprocess.Popen(
        [sys.executable, str(LOGGER), "--connect", running.endpoint, "--asset", "logged", "--seconds", "18"],
        env=os.environ | {"PYTHONPATH": str(ROOT)}, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        wait_until(lambda: running.get("/v1/assets/logged") is not None)
        running.end(signal.SIGKILL)
        running.start()
        assert logger.wait(60) == 0, logger.stderr.read()
        state = running.get("/v1/assets/logged")
        lost = [f for w in state["windows"] for f in w["faults"] if f["kind"] in ("gap", "missing_channel")]
        assert lost == [] and state["data_quality"]["channels"]["accel/y6"].get("lost", 0) == 0
        starts = [datetime.fromisoformat(w["start_time"]).timestamp() for w in state["windows"]]
        assert len(starts) >= 3 and max(b - a for a, b in itertools.pairwise(starts)) < 8.0
    finally:
        logger.kill()
        logger.wait()
        logger.stderr.close()
        running.end(signal.SIGKILL)
