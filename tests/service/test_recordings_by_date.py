"""A machine whose tachometer counts anew in every file: its recordings follow one another by their dates."""

from __future__ import annotations

import json
import runpy
from pathlib import Path

import numpy as np
import pytest
from service_streams import Sink
from typer.testing import CliRunner

from service.cli.commands import app
from service.files.rig import rig_of
from service.runtime.pipeline import Pipeline
from service.runtime.twin_port import gear_twin
from service.stream.sources.mcap import Recording
from twin.options import Options

MACHINE = runpy.run_path(str(Path(__file__).parents[2] / "docs" / "examples" / "machine.py"))
ANSWERS = """schema = "gear-answers/1"
asset = "pump-drive"
pinion_teeth = 23
gear_teeth = 57
speed = "1476 rpm"
module = "2.5 mm"
face_width = "25 mm"
power = "4 kW"
encoder_pinion = 1
encoder_pinion_column = "Tacho (V)"
data_file = "run.csv"
sample_rate = "5.12 kHz"
age = "new"
[[accelerometers]]
column = "Acc1 (g)"
unit = "g"
"""


def command(*given):
    done = CliRunner().invoke(app, [str(g) for g in given])
    assert done.exit_code == 0, (given, done.output, done.exception)


@pytest.fixture
def imported(tmp_path):
    """Imports recordings of so many seconds, begun at these dates, by the files that `init` makes."""
    (tmp_path / "answers.toml").write_text(ANSWERS)

    def by(files):
        out = []
        for i, (date, seconds) in enumerate(files):
            values = MACHINE["recording"](0.5, seed=3 + i, duration=seconds)
            np.savetxt(
                tmp_path / "run.csv",
                values,
                delimiter=",",
                header=",".join(MACHINE["COLUMNS"]),
                comments="",
                fmt="%.9g",
            )
            if not i:
                command("init", "--answers", tmp_path / "answers.toml", "--out", tmp_path)
            mapping = tmp_path / "mapping.toml"
            text = mapping.read_text().replace("[file]", f"started = {date}\n\n[file]", 1)
            (dated := tmp_path / f"mapping-{i}.toml").write_text(text)
            out.append(tmp_path / f"run-{i}.mcap")
            command("import", dated, "--out", out[-1])
        return out

    return by


def followed(recordings):
    """What one service says of the recordings, replayed one after the other."""
    outcomes = []
    with Recording(recordings[0]) as first:
        rig = rig_of(first, None)
    pipeline = Pipeline(lambda asset: rig, gear_twin(Options(trace=True)), Sink(outcomes))
    for path in recordings:
        with Recording(path) as recording:
            for frame in recording.frames(lambda channel, error: None):
                pipeline.feed(frame)
        pipeline.flush()
    return outcomes


MARCH = tuple(f"2026-03-{day:02d}T08:00:00+00:00" for day in (1, 8, 15))


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [(7.0, 5.0), (5.0, 5.0, 4.0)])
def test_recordings_that_each_begin_their_count_are_followed_by_their_dates_without_a_question(imported, seconds):
    """Every file after the first was a counter that was reset, and the machine stayed without a verdict."""
    outcomes = followed(imported(tuple(zip(MARCH, seconds, strict=False))))
    counts = [o.record["revolutions"] for o in outcomes]
    assert counts == sorted(set(counts)) and [o.record["quality"] for o in outcomes] == ["good"] * len(seconds)
    assert all("dates" in said["note"] for o in outcomes for kind, said in o.events if kind == "change")
    status = outcomes[-1].report["status"]
    assert status["verdict"]["window"] == len(seconds) - 1 and "reset" not in json.dumps(status)
