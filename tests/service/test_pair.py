"""A pair of two encoders alone, from sampled levels to answers: import, assess, diagnose, REST."""

import json

import numpy as np
import pytest

from service.cli import run
from service.contract.answer import Asset
from service.contract.parts import EncoderPair
from service.errors import InputError
from service.files.import_recording import import_recording
from service.report.lines import pair_sentences
from service.report.plots import pair_plots
from service.runtime.assess import assess
from service.stream.sources.mcap import Recording, read_windows
from tests.claims.test_encoder_pair import PER_TURN, RATE, counts, levels, marked
from twin.encoder_pair.assessing import assess_pair
from twin.encoder_pair.motion import forward_edges
from twin.rig import Rig
from twin.windows import Window

MAPPING = """
schema = "gear-import/1"
asset = "two-encoders"
started = 2026-03-12T08:14:00Z
[file]
path = "levels.npz"
sample_rate_hz = {rate}
[channels.pinion]
kind = "encoder"
unit = "quadrature"
columns = ["a1", "b1"]
edges_per_rev = "per_turn"
[channels.gear]
kind = "encoder"
unit = "quadrature"
columns = ["a2", "b2"]
edges_per_rev = {per_turn}
first_edge_index = 40
[rig]
{rig}
"""


def imported(folder, first, second, rate=RATE, per_turn=PER_TURN, rig="", change=("", "")):
    """A recording of two encoders by their counts at every sample; with what the import said."""
    (a1, b1), (a2, b2) = levels(first), levels(second)
    np.savez(folder / "levels.npz", a1=a1, b1=b1, a2=a2, b2=b2, per_turn=per_turn, volts=2.4 * a1)
    text = MAPPING.format(rate=rate, per_turn=per_turn, rig=rig)
    assert change[0] in text
    (folder / "mapping.toml").write_text(text.replace(*change))
    return folder / "pair.mcap", import_recording(folder / "mapping.toml", folder / "pair.mcap")


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    return imported(tmp_path_factory.mktemp("pair"), *counts(1))[0]


