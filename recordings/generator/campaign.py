"""A whole campaign: calibration and measurement windows on one wearing machine, and the truth behind them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime
from math import pi
from typing import Any

import numpy as np

from recordings.generator import sensor_faults, sensors
from recordings.generator import spec as specs
from recordings.generator.effects import knobs_at
from recordings.generator.errors import SimulationError, SpecError
from recordings.generator.flanks import pair_of
from recordings.generator.knobs import Knobs
from recordings.generator.machine import Condition, Machine
from recordings.generator.structure import INDEX, build
from recordings.generator.truth import end_of_life, whole_truth, window_truth
from recordings.generator.wear import Wearing, depths

SETTLE = 0.6  # the machine runs before a window's record starts [s]
PAD = 0.1  # recorded beyond both ends of a window, for the filters [s]
GROWTH_STEPS = 12  # in which an effect that grows does so while the flanks wear
MOST_SHIFT = PAD - 0.01  # of the accelerometer's clock [s]
PAUSE = (2.0, 6.0)  # the machine stands between windows to be set up [s]

Progress = Callable[[float, str], None]


@dataclass(slots=True)
class Recorded:
    """What the instruments gave in one window."""

    start_time_ns: int
    acceleration: np.ndarray  # [m/s²]
    torque: np.ndarray  # [N·m]
    pinion_edges: tuple[int, np.ndarray]  # number of the first edge, times after the start [s]
    gear_edges: tuple[int, np.ndarray]


@dataclass(slots=True)
class Campaign:
    """A simulated campaign: its checked spec, its windows, and the truth, which goes to another file."""

    spec: dict[str, Any]
    accelerometer: str
    edges_per_rev: tuple[int, int]
    windows: list[Recorded] = field(default_factory=list)
    truth: dict[str, Any] = field(default_factory=dict)


class _Run:
    """One campaign under way: the machine, its age and the time of day."""

    def __init__(self, spec: dict[str, Any], rig: Mapping[str, Any]):
        self.spec, self.rig = spec, rig
        self.rng = {
            name: np.random.default_rng([spec["seed"], i])
            for i, name in enumerate(("machine", "discs", "drive", "noise", "wear", "time", "foreign"))
        }
        self.machine = _machine(spec, rig, self.rng["machine"])
        self.wearing = Wearing(self.machine, spec["wear"], self.rng["wear"])
        self.discs = _discs(spec, rig, self.machine, self.rng["discs"])
        self.revolutions = 0.0  # that the flanks are worn by
        self.ended = 0.0  # revolutions at the end of the last window
        self.started = self.clock = datetime.fromisoformat(spec["started"]).timestamp()

    def knobs(self, revolutions: float):
        return knobs_at(self.spec["effects"], revolutions, self.machine.pair, self.spec["seed"])

    def operating(self, revolutions: float) -> Condition:
        """The condition of the campaign at an age."""
        for c in self.spec["conditions"]:
            if revolutions < c["until_revolutions"]:
                break
        return Condition(2 * pi * c["speed_hz"], c["torque_nm"])

    def wear_to(self, stop: float, forced: Condition | None = None) -> None:
        """Wears on to an age, under the campaign's conditions or a forced one; effects set in on the way."""
        turning = [c["until_revolutions"] for c in self.spec["conditions"]]
        turning += [e["onset_revolutions"] for e in self.spec["effects"]]
        for e in self.spec["effects"]:
            if e["full_revolutions"] > e["onset_revolutions"]:
                turning += np.linspace(e["onset_revolutions"], e["full_revolutions"], GROWTH_STEPS + 1).tolist()
        first = self.spec["wear"]["from_revolutions"]
        turning.append(first)
        while self.revolutions < stop:
            now = self.revolutions
            until = min([stop] + [t for t in turning if now < t])
            if now >= first:
                knobs, active = self.knobs(now)
                self.wearing.advance(now, until, forced or self.operating(now), knobs, len(active))
            self.revolutions = until

    def rising(self, condition: Condition, number: int) -> Condition:
        """The condition of a measurement window, in which speed and torque may rise."""
        rises = {key: self.spec["windows"][key] for key in ("speed_rise", "torque_rise")}
        return replace(condition, **{key: rise[number] for key, rise in rises.items() if rise})

    def window(self, kind: str, index: int, target: float, condition: Condition, seconds: float):
        """One window with its middle at `target` pinion revolutions, or as soon after as can be."""
        rng, drive = self.rng["drive"], self.spec["drive"]
        turns_per_second = condition.speed / (2 * pi)
        lead_in = (SETTLE + PAD) * turns_per_second
        start = max(target - seconds / 2 * turns_per_second, self.ended + lead_in)
        middle = start + seconds / 2 * turns_per_second
        forced = condition if kind == "calibration" else None
        self.clock += self.rng["time"].uniform(*PAUSE)
        self.clock += (start - self.ended) / (
            self.operating(start).speed / (2 * pi) if forced is None else turns_per_second
        )
        self.wear_to(middle, forced)
        actual = replace(
            condition,
            speed=condition.speed * (1 + drive["speed_spread"] * rng.normal()),
            torque=condition.torque * (1 + drive["torque_spread"] * rng.normal()),
            speed_wander=drive["speed_wander"],
            torque_wander=drive["torque_wander"],
            wander_seconds=drive["wander_seconds"],
        )
        recorded, facts = self._measure(start, actual, seconds)
        _, active = self.knobs(middle)
        truth = {
            "index": index,
            "kind": kind,
            "worn_revolutions": self.revolutions,
            "start_time_ns": recorded.start_time_ns,
            "effects_active": active,
            "depth": depths(self.machine),
            **facts,
        }
        self.ended = start + seconds * turns_per_second
        self.clock += seconds
        self.wear_to(self.ended, forced)
        return recorded, truth

    def _measure(self, start: float, condition: Condition, seconds: float):
        machine, spec = self.machine, self.spec["sensors"]
        knobs, _ = self.knobs(self.revolutions)
        z1, z2 = machine.pair.teeth
        cycle = np.floor(start / z2)  # rounds of all tooth pairs: not in the angles, put back in the counts
        before = (SETTLE + PAD) * condition.speed / (2 * pi)
        at_start = replace(
            condition,
            speed=condition.speed * (1 - condition.speed_rise / 2),
            torque=condition.torque * (1 - condition.torque_rise / 2),
            speed_rise=0.0,
            torque_rise=0.0,
        )
        motion = machine.at_rest(at_start, knobs, 2 * pi * (start - before - cycle * z2))
        machine.settle(motion, at_start, knobs, SETTLE, self.rng["drive"])
        record = machine.run(motion, condition, knobs, seconds + 2 * PAD, self.rng["drive"])
        times = machine.dt * np.arange(len(record)) - PAD
        inside = (times >= 0) & (times < seconds)
        acceleration, clean = self._acceleration(record, condition.torque, knobs, seconds)
        rate, noise = 1 / machine.dt, self.rng["noise"]
        factor = round(rate / spec["torque_rate_hz"])
        torque = sensors.decimated(record[:, 1], factor, round(PAD * rate), round(seconds * spec["torque_rate_hz"]))
        drifted = 1 - np.exp(-self.revolutions / spec["drift_revolutions"])
        torque += spec["torque_drift_nm"] * drifted
        gear_zero = spec["encoder_drift_um"] * 1e-6 * drifted / machine.pair.base_radius[1]
        jitter, clock = spec["encoder_jitter_ns"] * 1e-9, spec["encoder_clock_ns"] * 1e-9
        told: list[tuple[int, np.ndarray]] = []
        for disc, angle, turns in zip(self.discs, (record[:, 2], record[:, 3] - gear_zero), (z2, z1), strict=True):
            first, at = sensors.edges(disc, times, angle, 0.0, seconds, jitter, clock, noise)
            first += round(cycle * turns) * disc.edges_per_rev
            lines = knobs.disc_lines.get("gear" if told else "pinion", [])
            told.append(sensor_faults.seen(first, at, disc.edges_per_rev, lines, self.rng["foreign"]))
        recorded = Recorded(
            round(self.clock * 1e9),
            acceleration,
            sensors.converted(torque, spec["torque_noise_nm"], spec["torque_range_nm"], spec["bits"], noise),
            *told,
        )
        if min(first for first, _ in told) < 0:
            raise SimulationError("an encoder counted below zero: the first window starts too early")
        facts = {"drifted": float(drifted)} | window_truth(
            machine, record[inside], clean, recorded.acceleration, spec["acceleration_rate_hz"], cycle
        )
        return recorded, facts

    def _acceleration(
        self, record: np.ndarray, torque: float, knobs: Knobs, seconds: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """The accelerometer's samples, and the housing's true acceleration in its band.

        From the record of `integrate.run` and the mean torque [N·m]; what is foreign to the machine is not in
        its true acceleration.
        """
        spec, rate = self.spec["sensors"], 1 / self.machine.dt
        out_rate = spec["acceleration_rate_hz"]
        cut = round(rate / out_rate), round(PAD * rate), round(seconds * out_rate)
        raw, angle = self._housing(record, torque, knobs), record[:, 2]
        clean = sensors.decimated(raw, *cut)
        if knobs.resonance[0]:
            raw = sensors.mounted(raw, rate, *knobs.resonance)
        if knobs.loose_accelerometer is not None:
            raw = knobs.loose_accelerometer(raw, 1 / rate, self.rng["foreign"])
        elapsed = self.clock - self.started
        if abs(knobs.clock.at(elapsed + seconds)) > MOST_SHIFT:
            raise SimulationError(
                f"time_shift: the clocks differ by {1e3 * knobs.clock.at(elapsed + seconds):.0f} ms, more than the "
                f"{1e3 * MOST_SHIFT:.0f} ms that are simulated around a window"
            )
        felt = sensors.decimated(knobs.clock(raw, 1 / rate, elapsed), *cut)
        t = np.arange(felt.size) / out_rate
        for shaken in knobs.foreign:
            at = angle[cut[1] :: cut[0]][: felt.size]
            felt = shaken(felt, t + self.clock % 1.0, at, self.rng["foreign"])
        felt = felt * knobs.gain
        for frequency, amplitude in knobs.tones:
            felt = felt + amplitude * np.sin(2 * pi * frequency * (t + self.clock % 1.0))
        noisy = sensors.converted(
            felt, spec["acceleration_noise"], spec["acceleration_range"], spec["bits"], self.rng["noise"]
        )
        return noisy, clean

    def _housing(self, record: np.ndarray, torque: float, knobs: Knobs) -> np.ndarray:
        """Acceleration of the housing at the accelerometer, at every step [m/s²]."""
        if knobs.foot is None or not self.machine.accelerometer.startswith("y"):
            return record[:, 0]
        z1, z2 = self.machine.pair.teeth
        return record[:, 0] + knobs.foot(record, self.machine.dt, torque, self.machine.rated_torque, z2 / z1)


def _machine(spec: dict[str, Any], rig: Mapping[str, Any], rng: np.random.Generator) -> Machine:
    m = spec["machine"]
    pair = pair_of(rig)
    shape = (len(pair.points), m["slices"])
    accelerometer = rig["sensors"]["accelerometer"]
    if accelerometer not in INDEX:
        raise SpecError(f"the rig's sensors.accelerometer = {accelerometer!r} must be one of {', '.join(INDEX)}")
    return Machine(
        structure=build(rig, rng, m["stiffness_spread"], m["mass_spread"], m["damping_spread"]),
        pair=pair,
        slices=m["slices"],
        stiffness_scale=m["mesh_stiffness_scale"],
        damping_time=float(rig["mesh"]["relative_damping_time"]) * m["mesh_damping_scale"],
        rated_torque=float(rig["operating"]["input_torque"]),
        phase=float(rng.uniform(0, pair.teeth[0] * pair.base_pitch)),
        accelerometer=accelerometer,
        dt=1 / spec["solver"]["step_rate_hz"],
        pinion_worn=np.zeros((pair.teeth[0], *shape)),
        gear_worn=np.zeros((pair.teeth[1], *shape)),
        bearing_span=float(rig["shafts"].get("bearing_span", 0.15)),
    )


def _discs(spec, rig, machine: Machine, rng: np.random.Generator) -> tuple[sensors.Disc, sensors.Disc]:
    pinion, gear = (
        sensors.make_disc(
            int(rig["encoders"][f"{shaft}_edges_per_rev"]),
            np.array(spec["sensors"][f"{shaft}_graduation_um"]) * 1e-6,
            radius,
            rng,
        )
        for shaft, radius in zip(("pinion", "gear"), machine.pair.base_radius, strict=True)
    )
    return pinion, gear


def simulate(spec: Mapping[str, Any], rig: Mapping[str, Any], progress: Progress | None = None) -> Campaign:
    """A whole campaign from a spec's mapping and a rig file's; SpecError where either cannot be used.

    progress(fraction, what) is called as the work goes on.
    """
    checked = specs.read(spec)
    try:
        run = _Run(checked, rig)
        limit = float(rig["end_of_life"]["max_depth"]) if checked["truth"]["to_end_of_life"] else None
    except KeyError as missing:
        raise SpecError(f"the rig file does not give {missing}, which this simulation needs") from missing
    pinion, gear = run.discs
    campaign = Campaign(checked, run.machine.accelerometer, (pinion.edges_per_rev, gear.edges_per_rev))
    plan = [
        ("calibration", 0.0, Condition(2 * pi * c["speed_hz"], c["torque_nm"]), c["seconds"])
        for c in checked["calibration"]
    ]
    plan += [
        ("measurement", r, run.rising(run.operating(r), i), checked["windows"]["seconds"])
        for i, r in enumerate(checked["windows"]["at_revolutions"])
    ]
    truths = []
    for index, (kind, target, condition, seconds) in enumerate(plan):
        if progress:
            progress(
                index / len(plan),
                f"{kind} window {index + 1} of {len(plan)} at {max(target, run.ended):.0f} revolutions",
            )
        recorded, truth = run.window(kind, index, target, condition, seconds)
        campaign.windows.append(recorded)
        truths.append(truth)
    campaign.truth = whole_truth(checked, run.machine, truths)
    if limit is not None:
        if progress:
            progress(1.0, "on to the end of life")
        if checked["truth"]["life_step_um"] is not None:
            run.wearing.wear = run.wearing.wear | {"step_um": checked["truth"]["life_step_um"]}
        if checked["truth"]["life_share"] is not None:
            limit = 1e-6 * np.ceil(depths(run.machine)["combined_um"] / checked["truth"]["life_share"])
        campaign.truth["end_of_life"] = end_of_life(
            run.machine, run.wear_to, run.revolutions, limit, run.operating(run.revolutions)
        )
    if progress:
        progress(1.0, "done")
    return campaign
