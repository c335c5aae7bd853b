"""Every detector answers by itself, whatever has been found before, and sees no more than its context."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from benchmarks.scoring import ROOT, windows_of
from tests.dynamics_cases import RIG, model
from twin.effects import EFFECTS
from twin.effects.facts import DETECTORS as DECLARED
from twin.errors import NotAvailable
from twin.features.non_gear import NonGearFeatures
from twin.features.window_features import MeasuredLines, WindowFeatures
from twin.model import Condition
from twin.rig import Rig
from twin.scales import Scales
from twin.step import Options, State, step
from twin.tracing.attribution import AttributedEffect
from twin.tracing.context import NOTHING, TracingContext, WornWindows
from twin.tracing.detectors import DETECTORS, crack, mesh, non_gear, rattle, tooth_errors
from twin.tracing.findings import Findings, NonGearContent
from twin.tracing.trace import trace
from twin.updating.history import WindowInput

SHORT = ROOT / "recordings" / "short-campaign.mcap"
NAMES = [detector.name for detector in DETECTORS]


@lru_cache(maxsize=1)
def followed():
    """The short healthy campaign's windows, depths and mesh phase."""
    rig, windows = windows_of(SHORT)
    state = State()
    for window in windows:
        state, _ = step(rig, state, window, Options(trace=True))
    return rig, state.tracing.history, dict(state.tracing.stages[-1].depths), state.tracing.phase


@lru_cache(maxsize=1)
def healthy() -> TracingContext:
    rig, history, depths, phase = followed()
    return TracingContext.of(rig, history, depths, phase)


def window(n: int, *, speed: float = 10.0, revolutions: float | None = None, **features) -> WindowInput:
    return WindowInput(
        index=n,
        features=WindowFeatures(
            start_time_ns=n,
            duration=5.0,
            quality="good",
            speed_hz=speed,
            torque_nm=10.0,
            revolutions=1000.0 * (n + 1) if revolutions is None else revolutions,
            rms=3.0,
            **features,
        ),
    )


@pytest.mark.slow
@pytest.mark.parametrize("detector", DETECTORS, ids=NAMES)
def test_detector_runs_alone_and_finds_nothing_in_a_healthy_machine(detector):
    context = healthy()
    found = detector.detect(context)
    assert isinstance(found, Findings)
    assert found.effects == () and not found.teeth_separate and not found.non_gear.unknown
    assert context.findings is NOTHING  # a detector changes nothing


@pytest.mark.slow
@pytest.mark.parametrize("detector", DETECTORS, ids=NAMES)
def test_detector_keeps_what_was_found_before_it(detector):
    tone = NonGearContent(modulated_by="gear")
    before = Findings(non_gear=tone, run_out_orders=frozenset({1}))
    found = detector.detect(healthy().with_findings(before))
    assert found.run_out_orders == (set() if detector.name == "eccentricity" else {1})
    content = replace(found.non_gear, described="")  # the unknown effect puts what was found in words
    assert content == (NonGearContent() if detector.name == "non_gear" else tone)


@pytest.mark.slow
def test_mesh_lines_are_fitted_as_an_accelerometer_without_its_fault_would_have_shown_them():
    context = healthy()
    onset = mesh.mesh_windows(context).windows[1].revolutions
    fault = AttributedEffect.of(EFFECTS["sensor_gain"](gain=2.0), onset=onset, parameters={}, log_evidence=50.0)
    faulty = context.with_findings(context.findings.adding(fault))
    for before, after in zip(mesh.mesh_windows(context).windows, mesh.mesh_windows(faulty).windows, strict=True):
        gain = 2.0 if before.revolutions >= onset else 1.0
        for name in ("lines", "std"):
            was, now = getattr(before, name), getattr(after, name)
            np.testing.assert_allclose(gain * now["acceleration"], was["acceleration"])
            np.testing.assert_array_equal(now["encoder"], was["encoder"])


def test_every_detector_that_an_effect_declares_is_run():
    assert {name for name in DECLARED if name} <= set(NAMES)
    assert {kind.facts.detector for kind in EFFECTS.values()} <= {"", *NAMES}


def test_detectors_that_need_the_mesh_phase_are_left_out_without_it():
    rig, history, depths, _ = followed()
    traced = trace(rig, history, depths, None)
    assert traced.found == () and traced.misfit_before is None and traced.fitted


def test_context_without_a_mesh_phase_says_so_where_the_phase_is_needed():
    rig, history, depths, _ = followed()
    context = TracingContext.of(rig, history, depths, None)
    for detector in (tooth_errors, crack, mesh):
        with pytest.raises(NotAvailable, match="no mesh phase is known"):
            detector.detect(context)


