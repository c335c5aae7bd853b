"""From a campaign to its files: the recording, and the truth apart from it."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from recordings.generator.campaign import Campaign, Progress, simulate
from recordings.generator.errors import SpecError
from recordings.generator.faults import FAULTS, SAMPLES_ONLY
from recordings.generator.writer import Frame, encoder_frames, sample_frames, write_mcap


def frames(campaign: Campaign) -> Iterator[tuple[str, Frame]]:
    """(topic, frame) of the whole campaign in the order of arrival, the spec's faults put in."""
    spec = campaign.spec
    rng = np.random.default_rng([spec["seed"], 100])
    names = (f"accel/{campaign.accelerometer}", "torque/pinion", "encoder/pinion", "encoder/gear")
    sequence = {name: int(rng.integers(0, 5000)) for name in names}
    s = spec["sensors"]
    for index, w in enumerate(campaign.windows):
        seconds = w.acceleration.size / s["acceleration_rate_hz"]
        cut = {
            names[0]: sample_frames(
                w.acceleration,
                s["acceleration_rate_hz"],
                w.start_time_ns,
                s["frame_seconds"],
                sequence[names[0]],
            ),
            names[1]: sample_frames(
                w.torque, s["torque_rate_hz"], w.start_time_ns, s["frame_seconds"], sequence[names[1]]
            ),
        }
        for name, (first, times), per_rev in zip(
            names[2:], (w.pinion_edges, w.gear_edges), campaign.edges_per_rev, strict=True
        ):
            cut[name] = encoder_frames(
                first, times, per_rev, w.start_time_ns, seconds, s["frame_seconds"], sequence[name]
            )
        for name in names:
            sequence[name] += len(cut[name])
        for name in s["missing"]:
            del cut[name]
        for fault in spec["faults"]:
            if fault["window"] == index:
                cut[fault["channel"]] = _spoilt(fault, cut, rng)
        yield from _arriving(f"gearbox/{spec['asset']}/", cut)


def _spoilt(fault: Mapping[str, Any], cut: Mapping[str, list[Frame]], rng) -> list[Frame]:
    channel, kind = fault["channel"], fault["kind"]
    if channel not in cut:
        raise SpecError(f"faults: channel = {channel!r} must be one of {', '.join(cut)}")
    if kind in SAMPLES_ONLY and channel.startswith("encoder"):
        raise SpecError(f"faults: {kind} is for sampled channels, not for {channel}")
    return FAULTS[kind].apply(cut[channel], fault, rng)


def _arriving(prefix: str, cut: Mapping[str, list[Frame]]) -> Iterator[tuple[str, Frame]]:
    """All channels' frames by time, each channel in its own order even where that is disturbed."""
    queue = []
    for name, channel in cut.items():
        latest = 0
        for frame in channel:
            latest = max(latest, frame[0])
            queue.append((latest, prefix + name, frame))
    for _, topic, frame in sorted(queue, key=lambda item: item[0]):
        yield topic, frame


def write(campaign: Campaign, path, truth_path=None, rig_toml: str | None = None) -> None:
    """Writes the recording to `path`, and the truth to `truth_path` (JSON) where one is given.

    `rig_toml`, the text of the rig file, is attached to the recording.
    """
    spec = campaign.spec
    prefix = f"gearbox/{spec['asset']}/"
    channels = {
        f"accel/{campaign.accelerometer}": "SampleFrame",
        "torque/pinion": "SampleFrame",
        "encoder/pinion": "EncoderFrame",
        "encoder/gear": "EncoderFrame",
    }
    channels = {prefix + name: kind for name, kind in channels.items() if name not in spec["sensors"]["missing"]}
    metadata = {key: spec[key] for key in ("asset", "description", "started")}
    write_mcap(Path(path), channels, frames(campaign), metadata, rig_toml)
    if truth_path is not None:
        Path(truth_path).write_text(json.dumps(campaign.truth, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def simulate_file(spec_path, out_path, truth_path=None, progress: Progress | None = None) -> Campaign:
    """Simulates the campaign of a spec file (TOML); its rig file is sought from the spec's folder."""
    spec_path = Path(spec_path)
    spec = _toml(spec_path)
    rig_path = spec_path.parent / spec.get("rig", "../rigs/unsw.toml")
    campaign = simulate(spec, _toml(rig_path), progress)
    write(campaign, out_path, truth_path, rig_path.read_text(encoding="utf-8"))
    return campaign


def _toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise SpecError(f"{path}: {error.strerror}") from error
    except tomllib.TOMLDecodeError as error:
        raise SpecError(f"{path} is no TOML: {error}") from error
