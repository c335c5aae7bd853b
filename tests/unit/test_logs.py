"""Log lines: text or JSON, with asset and window, limited for each cause."""

from __future__ import annotations

import io
import json
import logging
import pickle
import re
import threading
import warnings

import numpy as np
import pytest

from service.configuration.load import load
from service.errors import InputError
from service.logs import MOST_CAUSES, PERIOD, LimitedLines, about, carry, formatter, logging_by
from service.settings import Settings

log = logging.getLogger("service.test")


class Clock:
    now = 0.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def lines(clock):
    """Makes a handler of our own logger; what it writes."""
    made = []

    def begin(form="text", most=10):
        out = io.StringIO()
        handler = LimitedLines(formatter(form), most, clock=clock, stream=out)
        log.addHandler(handler)
        made.append(handler)
        return lambda: out.getvalue().splitlines()

    yield begin
    for handler in made:
        log.removeHandler(handler)
        handler.close()


def test_text_line_says_when_how_grave_and_what(lines):
    written = lines()
    log.warning("%s: no window since %d s", "unsw", 7)
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT[\d:.]+Z warning: unsw: no window since 7 s", written()[0])


def test_json_line_carries_logger_level_asset_window_and_traceback(lines):
    written = lines("json")
    with about(asset="unsw", window="2026-01-01T00:00:00Z"):
        try:
            raise ZeroDivisionError("a fault")
        except ZeroDivisionError:
            log.exception("a window was refused: %s", "µ")
    log.warning("after", extra={"asset": "press"})
    first, second = map(json.loads, written())
    assert first["message"] == "a window was refused: µ" and "ZeroDivisionError: a fault" in first["exception"]
    assert (first["asset"], first["window"]) == ("unsw", "2026-01-01T00:00:00Z")
    assert (first["level"], first["logger"]) == ("error", "service.test") and first["time"].endswith("Z")
    assert second["asset"] == "press" and "window" not in second


def test_text_names_the_asset_and_window_only_where_the_message_does_not(lines):
    written = lines()
    with about(asset="unsw", window="w7"):
        log.warning("unsw: cannot be used")
        log.warning("a step failed")
    assert written()[0].endswith("unsw: cannot be used (window=w7)")
    assert written()[1].endswith("a step failed (asset=unsw, window=w7)")


def test_flood_of_one_cause_is_limited_and_counted_and_others_are_not(lines, clock):
    written = lines("json")
    for number in range(1617):
        log.warning("no rig file is known for %s", f"asset-{number}", extra={"asset": f"asset-{number}"})
    log.warning("something else")
    assert len(written()) == 11
    clock.now = PERIOD + 1
    log.warning("no rig file is known for %s", "one more")
    said = [json.loads(line) for line in written()[11:]]
    assert said[0]["left_out"] == 1607 and said[0]["level"] == "warning"
    assert said[0]["message"] == "1607 more lines within 60 s were left out: no rig file is known for …"
    assert said[1]["message"] == "no rig file is known for one more"


def test_tracebacks_in_a_loop_are_limited_too(lines):
    written = lines(most=3)
    for _ in range(1000):
        try:
            raise OSError("too many open files")
        except OSError:
            log.exception("a connection could not be accepted")
    assert sum("Traceback" in line for line in written()) == 3


def test_count_of_what_was_left_out_is_said_without_another_line(clock):
    out = io.StringIO()
    handler = LimitedLines(formatter("text"), 1, clock=clock, stream=out)
    for _ in range(3):
        handler.handle(log.makeRecord("service.test", logging.WARNING, "f", 1, "again", None, None))
    clock.now = PERIOD + 1
    handler._due()
    assert out.getvalue().splitlines()[-1].endswith("2 more lines within 60 s were left out: again")
    for _ in range(2):
        handler.handle(log.makeRecord("service.test", logging.WARNING, "f", 1, "again", None, None))
    handler.close()  # at the end, too
    assert out.getvalue().splitlines()[-1].endswith("1 more lines within 60 s were left out: again")


def test_memory_of_causes_is_bounded_and_messages_that_all_differ_are_limited_together(lines):
    written = lines(most=10)
    for number in range(5000):
        log.warning(f"message {number}")
    assert len(written()) == MOST_CAUSES + 10


