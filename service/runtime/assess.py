"""A whole recording through the twin, without a server: `gear-twin assess`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from service.contract.answer import RigSummary, assemble
from service.errors import FrameError, InputError
from service.files.rig import Source, choose_asset, rig_of
from service.runtime.outcomes import Outcome
from service.runtime.pipeline import Pipeline
from service.runtime.twin_port import Twin, gear_twin
from service.stream.assembly import DEFAULT, AssemblySettings
from service.stream.sources.mcap import Recording
from service.stream.wire.topics import PREFIX, Channel, topic_of
from twin.rig import Rig

Progress = Callable[[float, int], None]  # share of the file read, windows done


def assess(
    path: str | Path,
    rig_path: str | Path | None = None,
    options: Any = None,
    progress: Progress = lambda share, windows: None,
    *,
    asset: str | None = None,
    prefix: str = PREFIX,
    assembly: AssemblySettings = DEFAULT,
    twin: Twin | None = None,
    enough: Callable[[Sequence[Mapping[str, Any]]], bool] = lambda records: False,
) -> dict[str, Any]:
    """The answer of section 4 about a recording's asset; InputError where it cannot be used, or not assessed.

    twin    its functions; None for the twin itself, with `options`
    enough  ends the reading early, once it holds for the window records so far
    """
    return assess_with_state(
        path, rig_path, options, progress, asset=asset, prefix=prefix, assembly=assembly, twin=twin, enough=enough
    )[2]


def assess_with_state(
    path: str | Path,
    rig_path: str | Path | None = None,
    options: Any = None,
    progress: Progress = lambda share, windows: None,
    *,
    asset: str | None = None,
    prefix: str = PREFIX,
    assembly: AssemblySettings = DEFAULT,
    twin: Twin | None = None,
    enough: Callable[[Sequence[Mapping[str, Any]]], bool] = lambda records: False,
) -> tuple[Rig, Any, dict[str, Any]]:
    """The rig, the twin's state after the last window, and the answer; as `assess`."""
    with Recording(path, prefix) as recording:
        asset = choose_asset(recording, asset)
        rig = rig_of(recording, rig_path)
        twin = twin or gear_twin(options)
        return assess_source(recording, asset, rig, twin, progress, prefix=prefix, assembly=assembly, enough=enough)


def assess_source(
    recording: Source,
    asset: str,
    rig: Rig,
    twin: Twin,
    progress: Progress = lambda share, windows: None,
    *,
    prefix: str = PREFIX,
    assembly: AssemblySettings = DEFAULT,
    enough: Callable[[Sequence[Mapping[str, Any]]], bool] = lambda records: False,
) -> tuple[Rig, Any, dict[str, Any]]:
    """The same of a recording that is open."""
    results = _Results()
    records = results.records
    assembly = assembly.waiting_for(recording.labels(asset))
    pipeline = Pipeline(lambda name: rig, twin, results, assembly=assembly)

    def reject(channel: Channel, error: FrameError) -> None:
        if channel.asset == asset:
            pipeline.reject(channel, error)

    for frame in recording.frames(reject):
        if frame.channel.asset == asset:
            pipeline.feed(frame)
            progress(recording.bytes_read / recording.size, len(records))
            if enough(records):
                break
    else:
        pipeline.flush(asset)
    progress(1.0, len(records))
    quality = pipeline.quality(asset) | {"recording": list(recording.faults)}
    answer = assemble(asset, records, results.report, quality)
    answer["rig"] = RigSummary.of(rig).as_json()
    _demand_assessment(recording.path, answer, prefix)
    return rig, results.state, answer


class _Results:
    """A `ResultSink` that keeps the records and the newest report."""

    def __init__(self) -> None:
        self.records: list[Mapping[str, Any]] = []
        self.report: Mapping[str, Any] | None = None
        self.state: Any = None

    def commit(self, outcome: Outcome) -> bool:
        self.records.append(outcome.record)
        self.report, self.state = outcome.report, outcome.state
        return True

    def publish(self, outcome: Outcome) -> None:
        """Nobody watches."""


class Unassessable(InputError):
    """A recording that could be read but not assessed; `answer` holds what is known of it all the same."""

    def __init__(self, message: str, answer: dict[str, Any]):
        super().__init__(message)
        self.answer = answer


def _demand_assessment(path: str | Path, answer: dict[str, Any], prefix: str) -> None:
    """Some window must have been used, and the twin compared where the rig file says that it can be."""
    records, quality = answer["windows"], answer["data_quality"]
    asset, missing = answer["asset"], quality["missing_channels"]
    needed = [label for label in missing if label.split("/")[0] in ("accel", "torque")]
    compared = any(record.get("rms_predicted") is not None for record in records)
    used = [record for record in records if record["quality"] != "refused"]
    if used and (compared or not needed):
        return
    absent_labels = missing if not used else needed
    topics = ", ".join(topic_of(Channel(asset, *label.split("/")), prefix) for label in absent_labels)
    absent = f"the rig file names {topics}, which the recording does not have" if topics else ""
    if used:
        raise Unassessable(f"{path}: no window can be compared with the twin: {absent}", answer)
    if records:
        reason = f"no window of {len(records)} can be used: {records[0]['reason']}"
    else:
        reason = f"no whole window: {quality['faults'][-1]['detail'] if quality['faults'] else 'no frames'}"
    raise Unassessable("; ".join(part for part in (f"{path}: {reason}", absent) if part), answer)


def warnings(recording: str | Path, answer: dict[str, Any]) -> list[str]:
    """One line each for what was wrong with a recording that could be used all the same."""
    quality, lines = answer["data_quality"], []
    if quality.get("recording"):
        lines.append(f"{recording}: {'; '.join(quality['recording'])}")
    lines += [f"rig file {answer['rig']['name']}: {note}" for note in answer["rig"]["notes"]]
    for label in quality["missing_channels"]:
        lines.append(f"{recording}: channel {label}, which the rig file names, is missing")
    grouped: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for fault in quality["faults"]:
        if fault["action"] in ("degraded", "refused"):
            grouped.setdefault((fault["channel"], fault["kind"]), []).append(fault)
    for (label, kind), faults in grouped.items():
        lines.append(f"{recording}: {label}: {kind}, {len(faults)} times: {faults[0]['detail']}")
    refused = [w for w in answer["windows"] if w["quality"] == "refused"]
    if refused:
        lines.append(f"{recording}: {len(refused)} windows refused: {refused[0]['reason']}")
    return lines
