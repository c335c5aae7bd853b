"""Signals by REST: what is known in closed form is where it must be, in every view and format."""

from __future__ import annotations

import csv
import io
import threading

import numpy as np
import pytest
import service_fakes as fakes
from gear_signals import ERROR, MESH, RIG, RUN_OUT, SIDEBAND, SPEED, Z1, Z2, meshing_window
from segments import in_folder, keep
from test_api import Client

from service.api import create_app
from service.signals.subject import Subject
from service.signals.view import Axis, Series, View, ViewOptions, as_json, extremes, peaks, rounded
from service.signals.views import VIEWS
from twin.errors import NotAvailable, ParameterError
from twin.rig import Rig
from twin.windows import Samples, Window

KEPT = (2, 3, 5)
URL = "/v1/assets/unsw/windows/3/signals"
SCALLOPING = 8 / (3 * np.pi)  # least reading of a line of amplitude 1 by a Hann window: at the border of two bins


@pytest.fixture
def client(store, board, tmp_path):
    fakes.campaign(store, board, windows=6)
    store.keep_rig("unsw", RIG)
    board.update("unsw", rig=RIG)
    signals = in_folder(store, tmp_path / "segments")
    for index in KEPT:
        keep(signals, "unsw", index, meshing_window(index), revolutions=100.0 * index)
    return Client(create_app(board, store, signals=signals))


def view(name: str, window: Window | None = None, rig=RIG, **options) -> View:
    subject = Subject(asset="a", index=0, window=window or meshing_window(), rig=Rig.from_mapping(rig))
    return VIEWS[name](subject, ViewOptions(**options))


def at(found: View, x: float, series: int = 0) -> float:
    near = np.abs(found.x.values - x) <= 2 * (found.x.values[1] - found.x.values[0])
    return float(found.series[series].values[near].max())


def reads(value: float, amplitude: float) -> bool:
    return 0.99 * SCALLOPING * amplitude <= value <= 1.01 * amplitude


def test_the_spectrum_shows_mesh_and_sideband_with_their_amplitudes_and_marks_them():
    found = view("spectrum")
    assert reads(at(found, Z1 * SPEED), MESH)
    assert reads(at(found, (Z1 + 1) * SPEED), SIDEBAND)
    assert found.figures["rms"] == pytest.approx(np.hypot(MESH, SIDEBAND) / np.sqrt(2), rel=0.01)
    marked = {m.label: m.x for m in found.markers}
    assert marked["mesh 1×"] == pytest.approx(190.0, rel=1e-4)
    assert marked["mesh 2× + 1 gear"] == pytest.approx(380.0 + 190 / 52, rel=1e-4)
    assert marked["gear 1×"] == pytest.approx(10 * Z1 / Z2, rel=1e-4)
    γ = 0.25
    assert marked["drive end outer race 1×"] == pytest.approx(10 * 8 * (1 - γ) / 2, rel=1e-4)
    assert marked["drive end inner race 2×"] == pytest.approx(2 * 10 * 8 * (1 + γ) / 2, rel=1e-4)
    assert all(m.x <= found.x.values[-1] for m in found.markers)


def test_an_rms_scale_and_an_averaged_spectrum_say_so():
    one, other = view("spectrum"), view("spectrum", rms=True, averaged=True)
    assert at(other, 190.0) == pytest.approx(at(one, 190.0) / np.sqrt(2), rel=0.16)
    assert "15 segments" in " ".join(other.notes) and "RMS amplitudes" in " ".join(other.notes)


def test_the_order_spectrum_of_a_run_up_keeps_its_lines_where_the_spectrum_smears_them():
    window = meshing_window(run_up=0.2)
    found = view("order-spectrum", window)
    assert reads(at(found, Z1), MESH) and reads(at(found, Z1 + 1), SIDEBAND)
    assert view("spectrum", window).series[0].values.max() < 0.3 * MESH


def test_transmission_error_has_its_lines_its_mean_removed_and_micrometres():
    found = view("order-spectrum", channel="transmission-error")
    assert found.series[0].unit == "µm"
    assert reads(at(found, Z1), ERROR * 1e6) and reads(at(found, Z1 / Z2), RUN_OUT * 1e6)
    wave = view("transmission-error")
    values = wave.series[0].values
    assert abs(np.nanmean(values)) < 1e-6
    assert np.nanstd(values) == pytest.approx(1e6 * np.hypot(ERROR, RUN_OUT) / np.sqrt(2), rel=0.1)
    assert view("waveform", channel="transmission-error").view == "transmission-error"


