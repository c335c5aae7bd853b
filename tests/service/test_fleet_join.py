"""How the parts of a fleet on several hosts find one another: the router, and what Ray is given of a cluster."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest
from service_streams import ROOT, free_port

from service.errors import InputError
from service.fleet import cluster
from service.fleet.router import route
from service.settings import Settings
from service.transport.zenoh_session import open_session


@pytest.fixture
def plain(monkeypatch):
    """An environment that says nothing of Ray."""
    for name in [name for name in os.environ if name.startswith("RAY_")]:
        monkeypatch.delenv(name)
    return monkeypatch


def test_a_cluster_of_this_machine_alone_is_bound_to_loopback_and_has_a_token_of_its_own(plain, tmp_path):
    given = cluster.environment(tmp_path / "fleet")
    token = tmp_path / "fleet" / cluster.TOKEN
    assert cluster.LOOPBACK_ONLY.items() <= given.items() and cluster.QUIET.items() <= given.items()
    assert given["RAY_AUTH_MODE"] == "token" and given["RAY_AUTH_TOKEN_PATH"] == str(token)
    assert token.stat().st_mode & 0o777 == 0o600 and len(token.read_text()) == 64
    assert cluster.environment(tmp_path / "fleet") == given


def test_a_cluster_of_several_hosts_is_joined_as_its_own_environment_says(plain, tmp_path):
    assert cluster.environment_to_join(tmp_path) == cluster.QUIET  # no loopback, and no token that nobody knows
    assert not (tmp_path / cluster.TOKEN).exists()
    (tmp_path / cluster.TOKEN).write_text("a" * 64)
    assert cluster.environment_to_join(tmp_path)["RAY_AUTH_TOKEN_PATH"] == str(tmp_path / cluster.TOKEN)
    plain.setenv("RAY_AUTH_TOKEN", "b" * 64)
    plain.setenv("RAY_health_check_period_ms", "2000")
    given = cluster.environment_to_join(tmp_path)
    assert not {"RAY_AUTH_MODE", "RAY_AUTH_TOKEN_PATH", "RAY_health_check_period_ms"} & set(given)


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