def test_levels_become_edges_that_rise_with_reversals_and_missed_counts_said(tmp_path):
    still, turning = np.zeros(700, int), np.repeat(np.arange(200), 10)
    back = turning.copy()
    back[1000:] -= np.minimum(np.arange(1000) // 5, 5)  # five counts are taken back while five go on
    back[1500] = back[1499] = back[1498]
    first = np.concatenate((still, back, np.full(300, back[-1])))
    jump = turning // 2
    jump[jump >= 60] += 1  # a count between two samples that nobody saw
    second = -np.concatenate((still, jump, np.full(300, jump[-1])))
    path, found = imported(tmp_path, first, second, rate=1000.0, per_turn=64)
    _, _, (window,) = read_windows(path)
    assert window.accelerations == {} and window.quality == "good"
    pinion, gear = (window.encoders[s] for s in ("pinion", "gear"))
    assert (pinion.first_index, gear.first_index, pinion.per_rev) == (0, 40, 64)
    assert pinion.times.size == back[-1] and gear.times.size == jump[-1]
    for shaft, n in ((pinion, first), (gear, second)):
        assert np.all(np.diff(shaft.times) > 0)
        assert shaft.times == pytest.approx(forward_edges(n, 1000.0).times, abs=1e-9)
    assert pinion.times[0] == pytest.approx(0.7095)
    assert found["encoders"]["encoder/pinion"]["reversals"] > 0 and found["encoders"]["encoder/gear"]["reversals"] == 0
    assert found["encoders"]["encoder/pinion"]["counts_taken_back"] > 0
    assert found["encoders"]["encoder/gear"]["illegal_transitions"] == 1
    assert "1 illegal transitions, in which both levels changed: 1 counted as two" in found["notes"]["encoder/gear"]
    assert "opposite senses" in found["notes"]["senses"]


def test_a_standstill_is_written_as_frames_without_an_edge(pair):
    with Recording(pair) as recording:
        frames = [f for f in recording.frames(lambda *_: None) if f.channel.name == "gear"]
    assert [f.sequence for f in frames] == list(range(12))  # 6 s in half seconds
    assert frames[0].edge_offsets_ns.size == frames[-1].edge_offsets_ns.size == 0
    assert [f.first_edge_index for f in frames] == sorted(f.first_edge_index for f in frames)


def test_the_pair_is_answered_and_wear_is_not(pair):
    answer = assess(pair)
    found = answer["pair"]
    assert found["ratio"]["value"] == pytest.approx(31 / 16, abs=3 * found["ratio"]["std"])
    assert "31/16" in found["teeth_that_fit"] and found["stated"] is None
    sizes = {(t["shaft"], t["multiple"]): t for t in found["run_out"]}
    assert sizes["gear", 1]["amplitude_urad"] == pytest.approx(20000, abs=3 * sizes["gear", 1]["std_urad"] + 200)
    assert (
        sizes["gear", 1]["amplitude_um"] is None and "its encoder's disc" in sizes["gear", 1]["indistinguishable_from"]
    )
    assert found["rest_urad"]["after"] < 0.3 * found["rest_urad"]["before"]
    (window,) = answer["windows"]
    assert window["quality"] == "good" and window["speed_hz"] == pytest.approx(found["speed_hz"]["mean"])
    assert window["rms_measured"] is None and window["mesh_frequency_hz"] is None
    for part in ("wear", "rul", "residual"):
        assert answer[part]["status"] == "not available" and "the rig file does not give" in answer[part]["reason"]
    assert answer["effects"] == [] and answer["unexplained"]["verdict"] == "insufficient_data"
    assert isinstance(Asset.model_validate(answer).pair, EncoderPair)


TEETH = """
[rig.gears]
module = 0.002
pressure_angle_deg = 20.0
[rig.gears.pinion]
teeth = {}
[rig.gears.gear]
teeth = {}
"""


@pytest.mark.parametrize(("teeth", "contradicted"), [((16, 31), False), ((15, 30), True)])
def test_stated_teeth_are_held_beside_the_ratio_and_give_micrometres(tmp_path, teeth, contradicted):
    path, _ = imported(tmp_path, *counts(1), rig=TEETH.format(*teeth))
    answer = assess(path)
    found = answer["pair"]
    assert (f"contradicts {teeth[1]}/{teeth[0]} teeth" in answer["windows"][0]["notes"][-1]) is contradicted
    assert (
        found["stated"]["contradicted"] is contradicted and found["stated"]["source"] == f"{teeth[1]}/{teeth[0]} teeth"
    )
    assert found["base_radii"]["assumed"] is False
    radius = 1e-3 * teeth[0] * np.cos(np.radians(20))
    term = found["run_out"][0]
    assert term["amplitude_um"] == pytest.approx(term["amplitude_urad"] * radius)


def test_diagnose_tells_the_pair_in_words_figures_and_json(pair, tmp_path, capsys):
    given = ["--out", str(tmp_path / "d.html"), "--json", str(tmp_path / "d.json"), "--base-radii-mm", "15", "30"]
    assert run(["diagnose", str(pair), *given]) == 0
    said = capsys.readouterr().out
    assert "turns of the pinion for one of the gear" in said and "µm on an assumed base radius of 30 mm" in said
    assert "indistinguishable from that of its encoder's disc" in said
    html = (tmp_path / "d.html").read_text()
    assert html.count("plotly-graph-div") == 3 and "Transmission error from the two encoders" in html
    found = json.loads((tmp_path / "d.json").read_text())["pair"]
    assert found["base_radii"] == {"pinion_mm": 15.0, "gear_mm": 30.0, "assumed": True}
    assert found["stated"]["contradicted"] is True
    speed = found["speed"]
    assert speed["pinion_hz"][0] == 0 and max(speed["pinion_hz"]) == pytest.approx(1.4, rel=0.05)
    assert run(["report", str(tmp_path / "d.json")]) == 0
    assert "turns of the pinion for one of the gear" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("what", "said", "drawn"),
    [
        ({"counts": 15}, "of the gear's turn, in each of 4 turns", "counts each turn of the gear"),
        ({"counts": 0, "angle": 1.75}, "Counts were missed at", "-30 counts"),
    ],
)
def test_sharp_steps_are_told_and_drawn(what, said, drawn):
    pinion, gear = marked(7, **what)
    window = Window(start_time_ns=1, encoders={"pinion": pinion, "gear": gear})
    section = EncoderPair.of(assess_pair(Rig.from_mapping({}), window, 0)).as_json()
    assert said in "\n".join(pair_sentences(section))
    (mark,) = pair_plots(section)[0].layout.annotations
    assert drawn in mark.text


