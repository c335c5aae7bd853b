"""Measured machines of which little is known: what is found in them, and what is not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from service.errors import InputError
from service.files.baseline import compared, learned, lines_of_no_shaft, load
from service.files.import_recording import import_recording
from service.files.relation import answer, tried_on
from service.files.series import load_series
from tests.rules import shared_folder
from twin.baseline.comparison import compare_with_baseline, described, pair_shafts, tracked
from twin.baseline.spacing import unattributed_spacings
from twin.baseline.spacing_search import SpacingSearchThresholds, search, spectra
from twin.levels.relation import CASES
from twin.levels.trials import LEAST_GAIN

CAGE = 0.39602  # third of the order of the 28-channel rig's modulation
ROOT = Path(__file__).parents[2]
MEASURED = shared_folder() / "measured"
MAPPINGS = ROOT / "recordings" / "mappings"
needs = pytest.mark.shared


@pytest.fixture(scope="module")
def brought(tmp_path_factory):
    folder = tmp_path_factory.mktemp("measured")

    def one(name, source):
        out = folder / f"{source.split('.')[0]}.mcap"
        import_recording(MAPPINGS / f"{name}.toml", out, source=MEASURED / name / source)
        return out

    return one


@needs
@pytest.mark.slow
def test_broken_tooth_is_traced_to_its_shaft_and_the_healthy_load_left_out_has_nothing(brought):
    def file(state, percent):
        return brought("spectraquest-broken-tooth", f"{state}30hz{percent}.csv.gz")

    baseline = learned([file("h", percent) for percent in (0, 20, 30, 60, 70)])
    assert [float(s) for s in baseline.shafts] == [1.0, 0.4, 0.15]
    _, well = compared(baseline, file("h", 40))
    assert well.effects == () and well.unexplained.verdict == "explained"
    _, broken = compared(baseline, file("b", 40))
    assert not [e for e in broken.effects if e.name == "tooth_crack"]  # not what these data decide
    (local,) = [e for e in broken.effects if "shaft_order" in e.parameters]
    assert local.name == "unknown_effect" and local.parameters["shaft_order"].value == pytest.approx(0.15)
    assert local.channels == ("a4",) and local.evidence.log_evidence > 100
    alike = local.evidence.indistinguishable_from
    assert "tooth_crack" in alike and any("low-frequency response of a4" in said for said in alike)
    assert broken.unexplained.verdict == "unknown_effect" and "was the machine reassembled" in broken.unexplained.reason
    moved = {e.channels[0]: e.parameters["frequency"].value for e in broken.effects if e.name == "sensor_resonance"}
    assert set(moved) == {"a1", "a2", "a3"} and moved["a1"] == pytest.approx(1200, rel=0.15)
    for channel in moved:
        errors = broken.residual.channels[channel]
        assert abs(errors.rms_after) < 0.1 and errors.waveform_after < 0.8 * errors.waveform_before


@needs
@pytest.mark.slow
@pytest.mark.parametrize(("state", "percent"), [("h", 0), ("h", 30), ("h", 70), ("b", 0), ("b", 30), ("b", 70)])
def test_halves_of_a_recording_and_one_just_beyond_the_learned_range_have_the_verdict_of_the_whole(
    brought, state, percent
):
    """Load 0 lies 9 % of the learned range beyond it, where it is left out."""
    name = "spectraquest-broken-tooth"
    known = learned([brought(name, f"h30hz{p}.csv.gz") for p in (0, 20, 30, 40, 60, 70, 80) if p != percent])
    loaded = load(brought(name, f"{state}30hz{percent}.csv.gz"), shafts=known.shafts)
    whole = loaded.windows[0].window
    for low, high in ((0.0, 1.0), (0.0, 0.5), (0.5, 1.0)):
        found = compare_with_baseline(
            known, loaded.rig, [tracked(known.rig, part(whole, low, high), "part", known.shafts)]
        )
        if state == "h":
            assert found.effects == () and found.unexplained.verdict == "explained"
            continue
        assert found.unexplained.verdict == "unknown_effect"
        (local,) = [e for e in found.effects if "shaft_order" in e.parameters]
        assert local.name == "unknown_effect" and local.channels == ("a4",)
        assert local.parameters["shaft_order"].value == pytest.approx(0.15)
        assert not {e.name for e in found.effects} - {"unknown_effect", "sensor_resonance"}


def part(window, low, high):
    """The accelerations of a stretch of a window, from and to a share of it."""
    samples = {}
    for name, x in window.accelerations.items():
        i, j = (int(share * x.values.size) for share in (low, high))
        samples[name] = replace(x, start=x.start + i / x.rate, values=x.values[i:j])
    return replace(window, accelerations=samples)


@pytest.mark.slow
@needs
def test_baseline_of_four_healthy_recordings_says_that_it_cannot_judge_teeth_and_is_never_explained(brought):
    def file(state, percent):
        return brought("spectraquest-broken-tooth", f"{state}30hz{percent}.csv.gz")

    baseline = learned([file("h", percent) for percent in (0, 20, 30, 40)])
    _, broken = compared(baseline, file("b", 20))
    assert broken.unexplained.verdict == "insufficient_data" and broken.effects == ()
    assert "4 of at least 5 recordings" in broken.unexplained.reason
    assert "teeth cannot be judged yet" in broken.unexplained.reason
    sufficiency = described(baseline).sufficiency
    assert (sufficiency.recordings, sufficiency.recordings_needed) == (4, 5)
    assert {kind.what for kind in sufficiency.not_judged} == {"single teeth", "changes of a sensor or its mount"}


@pytest.mark.slow
@needs
def test_modulation_of_the_28_channel_rig_is_named_and_belongs_to_no_gear(brought):
    found = load(brought("spur-rig-28ch-2000rpm", "channels.npz"))
    lines = {round(line["frequency_hz"], 1): line for line in lines_of_no_shaft(found)}
    line, race = lines[39.6], lines[171.6]
    assert line["frequency_hz"] == pytest.approx(39.58, abs=0.05)
    assert line["frequency_std_hz"] < 0.01 and line["geared"] is None and line["part"] == 3
    possible = [c["name"] for c in line["causes"] if c["possible"]]
    shared = "cage and outer race of one bearing of 13 elements"
    assert possible == ["cage of a bearing on the pinion", shared]
    assert set(line["channels"]) == set(race["channels"]) == set(found.windows[0].window.accelerations)
    assert {c["name"] for c in race["causes"] if c["possible"]} >= {"outer race of a bearing on the pinion", shared}


@pytest.mark.slow
@needs
def test_modulation_of_the_28_channel_rig_is_found_on_every_channel_alone(brought):
    """Its sidebands stand at least 12 times above the median of their neighbourhood on each of the ten."""
    found = load(brought("spur-rig-28ch-2000rpm", "channels.npz"))
    one, track = found.windows[0].window, found.windows[0].track
    for channel, samples in one.accelerations.items():
        alone = unattributed_spacings({channel: samples}, track, (23, 46), pair_shafts(found.rig))
        off = [abs(s.order / round(s.order / CAGE) - CAGE) for s in alone.spacings if abs(s.order - 3 * CAGE) < 0.02]
        assert off and min(off) < 0.002, channel
        assert all(s.log_chance < np.log(0.01) for s in alone.spacings)


@pytest.mark.slow
@needs
def test_search_about_shifted_places_of_the_28_channel_rig_finds_no_more_than_chance(brought):
    found = load(brought("spur-rig-28ch-2000rpm", "channels.npz")).windows[0]
    shown = spectra(found.window.accelerations, found.track, 23, 2)
    rng, limit = np.random.default_rng(1), np.log(SpacingSearchThresholds().chance)
    tried = [search(shown, 23, 2, shift=tuple(rng.uniform(-9, 9, 3))) for _ in range(60)]
    alone = [values.min() < limit for t in tried for values in t.alone.values()]
    assert sum(t.log_chance.min() < limit for t in tried) <= 3  # of 60 at 1 %: four and more once in 300
    assert np.mean(alone) < 0.025  # of 600 at 1 %, ten channels of one record at a time


WRONG = {
    "teeth of the pinion": (
        lambda text: text.replace("teeth = 32", "teeth = 31"),
        r"\(31, 80\) teeth.* which are right",
    ),
    "teeth of the gear": (
        lambda text: text.replace("teeth = 80", "teeth = 78"),
        r"\(32, 78\) teeth.* which are right",
    ),
    "rate": (lambda text: text.replace("12800", "10000"), "no comb of mesh lines stands out"),
    "two channels": (
        lambda text: (
            text.replace("[channels.a1]", "[channels.X]")
            .replace("[channels.a3]", '[channels.a1]\ncolumn = "a3"')
            .replace("[channels.X]", '[channels.a3]\ncolumn = "a1"')
        ),
        "a1 and a3 seem exchanged",
    ),
}


@pytest.mark.slow
@needs
@pytest.mark.parametrize("what", WRONG)
@pytest.mark.parametrize("state", ["h", "b"])
def test_wrong_mapping_is_caught_before_a_diagnosis_with_what_does_not_fit(brought, tmp_path, what, state):
    name = "spectraquest-broken-tooth"
    baseline = learned([brought(name, f"h30hz{percent}.csv.gz") for percent in (30, 60)])
    edit, message = WRONG[what]
    mapping, out = tmp_path / "wrong.toml", tmp_path / "wrong.mcap"
    mapping.write_text(edit((MAPPINGS / f"{name}.toml").read_text()))
    import_recording(mapping, out, source=MEASURED / name / f"{state}30hz40.csv.gz")
    with pytest.raises(InputError, match=message):
        compared(baseline, out)


@pytest.fixture(scope="module")
def wear_series():
    return load_series(MAPPINGS / "bgu-spur-wear-35.toml", MEASURED / "bgu-spur-wear-35" / "records.csv")


@needs
def test_wear_series_has_its_assemblies(wear_series):
    cases = wear_series.cases
    assert wear_series.records == 378 and cases.worn.sum() == 23 and (~cases.worn).sum() == 4
    i = cases.name.index("W20")
    assert cases.depth[i] == pytest.approx(488e-6)
    assert cases.level["45rps"][i] / 9.80665 == pytest.approx(1.676, abs=0.002)
    first = cases.name.index("W1")
    for label in ("45rps", "15rps"):  # the first case lies below the unworn ones in level, not in modulation
        assert cases.level[label][first] < cases.level[label][~cases.worn].mean()
    assert cases.level["45rps-fme"][first] > cases.level["45rps-fme"][~cases.worn].mean()
    assert [k for k, q in wear_series.quantities.items() if not q.modelled] == ["45rps-fme", "15rps-fme"]


@needs
@pytest.mark.slow
@pytest.mark.timeout(1200)  # nine time-domain curves of the levels, half a minute each on a slow core
def test_levels_of_the_wear_series_beside_curves_that_know_nothing_of_gears(wear_series):
    s = wear_series
    tried = tried_on(s, draws=2)
    by = {t.name: t.errors for t in tried.trials}
    fast, slow = "45rps", "15rps"
    # with equal information the twin is nearer than a line at 15 rev/s and not at 45, and nowhere nearer than a spline
    for twin, also in (("background", ""), ("assembly", " + assembly")):
        line, spline = by["straight line" + also], by["spline" + also]
        assert by[twin].mean(slow) < line.mean(slow) and by[twin].mean(fast) > line.mean(fast)
        assert all(spline.mean(k) < by[twin].mean(k) for k in (fast, slow))
        assert spline.log_density - by[twin].log_density > LEAST_GAIN
    # a gain alone fails by more than the level itself: what the machine does beside the mesh must be known
    assert min(by["twin"].mean(k) for k in (fast, slow)) > 1
    # nothing that was tried earns its place, by itself or with others
    assert tried.choice.causes == () and all(t.gain < LEAST_GAIN for t in tried.trials if t.cause)
    assert tried.gain < LEAST_GAIN
    # so the relation is the cubic through the cases, which is nearer than the model at both speeds; what the published
    # frequency modulation adds to the depths of cases left out is not enough for it to be used
    assert tried.basis == CASES and tried.cubic.indicators == {}
    assert tried.cubic.errors.log_density - tried.modelled.log_density > LEAST_GAIN
    assert all(tried.left.mean(k) < tried.modelled.mean(k) for k in (fast, slow))
    # from four worn cases the twin knows the rest better than a line and a spline do at 15 rev/s; at 45 the cubic is
    # better
    few = tried.few
    assert few["background"][slow] < min(few["straight line"][slow], few["spline"][slow])
    assert few["background"][fast] > few[CASES][fast]
    # at 45 rev/s the level stops rising, at 15 that is not shown; deep down there is a lower bound alone, and the bands
    # hold the truth
    told = answer(s, tried)
    stops = told["relation"][fast]["not_rising"]
    assert 600 < stops["from_um"] < 650 and stops["p"] <= 0.05 and told["relation"][slow]["not_rising"] is None
    held = [d["p05_um"] <= d["true_um"] <= (d["p95_um"] or 1e9) for d in told["depths"]]
    assert np.mean(held) >= 0.8  # 90 % band, 23 cases
    assert all(d["p95_um"] is None for d in told["depths"][-2:])
    # the within-case scatter is not reached, not even by a spline
    for k, floor in told["floor"].items():
        assert floor["within_case_percent"] < 100 * by["spline"].mean(k)
