"""An effect stays where held-out windows since its onset are predicted better with it, whatever effect it is."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from tests.held_out_windows import MESH, RIPPLE, SILENT, lines, window
from tests.mesh_pairs import UNSW_RIG
from twin.effects import EFFECTS
from twin.features.non_gear import NonGearFeatures
from twin.rig import Rig
from twin.tracing.attribution import AttributedEffect
from twin.tracing.detectors.tooth_errors import _ToothFit
from twin.tracing.earned import DISC, _changes, _sizes, asked_again, implausible, judged, refusal_of
from twin.tracing.held_out_content import content_change
from twin.tracing.held_out_error import ChannelComparison, HeldOutComparison
from twin.tracing.joining import with_rivals
from twin.tracing.moved_lines import moved_lines, shown_share
from twin.tracing.state import EffectErrors, Tracing
from twin.updating.history import WindowInput

RIG = Rig.from_mapping(UNSW_RIG)
RNG = np.random.default_rng(7)


def effect(name, value, std, evidence=100.0, onset=0.0, **fields):
    """An effect with one stated size."""
    kind = EFFECTS[name]
    size = next(p.name for p in kind.parameters if not p.shape)
    return AttributedEffect.of(
        kind(**{size: value}), onset=onset, parameters={size: (value, "", std)}, log_evidence=evidence, **fields
    )


def errors(pairs, is_torque=True):
    """As the errors of windows without and with an effect are judged."""
    moved = moved_lines(pairs, is_torque)
    return EffectErrors(before=None, after=None, moved=moved, changes=_changes(pairs, is_torque))


def rippled(share, count, noise=0.01, seed=1):
    """Windows with a ripple, of which the effect predicts a share."""
    rng, out = np.random.default_rng(seed), []
    for index in range(count):
        y = MESH + RIPPLE + noise * (rng.normal(size=4) + 1j * rng.normal(size=4))
        out.append((window(MESH, y, index=index), window(MESH + share * RIPPLE, y, index=index)))
    return out


@pytest.mark.parametrize("share", [0.5, 0.8, 1.0, 1.3])
def test_effect_that_explains_its_line_in_three_windows_has_earned_its_name(share):
    assert judged(effect("torque_ripple", 0.2, 0.01), errors(rippled(share, 3))).kind == "earned"


@pytest.mark.parametrize("share", [-1.0, -0.3, 2.3, 4.0])
def test_effect_that_points_away_or_is_far_too_large_is_refused(share):
    assert judged(effect("torque_ripple", 0.2, 0.01), errors(rippled(share, 3))).kind == "refused"


@pytest.mark.parametrize("count", [1, 2])
def test_effect_that_fewer_than_three_windows_could_test_is_suspected(count):
    verdict = judged(effect("torque_ripple", 0.2, 0.01), errors(rippled(1.0, count)))
    assert verdict.kind == "suspected" and "held-out window" in verdict.reason


def test_effect_that_no_window_could_test_is_suspected():
    assert judged(effect("torque_ripple", 0.2, 0.01), EffectErrors(before=None, after=None)).kind == "suspected"


@pytest.mark.parametrize(("name", "size"), [
    ("torque_ripple", 0.2), ("profile_error", 1e-5), ("misalignment", 2e-5), ("gear_eccentricity", 3e-5),
])  # fmt: skip
@pytest.mark.parametrize("share", [0.0, 0.01])
def test_effect_that_moves_no_line_beyond_its_scatter_claims_nothing_and_is_refused(name, size, share):
    """Profile errors were added beside a run-out of the gear, though neither held-out error changed."""
    assert judged(effect(name, size, 0.01 * size), errors(rippled(share, 4))).kind == "refused"


def with_acceleration(pairs, without, present, measured):
    """The windows with an acceleration that is predicted without the effect, and with it."""
    return [
        tuple(
            replace(w, channels={**w.channels, "acceleration": lines(m, measured)})
            for w, m in zip(pair, (without, present), strict=True)
        )
        for pair in pairs
    ]


@pytest.mark.parametrize(("without", "present"), [(0.6, 0.2), (0.9, 0.3), (0.5, 1.6)])
def test_effect_by_which_another_channel_rises_more_than_its_own_falls_is_refused(without, present):
    """A misalignment of a path that is no linear structure: the level fell, the waveform went from 47 to 48 %."""
    heard = np.array([0.0, 0.0, 3.0, 2.0])
    pairs = with_acceleration(rippled(0.1, 3, noise=1e-3), without * heard, present * heard, heard)
    verdict = judged(effect("torque_ripple", 0.2, 0.01), errors(pairs))
    assert verdict.kind == "refused" and "acceleration" in verdict.reason


def test_channel_that_stays_within_what_a_healthy_machine_leaves_speaks_against_nothing():
    heard = np.array([0.0, 0.0, 3.0, 2.0])
    pairs = with_acceleration(rippled(0.6, 3, noise=1e-3), 0.99 * heard, 0.97 * heard, heard)
    assert judged(effect("torque_ripple", 0.2, 0.01), errors(pairs)).kind == "earned"


@pytest.mark.slow
def test_of_healthy_machines_few_keep_an_effect_that_was_fitted_to_their_noise():
    """A ripple fitted to the noise of other windows, of a size that chance gives it."""
    rng, kept = np.random.default_rng(2), 0
    for _ in range(2000):
        fitted = 1e-2 * (rng.normal(size=3) + 1j * rng.normal(size=3)).mean()
        pairs = []
        for index in range(3):
            y = MESH + 1e-2 * (rng.normal(size=4) + 1j * rng.normal(size=4))
            m = MESH + np.array([0, fitted, 0, 0])
            pairs.append((window(MESH, y, index=index, std=1e-2), window(m, y, index=index, std=1e-2)))
        kept += judged(effect("torque_ripple", abs(fitted), 1e-2), errors(pairs)).kind == "earned"
    assert kept <= 0.01 * 2000


# -- the size ---------------------------------------------------------------------------------------------------------


def test_chance_of_an_amplitude_with_a_free_phase_is_that_of_rayleighs_distribution():
    """Over two of its standard deviations in 13.5 % of pure noise, a signed number in 4.6 %."""
    ((_, amplitude),) = _sizes(effect("torque_ripple", 2.0, 1.0))
    ((_, signed),) = _sizes(effect("misalignment", 2e-6, 1e-6))
    assert amplitude == pytest.approx(np.exp(-2), rel=1e-6) and signed == pytest.approx(0.0455, abs=1e-4)
    noise = np.abs(RNG.normal(size=200_000) + 1j * RNG.normal(size=200_000))
    assert amplitude == pytest.approx((noise > 2).mean(), abs=0.003)


@pytest.mark.parametrize(
    ("name", "value", "std"),
    [
        ("pinion_eccentricity", 3e-6, 1.5e-6),
        ("misalignment", 17e-6, 8e-6),
        ("tooth_friction", 0.02, 0.01),
        ("mass_unbalance", 2e-3, 1e-3),
        ("mesh_damping", 1.4, 0.2),
        ("sensor_gain", 1.04, 0.02),
    ],
)
def test_size_that_chance_gives_in_more_than_one_of_a_hundred_healthy_machines_is_no_finding(name, value, std):
    assert "by chance" in implausible(RIG, effect(name, value, std))


def pitch_errors(rms, std, chance):
    teeth = EFFECTS["pitch_error"](pinion=tuple(rms * np.cos(np.arange(19))))
    return AttributedEffect.of(teeth, parameters={"pinion_rms": (rms, "m", std)}, log_evidence=6007.0, chance=chance)


@pytest.mark.parametrize(("rms", "std", "chance"), [
    (0.29e-6, 0.21e-6, 0.16), (0.36e-6, 0.34e-6, 0.6), (2e-6, 1.5e-6, 0.02),
])  # fmt: skip
def test_pitch_errors_that_noise_gives_are_no_finding_whatever_their_evidence(rms, std, chance):
    assert "by chance" in implausible(RIG, pitch_errors(rms, std, chance))
    assert implausible(RIG, pitch_errors(10 * rms, std, 1e-5)) is None


def test_pitch_errors_fitted_to_noise_stand_out_from_it_in_no_more_than_one_case_of_a_hundred():
    """Teeth fitted to lines of nothing but noise, by the least squares of the detector."""
    rng, z, lines = np.random.default_rng(4), 19, 60
    response = rng.normal(size=(2 * lines, z))
    fit = _ToothFit(
        gear=0, pattern=None, matrix=np.concatenate((response, 1e-3 * np.eye(z))), std=np.ones(lines)
    )  # fmt: skip
    noise = rng.normal(size=(2000, lines)) + 1j * rng.normal(size=(2000, lines))
    chances = [chi2.sf(fit.explained(fit.correction(rest, np.zeros(z))), z - 1) for rest in noise]
    assert np.mean(np.array(chances) < 0.01) <= 0.015


@pytest.mark.parametrize(
    ("name", "value", "std"),
    [
        ("mass_unbalance", 70_600e-6, 3e-3),  # 70,600 g·mm on a laboratory shaft
        ("pinion_eccentricity", 300e-6, 10e-6),  # over the backlash of 100 µm
        ("gear_eccentricity", 170e-6, 5e-6),
        ("misalignment", 117e-6, 4e-6),
    ],
)
def test_size_that_this_rig_does_not_allow_is_no_finding(name, value, std):
    assert "possible" in implausible(RIG, effect(name, value, std))


@pytest.mark.parametrize(
    ("name", "value", "std"),
    [
        ("mass_unbalance", 20_000e-6, 2e-3),
        ("gear_eccentricity", 90e-6, 1e-6),
        ("misalignment", 60e-6, 5e-6),
        ("tooth_crack", 0.3, 0.05),
        ("sensor_gain", 0.88, 0.03),
        ("misalignment", 101e-6, 5e-6),  # beyond the bound by less than it is uncertain by
    ],
)
def test_size_that_stands_out_from_chance_and_is_possible_is_one(name, value, std):
    assert implausible(RIG, effect(name, value, std)) is None


# -- what competes ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("behind", "alike"), [(-0.9, True), (3.0, True), (5.9, True), (20.0, False)])
def test_effect_with_hardly_more_evidence_than_its_runner_up_is_indistinguishable_from_it(behind, alike):
    item = with_rivals(effect("profile_error", 10e-6, 1e-6, runner_up="misalignment", over_runner_up=behind))
    assert ("misalignment" in item.alike) == alike


# -- asked again ----------------------------------------------------------------------------------------------------


def test_refused_effect_is_asked_again_by_windows_that_have_come_since_and_where_it_sets_in_later(monkeypatch):
    item = effect("misalignment", 30e-6, 3e-6)
    windows = {"now": (2, 5)}
    monkeypatch.setattr(
        "twin.tracing.earned._windows", lambda rig, tracing, item: ([Numbered(i) for i in windows["now"]], set())
    )
    judging = EffectErrors(before=None, after=None, windows=(2, 5))
    before = Tracing(found=(item,), errors=(judging,), measured=8)
    tracing = Tracing(refuted={"misalignment": refusal_of(before, item, "no fall")}, measured=9)
    assert not asked_again(RIG, tracing, item)
    assert asked_again(RIG, tracing, effect("misalignment", 30e-6, 3e-6, onset=3000.0))
    windows["now"] = (2, 5, 8)
    assert asked_again(RIG, tracing, item)
    windows["now"] = ()
    assert not asked_again(RIG, tracing, item) and asked_again(RIG, replace(tracing, measured=11), item)


class Numbered:
    def __init__(self, index):
        self.index = index


# -- effects that no steady state predicts -----------------------------------------------------------------------------


def heard(*rates):
    return NonGearFeatures(
        duration=5.0, speed_hz=10.0, tones=(), lines=(), kurtosis=4.0, rates=tuple((r, 0.3) for r in rates)
    )


def judged_bearing(order, *windows):
    given = [WindowInput(index=i, features=None, non_gear=heard(*rates)) for i, rates in enumerate(windows)]
    kind = EFFECTS["bearing_defect"](blow=1.0, order=order)
    before, after = content_change(kind, given, [])
    from twin.tracing.earned import _change

    item = AttributedEffect.of(kind, parameters={"order": (order, "", 0.02)}, log_evidence=22.6)
    change = _change("envelope", before, after, 0.0, True, (1.0, 0.0))
    return judged(item, EffectErrors(before=None, after=None, changes=(change,)))


def test_bearing_whose_multiples_come_again_in_later_windows_has_earned_its_name():
    multiples = [(3.05 * k * (1 + 0.002 * n) for k in (1, 2, 3, 4)) for n in range(3)]
    assert judged_bearing(3.05, *map(tuple, multiples)).kind == "earned"


def test_bearing_that_later_windows_do_not_show_is_refused():
    """Order 9.502 with evidence of 22.6 nat, which improves nothing."""
    assert judged_bearing(9.502, (4.1, 7.7), (), (5.3, 6.9, 11.2)).kind == "refused"
    assert judged_bearing(9.502, (), (), ()).kind == "refused"


@pytest.mark.parametrize("shift", [-0.02, 0.02, 0.025])
def test_bearing_whose_elements_slip_from_window_to_window_has_earned_its_name(shift):
    """Multiples 5 to 10 of an order that lies 2 % beside the fitted one: none is within 1.2 % of the fitted one's."""
    windows = [tuple(3.55 * (1 + shift) * k * (1 + 0.004 * (-1) ** k) for k in range(5, 11)) for _ in range(3)]
    assert judged_bearing(3.55, *windows).kind == "earned"


