"""The demo: a service of its own, a replay into it, a summary, and an exit status that can be relied on."""

from __future__ import annotations

import io
import os
import signal
import subprocess
import sys
import urllib.error
import urllib.request

import pytest
from rich.console import Console
from service_streams import HERE, ROOT, free_port, service, write_recording

from service.errors import InputError
from service.runtime.demo import run
from service.runtime.reception import assembly_settings
from service.settings import Settings
from service.stream.sources.mcap import read_windows

FAKE = (sys.executable, str(HERE / "fake_twin.py"))


@pytest.fixture
def said(monkeypatch):
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH")))))
    return io.StringIO()


def here(**given):
    """Settings at a free address, since other tests may run a demo at the same time."""
    return Settings(http=f"127.0.0.1:{free_port()}", **given)


def show(said):
    return Console(file=said, width=120, color_system=None)


@pytest.mark.slow
def test_demo_replays_sums_up_and_ends_with_status_0(tmp_path, said):
    recording = write_recording(tmp_path / "short.mcap", 4)
    status = run(here(), exit_after=True, recordings=[recording], console=show(said), command=FAKE)
    text = said.getvalue()
    assert status == 0, text
    for words in ("windows", "4", "updates", "2.7e-06 /N", "maximum wear depth", "remaining life", "http://127"):
        assert words in text


@pytest.mark.slow
def test_demo_waits_for_the_windows_that_its_settings_make(tmp_path, said):
    recording = write_recording(tmp_path / "short.mcap", 2)
    chosen = here(window_length=0.5)
    expected = len(read_windows(recording, assembly_settings(chosen))[2])
    assert expected > 4
    status = run(chosen, exit_after=True, recordings=[recording], console=show(said), command=FAKE)
    assert status == 0 and f"{expected}/{expected} windows" in said.getvalue(), said.getvalue()


@pytest.mark.slow
def test_demo_of_a_machine_whose_wear_is_not_available_fails_and_says_why(tmp_path, said):
    recording = write_recording(tmp_path / "bare.mcap", 2, rig=None)
    status = run(here(), exit_after=True, recordings=[recording], console=show(said), command=FAKE)
    assert status == 1
    assert "failed: wear is not available: the rig file does not give gears.module" in said.getvalue()


def test_demo_whose_service_does_not_start_fails_and_says_why(tmp_path, said):
    recording = write_recording(tmp_path / "short.mcap", 1)
    command = (sys.executable, "-c", "raise SystemExit('no room on this machine')")
    status = run(here(), exit_after=True, recordings=[recording], console=show(said), command=command)
    assert status == 1 and "no room on this machine" in said.getvalue()


def test_demo_without_its_recording_names_it(tmp_path):
    with pytest.raises(InputError, match=r"absent\.mcap: there is no such recording"):
        run(here(), exit_after=True, recordings=[tmp_path / "absent.mcap"])


@pytest.mark.slow
def test_demo_at_an_address_in_use_fails_and_does_not_show_the_other_service_as_its_own(tmp_path, said):
    recording = write_recording(tmp_path / "short.mcap", 1)
    with service(tmp_path / "other") as other:
        settings = Settings(http=other.http)
        status = run(settings, exit_after=True, recordings=[recording], console=show(said), command=FAKE)
        assert status == 1 and other.get("/v1/assets") == []
    assert "the service did not start" in said.getvalue() and "address already in use" in said.getvalue()


DEMO = """
import sys
from pathlib import Path
from rich.console import Console
from service.__main__ import leave
from service.runtime.demo import run
from service.settings import Settings

console = Console(width=120, color_system=None)
recording, twin, http = sys.argv[1:]
leave(run(Settings(http=http), recordings=[Path(recording)], console=console, command=(sys.executable, twin)))
"""


@pytest.mark.slow
def test_terminated_demo_takes_its_service_with_it(tmp_path, said):
    recording, http = write_recording(tmp_path / "short.mcap", 2), f"127.0.0.1:{free_port()}"
    command = [sys.executable, "-c", DEMO, str(recording), FAKE[1], http]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as demo:
        for line in demo.stdout:
            if "Press Ctrl-C to stop." in line:
                break
        with urllib.request.urlopen(f"http://{http}/healthz", timeout=10) as answer:
            assert answer.status == 200
        demo.send_signal(signal.SIGTERM)
        assert demo.wait(30) == 128 + signal.SIGTERM
    with pytest.raises(urllib.error.URLError, match="refused"):
        urllib.request.urlopen(f"http://{http}/healthz", timeout=10)


@pytest.mark.slow
def test_demo_prints_the_address_of_the_page_before_it_replays(tmp_path, said):
    recordings = [write_recording(tmp_path / f"{name}.mcap", 2, asset=name) for name in ("healthy", "faulty")]
    assert run(here(), exit_after=True, recordings=recordings, console=show(said), command=FAKE) == 0
    text = said.getvalue()
    assert text.index("Page:  http://127") < text.index("Replaying healthy.mcap") < text.index("Replaying faulty.mcap")
    for asset in ("healthy", "faulty"):
        assert f"{asset} after" in text


@pytest.mark.slow
def test_demo_opens_the_page_only_where_there_is_a_graphical_browser(tmp_path, said, monkeypatch):
    recording, opened = write_recording(tmp_path / "short.mcap", 1), []
    monkeypatch.setattr("webbrowser.open", opened.append)
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    given = {"exit_after": True, "recordings": [recording], "console": show(said), "command": FAKE}
    assert run(here(), browser=True, **given) == 0 and opened == []
    monkeypatch.setenv("DISPLAY", ":0")
    assert run(here(), browser=True, **given) == 0
    assert len(opened) == 1 and opened[0].startswith("http://127.0.0.1:")
