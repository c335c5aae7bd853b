"""`gear-twin import`: measured columns become a recording that the service reads like any other."""

import numpy as np
import pytest

from service.cli import run
from service.errors import InputError
from service.files.import_mapping import load_import_mapping
from service.files.import_recording import import_recording
from service.stream.sources.mcap import read_windows
from twin.features.extract import extract
from twin.rig import Rig

RATE = 12800.0
MAPPING = """
schema = "gear-import/1"
asset = "bench"
description = "a spur pair on a bench"
started = 2024-05-01T12:00:00Z

[file]
path = "data.csv"
sample_rate_hz = 12800

[channels.top]
column = "a1"
unit = "g"

[channels.side]
column = "a2"
unit = "unknown"

[channels.mic]
column = "p"
unit = "Pa"

[rig.gears.pinion]
teeth = 20

[rig.gears.gear]
teeth = 37

[rig.operating]
pinion_speed_hz = 25.0

[rig.sensors]
accelerometer = "top"
"""


def signal(seconds=4.0, seed=1):
    """Two accelerations with mesh lines and sidebands of a 20/37 pair at 25.1 Hz, and a pressure."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * RATE)) / RATE
    mesh = 2 * np.pi * 25.1 * 20 * t
    side = 1 + 0.3 * np.cos(mesh / 20) + 0.3 * np.cos(mesh / 37)
    x = sum(a * np.cos(k * mesh + k) for k, a in ((1, 1.0), (2, 0.5), (3, 0.3), (4, 0.2), (5, 0.2))) * side
    return np.stack([x + 0.02 * rng.standard_normal(t.size) for _ in range(3)], axis=1)


@pytest.fixture
def bench(tmp_path):
    """A folder with a data file and a function that writes a mapping file with replaced text."""
    table = signal()
    np.savetxt(tmp_path / "data.csv", table, fmt="%.6f", delimiter=",", header="a1,a2,p", comments="")

    def mapping(*changes):
        text = MAPPING
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / "mapping.toml"
        path.write_text(text)
        return path

    mapping.table, mapping.folder = table, tmp_path
    return mapping


@pytest.mark.slow
def test_columns_become_a_recording_in_the_units_of_the_contract(bench):
    seen = []
    out = bench.folder / "out.mcap"
    summary = import_recording(bench(), out, progress=lambda done, total: seen.append((done, total)))
    rig, metadata, windows = read_windows(out)
    (window,) = windows
    assert window.quality == "good"
    assert set(window.accelerations) == {"top", "side"}
    assert window.accelerations["top"].rate == RATE
    assert window.accelerations["top"].values == pytest.approx(9.80665 * bench.table[:, 0], rel=1e-5, abs=1e-4)
    assert window.accelerations["side"].values == pytest.approx(bench.table[:, 1], rel=1e-6, abs=1e-6)
    assert (metadata["asset"], metadata["started"]) == ("bench", "2024-05-01T12:00:00+00:00")
    assert Rig.from_mapping(rig).teeth == (20, 37)
    assert seen[-1] == (summary["duration"], summary["duration"]) and summary["frames"] == len(seen)


def test_what_is_not_known_is_said_and_never_relabelled(bench):
    summary = import_recording(bench(("started = 2024-05-01T12:00:00Z\n", "")), bench.folder / "out.mcap")
    assert "unit unknown" in summary["notes"]["accel/side"]
    assert "unknown" in summary["notes"]["started"]
    assert summary["left_out"] == {"accel/mic": "not an acceleration (Pa)"}
    assert "times 9.80665" in summary["notes"]["accel/top"]


def test_the_imported_recording_gives_speed_rms_and_mesh_bands_and_no_wear(bench):
    import_recording(bench(), bench.folder / "out.mcap")
    rig, _, (window,) = read_windows(bench.folder / "out.mcap")
    found = extract(Rig.from_mapping(rig), window)
    assert found.speed_hz == pytest.approx(25.1, rel=1e-4)
    assert found.rms > 0 and found.mesh_bands[0] > found.mesh_bands[1] > 0
    assert found.transmission_error is None and "no encoder" in found.unavailable["transmission_error"]
    assert found.revolutions is None and found.torque_nm is None


def test_volts_are_divided_by_the_sensitivity(bench):
    changed = bench(('unit = "g"', 'unit = "V"\nsensitivity = 0.05'))
    import_recording(changed, bench.folder / "out.mcap")
    _, _, (window,) = read_windows(bench.folder / "out.mcap")
    assert window.accelerations["top"].values == pytest.approx(20 * bench.table[:, 0], rel=1e-4, abs=1e-3)


def test_an_empty_cell_is_a_lost_sample_not_a_wrong_one(bench):
    lines = (bench.folder / "data.csv").read_text().splitlines()
    cells = lines[500].split(",")
    lines[500] = ",".join(["", *cells[1:]])
    (bench.folder / "data.csv").write_text("\n".join(lines))
    import_recording(bench(), bench.folder / "out.mcap")
    _, _, (window,) = read_windows(bench.folder / "out.mcap")
    assert np.flatnonzero(np.isnan(window.accelerations["top"].values)).tolist() == [499]
    assert np.isfinite(window.accelerations["side"].values).all()


@pytest.mark.parametrize("cut", [1, 2])
def test_a_last_row_that_was_cut_off_is_left_out_and_told(bench, capsys, cut):
    """It was left out, and that stood in the recording's notes alone."""
    path = bench.folder / "data.csv"
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines, ",".join(lines[-1].split(",")[:cut])]))
    assert run(["import", str(bench()), "--out", str(bench.folder / "out.mcap")]) == 0
    assert capsys.readouterr().err.count("note: the last row is cut off and left out") == 1
    _, _, (window,) = read_windows(bench.folder / "out.mcap")
    assert window.accelerations["top"].values.size == len(lines) - 1