def test_rates_of_no_order_rarely_earn_a_bearings_name():
    rng, earned = np.random.default_rng(6), 0
    for _ in range(300):
        windows = [tuple(rng.uniform(2.0, 45.0, 10)) for _ in range(4)]
        earned += judged_bearing(3.55, *windows).kind == "earned"
    assert earned <= 0.1 * 300


@pytest.mark.parametrize(("level", "kind"), [(0.5, "earned"), (0.02, "earned"), (-0.3, "refused")])
def test_lines_of_no_shaft_are_judged_by_their_level_alone(level, kind):
    """A tone of 0.5 m/s² in three windows; a negative level stands for one that the windows do not show."""
    rng, pairs = np.random.default_rng(4), []
    for index in range(3):
        shown = max(level, 0.0) * (1 + 0.05 * rng.normal())
        both = []
        for predicted in (0.0, abs(level)):
            w = window(MESH, MESH, channel="acceleration", index=index)
            heard = w.acceleration.extended([4.3], [shown], [predicted], [1e-3])
            both.append(replace(w, channels={"acceleration": heard}))
        pairs.append(tuple(both))
    item = AttributedEffect.of(EFFECTS["unknown_effect"](), parameters={}, log_evidence=1e4)
    assert judged(item, errors(pairs)).kind == kind


