"""A machine without a rig model from files to answers: import, baseline, diagnosis; and what is refused."""

import json
from io import BytesIO

import numpy as np
import pytest

from service.cli import run
from service.errors import InputError
from service.files.baseline import SCHEMA, compared, learned, load, read_baseline, save
from service.files.import_recording import import_recording
from tests.claims.test_baseline import RATE, SPEED, TEETH, machine
from twin.baseline.comparison import described

MAPPING = """
schema = "gear-import/1"
asset = "bench"
[file]
path = "columns.npz"
sample_rate_hz = {rate}
[channels.a]
unit = "m/s2"
[channels.b]
unit = "m/s2"
[rig.gears.pinion]
teeth = {z1}
[rig.gears.gear]
teeth = {z2}
[rig.operating]
pinion_speed_hz = {speed}
"""


def recording(folder, name, teeth=TEETH, **what):
    started = what.pop("started", "2026-03-12T08:14:00Z")
    window = machine(what.pop("load", 0.42), what.pop("seed", 99), **what)
    columns, mapping, out = (folder / f"{name}.{end}" for end in ("npz", "toml", "mcap"))
    np.savez(columns, **{k: s.values for k, s in window.accelerations.items()})
    mapping.write_text(MAPPING.format(rate=RATE, z1=teeth[0], z2=teeth[1], speed=SPEED))
    import_recording(mapping, out, source=columns, started=started)
    return out


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("machine")


@pytest.fixture(scope="module")
def healthy(folder):
    return [recording(folder, f"h{i}", load=load, seed=i) for i, load in enumerate((0.1, 0.3, 0.5, 0.7))]


@pytest.fixture(scope="module")
def file(folder, healthy):
    path = folder / "healthy.baseline"
    assert run(["baseline", *map(str, healthy), "--out", str(path)]) == 0
    return path


@pytest.mark.slow
def test_every_command_cuts_a_recording_into_the_windows_that_the_settings_say(healthy, tmp_path, monkeypatch):
    from service.cli.assessing import windowing
    from service.runtime.assess import assess

    monkeypatch.setenv("GEAR_TWIN_WINDOW_LENGTH", "1.5")
    assessed = assess(healthy[0], assembly=windowing())["windows"]
    assert len(assessed) > len(load(healthy[0]).windows)  # with the default length
    assert run(["baseline", *map(str, healthy), "--out", str(tmp_path / "short.baseline")]) == 0
    short = read_baseline(tmp_path / "short.baseline")
    assert sum(r.name.startswith("h0#") for r in short.readings) == len(assessed)
    out = tmp_path / "answer.json"
    assert run(["diagnose", str(healthy[0]), "--baseline", str(tmp_path / "short.baseline"), "--json", str(out)]) == 0
    assert len(json.loads(out.read_text())["windows"]) == len(assessed)


@pytest.mark.slow
def test_baseline_file_gives_the_baseline_back_whole(file, healthy):
    made, read = learned(healthy), read_baseline(file)
    assert described(made) == described(read)
    assert read.shafts == made.shafts and read.path_scatter == pytest.approx(dict(made.path_scatter))
    for mine, yours in zip(made.readings, read.readings, strict=True):
        for name, channel in mine.channels.items():
            other = yours.channels[name]
            assert np.array_equal(channel.lines, other.lines)
            assert channel.off.names == other.off.names and np.array_equal(channel.off.values, other.off.values)
            assert (channel.off.clipped, channel.off.constant) == (other.off.clipped, other.off.constant)


@pytest.mark.slow
def test_fault_is_named_with_errors_and_without_wear(folder, file, capsys):
    fault = recording(folder, "fault", pulse=2.0)
    given = ["--json", str(folder / "fault.json"), "--out", str(folder / "fault.html")]
    assert run(["diagnose", str(fault), "--baseline", str(file), *given]) == 0
    html = (folder / "fault.html").read_text()
    assert "a local fault of one tooth" in html and "Mesh bands, RMS" not in html
    assert html.count("plotly-graph-div") == 2  # bands, and the turn of the shaft: no way to a sensor has changed
    said = capsys.readouterr().out
    assert "A local fault of one tooth (a)" in said and "not available" in said
    answer = json.loads((folder / "fault.json").read_text())
    (effect,) = answer["effects"]
    assert effect["name"] == "tooth_crack" and effect["parameters"]["shaft_order"]["value"] == pytest.approx(2 / 3)
    assert effect["error_after"]["waveform_percent"] < effect["error_before"]["waveform_percent"]
    assert answer["wear"]["status"] == answer["rul"]["status"] == "not available"
    assert answer["unexplained"]["verdict"] in ("explained", "unknown_effect")