def test_encoder_edge_times_and_torque_come_through(bench):
    edges = np.arange(2500) / 2560.0 + 0.001
    torque = 10 + np.sin(np.arange(12800))
    np.savez(bench.folder / "data.npz", e=edges, t=torque)
    head = MAPPING[: MAPPING.index("[channels.top]")].replace("data.csv", "data.npz")
    more = '[channels.pinion]\nkind = "encoder"\ncolumn = "e"\nunit = "s"\nedges_per_rev = 256\n'
    path = bench.folder / "e.toml"
    path.write_text(head + more + "first_edge_index = 5120\n")
    import_recording(path, bench.folder / "out.mcap")
    _, _, (window,) = read_windows(bench.folder / "out.mcap")
    found = window.encoders["pinion"]
    assert (found.per_rev, found.first_index, found.times.size) == (256, 5120, 2500)
    assert np.diff(found.times) == pytest.approx(np.diff(edges), abs=1e-9)
    path.write_text(head + '[channels.pinion]\nkind = "torque"\ncolumn = "t"\nunit = "Nm"\n')
    import_recording(path, bench.folder / "out.mcap")


WRONG = [
    (('path = "data.csv"', 'path = "gone.csv"'), "file.path = .*gone.csv does not exist"),
    (
        ('column = "a1"', 'column = "a9"'),
        r"channels.top.column = 'a9' is not in data.csv, which has a1, a2, p",
    ),
    (('unit = "g"', 'unit = "mm"'), r"channels.top.unit = 'mm' must be one of m/s2, g, V, Pa, unknown"),
    (('unit = "g"', 'unit = "V"'), r"channels.top.sensitivity = \(missing\) must be a number \[V per m/s²\]"),
    (('unit = "g"', 'unit = "g"\nsensitivity = 2'), "sensitivity = 2 goes with unit 'V' only"),
    (("sample_rate_hz = 12800", "sample_rate_hz = 0"), "file.sample_rate_hz = 0 Hz is outside"),
    (("sample_rate_hz = 12800", "sample_rate_hz = -12.8"), "file.sample_rate_hz = -12.8 Hz is outside"),
    (("sample_rate_hz = 12800", ""), "no sample rate is known: .* give file.sample_rate_hz, or file.time_column"),
    (("teeth = 20", "teeth = 2"), "rig: gears.pinion.teeth = 2 is outside"),
    (("teeth = 20", "teeth = 20.5"), "rig: gears.pinion.teeth = 20.5 must be a whole number"),
    (
        ("pinion_speed_hz = 25.0", "pinion_speed_hz = 25000.0"),
        "pinion_speed_hz = 25000 Hz is outside .*rev/min",
    ),
    (('accelerometer = "top"', 'accelerometer = "mic"'), "rig.sensors.accelerometer = 'mic' must be one of"),
    (('asset = "bench"', 'asset = "a/b"'), "asset = 'a/b' must be 1 to 64 letters"),
    (('unit = "g"', 'unti = "g"'), "channels.top.unti is not known; known here: kind, column, unit"),
    (('schema = "gear-import/1"', 'schema = "gear-import/9"'), "schema = 'gear-import/9' must be"),
    (
        ('schema = "gear-import/1"', 'schema = ["gear-import/1"]'),
        r"schema = \['gear-import/1'\] must be 'gear-import/1'",
    ),
    (('asset = "bench"', 'asset = "bench"\nnotes = 7'), "notes = 7 must be a list of texts"),
    (('asset = "bench"', 'asset = "bench"\nnotes = "new oil"'), "notes = 'new oil' must be a list of texts"),
    (("started = 2024-05-01T12:00:00Z", 'started = "May"'), "started = 'May' must be a date"),
    (
        ("[channels.top]", "[channels.pinion]\nkind = 'tacho'\n[channels.top]"),
        "kind = 'tacho' must be one of",
    ),
]


@pytest.mark.parametrize(("change", "message"), WRONG)
def test_a_wrong_mapping_is_one_line_that_names_the_key_and_what_would_be_right(bench, change, message):
    with pytest.raises(InputError, match=message) as caught:
        import_recording(bench(change), bench.folder / "out.mcap")
    assert "\n" not in str(caught.value)
    assert not (bench.folder / "out.mcap").exists()


@pytest.mark.parametrize("content", [b"\x1f\x8bbroken", b"a1,a2,p\n1,2,x\n", b"", b"a1,a2,p\n1,2,3\n"])
def test_a_broken_data_file_is_one_line_and_leaves_nothing_behind(bench, content):
    (bench.folder / "data.csv").write_bytes(content)
    with pytest.raises(InputError, match=r"data\.csv") as caught:
        import_recording(bench(), bench.folder / "out.mcap")
    assert "\n" not in str(caught.value)
    assert sorted(p.name for p in bench.folder.iterdir()) == ["data.csv", "mapping.toml"]


def test_a_time_column_taken_for_a_vibration_is_noticed(bench):
    table = signal()
    table[:, 0] = np.arange(len(table)) / RATE
    np.savetxt(bench.folder / "data.csv", table, fmt="%.8f", delimiter=",", header="a1,a2,p", comments="")
    with pytest.raises(InputError, match="only rises"):
        import_recording(bench(), bench.folder / "out.mcap")


def test_series_file_given_as_a_mapping_says_which_command_it_is_for(tmp_path):
    path = tmp_path / "series.toml"
    path.write_text('schema = "gear-series/1"\nasset = "a"\n[levels.fast]\ncolumn = "rms"\n')
    with pytest.raises(InputError, match=r"this file is a series for `gear-twin relate`, not a mapping for"):
        load_import_mapping(path)
