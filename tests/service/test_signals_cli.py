"""`gear-twin signals`: views of a recording's windows from the command line, also with what the twin expects."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest
from service_streams import write_recording

from service.cli import run
from service.cli.assessing import windowing
from service.signals.recorded import recorded_subject
from service.signals.view import ViewOptions
from service.signals.views import VIEWS


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return write_recording(tmp_path_factory.mktemp("signals") / "short.mcap", windows=3)


def test_the_summary_names_figures_and_channels(recording, capsys):
    assert run(["signals", str(recording), "--view", "waveform", "--window", "1"]) == 0
    said = capsys.readouterr().out
    assert "Waveform of accel/y6, window 1 of unsw" in said
    assert "transmission-error" in said and "rms:" in said


@pytest.mark.parametrize("ending", ["png", "csv", "json"])
def test_a_view_is_written_as_its_ending_says(recording, tmp_path, ending):
    out = tmp_path / f"spectrum.{ending}"
    assert run(["signals", str(recording), "--out", str(out)]) == 0
    content = out.read_bytes()
    if ending == "png":
        assert content.startswith(b"\x89PNG")
    elif ending == "csv":
        head, *rows = csv.reader(content.decode().splitlines())
        assert head[0] == "frequency [Hz]" and len(rows) == 2001
    else:
        assert json.loads(content)["window"] == 2


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--window", "7"], "there is no window 7; the recording has windows 0 to 2"),
        (["--channel", "accel/zz"], "has no channel 'accel/zz'; it has accel/y6"),
        (["--out", "picture.bmp"], "picture.bmp: the ending must be one of .png, .csv, .json"),
        (["--view", "spectrum", "--channel", "encoder/gear"], "choose its order spectrum"),
    ],
)
def test_what_cannot_be_shown_is_one_clear_line(recording, capsys, options, said):
    assert run(["signals", str(recording), *options]) == 2
    assert said in capsys.readouterr().err


@pytest.mark.slow
def test_what_is_modelled_agrees_with_what_is_measured_on_the_reference_campaign(shared):
    subject = recorded_subject(
        shared / "campaigns" / "D07.mcap", 6, rig_path=None, asset=None, prefix="gearbox", assembly=windowing(),
        modelled=True,
    )  # fmt: skip
    for channel, most in (("accel/y6", 0.3), ("transmission-error", 0.1)):  # of the measured waveform, mean left out
        for shaft in ("pinion", "gear"):
            shown = VIEWS["synchronous-average"](subject, ViewOptions(channel=channel, shaft=shaft))
            measured, modelled = (s.values for s in shown.series[:2])
            assert shown.series[1].name == "modelled"
            assert np.std(measured - modelled) < most * np.std(measured), (channel, shaft)
    assert VIEWS["flank"](subject, ViewOptions()).figures["depth_um"] == pytest.approx(22.5, rel=0.1)
