"""The search for lines of no known shaft: by chance as rarely as stated, and from the size that it states."""

from functools import lru_cache

import numpy as np
import pytest

from service.report.lines import search_sentences
from tests.claims.test_baseline import RATE, RIG, SHAFTS, TEETH, machine
from twin.baseline.causes import one_bearing
from twin.baseline.comparison import lines_without_shaft
from twin.baseline.reading import angle_of
from twin.baseline.spacing import unattributed_spacings
from twin.baseline.spacing_search import SpacingSearchThresholds, search, spectra
from twin.windows import Edges, Samples, Window

SPEED, SECONDS, STRANGE = 16.0, 8.0, 1.2371
CHANCE = SpacingSearchThresholds().chance


def noise(seed, channels=("a", "b"), side=None, harmonic=1):
    """Mesh lines and noise; with sidebands of an amplitude about one mesh harmonic in channel a."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(SECONDS * RATE)) / RATE
    θ = 2 * np.pi * SPEED * t
    out = {}
    for name in channels:
        x = np.cos(20 * θ) + 0.5 * np.cos(40 * θ) + rng.normal(size=t.size)
        if side is not None and name == "a":
            x += side * sum(np.cos((20 * harmonic + sign * STRANGE) * θ + rng.uniform(0, 6)) for sign in (-1, 1))
        out[name] = Samples(start=0.0, rate=RATE, values=x)
    edges = Edges(per_rev=1, first_index=0, times=np.arange(int(SPEED * SECONDS)) / SPEED)
    return Window(start_time_ns=1, accelerations=out, encoders={"pinion": edges})


def found(window):
    return unattributed_spacings(window.accelerations, angle_of(RIG, window), TEETH, SHAFTS)


@lru_cache(maxsize=1)
def track():
    return angle_of(RIG, noise(0))


@pytest.mark.slow
def test_noise_has_a_spacing_as_rarely_as_stated():
    hits = [
        bool(unattributed_spacings(noise(seed).accelerations, track(), TEETH, SHAFTS).spacings) for seed in range(200)
    ]
    assert sum(hits) <= 6  # of 200 at 1 %: seven and more once in 250


@pytest.mark.slow
@pytest.mark.parametrize("channels", [("a",), ("a", "b", "c", "d")])
def test_sidebands_are_found_near_the_stated_limit_on_one_channel_however_many_others_there_are(channels):
    limit = next(x for x in found(noise(5, channels)).limits if x.channel == "a" and x.harmonic == 2)
    seen = {}
    for times in (0.4, 1.5):
        spacings = [found(noise(seed, channels, times * limit.amplitude, 2)).spacings for seed in range(20, 30)]
        seen[times] = sum(any(abs(s.order - STRANGE) < 0.01 for s in each) for each in spacings)
    assert seen[1.5] >= 9 and seen[0.4] <= 2
    strongest = found(noise(20, channels, 1.5 * limit.amplitude, 2)).spacings[0]
    assert strongest.channels[0] == "a" and strongest.log_chance < np.log(CHANCE)


def test_chance_of_several_channels_is_never_below_that_of_the_clearest_by_more_than_they_agree():
    w = noise(3, ("a", "b", "c"), 0.3)
    tried = search(spectra(w.accelerations, track(), TEETH[0], 3), TEETH[0], 3)
    each = np.array(list(tried.alone.values()))
    # e times the geometric mean, and twice for the better of two combinations
    assert np.all(tried.log_chance >= np.minimum(each.min(axis=0), each.mean(axis=0)))
    assert np.all(tried.log_chance <= np.log(2 * 3) + each.min(axis=0))


def test_channel_that_does_not_reach_the_mesh_frequency_is_not_searched():
    slow = {"slow": Samples(start=0.0, rate=256.0, values=np.random.default_rng(1).normal(size=2048))}
    seen = unattributed_spacings(slow, track(), TEETH, SHAFTS)
    assert seen.spacings == () and seen.limits == ()
    both = unattributed_spacings(slow | dict(noise(5, ("a",)).accelerations), track(), TEETH, SHAFTS)
    assert {x.channel for x in both.limits} == {"a"}


def test_where_nothing_is_found_what_was_sought_is_said_with_its_limit():
    w = machine(0.5, 3, seconds=8.0)
    seen = lines_without_shaft(RIG, w, "w")
    assert seen.lines == () and seen.unexplained is None and seen.sought.found == 0
    assert 0 < seen.sought.smallest < 5 and seen.sought.largest == pytest.approx(0.5 * 20 * 16, rel=0.05)
    assert {x.channel for x in seen.sought.limits} == {"a", "b"} and all(x.amplitude > 0 for x in seen.sought.limits)
    said = search_sentences({
        "found": 0, "from_hz": 1.5, "to_hz": 160.0,
        "detection_limits": [{"channel": "a", "harmonic": 1, "amplitude": 0.031}],
    })  # fmt: skip
    assert said == [
        "Modulation by a frequency of no known shaft: none found. Sidebands 1.50 to 160 Hz from the mesh lines were "
        "searched for; at mesh harmonic 1, half of those with this peak would be found: 0.031 (a)."
    ]


def test_two_spacings_are_one_bearing_where_their_ratio_is_its_element_count():
    (cause,) = one_bearing(5.1483, 1e-4, [(0.39602, 1e-5)])
    assert "13 elements" in cause.name
    assert one_bearing(5.20, 1e-4, [(0.39602, 1e-5)]) == []  # 13.13 times
    assert one_bearing(5.1483, 0.02, [(0.39602, 1e-3)]) == []  # any ratio would be whole within such uncertainty
