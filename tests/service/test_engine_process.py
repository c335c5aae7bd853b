"""The process that asks the engine: what it answers, and that `fleet up` never waits for an engine that is gone."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from functools import partial
from pathlib import Path

import psutil
import pytest
from service_streams import ROOT, wait_until

from service.errors import DeliveryError, InputError
from service.fleet.engine_nodes import EngineNode, find_node
from service.fleet.engine_process import EngineLost, EngineProcess
from service.settings import Settings

NODE = EngineNode(id="0123456789abcdef", name="node-1", host="here", room=4, alive=True)


class RaysOwn(Exception):
    """As Ray raises it."""


RaysOwn.__module__ = "ray.exceptions"


class FakeEngine:
    """An engine that does what it is asked, and writes to a file that it has been left."""

    def __init__(self, left: Path) -> None:
        self._left = left

    def place(self):
        """There is nothing to be placed."""

    def nodes(self):
        return [NODE]

    def room(self):
        return os.getpid()

    def spread(self, served):
        return [(partition, NODE.id) for partition in served]

    def drain(self, node, served, address):
        raise InputError(f"{node.name} cannot be drained: the other nodes have no room")

    def move(self, partition, to):
        if to == "killed":
            os.kill(os.getpid(), signal.SIGKILL)
        if to == "refused":
            raise RaysOwn("the head says no\nwith much besides")
        time.sleep(1e6)  # waits for a head that is gone

    def leave(self):
        self._left.write_text("left")


def not_reached():
    raise DeliveryError("the engine at 127.0.0.1:1 cannot be reached: nobody is there")


def begun(tmp_path, lost=lambda: False):
    return EngineProcess(partial(FakeEngine, tmp_path / "left"), Settings(data=tmp_path), lost)


@pytest.mark.slow
def test_it_answers_from_another_process_and_goes_on_after_errors(tmp_path):
    engine = begun(tmp_path)
    engine.place()
    assert engine.nodes() == [NODE] and find_node(engine.nodes(), "0123") == NODE
    assert psutil.Process(engine.room()).ppid() == os.getpid()
    assert engine.spread({3: "0123"}) == [(3, NODE.id)]
    with pytest.raises(InputError, match="node-1 cannot be drained"):
        engine.drain(NODE, {}, "127.0.0.1:1")
    with pytest.raises(DeliveryError, match=r"^the engine: the head says no$"):
        engine.move(0, "refused")
    process = psutil.Process(engine.room())
    for number in (signal.SIGINT, signal.SIGTERM):  # a supervisor tells all processes: `fleet up` ends this one
        process.send_signal(number)
    assert engine.nodes() == [NODE]
    engine.close()
    assert not process.is_running() and (tmp_path / "left").read_text() == "left"


@pytest.mark.slow
def test_a_call_that_waits_for_a_head_that_is_gone_ends_with_its_process(tmp_path):
    """`fleet up` once waited in such a call for a minute, and was then ended by Ray."""
    gone = threading.Event()
    engine = begun(tmp_path, gone.is_set)
    process = psutil.Process(engine.room())
    threading.Timer(0.5, gone.set).start()
    with pytest.raises(EngineLost, match="does not answer"):
        engine.move(0)
    assert not engine.is_alive and not process.is_running()
    with pytest.raises(EngineLost, match="has not been joined again"):
        engine.nodes()
    engine.close()


@pytest.mark.slow
def test_a_process_that_ray_has_ended_is_an_engine_that_was_lost(tmp_path):
    engine = begun(tmp_path)
    with pytest.raises(EngineLost, match="has ended"):
        engine.move(0, "killed")
    assert not engine.is_alive


@pytest.mark.slow
def test_an_engine_that_is_not_reached_is_said(tmp_path):
    with pytest.raises(DeliveryError, match=r"the engine at 127\.0\.0\.1:1 cannot be reached: nobody is there"):
        EngineProcess(not_reached, Settings(data=tmp_path), lambda: False)


@pytest.mark.slow
def test_it_ends_when_fleet_up_has_been_killed(tmp_path):
    code = (
        "import os, time\n"
        "from test_engine_process import *\n"
        f"engine = begun(Path({str(tmp_path)!r}))\n"
        "print(engine.room(), flush=True)\n"
        "time.sleep(1e6)\n"
    )
    environment = os.environ | {"PYTHONPATH": f"{ROOT}{os.pathsep}{Path(__file__).parent}"}
    up = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, env=environment, text=True)
    assert up.stdout is not None
    process = psutil.Process(int(up.stdout.readline()))
    up.kill()
    up.wait()
    wait_until(lambda: not process.is_running(), 20)
    assert (tmp_path / "left").read_text() == "left"
    up.stdout.close()