def test_channel_that_holds_nothing_is_judged_by_nothing():
    assert _changes([(window(MESH, MESH), window(MESH, MESH))], True)[0].channel == "torque"


# -- what one encoder alone shows -------------------------------------------------------------------------------------

SIDEBANDS = np.array([3.0, 18.0, 20.0, 37.0, 39.0, 56.0, 58.0, 75.0])
MADE = np.exp(1j * np.arange(8))  # of the sidebands, by an effect


def channel(measured, predicted):
    return ChannelComparison(
        orders=SIDEBANDS, measured=measured, predicted=predicted * MADE, std=np.full(8, 0.1), variance=np.full(8, 0.04)
    )


def seen_by_the_encoder(count=3, **others):
    """Windows whose transmission error shows all of an effect, and other channels what they measure."""
    pairs = []
    for index in range(count):
        noise = 0.1 * (RNG.normal(size=8) + 1j * RNG.normal(size=8))
        measured = {"transmission_error": 5 * MADE} | others
        pair = []
        for present in (0.0, 1.0):
            channels = {
                name: channel(y + noise, present * (5 if "error" in name else 2)) for name, y in measured.items()
            }
            pair.append(
                HeldOutComparison(
                    index=index,
                    speed_hz=10.0,
                    channels={"acceleration": SILENT} | channels,
                    rms_measured=1.0,
                    rms_predicted=1.0,
                )
            )
        pairs.append(tuple(pair))
    return errors(pairs)