def test_a_wheel_that_hardly_turns_gives_no_ratio_and_says_why(tmp_path):
    turning = np.repeat(np.arange(16000), 2)
    path, _ = imported(tmp_path, turning, -turning // 16)
    answer = assess(path)
    assert answer["pair"]["status"] == "not available" and "do not determine a ratio" in answer["pair"]["reason"]
    path, _ = imported(tmp_path, turning[:16000], -turning[:16000] // 16)
    with pytest.raises(InputError, match=r"no window of 1 can be used.* turn 2\.00 and 0\.12 times do not"):
        assess(path)


def test_assumed_radii_are_refused_where_there_is_nothing_to_give_in_micrometres(pair, tmp_path, capsys):
    assert run(["diagnose", str(pair), "--base-radii-mm", "0.015", "0.03"]) == 2
    assert "0.015 mm of the pinion is outside" in capsys.readouterr().err
    known, _ = imported(tmp_path, *counts(1), rig=TEETH.format(16, 31))
    assert run(["diagnose", str(known), "--base-radii-mm", "15", "30"]) == 2
    assert "the rig file gives" in capsys.readouterr().err


def test_a_baseline_is_refused_where_no_tooth_counts_are_known(pair, tmp_path, capsys):
    assert run(["baseline", str(pair), "--out", str(tmp_path / "b")]) == 2
    assert "a baseline needs the tooth counts of the pair" in capsys.readouterr().err


def test_levels_of_a_csv_file_are_read_alike(tmp_path):
    turning = np.repeat(np.arange(800), 2)
    npz, _ = imported(tmp_path, turning, -turning, change=('"per_turn"', "4000"))
    known = read_windows(npz)[2][0].encoders["gear"].times
    table = np.stack([*levels(turning), *levels(-turning)], axis=1)
    np.savetxt(tmp_path / "levels.csv", table, fmt="%d", delimiter=",", header="a1,b1,a2,b2", comments="")
    import_recording(tmp_path / "mapping.toml", tmp_path / "csv.mcap", source=tmp_path / "levels.csv")
    assert np.array_equal(read_windows(tmp_path / "csv.mcap")[2][0].encoders["gear"].times, known)


WRONG = [
    (('["a1", "b1"]', '["a1"]'), r"channels.pinion.columns = \['a1'\] must name two columns"),
    (('["a1", "b1"]', '["a1", "a1"]'), "must name two columns"),
    (('columns = ["a1", "b1"]', 'column = "a1"'), r"channels.pinion.columns = \(missing\) must name the two levels"),
    (('["a1", "b1"]', '["a1", "b9"]'), "channels.pinion.columns = 'b9' is not in levels.npz"),
    (('["a1", "b1"]', '["volts", "b1"]'), r"must hold levels 0 and 1, and goes from 0 to 2\.4"),
    (('["a1", "b1"]', '["per_turn", "b1"]'), "is a single number and must be a row of numbers"),
    (('"per_turn"', '"counts"'), "edges_per_rev = 'counts' is no single number of levels.npz"),
    (('"per_turn"', "12.5"), "edges_per_rev = 12.5 must be a whole number"),
    (('unit = "quadrature"\ncolumns = ["a1", "b1"]', 'unit = "s"\ncolumn = "a1"'), "must hold rising edge times"),
    (('unit = "quadrature"', 'unit = "s"'), "columns = .* goes with unit 'quadrature' only"),
]


@pytest.mark.parametrize(("change", "message"), WRONG)
def test_a_wrong_mapping_of_a_quadrature_encoder_is_one_line(tmp_path, change, message):
    turning = np.repeat(np.arange(800), 2)
    with pytest.raises(InputError, match=message) as caught:
        imported(tmp_path, turning, -turning, change=change)
    assert "\n" not in str(caught.value)


def test_an_encoder_that_ends_where_it_began_has_no_forward_sense(tmp_path):
    swing = np.concatenate((np.arange(50), np.arange(50)[::-1]))
    with pytest.raises(InputError, match=r"channels.pinion: .* no forward sense"):
        imported(tmp_path, swing, np.arange(100))
