"""Features of the reference campaigns and measured sets, against their stated truth.

Only what a feature itself claims: nothing here is fitted to these recordings.
"""

import gzip
import json
from pathlib import Path

import numpy as np
import pytest

from service.files.import_recording import import_recording
from service.stream.sources.mcap import read_windows
from twin.errors import NotAvailable
from twin.features.extract import extract
from twin.features.level import band_rms
from twin.features.mesh_speed import mesh_speed
from twin.rig import Rig

pytestmark = pytest.mark.shared
MAPPINGS = Path(__file__).resolve().parents[2] / "recordings" / "mappings"


def campaign(shared, name):
    """Features of a campaign's windows and the truth of each."""
    rig, _, windows = read_windows(shared / "campaigns" / f"{name}.mcap")
    truth = json.loads((shared / "campaigns" / "truth" / f"{name}.json").read_text())["windows"]
    assert len(windows) == len(truth)
    return [extract(Rig.from_mapping(rig), w) for w in windows], truth


@pytest.mark.slow
@pytest.mark.parametrize("name", ["D00", "D09", "D10"])
def test_speed_and_revolutions_are_those_of_the_machine(shared, name):
    for found, true in zip(*campaign(shared, name), strict=True):
        assert found.speed_hz == pytest.approx(true["speed_hz"], abs=1e-3)
        assert found.revolutions == pytest.approx(true["revolutions"], abs=2e-3)


def test_rms_up_to_half_the_sampling_rate_is_that_of_the_record(shared):
    _, _, windows = read_windows(shared / "campaigns" / "D00.mcap")
    truth = json.loads((shared / "campaigns" / "truth" / "D00.json").read_text())["windows"]
    for window, true in zip(windows, truth, strict=True):
        rms = band_rms(window.accelerations["y6"], (0.0, 6400.0))
        assert rms == pytest.approx(true["rms_recorded"], rel=0.01)  # the ends are tapered


def worn(features, truth):
    pairs = [(f, t) for f, t in zip(features, truth, strict=True) if t["kind"] == "wear"]
    depth = np.array([t["depth"]["combined_um"] for _, t in pairs]) * 1e-6
    return [f for f, _ in pairs], depth


@pytest.mark.slow
@pytest.mark.parametrize("name", ["D00", "D09"])
def test_transmission_error_at_the_mesh_order_grows_in_proportion_to_the_wear(shared, name):
    features, depth = worn(*campaign(shared, name))
    line = np.array([f.transmission_error.get(1) for f in features])
    growth = np.abs(line - line[0])[1:] / depth[1:]
    assert growth == pytest.approx(np.full(growth.size, 0.38), rel=0.05)
    assert np.angle((line - line[0])[1:]) == pytest.approx(np.full(growth.size, np.angle(line[-1])), abs=0.03)


def test_mean_transmission_error_is_a_wear_gauge(shared):
    features, depth = worn(*campaign(shared, "D00"))
    mean = np.array([f.transmission_error.get(0).real for f in features])
    torque = np.array([f.torque_nm for f in features])
    gauge = mean - 8.5e-6 * torque  # the shafts' and teeth's compliance, from the two torques at 2 Hz
    slope = np.polyfit(depth, gauge - gauge[0], 1)[0]
    assert slope == pytest.approx(0.67, rel=0.03)


def test_gear_eccentricity_stands_at_the_gear_order(shared):
    features, _ = campaign(shared, "D04")
    assert [abs(f.transmission_error.get(0, 0, 1)) for f in features] == pytest.approx([90e-6] * 8, rel=0.02)


def test_without_the_gear_encoder_nothing_is_invented(shared):
    features, _ = campaign(shared, "D12")
    for found in features:
        assert found.transmission_error is None and "gear" in found.unavailable["transmission_error"]
        assert found.speed_hz and found.rms and found.acceleration


