"""A small campaign from spec to file: what the contract asks of a recording, and its faults."""

import copy
import json

import numpy as np
import pytest
from mcap.reader import make_reader

from recordings import simulate_file
from recordings.generator import SpecError, simulate, write
from recordings.generator.deliver import frames
from service.stream.wire import gearbox_pb2
from tests.generator_instances import RECORDINGS, SPEC, rig

Y6, TORQUE = "gearbox/test-rig/accel/y6", "gearbox/test-rig/torque/pinion"
PINION, GEAR = "gearbox/test-rig/encoder/pinion", "gearbox/test-rig/encoder/gear"


@pytest.fixture(scope="module")
def campaign():
    return simulate(SPEC, rig())


@pytest.fixture(scope="module")
def recording(campaign, tmp_path_factory):
    folder = tmp_path_factory.mktemp("recording")
    write(campaign, folder / "a.mcap", folder / "a.json", "name = 'a rig'\n")
    return folder


def by_topic(campaign):
    out = {}
    for topic, frame in frames(campaign):
        out.setdefault(topic, []).append(frame)
    return out


def spoilt(campaign, *faults):
    """The same campaign with faults in its delivery."""
    other = copy.copy(campaign)
    other.spec = {**campaign.spec, "faults": tuple({"channel": "accel/y6", "window": 1, **f} for f in faults)}
    return by_topic(other)[Y6]


@pytest.mark.slow
def test_the_file_is_as_the_contract_asks(recording):
    with (recording / "a.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        names = {c.topic: summary.schemas[c.schema_id].name for c in summary.channels.values()}
        encodings = {c.message_encoding for c in summary.channels.values()}
        encodings |= {s.encoding for s in summary.schemas.values()}
        attachments = [(a.name, a.media_type, a.data) for a in reader.iter_attachments()]
        metadata = {m.name: m.metadata for m in reader.iter_metadata()}
        messages = list(reader.iter_messages())
    assert names == {
        Y6: "gearbox.v1.SampleFrame",
        TORQUE: "gearbox.v1.SampleFrame",
        PINION: "gearbox.v1.EncoderFrame",
        GEAR: "gearbox.v1.EncoderFrame",
    }
    assert encodings == {"protobuf"}
    assert summary.chunk_indexes and all(c.compression == "zstd" for c in summary.chunk_indexes)
    assert attachments == [("rig.toml", "application/toml", b"name = 'a rig'\n")]
    assert set(metadata["recording"]) == {"asset", "description", "started"}
    assert len(messages) == 4 * 2 * 3
    for _, channel, message in messages:
        assert message.log_time == message.publish_time
        if channel.topic == Y6:
            frame = gearbox_pb2.SampleFrame.FromString(message.data)
            assert message.log_time - frame.start_time_ns == round(len(frame.values) / frame.sample_rate_hz * 1e9)


def test_the_recording_does_not_hold_the_truth(recording):
    data = (recording / "a.mcap").read_bytes()
    assert b"effects" not in data and b"depth" not in data
    truth = json.loads((recording / "a.json").read_text(encoding="utf-8"))
    assert [w["kind"] for w in truth["windows"]] == ["calibration", "measurement", "measurement"]
    assert truth["windows"][2]["depth"]["combined_um"] == pytest.approx(2.6, rel=0.1)


def test_sequence_numbers_count_up_over_all_windows(campaign):
    for channel in by_topic(campaign).values():
        numbers = [message.sequence for _, message in channel]
        assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))


def test_edges_are_counted_on_within_and_between_windows(campaign):
    channel = [m for _, m in by_topic(campaign)[PINION]]
    for one, two in ((0, 1), (2, 3), (4, 5)):
        assert channel[two].first_edge_index == channel[one].first_edge_index + len(channel[one].edge_offset_ns)
    for window, frame in zip(campaign.truth["windows"], channel[::2], strict=True):
        middle = frame.first_edge_index / 1024 + window["speed_hz"] * 0.25
        assert 0 <= middle - window["revolutions"] < 1.01  # the disc's own angle
        assert np.all(np.diff(frame.edge_offset_ns) > 0)


