"""`gear-twin remote alarms` against a running service."""

from __future__ import annotations

import json

import pytest
import service_fakes as fakes
from test_alarms import WORN
from test_health import report_of

from service.alarms.keeper import AlarmKeeper
from service.cli import run
from service.cli.alarms import alarm_lines
from service.results.alarm_store import AlarmStore

OK = {"level": "ok", "reason": "the latest window is good"}


@pytest.fixture
def worn(store, board, address):
    fakes.campaign(store, board, windows=4)
    keeper = AlarmKeeper(AlarmStore(store.database))
    keeper.window("unsw", 1, {"index": 0, "quality": "good"}, report_of(WORN), OK)
    board.update("unsw", alarms=keeper.open("unsw"))
    return address


def said(capsys, *arguments):
    status = run(["remote", "alarms", *arguments])
    out, err = capsys.readouterr()
    return status, out, err


@pytest.mark.slow
def test_alarms_are_listed_acknowledged_and_cleared_by_name(worn, capsys):
    status, out, _ = said(capsys, "list", "--service", worn)
    assert status == 0 and "1  ALARM  unsw  depth, active, since 1970-01-01 00:00:00 UTC" in out
    assert "Stop the machine and replace the gear pair: 511 µm of 500 µm." in out
    status, out, _ = said(capsys, "acknowledge", "1", "--by", "Anna", "--note", "seen", "--url", worn)
    assert (status, out) == (0, "alarm 1 of unsw: active, acknowledged\n")
    status, out, _ = said(capsys, "list", "unsw", "--url", worn, "--json", "-")
    assert json.loads(out)[0]["acknowledgement"]["note"] == "seen"
    status, out, _ = said(capsys, "clear", "1", "--by", "Ben", "--url", worn)
    assert (status, out) == (0, "alarm 1 of unsw: closed\n")
    assert said(capsys, "list", "--url", worn)[1] == "no open alarm\n"
    assert "Cleared by Ben at" in said(capsys, "list", "--all", "--url", worn)[1]


def test_wrong_requests_end_with_one_line_and_status_2(worn, capsys):
    for arguments, why in (
        (["acknowledge", "7", "--by", "Anna"], "no alarm 7 is open; open alarms: 1"),
        (["list", "nobody"], "no asset 'nobody' has been seen"),
        (["rules", "unsw", "--set", "none.toml"], "--by is missing"),
    ):
        status, out, err = said(capsys, *arguments, "--url", worn)
        assert status == 2 and why in err and out == "" and err.count("\n") == 1
    assert "Missing option '--by'" in said(capsys, "clear", "1", "--url", worn)[2]


def test_rules_are_shown_with_what_is_learned_and_set_from_a_file(worn, capsys, tmp_path):
    assert "kurtosis: kurtosis: limits learned; 3 windows in a row" in said(
        capsys, "rules", "unsw", "--url", worn
    )[1]  # fmt: skip
    file = tmp_path / "rules.toml"
    file.write_text('[[rule]]\nname = "oil"\nquantity = "temperature"\nwatch = 70\nalarm = 85\n')
    status, out, _ = said(capsys, "rules", "unsw", "--set", str(file), "--by", "Anna", "--url", worn)
    assert status == 0 and "set by Anna" in out and "oil: temperature: watch 70, alarm 85; at once" in out


def test_long_sentences_fit_the_terminal(monkeypatch):
    monkeypatch.setattr("service.report.words.width", lambda: 80)
    alarm = {"id": 12, "level": "watch", "asset": "a", "quantity": "rms", "place": "a1", "state": "active_acknowledged",
             "raised_at": "2023-11-14T22:13:20.000000000Z", "reason": "word " * 60, "action": ""}  # fmt: skip
    assert max(map(len, alarm_lines([alarm])[1:])) <= 80
