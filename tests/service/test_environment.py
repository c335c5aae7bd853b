"""The environment that others make: folders of modules that lie about, and workers that cannot be started."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from contextlib import contextmanager

import pytest
from service_streams import ROOT, Service, wait_until, write_recording
from test_workers import Pool, alive, server

from service.cli import run
from service.runtime import worker_processes

BROKEN = "raise ImportError('the kernels of this folder cannot be loaded')\n"


@pytest.mark.parametrize("lying", ["checkout", "random.py", "numpy/__init__.py"])
def test_workers_take_the_modules_of_the_service_whatever_lies_where_it_is_started(tmp_path, monkeypatch, lying):
    if lying == "checkout":
        copy_program(tmp_path)
        (tmp_path / "twin" / "compiled" / "kernels.so").unlink()
    else:
        (tmp_path / lying).parent.mkdir(exist_ok=True)
        (tmp_path / lying).write_text("# another module of this name\n")
    monkeypatch.chdir(tmp_path)
    end_server()
    pool = Pool(workers=1)
    try:
        pool.window("a")
        assert pool.wait(1)[0].refused is None
        assert "PYTHONSAFEPATH" not in os.environ and os.environ["PYTHONPATH"] == str(ROOT)
    finally:
        pool.processes.close()
        end_server()


def end_server():
    """Has the next worker made by a new server of processes."""
    if server() is not None:
        worker_processes._kill_server()
        wait_until(lambda: not alive([server()]))


def copy_program(folder):
    for part in ("service", "twin", "recordings"):
        shutil.copytree(ROOT / part, folder / part, ignore=shutil.ignore_patterns("__pycache__", "*.mcap", "source"))


@contextmanager
def serving(folder):
    """`gear-twin serve` of a copy of the program in which the workers' part cannot be loaded."""
    copy_program(folder)
    (folder / "twin" / "updating" / "model_cache.py").write_text(BROKEN)
    running = Service(folder / "data")
    given = {f"GEAR_TWIN_{name}": value for name, value in running.given.items()}
    with running.out.open("w") as out, running.err.open("w") as err:
        process = subprocess.Popen(
            [sys.executable, "-m", "service", "serve"], cwd=folder, stdout=out, stderr=err,
            env=os.environ | given | {"PYTHONPATH": str(folder)},
        )  # fmt: skip
    try:
        wait_until(lambda: "serves" in running.said()[0])
        yield running
    finally:
        process.terminate()
        process.wait(20)


def test_a_service_none_of_whose_workers_lives_is_not_ready_and_says_why_wherever_it_is_asked(tmp_path, capsys):
    recording = write_recording(tmp_path / "a.mcap", windows=2)
    (tmp_path / "program").mkdir()
    with serving(tmp_path / "program") as running:
        why = "no worker process can be started"
        wait_until(lambda: "cannot be started now" in running.said()[1])
        assert run(["ready", "--url", f"http://{running.http}"]) == 2 and why in capsys.readouterr().err
        assert run(["replay", str(recording), "--connect", running.endpoint, "--speed", "0"]) == 0
        assert re.search(f"the frames are stored and cannot be assessed now: {why}: .+", capsys.readouterr().err)
        wait_until(lambda: why in str(running.get("/v1/assets")))
        (asset,) = running.get("/v1/assets")
        assert why in asset["status"]["reasons"][0] and why in asset["data"] + asset["reason"]
        assert "log of the service" in asset["status"]["action"]
        assert running.said()[1].count("cannot be started now") < 10
