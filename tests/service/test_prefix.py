"""Every command that reads a recording or a stream uses `[stream] prefix` of the configuration file and environment."""

from __future__ import annotations

import inspect

import pytest
import typer
from service_streams import write_recording

from benchmarks.reference import _leaves
from service.cli import run
from service.cli.commands import app
from service.files.import_recording import import_recording
from service.stream.sources.mcap import Recording

ANOTHER = "plant/gears"
LEAVES = {name.removeprefix("gear-twin "): c for name, c in _leaves(typer.main.get_command(app), "gear-twin")}

READING = {  # what each needs after its recording
    "assess": ["--no-trace", "--mcap", "OUT.mcap"],
    "calibrate": ["--unworn", "1"],
    "report": ["--no-trace", "--out", "OUT.html"],
    "diagnose": [],
    "signals": [],
    "what-if": ["--no-trace"],
    "doctor": [],
    "baseline": ["--out", "OUT.baseline"],
}
HANDED_ON = {  # what the prefix is handed to
    "replay": (["RECORDING"], "service.runtime.replay.replay"),
    "record": (["--out", "OUT.mcap", "--connect", "tcp/127.0.0.1:9"], "service.cli.recordings.record_live"),
    "serve": ([], "service.runtime.serve.run"),
    "demo": (["--exit"], "service.runtime.demo.run"),
}
WRITING = {"import"}
IN_BATCHES = {"fleet assess"}  # reads what is stored: test_fleet_assess.py
NO_STREAM = {  # commands that read neither a recording nor a stream
    "config", "init", "thresholds", "relate", "depths", "detectability", "example", "db",
    "fleet",  # a fleet's keys are made of the setting: test_fleet_fence.py
    "simulate",  # another program's recordings: their prefix is that of the contract
}  # fmt: skip


@pytest.fixture
def configured(tmp_path):
    file = tmp_path / "twin.toml"
    file.write_text(f'[stream]\nprefix = "{ANOTHER}"\n', encoding="utf-8")
    return ["--config", str(file)]


@pytest.fixture
def recording(tmp_path):
    return write_recording(tmp_path / "short.mcap", 2, prefix=ANOTHER)


def in_folder(words, tmp_path, recording):
    return [str(recording) if w == "RECORDING" else w.replace("OUT", str(tmp_path / "out")) for w in words]


def test_every_command_has_a_place_in_the_table():
    for name, command in LEAVES.items():
        options = {option for parameter in command.params for option in parameter.opts}
        known = name in READING or name in HANDED_ON or name in WRITING or name in IN_BATCHES
        if known and name != "demo":
            assert {"--prefix", "--config"} <= options, name
        else:
            assert "--prefix" not in options, name
            assert known or "--url" in options or name.split()[0] in NO_STREAM, name


QUICK = ("assess", "doctor")  # the others compute for seconds
TOO_SHORT = ("no window has given a remaining life yet", "pinion turns are too few")  # read, but nothing comes of it


@pytest.mark.parametrize("command", [pytest.param(c, marks=[] if c in QUICK else [pytest.mark.slow]) for c in READING])
def test_a_recording_is_read_under_the_prefix_of_the_file(command, tmp_path, recording, configured, capsys):
    words = [command, str(recording), *in_folder(READING[command], tmp_path, recording)]
    assert run(words) == 2
    assert f"its topics begin with {ANOTHER!r}, not 'gearbox': set the prefix" in capsys.readouterr().err
    status = run([*words, *configured])
    said = capsys.readouterr().err
    assert "prefix" not in said and "no channel" not in said
    assert status == 0 or any(reason in said for reason in TOO_SHORT)


@pytest.mark.slow
def test_an_option_goes_before_the_environment_and_that_before_the_file(
    tmp_path, recording, configured, capsys, monkeypatch
):
    words = ["doctor", str(recording), "--json", str(tmp_path / "out.json")]
    monkeypatch.setenv("GEAR_TWIN_PREFIX", "elsewhere")
    assert run([*words, *configured]) == 2
    assert "not 'elsewhere'" in capsys.readouterr().err
    assert run([*words, *configured, "--prefix", ANOTHER]) == 0
    assert run([*words, "--prefix", "no prefix"]) == 2
    assert "prefix = 'no prefix'" in capsys.readouterr().err


@pytest.mark.parametrize("command", HANDED_ON)
def test_a_command_on_the_network_uses_the_prefix_of_the_file(command, tmp_path, recording, configured, monkeypatch):
    words, target = HANDED_ON[command]
    module, _, function = target.rpartition(".")
    signature = inspect.signature(getattr(__import__(module, fromlist=[function]), function))
    used = []

    class Called(Exception):
        pass

    def called(*given, **named):
        arguments = signature.bind(*given, **named).arguments
        used.append(arguments.get("prefix") or arguments["settings"].prefix)
        raise Called

    monkeypatch.setattr(target, called)
    with pytest.raises(Called):
        app([command, *in_folder(words, tmp_path, recording), *configured], standalone_mode=False)
    assert used == [ANOTHER]


def test_an_import_writes_the_topics_that_the_settings_name(tmp_path, configured, capsys):
    data, mapping, out = tmp_path / "data.csv", tmp_path / "data.toml", tmp_path / "out.mcap"
    data.write_text("time,a\n" + "".join(f"{i / 1000},{i % 7}\n" for i in range(3000)), encoding="utf-8")
    assert run(["import", str(data), "--guess", "--teeth", "23/57", "--speed", "10", "--write", str(mapping)]) == 0
    assert run(["import", str(mapping), "--out", str(out), *configured]) == 0
    with Recording(out, ANOTHER) as written:
        assert written.assets == ["data"]
    import_recording(mapping, out)
    with Recording(out) as written:
        assert written.assets == ["data"]