def test_zero_lines_mean_no_limit(lines):
    written = lines(most=0)
    for _ in range(50):
        log.warning("again")
    assert len(written()) == 50


def test_line_breaks_in_a_message_forge_no_line_and_a_huge_one_is_cut(lines):
    written = lines()
    log.warning("asset %r\n2026-01-01 error: forged", "x")
    log.warning("y" * 100_000)
    assert len(written()) == 2 and len(written()[1]) < 5000


def test_record_of_another_process_keeps_its_cause_and_what_was_bound_there(lines):
    written = lines("json", most=2)
    for number in range(4):
        with about(asset="unsw", window=f"w{number}"):
            record = log.makeRecord("service.test", logging.ERROR, "f", 1, "refused because of %d", (number,), None)
            carry(record)
        log.handle(pickle.loads(pickle.dumps(record)))
    assert [json.loads(line)["message"] for line in written()] == ["refused because of 0", "refused because of 1"]
    assert json.loads(written()[1])["window"] == "w1" and json.loads(written()[1])["asset"] == "unsw"


def test_stream_that_cannot_be_written_ends_nothing():
    class Full(io.StringIO):
        def write(self, text):
            raise OSError("no space left on device")

    handler = LimitedLines(formatter("text"), 10, stream=Full())
    handler.handle(log.makeRecord("service.test", logging.WARNING, "f", 1, "said", None, None))
    handler.handle(log.makeRecord("service.test", logging.WARNING, "f", 1, "%d", ("no number",), None))
    handler.close()


def test_command_writes_warnings_of_libraries_and_numpy_and_threads_that_fail_as_lines(capsys):
    with logging_by(Settings(log_format="json")), warnings.catch_warnings():
        warnings.simplefilter("always")
        warnings.showwarning = __import__("service.logs", fromlist=["_warned"])._warned
        warnings.warn("an old call", DeprecationWarning, stacklevel=1)
        np.float64(1.0) / np.float64(0.0)
        logging.getLogger("some.library").info("left out")
        logging.getLogger("some.library").warning("kept")
        log.info("our own")
        threading.excepthook(threading.ExceptHookArgs((ValueError, ValueError("x"), None, None)))
    said = [json.loads(line) for line in capsys.readouterr().err.splitlines()]
    assert [line["message"].partition(" (")[0] for line in said] == [
        "DeprecationWarning: an old call",
        "RuntimeWarning: divide by zero encountered in scalar divide",
        "kept",
        "our own",
        "the thread a thread ended with an internal error",
    ]
    log.warning("after the command nothing is written by it")
    assert capsys.readouterr().err.count("after the command") <= 1


def test_level_is_a_setting(capsys):
    with logging_by(Settings(log_level="error")):
        log.warning("left out")
        log.error("kept")
    assert "left out" not in capsys.readouterr().err
    assert not log.isEnabledFor(logging.INFO)


@pytest.mark.parametrize(
    "command",
    [["serve"], ["replay", "none.mcap"], ["record", "--out", "none.mcap", "--listen", "tcp/127.0.0.1:1"]],
    ids=lambda command: command[0],
)
def test_every_command_that_goes_on_for_long_logs_by_the_settings(command, monkeypatch, capsys, tmp_path):
    from service.cli import recordings, run
    from service.runtime import replay, serve

    def logged(*given, **named):
        log.warning("%s is said", "something")
        raise InputError("that is all")

    for module, name in ((serve, "run"), (replay, "replay"), (recordings, "record_live")):
        monkeypatch.setattr(module, name, logged)
    monkeypatch.setenv("GEAR_TWIN_LOG_FORMAT", "json")
    monkeypatch.setenv("GEAR_TWIN_DATA", str(tmp_path))
    assert run(command) == 2
    line = next(line for line in capsys.readouterr().err.splitlines() if line.startswith("{"))
    assert json.loads(line)["message"] == "something is said"


def test_settings_of_the_log_are_checked(monkeypatch):
    monkeypatch.setenv("GEAR_TWIN_LOG_FORMAT", "xml")
    with pytest.raises(Exception, match=r"log_format .*'text' or 'json'"):
        load()