def other_content(size):
    """Lines whose phases have nothing to do with the effect."""
    return size * MADE * np.array([1, -1, 1j, -1j, 1, -1, 1j, -1j])


@pytest.mark.parametrize("name", ["torque", "acceleration"])
@pytest.mark.parametrize("size", [0.3, 0.6, 1.0])
def test_channel_that_denies_what_an_effect_would_make_of_it_excuses_nothing(name, size):
    """A lobed disc: the error of the encoder fell by a larger factor than that of the torque rose by."""
    verdict = judged(effect("gear_eccentricity", 3e-5, 1e-6), seen_by_the_encoder(**{name: other_content(size)}))
    assert verdict.kind == "refused" and f"{name} on held-out windows" in verdict.reason


@pytest.mark.parametrize("name", ["gear_eccentricity", "pinion_eccentricity"])
@pytest.mark.parametrize("count", [2, 3])
def test_what_the_encoder_alone_shows_may_be_its_own_disc(name, count):
    verdict = judged(effect(name, 3e-5, 1e-6), seen_by_the_encoder(count))
    assert verdict.kind != "refused" and verdict.rivals == (DISC,)


@pytest.mark.parametrize("turned", [1, 1j, -1])
@pytest.mark.parametrize("name", ["torque", "acceleration"])
def test_what_another_channel_shows_too_is_not_the_discs(name, turned):
    """A path to the sensor that turns all phases alike hides nothing."""
    verdict = judged(effect("gear_eccentricity", 3e-5, 1e-6), seen_by_the_encoder(**{name: 2 * turned * MADE}))
    assert verdict.kind == "earned" and verdict.rivals == ()


