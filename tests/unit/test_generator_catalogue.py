"""The bundled recordings are those of the catalogue, and come again from their specs."""

import hashlib
import json
import tomllib

import numpy as np
import pytest
from mcap.reader import make_reader

from recordings.generator import simulate
from recordings.generator.deliver import frames
from recordings.generator.spec import read
from service.stream.wire import gearbox_pb2
from tests.generator_instances import RECORDINGS, rig

CATALOGUE = tomllib.loads((RECORDINGS / "catalogue.toml").read_text(encoding="utf-8"))
ENTRIES = {entry["file"]: entry for entry in CATALOGUE["recordings"]}


def messages(path):
    """topic → decoded frames of a recording, by time."""
    out = {}
    with path.open("rb") as stream:
        for schema, channel, message in make_reader(stream, validate_crcs=True).iter_messages():
            kind = getattr(gearbox_pb2, schema.name.rpartition(".")[2])
            out.setdefault(channel.topic, []).append(kind.FromString(message.data))
    return out


def test_the_catalogue_lists_every_recording_and_no_other():
    assert {p.name for p in RECORDINGS.glob("*.mcap")} == set(ENTRIES)


@pytest.mark.parametrize("name", ENTRIES)
def test_a_recording_is_the_one_of_the_catalogue(name):
    entry, data = ENTRIES[name], (RECORDINGS / name).read_bytes()
    assert len(data) == entry["bytes"]
    assert hashlib.sha256(data).hexdigest() == entry["sha256"]
    topics = {f"gearbox/{entry['asset']}/{c['channel']}" for c in CATALOGUE["channels"]}
    assert set(messages(RECORDINGS / name)) == topics
    for key in ("spec", "truth", "rig"):
        assert (RECORDINGS / entry[key]).is_file()


@pytest.mark.parametrize("name", ENTRIES)
def test_a_recording_has_the_windows_of_its_spec(name):
    entry = ENTRIES[name]
    spec = read(tomllib.loads((RECORDINGS / entry["spec"]).read_text(encoding="utf-8")))
    truth = json.loads((RECORDINGS / entry["truth"]).read_text(encoding="utf-8"))
    seconds = [c["seconds"] for c in spec["calibration"]]
    seconds += [spec["windows"]["seconds"]] * len(spec["windows"]["at_revolutions"])
    for channel in messages(RECORDINGS / name).values():
        assert len(channel) == sum(s / spec["sensors"]["frame_seconds"] for s in seconds)
    starts = {w["start_time_ns"] for w in truth["windows"]}
    assert starts <= {m.start_time_ns for m in messages(RECORDINGS / name)[f"gearbox/{entry['asset']}/accel/y6"]}


def test_the_papers_campaign_wears_as_the_paper_tells():
    """156 µm at 6000 revolutions, both flanks together, 73 % of it on the pinion (Feng et al., section 5)."""
    truth = json.loads((RECORDINGS / "truth" / "paper-campaign.json").read_text(encoding="utf-8"))
    at = {round(w["worn_revolutions"]): w["depth"] for w in truth["windows"]}
    assert at[6000]["combined_um"] == pytest.approx(156, abs=2)
    assert at[6000]["pinion_um"] / at[6000]["combined_um"] == pytest.approx(0.73, abs=0.01)
    assert {6000, 12000, 18000} <= set(at)


def test_levels_grow_with_wear_as_in_the_reference_campaigns():
    """0–2 kHz RMS at 10 Hz, 10 N·m of another simulated machine: sane within a factor of two."""
    depth, level = [0.0, 25.0, 74.0, 124.0, 200.0], [3.3, 13.0, 33.0, 53.0, 85.0]
    truth = json.loads((RECORDINGS / "truth" / "paper-campaign.json").read_text(encoding="utf-8"))
    windows = [w for w in truth["windows"] if w["kind"] == "measurement" and w["depth"]["combined_um"] < 200]
    assert len(windows) == 6
    for w in windows:
        expected = np.interp(w["depth"]["combined_um"], depth, level)
        assert 0.5 * expected < w["rms_true_2k"] < 2 * expected


@pytest.mark.slow
def test_the_short_campaign_comes_again_from_its_spec():
    """To the converter's step and the clock's tick: other processors round the last bits otherwise."""
    entry = ENTRIES["short-campaign.mcap"]
    spec = tomllib.loads((RECORDINGS / entry["spec"]).read_text(encoding="utf-8"))
    campaign = simulate({**spec, "truth": {"to_end_of_life": False}}, rig())
    made = {}
    for topic, (_, message) in frames(campaign):
        made.setdefault(topic, []).append(message)
    stored = messages(RECORDINGS / entry["file"])
    assert set(made) == set(stored)
    for topic, channel in stored.items():
        for old, new in zip(channel, made[topic], strict=True):
            assert old.start_time_ns == new.start_time_ns and old.sequence == new.sequence
            if "encoder" in topic:
                assert old.first_edge_index == new.first_edge_index
                assert np.allclose(old.edge_offset_ns, new.edge_offset_ns, rtol=0, atol=20.5)
            else:
                step = 2 * (1000.0 if "accel" in topic else 50.0) / 2**16
                assert np.allclose(old.values, new.values, rtol=0, atol=1.5 * step)
