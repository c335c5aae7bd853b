"""`gear-twin remote ready`, and commands whose packages an installation leaves out."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from service_streams import free_port

from service.cli import run
from service.cli.rest import own_address

FAULTY = Path(__file__).parents[2] / "recordings" / "faulty-campaign.mcap"


def test_a_service_that_accepts_frames_is_ready(address, capsys):
    assert run(["remote", "ready", "--url", address]) == 0
    assert capsys.readouterr().out == "ready\n"


def test_where_no_service_answers_the_line_says_so(monkeypatch, capsys):
    port = free_port()
    monkeypatch.setenv("GEAR_TWIN_HTTP", f"0.0.0.0:{port}")
    assert run(["remote", "ready"]) == 2
    assert f"http://127.0.0.1:{port}: no service answers at this address" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("listening", "asked"), [("[::]:81", "http://[::1]:81"), ("10.0.0.7:8000", "http://10.0.0.7:8000")]
)
def test_the_address_is_that_of_the_settings(monkeypatch, listening, asked):
    monkeypatch.setenv("GEAR_TWIN_HTTP", listening)
    assert own_address(None) == asked


@pytest.mark.slow
def test_a_command_names_the_extra_that_has_its_package(monkeypatch, tmp_path, capsys):
    monkeypatch.setitem(sys.modules, "plotly", None)
    monkeypatch.setitem(sys.modules, "plotly.graph_objects", None)
    assert run(["diagnose", str(FAULTY), "--out", str(tmp_path / "page.html")]) == 2
    line = capsys.readouterr().err.splitlines()[-1]
    assert "needs the package plotly, which is not installed here" in line and "gear-twin[analysis]" in line