def test_without_a_base_radius_transmission_error_is_an_angle():
    rig = {**RIG, "gears": {"pinion": {"teeth": Z1}, "gear": {"teeth": Z2}}}
    found = view("order-spectrum", rig=rig, channel="transmission-error")
    assert found.series[0].unit == "mrad"
    assert reads(at(found, Z1 / Z2), 1e3 * RUN_OUT / 0.03)


@pytest.mark.parametrize("shaft", ["pinion", "gear"])
def test_the_synchronous_average_is_the_pattern_of_a_turn(shaft):
    found = view("synchronous-average", shaft=shaft)
    assert found.x.values[0] == 0 and found.x.values[-1] < 360
    θ = np.radians(found.x.values) * (1 if shaft == "pinion" else Z2 / Z1)
    expected = MESH * np.cos(Z1 * θ + 0.3) + (SIDEBAND * np.cos((Z1 + 1) * θ) if shaft == "pinion" else 0)
    limit = 0.02 if shaft == "pinion" else 0.5  # the pinion's sideband does not repeat with the gear
    assert np.abs(found.series[0].values - expected).max() < limit * MESH
    assert found.series[-1].name == "without mesh and first sidebands"


def test_the_envelope_spectrum_of_a_modulated_carrier_shows_its_rate():
    t = np.arange(38_400) / 6400
    values = (1 + 0.5 * np.cos(2 * np.pi * 31.0 * t)) * np.cos(2 * np.pi * 1500 * t)
    values += 0.01 * np.random.default_rng(1).standard_normal(t.size)
    window = Window(start_time_ns=0, accelerations={"a": Samples(rate=6400.0, start=0.0, values=values)})
    found = view("envelope-spectrum", window, rig={}, band=(1200.0, 1800.0))
    assert found.x.unit == "Hz"
    assert at(found, 31.0) == pytest.approx(2 * 0.5 / (1 + 0.125), rel=0.16)
    assert found.x.values[np.argmax(found.series[0].values)] == pytest.approx(31.0, abs=0.2)


def test_the_waveform_of_an_encoder_is_its_shafts_speed():
    found = view("waveform", channel="encoder/pinion")
    assert found.series[0].unit == "Hz"
    assert found.series[0].values.mean() == pytest.approx(SPEED, rel=1e-3)


def test_a_machine_of_which_nothing_is_known_still_has_waveform_and_spectrum():
    window = meshing_window(encoders={}, torques={})
    assert view("waveform", window, rig={}).series[0].values.size
    assert view("spectrum", window, rig={}).markers == ()
    with pytest.raises(NotAvailable, match="shaft angle is not known"):
        view("order-spectrum", window, rig={})
    with pytest.raises(NotAvailable, match="no encoder on the pinion and the gear"):
        view("transmission-error", window)
    with pytest.raises(NotAvailable, match="worn flank is not available: it is drawn from the model"):
        view("flank", window)


def test_bearings_that_cannot_be_are_refused_with_a_likely_cause():
    bearing = {**RIG["rolling_bearings"][0], "rolling_elements": 40}
    with pytest.raises(ParameterError, match="do not fit on a pitch circle"):
        Rig.from_mapping({"rolling_bearings": [bearing]})
    with pytest.raises(ParameterError, match="lacks pitch_diameter"):
        Rig.from_mapping({"rolling_bearings": [{k: v for k, v in bearing.items() if k != "pitch_diameter"}]})
    with pytest.raises(ParameterError, match="must be a list of tables"):
        Rig.from_mapping({"rolling_bearings": 8})


# -- thinning -------------------------------------------------------------------------------------------------


def drawn(values, thinned="extremes") -> View:
    values = np.asarray(values, dtype=float)
    x = Axis(label="time", unit="s", values=np.arange(values.size) / 10)
    series = (Series(name="measured", unit="m/s²", values=values),)
    return View(view="waveform", channel="a", title="", x=x, series=series, thinned=thinned)


def test_thinning_keeps_every_spike_and_the_ends():
    values = np.zeros(100_001)
    values[54_321], values[54_322] = 9.0, -7.0
    kept = extremes(values, 500)
    assert {0, 54_321, 54_322, 100_000} <= set(kept.tolist()) and kept.size <= 510
    assert np.all(np.diff(kept) > 0)
    assert 54_321 in peaks(values, 500) and peaks(values, 500).size <= 500


