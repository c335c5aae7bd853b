"""Frozen answers are compared item by item, and every path that differs is said."""

import json
import time
from datetime import UTC, datetime

from benchmarks.frozen_answers import compare, differences, masked


def written(folder, **items):
    (folder / "rest").mkdir(parents=True)
    for name, value in items.items():
        (folder / "rest" / f"{name}.json").write_text(json.dumps(value))
    return folder


def test_every_path_that_differs_is_named_with_both_values():
    old = {"a": [1, {"b": 2.0}], "c": None, "e": "same"}
    new = {"a": [1, {"b": 2.5}, 3], "d": None, "e": "same"}
    assert list(differences(old, new)) == [
        "/a/1/b: 2.0 became 2.5",
        '/a/2: "(absent)" became 3',
        '/c: null became "(absent)"',
        '/d: "(absent)" became null',
    ]


def test_a_number_of_another_type_differs():
    assert list(differences({"n": 1}, {"n": 1.0})) == ["/n: 1 became 1.0"]
    assert list(differences([True], [1])) == ["/0: true became 1"]


def test_folders_are_the_same_only_where_each_item_is(tmp_path, capsys):
    old = written(tmp_path / "old", list=[1, 2], trend={"depth": 3})
    assert compare(old, written(tmp_path / "same", list=[1, 2], trend={"depth": 3}))
    assert capsys.readouterr().out == "2 items, 0 of them differ\n"
    assert not compare(old, written(tmp_path / "new", list=[1, 9], more=1))
    said = capsys.readouterr().out.splitlines()
    assert said == [
        "rest/list.json", "    /1: 2 became 9",
        "rest/more.json", '    : "(absent)" became 1',
        "rest/trend.json", '    : {"depth": 3} became "(absent)"',
        "3 items, 3 of them differ",
    ]  # fmt: skip
    assert not compare(tmp_path / "nothing", tmp_path / "nowhere")


def test_only_what_depends_on_clock_and_process_is_masked():
    now = time.time_ns()
    iso = f"{datetime.fromtimestamp(now // 10**9, UTC):%Y-%m-%dT%H:%M:%S}.123456789Z"
    given = {
        "received": iso,
        "received_ns": now,
        "start_time": "2026-02-09T08:00:49.5Z",
        "start_ns": 1770624049551001344,
    }
    shown = {**given, "received": "<time>", "received_ns": 0}
    assert json.loads(masked(json.dumps(given))) == shown
    waits = {"reason": "good; 12 windows wait to be assessed since 09:21:09 UTC", "waiting": {"windows": 12}}
    assert json.loads(masked(json.dumps(waits))) == {"reason": "good"}
    assert json.loads(masked(json.dumps([json.dumps(waits)]))) == ['{"reason": "good"}']
    in_csv = json.dumps(['status,"' + json.dumps(waits).replace('"', '""') + '"'])
    assert json.loads(masked(in_csv)) == ['status,"{""reason"": ""good""}"']
