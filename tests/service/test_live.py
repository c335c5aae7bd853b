"""Callbacks that Zenoh would swallow the faults of, and rig files that are offered."""

from __future__ import annotations

import pytest
from service_streams import RIG, free_port, wait_until

from service.runtime.rig_sources import OfferedRigs
from service.transport.guard import Guard
from service.transport.zenoh import ZenohTransport, open_session


def test_fault_of_a_callback_is_counted_and_goes_no_further(caplog):
    guard = Guard()
    guard(lambda _: 1 / 0)("sample")
    guard(lambda _: None)("sample")
    assert guard.errors == 1 and "ZeroDivisionError" in caplog.text


@pytest.fixture
def session():
    with open_session(listen=[f"tcp/127.0.0.1:{free_port()}"]) as opened:
        yield opened


def test_rig_file_is_taken_from_who_publishes_and_from_who_answers(session):
    with OfferedRigs(ZenohTransport(session)).watching() as offered:
        assert offered.find("a") is None
        session.put("gearbox/a/rig", RIG.read_bytes())
        wait_until(lambda: offered.find("a"))
        assert offered.find("a")["name"] == "unsw"
        answers = session.declare_queryable(
            "gearbox/b/rig", lambda query: query.reply("gearbox/b/rig", b'name = "other"')
        )
        assert offered.find("b") == {"name": "other"}
        answers.undeclare()
        assert offered.find("b") == {"name": "other"}  # remembered


@pytest.mark.parametrize(
    ("text", "told"),
    [(b"[gears", "not TOML"), (b"[gears]\nmodul = 2", "gears.modul"), (b"\xff", "not TOML")],
)
def test_rig_file_that_cannot_be_used_is_told_and_left(session, caplog, text, told):
    with OfferedRigs(ZenohTransport(session)).watching() as offered:
        session.put("gearbox/a/rig", text)
        wait_until(lambda: told in caplog.text)
        assert offered.find("a") is None