def test_both_encoders_tell_the_ratio_of_the_teeth(campaign):
    pinion, gear = (by_topic(campaign)[t] for t in (PINION, GEAR))
    turns = [(c[-1][1].first_edge_index - c[0][1].first_edge_index) / n for c, n in ((pinion, 1024), (gear, 2048))]
    assert turns[0] / turns[1] == pytest.approx(52 / 19, rel=2e-3)


@pytest.mark.slow
def test_the_same_spec_gives_the_same_bits_and_another_seed_another_machine():
    small = {
        **SPEC,
        "machine": {"slices": 1},
        "calibration": [],
        "windows": {"seconds": 0.25, "at_revolutions": [30]},
    }
    one, again, other = simulate(small, rig()), simulate(small, rig()), simulate({**small, "seed": 6}, rig())
    assert np.array_equal(one.windows[0].acceleration, again.windows[0].acceleration)
    assert np.array_equal(one.windows[0].gear_edges[1], again.windows[0].gear_edges[1])
    assert one.truth == again.truth
    assert not np.array_equal(one.windows[0].acceleration, other.windows[0].acceleration)


@pytest.mark.slow
def test_instrument_effects_act_on_the_accelerometer_alone(campaign):
    effects = [
        {"name": "sensor_gain", "gain": 0.5},
        {
            "name": "mains_interference",
            "frequencies_hz": [100.0],
            "amplitudes": [3.0],
            "onset_revolutions": 50,
        },
    ]
    disturbed = simulate({**SPEC, "effects": effects}, rig())
    assert [w["effects_active"] for w in disturbed.truth["windows"]] == [["sensor_gain"]] * 2 + [
        ["sensor_gain", "mains_interference"]
    ]
    plain, gained = campaign.windows[1].acceleration, disturbed.windows[1].acceleration
    assert gained.std() / plain.std() == pytest.approx(0.5, rel=0.02)
    t = np.arange(6400) / 12800
    tone = 2 * abs(np.mean(disturbed.windows[2].acceleration * np.exp(-2j * np.pi * 100 * t)))
    assert tone == pytest.approx(3.0, rel=0.1)
    for one, two in zip(campaign.windows[:2], disturbed.windows[:2], strict=True):
        assert np.array_equal(one.torque, two.torque)
        assert np.array_equal(one.pinion_edges[1], two.pinion_edges[1])