@pytest.mark.slow
def test_lost_frames_show_in_the_valid_share_and_do_not_move_the_level(shared):
    features, truth = campaign(shared, "D01")
    holed = [(f, t) for f, t in zip(features, truth, strict=True) if f.valid_share["accel/y6"] < 1]
    assert holed
    for found, true in holed:
        assert found.rms == pytest.approx(np.hypot(true["rms_true_2k"], true["noise_rms_2k"]), rel=0.03)


def imported(shared, tmp_path, mapping, source):
    out = tmp_path / "imported.mcap"
    import_recording(MAPPINGS / f"{mapping}.toml", out, source=shared / "measured" / mapping / source)
    rig, _, (window,) = read_windows(out)
    return Rig.from_mapping(rig), window


@pytest.mark.slow
def test_measured_rig_of_28_channels_turns_as_its_readme_says(shared, tmp_path):
    rig, window = imported(shared, tmp_path, "spur-rig-28ch-2000rpm", "channels.npz")
    found = extract(rig, window)
    assert found.speed_hz == pytest.approx(33.330, rel=1e-3)
    assert found.speed_hz * 23 == pytest.approx(766.60, rel=1e-3)
    assert found.sensor == "ch14"
    # README: 7.2 and 16.4 m/s² by a plain Hann spectrum over the whole record, which smears and reads low
    lines = np.abs(found.acceleration.mesh()[1])
    assert lines[0] == pytest.approx(7.2, rel=0.15) and lines[1] > 16.4
    # and 0.49, 0.41, 0.93, 0.37 for the sidebands at -1, +1 pinion order and -1, +1 gear order
    sides = [found.acceleration.get(1, p, g) for p, g in ((-1, 0), (1, 0), (0, -1), (0, 1))]
    assert np.abs(sides) == pytest.approx([0.49, 0.41, 0.93, 0.37], rel=0.25)
    assert all(found.mesh_bands) and found.rms > 0
    assert found.revolutions is None and found.transmission_error is None


@pytest.mark.slow
@pytest.mark.parametrize("file", ["h30hz0", "b30hz0"])
def test_measured_gearbox_without_load_turns_as_its_readme_says(shared, tmp_path, file):
    rig, window = imported(shared, tmp_path, "spectraquest-broken-tooth", f"{file}.csv.gz")
    found = extract(rig, window)
    assert found.speed_hz * 32 / 12800 == pytest.approx(0.07438, rel=1e-3)
    text = gzip.decompress((shared / f"measured/spectraquest-broken-tooth/{file}.csv.gz").read_bytes())
    values = np.loadtxt(text.decode().splitlines(), delimiter=",", skiprows=1)
    assert window.accelerations["a2"].values == pytest.approx(values[:, 1], rel=1e-6)
    assert all(found.mesh_bands) and found.rms > 0


@pytest.mark.slow
def test_measured_gearbox_slips_more_under_load(shared, tmp_path):
    speeds = []
    for load in (0, 40, 80):
        rig, window = imported(shared, tmp_path, "spectraquest-broken-tooth", f"h30hz{load}.csv.gz")
        speeds.append(extract(rig, window).speed_hz)
    assert speeds[0] > speeds[1] > speeds[2]
    assert speeds[2] == pytest.approx(29.62, rel=1e-3)


@pytest.mark.slow
def test_other_tooth_counts_do_not_hold_on_measured_records(shared, tmp_path):
    for mapping, source, wrong in (
        ("spur-rig-28ch-2000rpm", "channels.npz", [(22, 44), (24, 48), (19, 40)]),
        ("spectraquest-broken-tooth", "b30hz80.csv.gz", [(31, 80), (33, 80), (29, 72)]),
    ):
        rig, window = imported(shared, tmp_path, mapping, source)
        for teeth in wrong:
            with pytest.raises(NotAvailable, match="wrong tooth count"):
                mesh_speed(window.accelerations, teeth, rig.get("operating.pinion_speed_hz"))
