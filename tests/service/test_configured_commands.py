"""Every command that reads settings reads those of the configuration file that it is given."""

from __future__ import annotations

import os

import pytest
import typer
from service_streams import write_recording

from benchmarks.reference import _leaves
from service.cli import run
from service.cli.commands import app

LEAVES = dict(_leaves(typer.main.get_command(app), "gear-twin"))
WITHOUT_SETTINGS = {"simulate", "thresholds", "init", "relate", "depths", "detectability", "example"}


def options(command):
    return {option for parameter in command.params for option in parameter.opts}


def test_a_command_asks_a_service_or_takes_a_configuration_file_or_reads_no_settings():
    for name, command in LEAVES.items():
        if not {"--config", "--url"} & options(command):
            assert name.split()[1] in WITHOUT_SETTINGS, name
    for name in ("assess", "calibrate", "report", "diagnose", "baseline", "signals", "doctor", "demo", "what-if"):
        assert "--config" in options(LEAVES[f"gear-twin {name}"]), name


@pytest.mark.parametrize(
    "arguments", [["assess"], ["report"], ["signals"], ["calibrate"], ["diagnose"], ["doctor"]], ids=" ".join
)
def test_a_mistake_in_the_file_is_named_by_the_command_that_it_is_given_to(arguments, tmp_path, capsys):
    recording, file = write_recording(tmp_path / "short.mcap", 2), tmp_path / "twin.toml"
    file.write_text("[windows]\nlenght = 2.5\n", encoding="utf-8")
    assert run([*arguments, str(recording), "--config", str(file)]) == 2
    assert f"{file}" in capsys.readouterr().err
    assert "GEAR_TWIN_CONFIG" not in os.environ


def test_windows_are_cut_as_the_file_says(tmp_path, capsys):
    recording, file, out = write_recording(tmp_path / "short.mcap", 2), tmp_path / "twin.toml", tmp_path / "out.json"
    file.write_text("[windows]\nlength = 0.5\ngap = 0.2\n", encoding="utf-8")
    counts = []
    for given in ([], ["--config", str(file)]):
        assert run(["assess", str(recording), "--no-trace", "--json", str(out), *given]) == 0
        counts.append(out.read_text(encoding="utf-8").count('"start_time"'))
    assert counts[1] > counts[0]