def test_trace_ends_where_the_teeth_separate():
    def separating(context):
        return replace(context.findings, teeth_separate=True)

    def never(context):
        raise AssertionError("nothing is sought once the teeth separate")

    rig, history, depths, phase = followed()
    chain = [replace(DETECTORS[0], detect=separating), replace(DETECTORS[1], detect=never)]
    assert trace(rig, history, depths, phase, detectors=chain).found == ()


def test_windows_held_out_are_told_in_rising_order_and_take_no_part():
    rig, history, depths, phase = followed()
    traced = trace(rig, history, depths, phase, detectors=DETECTORS[:1])
    assert list(traced.held_out) == sorted(traced.held_out) and traced.held_out
    assert not set(traced.held_out) & set(traced.fitted)


def test_windows_at_less_than_half_of_the_usual_speed_are_no_measurement():
    history = [window(n, speed=4.9 if n in (1, 4) else 5.1 if n == 5 else 10.0) for n in range(8)]
    context = TracingContext.of(RIG, history, {}, None)
    assert context.measurement == {0, 2, 3, 5, 6, 7}


def test_window_that_cannot_be_read_is_counted_with_the_reason():
    history = [window(n) for n in range(6)]
    history[2] = replace(history[2], features=replace(history[2].features, revolutions=None))
    traced = trace(RIG, history, {}, None)
    ((index, reason),) = traced.skipped
    assert index == 2 and "no absolute count of revolutions" in reason
    with pytest.raises(NotAvailable, match="window 2: no absolute count of revolutions"):
        trace(RIG, history[1:3], {}, None)


def test_impacts_that_could_not_be_sought_are_not_taken_for_absent():
    def features(kurtosis, fault):
        return NonGearFeatures(
            duration=5.0, speed_hz=10.0, tones=(), lines=(), kurtosis=kurtosis, rates=(), fault=fault
        )

    gaps = "impacts are not searched for: the acceleration has gaps"
    windows = [(1000.0 * n, features(None, gaps) if n < 3 else features(1.0, "")) for n in range(5)]
    content = non_gear.find_non_gear_content(windows, False)
    assert content.not_available == ((gaps, 3),)
    assert not content.impacts


def test_orders_of_a_gear_pattern_follow_its_number_of_teeth():
    orders = tooth_errors.PATTERNS.orders
    assert orders(0, (19, 52)) == range(3, 16) and orders(1, (19, 52)) == range(4, 42)
    assert orders(0, (30, 80)) == range(3, 25) and orders(1, (30, 80)) == range(4, 65)


@pytest.mark.parametrize(("torque", "largest"), [(10.0, 45.0), (400.0, 1800.0)])
def test_largest_swing_of_the_load_that_the_model_is_given_follows_the_rated_torque(torque, largest):
    scales = Scales.of(Rig(RIG.values | {"operating": {**RIG.values["operating"], "input_torque": torque}}))
    overload = Condition(speed_hz=10.0, torque=100 * torque)
    windows = [window(n, noise_rms=2.9, transmission_error=sway(2e-3 * (1 + 0.2 * (n % 3)))) for n in range(6)]
    found = rattle.find_rattle(model(), [w.features for w in windows], [overload] * 6, scales)
    assert found is not None and found.effect.load_ripple == pytest.approx(largest)


def sway(size):
    """The transmission error's line at one cycle a turn of the pinion [m]."""
    return MeasuredLines(unit="m", keys=((0, 1, 0),), orders=(1.0,), amplitudes=(complex(size),), std=(1e-7,))


def test_windows_turn_back_to_one_mounting_where_a_disc_has_been_moved():
    context = healthy()
    assert isinstance(context.worn, WornWindows)
    moved = [w if w.index < 5 else shifted(w) for w in context.windows]
    mounted = replace(context.worn, windows=tuple(moved)).on_one_mounting
    assert {w.observed.mounting for w in mounted} == {0, 1}
    for before, after in zip(context.windows, mounted, strict=True):
        z, back = before.observed.lines["encoder"][0], after.observed.lines["encoder"][0]
        if after.observed.worn and np.isfinite(z):
            assert abs(np.angle(back / z)) < 0.05


def shifted(w):
    """The window after the disc was moved: its mean jumped, its lines turned by 0.8 rad of the mesh."""
    o = w.observed
    lines = {name: y * np.exp(0.8j * np.arange(1, y.size + 1)) for name, y in o.lines.items()}
    mean = None if o.mean is None else o.mean + 30e-6
    return replace(w, observed=replace(o, lines=lines, mean=mean))