def test_an_excerpt_is_shown_in_full_where_it_has_few_points():
    content = as_json(drawn(np.arange(1000.0)), 100, 10.0, 11.0)
    assert content["series"][0]["values"] == [float(v) for v in range(99, 112)]
    assert content["series"][0]["points_total"] == 13
    assert len(as_json(drawn(np.arange(1000.0)), 100)["x"]["values"]) <= 110


def test_numbers_are_rounded_to_significant_digits_and_missing_ones_are_null():
    values = [123456.789, -1.23456789e-9, 0.0, np.nan, np.inf, 5e-324]
    assert rounded(np.array(values), 4) == [123500.0, -1.235e-09, 0.0, None, None, 5e-324]


# -- REST -----------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_what_is_kept_is_listed(client):
    found = client.get("/v1/assets/unsw/signals").json()
    assert [w["index"] for w in found["windows"]] == list(KEPT)
    assert found["channels"] == ["accel/y6", "torque/pinion", "encoder/gear", "encoder/pinion", "transmission-error"]
    assert found["views"] == list(VIEWS) and found["reason"] is None
    assert found["bytes"] == sum(w["bytes"] for w in found["windows"]) > 0


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in VIEWS if name != "flank"])
def test_each_view_is_json_csv_and_a_picture(client, name):
    found = client.get(f"{URL}/{name}?points=500").json()
    assert (found["asset"], found["window"], found["view"]) == ("unsw", 3, name)
    measured = found["series"][0]
    assert measured["name"] == "measured"
    assert len(measured["values"]) == len(found["x"]["values"]) <= 520
    answer = client.get(f"{URL}/{name}?format=csv")
    assert answer.headers["content-type"].startswith("text/csv")
    head, *rows = csv.reader(io.StringIO(answer.text))
    assert len(rows) == measured["points_total"] and len(head) == len(rows[0])
    for theme in ("light", "dark"):
        picture = client.get(f"{URL}/{name}?format=png&theme={theme}")
        assert picture.headers["content-type"] == "image/png" and picture.content.startswith(b"\x89PNG")


def test_a_machine_without_a_model_says_what_its_rig_file_lacks(client):
    notes = client.get(f"{URL}/spectrum").json()["notes"]
    assert any(n.startswith("Not modelled: a model of this machine is not available: the rig file") for n in notes)
    assert not any("odelled" in n for n in client.get(f"{URL}/spectrum?modelled=false").json()["notes"])


def test_csv_holds_every_sample_as_it_was(client):
    _, *rows = csv.reader(io.StringIO(client.get(f"{URL}/waveform?format=csv").text))
    values = np.array(rows, dtype=float)
    np.testing.assert_allclose(values[:, 1], meshing_window(3).accelerations["y6"].values.astype(np.float32), rtol=1e-8)


def test_what_cannot_be_shown_says_why(client):
    answer = client.get("/v1/assets/unsw/windows/4/signals/spectrum")
    assert answer.status_code == 404 and answer.json()["kept"] == list(KEPT)
    assert "the raw signals of window 4 are not kept; kept are 2, 3, 5" in answer.json()["detail"]
    answer = client.get(f"{URL}/spectrum?channel=accel/zz")
    assert answer.status_code == 404 and "accel/y6" in answer.json()["channels"]
    assert client.get(f"{URL}/nonsense").status_code == 422
    assert client.get(f"{URL}/spectrum?points=1").status_code == 422
    assert client.get(f"{URL}/envelope-spectrum?band_low_hz=100").status_code == 422
    answer = client.get(f"{URL}/spectrum?channel=encoder/pinion")
    assert answer.status_code == 409 and "order spectrum" in answer.json()["detail"]
    assert client.get("/v1/assets/nobody/signals").status_code == 404


def test_a_service_that_keeps_no_signals_says_so(store, board):
    fakes.campaign(store, board)
    client = Client(create_app(board, store))
    assert client.get("/v1/assets/unsw/signals").json()["reason"] == "this service keeps no raw signals"
    assert client.get(f"{URL}/spectrum").status_code == 404
    assert client.get("/v1/assets/unsw/waterfall").status_code == 404


