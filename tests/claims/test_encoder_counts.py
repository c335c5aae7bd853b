"""Edges that an encoder lost or counted twice are put right, whatever looks like them is left alone.

Truth  the edges of a sound encoder on a shaft whose speed changes and swings with the mesh, built here; lines of its
       disc are then taken away or doubled in a share of the turns
"""

from dataclasses import replace

import numpy as np
import pytest

from service.stream.edge_counts import EncoderCounts
from twin.features.edge_counts import count_drift, counts_put_right
from twin.features.transmission_error import transmission_error
from twin.rig import Rig
from twin.windows import Edges, Window

TEETH, SPEED, SECONDS, RADIUS = (19, 52), 20.0, 1.5, 0.0268  # Hz, s, m
TURNS = np.pi * 2


def sound(per_rev, ratio=1.0, *, ramp=0.05, ripple=0.02, disc=0.002, first=5000, seed=1, jitter=60e-9, error=0.0):
    """Edges of a sound encoder on a shaft that turns `ratio` times the pinion's speed.

    ramp    growth of the speed over the window, relative
    ripple  swing of the speed with the mesh, relative
    disc    eccentricity of the disc [rad]
    error   transmission error at the mesh [turns of the pinion]
    """
    chance = np.random.default_rng(seed)
    t = np.arange(0, SECONDS, 2e-5)
    pinion = SPEED * (t + ramp * t**2 / (2 * SECONDS))
    mesh = TEETH[0]
    pinion = pinion + ripple / (mesh * TURNS) * np.sin(mesh * TURNS * pinion)
    turned = ratio * (pinion - error * np.sin(mesh * TURNS * pinion + 1))
    seen = turned + disc / TURNS * np.sin(TURNS * turned + 0.4)
    lines = np.arange(np.ceil(seen[0] * per_rev), np.floor(seen[-1] * per_rev))
    times = np.interp(lines, seen * per_rev, t) + jitter * chance.normal(size=lines.size)
    return Edges(per_rev=per_rev, first_index=first, times=times)


def struck_edges(edges, line, share, seed=3):
    number = edges.first_index + np.arange(edges.times.size)
    chance = np.random.default_rng(seed).uniform(size=number.size)
    struck = ((number - line) % edges.per_rev == 0) & (chance < share)
    struck[:8] = struck[-8:] = False
    return np.flatnonzero(struck)


def without(edges, struck):
    return replace(edges, times=np.delete(edges.times, struck))


def doubled(edges, struck, where=0.3):
    extra = edges.times[struck] + where * (edges.times[struck + 1] - edges.times[struck])
    return replace(edges, times=np.insert(edges.times, struck + 1, extra))


@pytest.fixture(scope="module")
def rig():
    return Rig.from_mapping(
        {"gears": {"pinion": {"teeth": TEETH[0], "base_radius": RADIUS}, "gear": {"teeth": TEETH[1]}}}
    )


def pair(**how):
    return {"pinion": sound(1024, **how), "gear": sound(2048, TEETH[0] / TEETH[1], error=1e-4, first=700, **how)}


def window(encoders, start=0):
    return Window(start_time_ns=start, encoders=encoders)


@pytest.mark.parametrize("share", [0.1, 0.4, 0.85, 1.0])
@pytest.mark.parametrize("per_rev", [60, 500, 1024])
@pytest.mark.parametrize("ramp", [0.0, 0.3, -0.2])
def test_lost_lines_are_put_in_where_they_were_lost(share, per_rev, ramp):
    whole = sound(per_rev, ramp=ramp, ripple=0.02 if per_rev > 100 else 0.005)
    struck = struck_edges(whole, 17, share)
    found = counts_put_right(without(whole, struck))
    assert found is not None and (found.lost, found.doubled, found.struck) == (struck.size, 0, struck.size)
    assert found.edges.times.size == whole.times.size and found.line == 17
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(found.edges.times)), struck)
    kept = np.isfinite(found.edges.times)
    np.testing.assert_array_equal(found.edges.times[kept], whole.times[kept])


@pytest.mark.parametrize("share", [0.1, 0.4, 0.85, 1.0])
@pytest.mark.parametrize("where", [0.02, 0.3, 0.5, 0.8])
def test_doubled_lines_are_left_out(share, where):
    whole = sound(1024)
    struck = struck_edges(whole, 330, share)
    found = counts_put_right(doubled(whole, struck, where))
    assert found is not None and (found.lost, found.doubled) == (0, struck.size)
    assert found.edges.times.size == whole.times.size
    pitch = np.median(np.diff(whole.times))
    assert np.abs(found.edges.times - whole.times).max() < 0.05 * pitch  # a bounce may take the edge's place
    if where > 0.1:
        np.testing.assert_array_equal(found.edges.times, whole.times)


