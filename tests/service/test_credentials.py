"""Credentials from outside: commands, the Python client, event streams and the page of a service that has keys."""

from __future__ import annotations

import threading
import time

import httpx
import pytest
import service_fakes as fakes

import gear_twin
from service.access.access import Access
from service.access.keys import KeyStore
from service.access.roles import Role
from service.api import events
from service.api.guard import COOKIE
from service.cli import run


@pytest.fixture
def keys(tmp_path):
    return KeyStore(tmp_path / "keys")


@pytest.fixture
def access(keys):
    keys.add("first", Role.administer)
    return Access(keys)


@pytest.fixture
def served(address, store, board):
    fakes.campaign(store, board)
    return address


@pytest.mark.slow
def test_commands_take_a_key_as_option_or_variable_and_never_print_it(served, keys, capsys, monkeypatch):
    key = keys.add("reader", Role.read)
    for command in (["remote", "effects", "list"], ["remote", "alarms", "list"], ["remote", "assets", "list"]):
        assert run([*command, "--url", served]) == 2
        assert "key or token with the role read" in capsys.readouterr().err
        assert run([*command, "--url", served, "--key", key]) == 0
        assert key not in "".join(capsys.readouterr())
        assert run([*command, "--url", served]) == 2  # the option held for its command alone
        capsys.readouterr()
    monkeypatch.setenv("GEAR_TWIN_KEY", key)
    assert run(["remote", "alarms", "list", "--url", served]) == 0
    assert run(["remote", "effects", "accept", "unsw", "misalignment", "--url", served]) == 2
    said = capsys.readouterr().err
    assert "this needs the role operate; reader has read" in said and key not in said


def test_python_client_takes_a_key(served, keys, monkeypatch):
    with gear_twin.Client(served) as client, pytest.raises(gear_twin.ServiceError, match="role read"):
        client.assets()
    key = keys.add("reader", Role.read)
    with gear_twin.Client(served, key=key) as client:
        assert [machine.asset for machine in client.assets()] == ["unsw"]
        with pytest.raises(gear_twin.ServiceError, match="needs the role operate"):
            client.inspect("unsw", revolutions=1.0, max_depth_um=1.0, std_um=1.0)
    monkeypatch.setenv("GEAR_TWIN_KEY", key)
    with gear_twin.Client(served) as client:
        assert len(client.assets()) == 1


def test_event_stream_ends_when_its_key_is_revoked(served, keys, monkeypatch):
    monkeypatch.setattr(events, "PING_S", 0.2)
    key = keys.add("reader", Role.read)
    begun, ended = threading.Event(), threading.Event()

    def read():
        url, headers = f"{served}/v1/assets/unsw/events?after=0", {"Authorization": f"Bearer {key}"}
        with httpx.stream("GET", url, headers=headers, timeout=20) as answer:
            assert answer.status_code == 200
            begun.set()
            for _ in answer.iter_lines():
                pass
        ended.set()

    reader = threading.Thread(target=read, daemon=True)
    reader.start()
    assert begun.wait(20)
    time.sleep(0.5)
    assert not ended.is_set()
    keys.revoke("reader")
    assert ended.wait(20)


@pytest.mark.slow
def test_page_asks_for_a_key_and_signs_in_and_out(open_page, served, keys):
    key = keys.add("ann", Role.read)
    page = open_page("/", allowed="the server responded with a status of 401")
    page.wait_for_selector("main[data-view=sign-in]")
    page.fill("input[name=key]", "gt_wrong")
    page.keyboard.press("Enter")
    page.wait_for_selector(".said.error")
    assert "unknown, expired or revoked" in page.inner_text(".said.error")
    page.fill("input[name=key]", key)
    page.keyboard.press("Enter")
    page.wait_for_selector("main[data-view=fleet]")
    page.wait_for_function("document.querySelector('#session').textContent.includes('ann')")
    (cookie,) = page.context.cookies()
    assert cookie["name"] == COOKIE and cookie["httpOnly"] and cookie["sameSite"] == "Strict"
    assert page.evaluate("document.cookie") == ""
    page.click("#session button")
    page.wait_for_selector("main[data-view=sign-in]")
    assert page.context.cookies() == []