def test_healthy_recording_at_another_load_has_no_effect(folder, file, capsys):
    assert run(["diagnose", str(recording(folder, "well", load=0.6, seed=31)), "--baseline", str(file)]) == 0
    assert "no effect was added" in capsys.readouterr().out


@pytest.mark.slow
def test_modulation_of_an_unknown_shaft_is_said_without_a_baseline(folder, capsys):
    path = recording(folder, "modulated", foreign=0.3961, seconds=9.0)
    given = ["--json", str(folder / "modulated.json"), "--out", str(folder / "modulated.html")]
    assert run(["diagnose", str(path), *given]) == 0
    said = capsys.readouterr().out
    assert "belong to no known shaft" in said and "Share of the energy" in said
    answer = json.loads((folder / "modulated.json").read_text())
    assert answer["unexplained"]["verdict"] == "unknown_effect"
    speed = SPEED * (1 - 0.0042)
    (found,) = answer["unattributed_lines"]
    assert found["frequency_hz"] == pytest.approx(0.3961 * speed, abs=0.02)
    part = found["spectrum"][0]
    line = np.argmax(part["amplitude"])  # of the mesh, in the middle
    assert part["from_hz"] + line * part["step_hz"] == pytest.approx(TEETH[0] * speed, abs=2 * part["step_hz"])
    html = (folder / "modulated.html").read_text()
    assert html.count("plotly-graph-div") == 3 and "Causes tested for" in html
    share = {b["family"]: b["share_percent"] for b in answer["energy_breakdown"] if b["channel"] == "a"}
    assert share["mesh"] > 50 and 90 < sum(share.values()) < 101
    assert "spectrum around the mesh lines" in html and "Depth of the modulation" in html


@pytest.mark.parametrize(("teeth", "message"), [((21, 30), "21"), ((20, 33), "33")])
def test_tooth_counts_that_do_not_fit_are_caught_before_a_diagnosis(folder, file, teeth, message):
    wrong = recording(folder, f"wrong{teeth[0]}{teeth[1]}", teeth=teeth)
    with pytest.raises(InputError, match=message):
        compared(read_baseline(file), wrong)


def test_file_that_is_no_baseline_is_refused_in_one_line(folder, healthy, capsys):
    broken = folder / "broken"
    broken.write_bytes(b"PK not a baseline")
    assert run(["diagnose", str(healthy[0]), "--baseline", str(broken)]) == 2
    assert "not a baseline" in capsys.readouterr().err
    assert run(["diagnose", str(healthy[0]), "--baseline", str(folder / "absent")]) == 2
    assert "cannot be read" in capsys.readouterr().err


def damaged(data):
    array, other, bare = BytesIO(), BytesIO(), BytesIO()
    np.save(array, np.arange(4))
    np.savez(other, a=np.arange(4))
    np.savez(bare, header=np.frombuffer(json.dumps({"schema": SCHEMA, "readings": []}).encode(), np.uint8))
    return {"empty": b"", "cut off": data[: len(data) // 2], "flipped": data[:4000] + b"\0" * 99 + data[4099:],
            "array": array.getvalue(), "other archive": other.getvalue(), "bare": bare.getvalue()}  # fmt: skip


@pytest.mark.parametrize("kind", ["empty", "cut off", "flipped", "array", "other archive", "bare"])
def test_damaged_baseline_is_one_clear_error(file, tmp_path, kind):
    """An empty or cut-off file ended in an EOFError or BadZipFile."""
    path = tmp_path / "damaged.baseline"
    path.write_bytes(damaged(file.read_bytes())[kind])
    with pytest.raises(InputError, match="not a baseline"):
        read_baseline(path)


def test_baseline_that_cannot_be_written_is_said(healthy, folder):
    with pytest.raises(InputError, match="cannot be written"):
        save(learned(healthy), folder / "no" / "such" / "folder")