def test_lost_and_doubled_lines_of_one_disc_and_several_lost_at_once():
    whole = sound(1024)
    lost, twice = struck_edges(whole, 100, 0.5), struck_edges(whole, 600, 0.5, seed=4)
    spoiled = doubled(whole, twice)
    spoiled = replace(spoiled, times=spoiled.times[~np.isin(spoiled.times, whole.times[np.append(lost, lost + 1)])])
    found = counts_put_right(spoiled)
    assert found is not None and (found.lost, found.doubled) == (2 * lost.size, twice.size)
    kept = np.isfinite(found.edges.times)
    np.testing.assert_array_equal(found.edges.times[kept], whole.times[kept])


def index_gap(missing=1):
    """A disc of 60 pitches with a gap, which has 60 − `missing` lines and is counted so."""
    whole = sound(60, ripple=0.0)
    number = np.arange(whole.times.size)
    return Edges(per_rev=60 - missing, first_index=0, times=whole.times[number % 60 >= missing])


def uneven(share):
    """An encoder whose lines and gaps are not alike: every other interval is long."""
    whole = sound(1024)
    times = whole.times.copy()
    times[1::2] += share * np.median(np.diff(times))
    return replace(whole, times=times)


@pytest.mark.parametrize(
    "healthy",
    [
        sound(1024),
        sound(1024, ramp=0.6),
        sound(1024, ramp=-0.5, ripple=0.1),
        sound(1024, disc=0.2),
        sound(500, ripple=0.2),
        sound(500, ripple=0.9999),
        sound(2500, ripple=0.99999),
        sound(60, ripple=0.05),
        index_gap(1),
        index_gap(2),
        uneven(0.3),
        uneven(0.45),
        sound(1024, jitter=4e-6),
        sound(1024, jitter=7e-6),
        sound(1, ripple=0.0),
        replace(sound(1024), times=np.where(np.arange(sound(1024).times.size) % 701 < 90, np.nan, sound(1024).times)),
    ],
    ids=[
        "sound", "ramp", "run-down", "eccentric disc", "torsional ripple", "rattle to a stop", "rattle of a fine disc",
        "few lines", "index gap", "wide index gap",
        "uneven lines", "very uneven lines", "noisy times", "very noisy times", "one pulse a turn", "frames lost",
    ],
)  # fmt: skip
def test_what_looks_like_lost_counts_is_left_alone(healthy):
    assert counts_put_right(healthy) is None


def test_a_single_gap_in_a_window_of_one_turn_is_not_decided():
    whole = sound(1024)
    short = replace(whole, times=np.delete(whole.times[:1200], 600))
    assert counts_put_right(short) is None


def test_the_transmission_error_is_that_of_the_sound_encoders():
    encoders = pair()
    struck = struck_edges(encoders["gear"], 479, 0.85)
    found = counts_put_right(without(encoders["gear"], struck))
    assert found is not None
    true = transmission_error(encoders["pinion"], encoders["gear"], TEETH, RADIUS).signal
    again = transmission_error(encoders["pinion"], found.edges, TEETH, RADIUS).signal
    wrong = transmission_error(encoders["pinion"], without(encoders["gear"], struck), TEETH, RADIUS).signal
    assert np.abs(again.values - true.values).max() < 1e-6  # [m]
    assert np.ptp(wrong.values) > 1e-3


def test_sound_shafts_drift_apart_by_less_than_teeth_allow_and_lost_counts_by_more():
    encoders = pair(disc=0.005)
    healthy = count_drift(encoders["pinion"], encoders["gear"], TEETH)
    assert healthy is not None and not healthy.impossible and abs(healthy.angle) < 0.5 * healthy.possible
    struck = struck_edges(encoders["gear"], 479, 1.0)
    lost = count_drift(encoders["pinion"], without(encoders["gear"], struck), TEETH)
    assert lost is not None and lost.impossible
    assert lost.lines[1] == pytest.approx(struck.size, rel=0.25)  # between the means of the ends of the window


def test_a_wrong_number_of_teeth_is_no_lost_count():
    encoders = pair()
    wrong = count_drift(encoders["pinion"], encoders["gear"], (19, 53))
    assert wrong is not None and wrong.ratio_wrong and not wrong.impossible


def test_a_sound_window_stays_the_very_same(rig):
    counts, given = EncoderCounts(), window(pair())
    assert counts.followed(given, rig)[0] is given