@pytest.mark.parametrize("name", ["torque", "acceleration"])
@pytest.mark.parametrize("times", [8, 60])
def test_another_channel_that_shows_many_times_what_the_effect_makes_of_it_shows_something_else(name, times):
    """An off-centre disc: sidebands of the housing agreed with an eccentricity by 62 ± 20 times what it makes."""
    seen = seen_by_the_encoder(**{name: 2 * times * MADE})
    quiet = replace(seen, changes=tuple(replace(c, claimed=c.claimed and c.channel != name) for c in seen.changes))
    assert judged(effect("gear_eccentricity", 3e-5, 1e-6), quiet).rivals == (DISC,)


def test_a_disc_is_no_rival_of_what_turns_with_no_shaft_or_begins_later():
    seen = seen_by_the_encoder()
    assert judged(effect("misalignment", 2e-5, 1e-6), seen).rivals == ()
    assert judged(effect("gear_eccentricity", 3e-5, 1e-6, onset=500.0), seen).rivals == ()


def test_share_that_a_channel_shows_is_one_of_what_was_predicted_and_within_its_deviation_of_other_lines():
    assert shown_share([(channel(2 * MADE, 0), channel(2 * MADE, 2))])[0] == pytest.approx(1.0)
    beyond = 0
    for _ in range(1000):
        y = RNG.normal(size=8) + 1j * RNG.normal(size=8)
        share, std = shown_share([(channel(y, 0), channel(y, 2))])
        beyond += share > 2.45 * std
    assert beyond < 0.06 * 1000


def test_torque_ripple_that_the_torque_meter_shows_in_its_one_line_is_not_the_discs():
    one = np.where(np.arange(8) == 0, MADE, 0)
    pairs = []
    for index in range(3):
        pair = []
        for present in (0.0, 1.0):
            channels = {
                name: replace(channel(size * one, 0), predicted=present * size * one)
                for name, size in (("transmission_error", 5.0), ("torque", 2.0))
            }
            pair.append(replace(window(MESH, MESH, index=index), channels={"acceleration": SILENT} | channels))
        pairs.append(tuple(pair))
    verdict = judged(effect("torque_ripple", 0.2, 0.01), errors(pairs))
    assert verdict.kind == "earned" and verdict.rivals == ()