@pytest.mark.slow
def test_instruments_may_drift_and_be_missing(campaign, tmp_path):
    faulty = {
        "encoder_drift_um": 50.0,
        "torque_drift_nm": 1.0,
        "drift_revolutions": 50,
        "missing": ["encoder/gear"],
    }
    other = simulate({**SPEC, "sensors": faulty}, rig())
    share = 1 - np.exp(-2.0)  # at 100 revolutions
    assert other.truth["windows"][2]["drifted"] == pytest.approx(share, rel=1e-6)
    one, two = campaign.windows[2], other.windows[2]
    assert np.mean(two.torque - one.torque) == pytest.approx(share, abs=2e-3)
    radius = rig()["gears"]["gear"]["base_radius"]
    edges = [np.interp(0.25, e[1], e[0] + np.arange(e[1].size)) for e in (one.gear_edges, two.gear_edges)]
    assert (edges[0] - edges[1]) / 2048 * 2 * np.pi * radius == pytest.approx(50e-6 * share, rel=0.05)
    assert one.pinion_edges[0] == two.pinion_edges[0]
    write(other, tmp_path / "x.mcap")
    with (tmp_path / "x.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert {c.topic for c in summary.channels.values()} == {Y6, TORQUE, PINION}


@pytest.mark.slow
def test_wear_may_start_later_than_the_count(campaign):
    late = simulate({**SPEC, "wear": {"k_m2_per_n": 6e-12, "from_revolutions": 60}}, rig())
    assert late.truth["windows"][1]["depth"]["combined_um"] == 0.0
    whole = campaign.truth["windows"][2]["depth"]["combined_um"]
    assert 0.3 * whole < late.truth["windows"][2]["depth"]["combined_um"] < 0.7 * whole


def test_lost_frames_leave_a_gap_in_the_sequence(campaign):
    numbers = [m.sequence for _, m in spoilt(campaign, {"kind": "lost", "count": 1})]
    assert len(numbers) == 5 and set(range(min(numbers), min(numbers) + 6)) - set(numbers)


def test_duplicate_frames_come_twice(campaign):
    numbers = [m.sequence for _, m in spoilt(campaign, {"kind": "duplicate", "count": 1})]
    assert len(numbers) == 7 and len(set(numbers)) == 6


def test_disordered_frames_come_late(campaign):
    numbers = [m.sequence for _, m in spoilt(campaign, {"kind": "disorder", "count": 1})]
    assert len(numbers) == 6 and numbers != sorted(numbers)


def test_nan_samples_are_as_many_as_asked_for(campaign):
    values = np.concatenate([m.values for _, m in spoilt(campaign, {"kind": "nan", "count": 3})])
    assert 1 <= np.isnan(values).sum() <= 3


def test_clipping_ends_at_its_level(campaign):
    clipped = np.concatenate([m.values for _, m in spoilt(campaign, {"kind": "clipping", "level": 5.0})][2:4])
    assert abs(clipped).max() == 5.0 and (abs(clipped) == 5.0).sum() > 10


def test_faults_of_samples_are_refused_for_encoders(campaign):
    with pytest.raises(SpecError, match="nan is for sampled channels, not for encoder/gear"):
        spoilt(campaign, {"kind": "nan", "count": 1, "channel": "encoder/gear"})
    with pytest.raises(SpecError, match="channel = 'accel/y7' must be one of accel/y6"):
        spoilt(campaign, {"kind": "nan", "count": 1, "channel": "accel/y7"})


def test_a_spec_that_is_no_toml_or_not_there_is_one_clear_error(tmp_path):
    with pytest.raises(SpecError, match=r"nowhere.toml: No such file"):
        simulate_file(tmp_path / "nowhere.toml", tmp_path / "x.mcap")
    (tmp_path / "bad.toml").write_text("seed = = 3")
    with pytest.raises(SpecError, match=r"bad.toml is no TOML"):
        simulate_file(tmp_path / "bad.toml", tmp_path / "x.mcap")


@pytest.mark.slow
def test_a_rig_without_what_a_simulation_needs_is_named():
    for table in ("inertias", "mesh", "encoders", "end_of_life"):
        poor = {k: v for k, v in rig().items() if k != table}
        with pytest.raises(SpecError, match=f"the rig file does not give '{table}'"):
            simulate({**SPEC, "truth": {"to_end_of_life": True}}, poor)


@pytest.mark.slow
def test_progress_is_told_and_the_rig_file_is_attached(tmp_path):
    text = (RECORDINGS / "rigs" / "unsw.toml").read_text(encoding="utf-8")
    (tmp_path / "rig.toml").write_text(text, encoding="utf-8")
    (tmp_path / "spec.toml").write_text(
        'schema = "gear-campaign/1"\nrig = "rig.toml"\nasset = "tiny"\nseed = 1\n[wear]\nk_m2_per_n = 0\n'
        "[machine]\nslices = 1\n[[conditions]]\nspeed_hz = 10\ntorque_nm = 10\n"
        "[windows]\nseconds = 0.25\nat_revolutions = [0]\n",
        encoding="utf-8",
    )
    told = []
    simulate_file(tmp_path / "spec.toml", tmp_path / "x.mcap", progress=lambda share, what: told.append((share, what)))
    assert told[0][0] == 0.0 and told[-1] == (1.0, "done")
    with (tmp_path / "x.mcap").open("rb") as stream:
        assert next(iter(make_reader(stream).iter_attachments())).data.decode() == text
