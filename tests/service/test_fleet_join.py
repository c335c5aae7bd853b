"""How the parts of a fleet on several hosts find one another: the router."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest
from service_streams import ROOT, free_port

from service.errors import InputError
from service.fleet.router import route
from service.settings import Settings
from service.transport.zenoh_session import open_session


@pytest.mark.slow
def test_the_router_routes_until_it_is_ended():
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    command = [sys.executable, "-m", "service", "fleet", "router", "--listen", endpoint]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None and process.stdout.readline() == f"routing at {endpoint}\n"
        with open_session(connect=[endpoint], wait=10), open_session(connect=[endpoint], wait=10):
            pass
        process.send_signal(signal.SIGTERM)
        assert process.wait(20) == 0
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


def test_a_router_is_open_to_other_computers_only_where_that_is_meant():
    with pytest.raises(InputError, match=r"other computers can reach this address, and everybody could publish"):
        route(Settings(listen=["tcp/0.0.0.0:7447"]))
    with pytest.raises(InputError, match="connect must be empty"):
        route(Settings(connect=["tcp/127.0.0.1:7447"]))