def test_a_window_put_right_is_degraded_and_says_which_encoder_and_how_often(rig):
    encoders = pair()
    struck = struck_edges(encoders["pinion"], 11, 0.4)
    out = EncoderCounts().followed(window(encoders | {"pinion": without(encoders["pinion"], struck)}), rig)[0]
    assert out.quality == "degraded" and [f.channel for f in out.faults] == ["encoder/pinion"]
    assert f"{struck.size} lost at one line of the disc, in {struck.size} of" in out.faults[0].detail
    assert out.encoders["gear"] is encoders["gear"]


def test_a_single_encoder_is_put_right_by_its_own_intervals():
    whole = sound(1024)
    struck = struck_edges(whole, 11, 0.4)
    out = EncoderCounts().followed(window({"pinion": without(whole, struck)}), None)[0]
    assert out.quality == "degraded" and out.encoders["pinion"].times.size == whole.times.size


def slipped(edges, lines):
    """Counts that vanish without a trace in the intervals, as of an interpolating encoder that loses its lock."""
    places = np.linspace(0, edges.times.size - 1, edges.times.size - lines)
    return replace(edges, times=np.interp(places, np.arange(edges.times.size), edges.times))


def test_counts_that_vanish_without_a_trace_refuse_the_window_where_the_teeth_forbid_it(rig):
    encoders = pair()
    lost = window(encoders | {"gear": slipped(encoders["gear"], 12)})
    out = EncoderCounts().followed(lost, rig)[0]
    assert out.quality == "refused" and "drift apart" in out.faults[0].detail
    few = window(encoders | {"gear": slipped(encoders["gear"], 1)})
    assert EncoderCounts().followed(few, rig)[0] is few  # less than backlash and deflection


@pytest.mark.parametrize("shaft", ["pinion", "gear"])
def test_the_count_goes_on_from_the_window_before_by_the_other_encoder(rig, shaft):
    counts, encoders = EncoderCounts(), pair()
    _, counts = counts.followed(window(encoders), rig)
    for lost_before in (0, 40, 700):
        counts = EncoderCounts.from_dict(counts.to_dict())  # a restart
        later = {
            name: replace(e, first_index=e.first_index + turns * e.per_rev)
            for (name, e), turns in zip(encoders.items(), (52 * 50, 19 * 50), strict=True)
        }
        struck = struck_edges(later[shaft], 11, 0.4)
        raw = without(later[shaft], struck)
        raw = replace(raw, first_index=raw.first_index - lost_before)
        encoders = later
        out, counts = counts.followed(window(later | {shaft: raw}), rig)
        assert out.encoders[shaft].first_index == later[shaft].first_index


def test_the_count_of_a_single_encoder_goes_on_by_the_struck_line():
    counts, whole = EncoderCounts(), sound(1024)
    first = []
    for turns, lost_before in ((0, 0), (3000, 60), (6000, 130)):
        later = replace(whole, first_index=whole.first_index + turns * 1024)
        raw = without(later, struck_edges(later, 11, 0.4))
        out, counts = counts.followed(window({"pinion": replace(raw, first_index=raw.first_index - lost_before)}), None)
        first.append((out.encoders["pinion"].first_index - later.first_index) % 1024)
    assert first == [0, 0, 0]


def test_with_a_wrong_number_of_teeth_no_count_is_moved_by_the_other_encoder():
    wrong = Rig.from_mapping({"gears": {"pinion": {"teeth": 19}, "gear": {"teeth": 53}}})
    counts, encoders = EncoderCounts(), pair()
    _, counts = counts.followed(window(encoders), wrong)
    lost = without(encoders["gear"], struck_edges(encoders["gear"], 11, 0.4))
    lost = replace(lost, first_index=lost.first_index + 2048 * 19)
    later = {
        "pinion": replace(encoders["pinion"], first_index=encoders["pinion"].first_index + 1024 * 52),
        "gear": lost,
    }
    out, counts = counts.followed(window(later), wrong)
    assert out.quality == "degraded" and out.encoders["gear"].first_index == lost.first_index


def test_a_counter_that_begins_again_ends_what_is_known_of_its_faults(rig):
    counts, encoders = EncoderCounts(), pair()
    struck = struck_edges(encoders["pinion"], 11, 0.4)
    _, counts = counts.followed(window(encoders | {"pinion": without(encoders["pinion"], struck)}), rig)
    again = window({name: replace(e, first_index=0) for name, e in encoders.items()})
    assert counts.moved
    same, counts = counts.followed(again, rig)
    assert same is again and not counts.moved
