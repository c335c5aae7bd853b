"""A change of the machine ends what it must of the twin's memory, and nothing else: compared field by field."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from functools import lru_cache
from pathlib import Path

import pytest

from service.files.rig import rig_of
from service.stream.sources.mcap import Recording, read_windows
from tests.effects_cases import INSTANCES
from twin.assessment import LevelReading, Unavailable
from twin.effects import EFFECTS
from twin.effects.addition import Addition
from twin.effects.facts import CHANGES
from twin.errors import ParameterError
from twin.features.indicator_record import ResidualRecord
from twin.features.window_features import WindowFeatures
from twin.machine_change import MachineChange
from twin.machine_changes import changed
from twin.options import Options
from twin.revolution_count import CountOffset, counted
from twin.state import State
from twin.step import change, step
from twin.tracing.attribution import AttributedEffect
from twin.tracing.state import TwinStage, relevant
from twin.updating.carried_over import CARRIED

SHORT = Path(__file__).resolve().parents[2] / "recordings" / "short-campaign.mcap"
NO_TRACE = Options(trace=False)
WORN = 5  # windows of the recording after which the gears are worn by 20 µm
FOUND = ("gear_eccentricity", "misalignment", "tooth_crack", "torque_ripple", "sensor_gain")


@lru_cache(maxsize=1)
def recorded():
    with Recording(SHORT) as recording:
        rig = rig_of(recording, None)
    return rig, tuple(read_windows(SHORT)[2])


@lru_cache(maxsize=1)
def worn() -> State:
    """A machine with worn gears and one effect of every kind, as the twin remembers it."""
    rig, windows = recorded()
    state = State()
    for window in windows[:WORN]:
        state, _ = step(rig, state, window, NO_TRACE)
    found = tuple(
        AttributedEffect(addition=Addition(effect=INSTANCES[name][0]), parameters={}, log_evidence=10.0, numbers=())
        for name in FOUND
    )
    memory = state.memory
    additions = relevant(found)
    stages = tuple(TwinStage(memory=replace(memory, effects=additions[:n])) for n in range(len(additions) + 1))
    return replace(
        state,
        levels={"10 Hz": LevelReading(level=5.0, window=4)},
        residual_records=tuple(
            ResidualRecord(sensor=s, gear="pinion", speed=10.0, torque=None, windows=3, mean_variance=1.0)
            for s in ("y6", "y7")
        ),
        tracing=replace(
            state.tracing, found=found, stages=stages, measured=9, next_search=12, next_trace=10, phase=0.3,
            turns=((1, 0.2),), signs={"waveform": 0.1},
            decisions={"misalignment": "accepted", "pitch_error": "rejected"},
        ),
    )  # fmt: skip


def after(kind: str, **given) -> State:
    return changed(recorded()[0], worn(), MachineChange(kind=kind, **given), NO_TRACE)


def leaves(value, path=""):
    """Every number, string and list of a state, by its place."""
    if isinstance(value, dict) and value:
        for key, item in value.items():
            yield from leaves(item, f"{path}.{key}" if path else key)
    else:
        yield path, value


def parts(state: State) -> dict:
    """The state by its places; of the stages, the memory of the twin in use."""
    data = asdict(state)
    for name in ("stages", "start", "found"):
        del data["tracing"][name]
    data["effects"] = [found.name for found in state.tracing.found]
    data["memory"] = asdict(state.memory)
    del data["memory"]["effects"]
    data["history"] = state.history
    return dict(leaves(data))


def differing(kind: str, **given) -> set[str]:
    before, now = parts(worn()), parts(after(kind, **given))
    return {path for path in before.keys() | now.keys() if before.get(path) != now.get(path)}


SINCE_NOW = {"tracing.started", "tracing.signs", "tracing.signs.waveform"}  # the history of this state is empty
RECENT = {"recent"}
DISCS = {"memory.phase", "memory.phase_std", "memory.offset", "memory.offset.value", "memory.offset.var",
         "memory.offset.torque", "memory.unworn_before"}  # fmt: skip
ANGLES = {"tracing.phase", "tracing.turns"}
PENDING = {"count.pending", "count.seen"}
LEVELS = {"levels", "levels.10 Hz.level", "levels.10 Hz.window", "residual_records", "learned_levels"}
HISTORY = {"history"}  # as one
VERDICT = {"rhythm.index", "rhythm.start_time_ns"}
SEARCH = {"tracing.next_trace"}  # next_search is due at the same number of windows as it was


@pytest.mark.parametrize(
    "kind, given, ended",
    [
        ("oil_changed", {}, {"memory.track.var_rate", "tracing.widened"}),
        ("sensor_moved", {"sensor": "y7"}, {"residual_records"}),
        (
            "sensor_moved",
            {"sensor": "y6"},
            {"effects", "memory.path", "memory.unworn", "memory.segments"} | LEVELS | RECENT | SINCE_NOW | SEARCH,
        ),
        (
            "counter_reset",
            {},
            {"count.at", "memory.segments"} | PENDING | DISCS | ANGLES | SINCE_NOW | SEARCH,
        ),
        (
            "reassembled",
            {},
            {
                "effects", "memory.path", "memory.mesh", "memory.segments", "memory.compliance_scale",
                "memory.fit.calibration.modal_damping", "memory.fit.calibration.damping_time",
                "memory.fit.std.modal_damping", "memory.fit.std.damping_time", "tracing.decisions.misalignment",
            } | LEVELS | RECENT | DISCS | ANGLES | SINCE_NOW | SEARCH | HISTORY | VERDICT,
        ),
    ],
    ids=["oil", "another sensor", "the sensor", "counter", "reassembled"],
)  # fmt: skip
def test_a_change_ends_what_it_must_and_nothing_else(kind, given, ended):
    found = differing(kind, **given)
    assert found <= ended, f"ended besides: {sorted(found - ended)}"
    optional = {"memory.offset", "levels", "tracing.signs"}  # empty on one side, mappings on the other
    assert ended - optional <= found, f"not ended: {sorted(ended - optional - found)}"


def test_depth_and_profile_outlive_every_change_but_other_gears():
    depth = worn().memory.depth
    assert depth > 15e-6
    for kind in CHANGES:
        now = after(kind, **({"sensor": "y6"} if kind == "sensor_moved" else {}))
        assert now.memory.depth == (0.0 if kind == "gears_replaced" else depth)
        track, before = now.memory.track, worn().memory.track
        if kind != "gears_replaced":
            assert (track.work, track.rate, track.revolutions) == (before.work, before.rate, before.revolutions)
            assert (track.var_rate > before.var_rate) == (kind == "oil_changed")


def test_replaced_gears_begin_unworn_on_the_structure_that_is_known():
    before, now = worn(), after("gears_replaced")
    old, memory = before.memory, now.memory
    assert (memory.fit, memory.compliance_scale, memory.path) == (old.fit, old.compliance_scale, old.path)
    assert memory.unworn == old.unworn[: CARRIED.calibration_windows] and memory.unworn_before == len(memory.unworn)
    assert (memory.segments, memory.mesh, memory.phase, memory.offset) == ((), (), None, None)
    assert (memory.track.work, memory.track.windows, memory.rms_track.work) == (0.0, 0, 0.0)
    assert memory.track.rate == old.track.rate  # the coefficient learned is the prior of the next pair ...
    assert memory.track.rate_std / memory.track.rate >= CARRIED.pair_to_pair  # ... as wide as pairs differ
    assert now.latest.wear is None and now.latest.life is None and now.levels == {} and now.recent == ()
    assert now.latest.calibration == before.latest.calibration
    assert now.windows_seen == before.windows_seen  # windows keep their numbers through all epochs


@pytest.mark.parametrize(
    "kind, given, gone",
    [
        ("gears_replaced", {}, {"gear_eccentricity", "misalignment", "tooth_crack"}),
        ("sensor_moved", {"sensor": "y6"}, {"sensor_gain"}),
        ("sensor_moved", {"sensor": "y7"}, set()),
        ("oil_changed", {}, set()),
        ("counter_reset", {}, set()),
        ("reassembled", {}, {"gear_eccentricity", "misalignment"}),
    ],
)
def test_an_effect_ends_with_the_part_that_it_belongs_to(kind, given, gone):
    now = after(kind, **given)
    names = [f.name for f in now.tracing.found]
    assert names == [name for name in FOUND if name not in gone]
    staged = [[a.name for a in s.memory.effects] for s in now.tracing.stages]
    expected = [a.name for a in relevant(now.tracing.found)]
    assert staged == [expected[:n] for n in range(len(expected) + 1)]
    assert ("misalignment" in now.tracing.decisions) == ("misalignment" in names)


def test_every_effect_ends_by_changes_that_there_are():
    for name, kind in EFFECTS.items():
        assert set(kind.facts.ended_by) <= set(CHANGES), name
        elsewhere = kind.facts.acts_on in ("bearing", "sensor", "unknown") or name == "torque_ripple"
        assert ("gears_replaced" in kind.facts.ended_by) != elsewhere


@pytest.mark.parametrize("kind", CHANGES)
def test_a_changed_state_survives_json(kind):
    now = after(kind, **({"sensor": "y6"} if kind == "sensor_moved" else {}))
    text = json.dumps(now.to_dict(), allow_nan=False)
    assert json.dumps(State.from_dict(json.loads(text)).to_dict(), allow_nan=False) == text


def test_after_replaced_gears_nothing_is_said_of_wear_until_a_window_of_theirs():
    state, answer = change(recorded()[0], worn(), MachineChange(kind="gears_replaced"), NO_TRACE)
    assert isinstance(answer.wear, Unavailable) and "gears have been replaced" in answer.wear.reason
    _, kept = change(recorded()[0], worn(), MachineChange(kind="oil_changed"), NO_TRACE)
    assert kept.wear == worn().latest.wear
    assert state.latest.wear is None


@pytest.mark.slow
def test_the_same_campaign_on_the_next_pair_gives_the_same_depths():
    """The first windows of the campaign once more after the gears were replaced: as of new gears."""
    rig, windows = recorded()
    state, depths = after("gears_replaced"), []
    for window in windows[2:WORN]:
        state, answer = step(rig, state, window, NO_TRACE)
        depths.append(answer.window.depth)
    fresh = [s for s in fresh_depths()]
    for now, then in zip(depths, fresh, strict=True):
        assert abs(now.median - then.median) < 0.5e-6
    assert state.counted == pytest.approx(800.8, abs=0.1)


@lru_cache(maxsize=1)
def fresh_depths():
    rig, windows = recorded()
    state, out = State(), []
    for window in windows[:WORN]:
        state, answer = step(rig, state, window, NO_TRACE)
        out.append(answer.window.depth)
    return out[2:]


@pytest.mark.parametrize("kind", ["reassembled", "sensor_moved", "counter_reset", "oil_changed"])
def test_the_depth_goes_on_after_a_change_that_keeps_it(kind):
    rig, windows = recorded()
    worn_only = replace(worn(), tracing=replace(worn().tracing, found=(), stages=worn().tracing.stages[:1], measured=3))
    made = MachineChange(kind=kind, sensor="y6" if kind == "sensor_moved" else None)
    state = changed(rig, worn_only, made, NO_TRACE)
    _, expected = step(rig, worn_only, windows[WORN], NO_TRACE)
    _, answer = step(rig, state, windows[WORN], NO_TRACE)
    assert answer.window.depth.median == pytest.approx(expected.window.depth.median, rel=0.03)


def features(revolutions: float) -> WindowFeatures:
    return WindowFeatures(start_time_ns=0, duration=1.0, quality="good", revolutions=revolutions)


@pytest.mark.parametrize(
    "kind, given, encoder, revolutions",
    [
        ("gears_replaced", {}, 20.0, 20.0),  # the counter began again with the gears
        ("gears_replaced", {}, 9100.0, 100.0),  # it counts on
        ("gears_replaced", {"at": 9050.0}, 9100.0, 50.0),  # ... and the count at the replacement is known
        ("counter_reset", {}, 20.0, 9020.0),
        ("counter_reset", {"at": 9400.0}, 20.0, 9420.0),  # it ran on before it was reset
        ("counter_reset", {"began": 10.0}, 20.0, 9010.0),
        ("counter_reset", {}, 9100.0, 9100.0),  # it was not reset after all
    ],
)
def test_revolutions_of_the_present_gears_follow_the_counter(kind, given, encoder, revolutions):
    count = CountOffset().awaiting(kind, 9000.0, given.get("at"), given.get("began", 0.0))
    count, window = counted(count, features(encoder))
    assert window.revolutions == pytest.approx(revolutions)
    count, later = counted(count, features(encoder + 500.0))
    assert later.revolutions == pytest.approx(revolutions + 500.0)


def test_a_counter_that_is_reset_twice_goes_on_from_the_sum():
    count = CountOffset().awaiting("counter_reset", 9000.0, None)
    count, _ = counted(count, features(100.0))
    count = count.awaiting("counter_reset", 9100.0, None)
    _, window = counted(count, features(30.0))
    assert window.revolutions == pytest.approx(9130.0)


def test_a_change_that_there_is_not_is_refused_with_those_that_there_are():
    with pytest.raises(ParameterError, match=r"'painted' is no change of a machine; one of gears_replaced, "):
        MachineChange(kind="painted")
    with pytest.raises(ParameterError, match="which one was moved"):
        MachineChange(kind="sensor_moved")