def test_the_waterfall_has_one_row_a_window_with_the_mesh_line_in_each(client):
    found = client.get("/v1/assets/unsw/waterfall?bins=320&x_to=320").json()
    assert [w["index"] for w in found["windows"]] == list(KEPT)
    values, x = np.array(found["values"]), np.array(found["x"]["values"])
    assert values.shape == (3, 320)
    for row in values:
        assert abs(x[row.argmax()] - 190.0) <= 1.0 and reads(row.max(), MESH)
    orders = client.get("/v1/assets/unsw/waterfall?view=order-spectrum&windows=2").json()
    assert [w["index"] for w in orders["windows"]] == [2, 5]
    head, *rows = csv.reader(io.StringIO(client.get("/v1/assets/unsw/waterfall?format=csv").text))
    assert len(head) == 4 and len(rows) == 400
    assert client.get("/v1/assets/unsw/waterfall?format=png").content.startswith(b"\x89PNG")
    assert client.get("/v1/assets/unsw/waterfall?channel=accel/none").status_code == 409


def test_windows_of_different_speed_share_no_marker_in_hertz(store, board, tmp_path):
    fakes.campaign(store, board, windows=3)
    board.update("unsw", rig=RIG)
    signals = in_folder(store, tmp_path / "segments")
    keep(signals, "unsw", 0, meshing_window(0))
    keep(signals, "unsw", 1, meshing_window(1, run_up=0.3))
    client = Client(create_app(board, store, signals=signals))
    found = client.get("/v1/assets/unsw/waterfall").json()
    assert found["markers"] == [] and "speed differs" in " ".join(found["notes"])
    assert client.get("/v1/assets/unsw/waterfall?view=order-spectrum").json()["markers"]


def test_indicators_are_curves_over_all_windows_kept_or_not(client, store, board):
    fakes.take(store, board, "unsw", 6, 5000.0)
    found = client.get("/v1/assets/unsw/indicators").json()
    assert found["index"] == list(range(7))
    by_name = {q["name"]: q for q in found["quantities"]}
    assert all(len(q["values"]) == 7 for q in found["quantities"])
    assert by_name["rms_measured"]["unit"] == "m/s²"
    assert client.get("/v1/assets/unsw/indicators?quantity=speed_hz").json()["quantities"][0]["label"] == "Pinion speed"
    answer = client.get("/v1/assets/unsw/indicators?quantity=nonsense")
    assert answer.status_code == 404 and "rms_measured" in answer.json()["quantities"]
    head, *rows = csv.reader(io.StringIO(client.get("/v1/assets/unsw/indicators?format=csv").text))
    assert head[:3] == ["index", "start_time", "revolutions"] and len(rows) == 7
    for axis in ("revolutions", "time", "index"):
        picture = client.get(f"/v1/assets/unsw/indicators?format=png&axis={axis}&quantity=rms_measured")
        assert picture.content.startswith(b"\x89PNG")


def test_condition_indicators_of_each_gear_are_quantities(client, store, board):
    gear = {"turns": 30, "fm0": 1.5, "fm4": 3.2, "na4": None}
    entry = fakes.record(6, 5000.0) | {
        "quality": "good", "faults": [],
        "indicators": {"y6": {"rms": 5.0, "kurtosis": 3.3, "crest_factor": 4.0, "gears": {"pinion": gear}}},
        "mesh_bands": [1.0, 2.0], "temperatures": {"oil": {"value": 61.0, "unit": "°C", "values": 3, "age_s": 0.1}},
    }  # fmt: skip
    store.commit(
        "unsw", fakes.START_NS + 10**15, record=entry, state={}, report=fakes.report(1, 1), 
        received_ns=1,
    )  # fmt: skip
    by_name = {q["name"]: q for q in client.get("/v1/assets/unsw/indicators").json()["quantities"]}
    assert by_name["y6/pinion/fm4"]["values"][-1] == 3.2 and by_name["y6/pinion/fm4"]["values"][0] is None
    assert "y6/pinion/na4" not in by_name
    assert by_name["mesh_band_2"]["values"][-1] == 2.0
    assert (by_name["temperature/oil"]["unit"], by_name["temperature/oil"]["values"][-1]) == ("°C", 61.0)


def test_many_at_once_get_the_same(client):
    found: list[dict] = []
    threads = [
        threading.Thread(target=lambda: found.append(client.get(f"{URL}/order-spectrum").json())) for _ in range(4)
    ]
    for t in threads:
        t.start()
    for t in threads:
        t.join()
    assert len(found) == 4 and all(f == found[0] for f in found)
