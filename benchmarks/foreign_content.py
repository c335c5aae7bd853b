"""Recordings with content of kinds that no effect of the table makes, and what is said of them.

    python -m benchmarks.foreign_content [--machines N] [--draw N] [--only TEXT …] [--folder DIR] [--processes N]

Sound machines are simulated (`trace_campaigns`), each window of them is then changed in one way of `KINDS`, and the
windows go through the twin. Counted are names of other effects, alarms, and whether the answer has the right frequency,
order or channel. A name that has the right cause among what it is indistinguishable from is counted apart. Every
machine is also judged as it is. Rules were tuned on draw 0; others judge. The status is 0 whenever it ran.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import butter, lfilter, sosfilt

from benchmarks.scoring import run, windows_of
from benchmarks.trace_campaigns.generate import FOLDER, make_all
from benchmarks.trace_campaigns.table import Row, merged
from benchmarks.trace_campaigns.wide import ON, STEP
from twin.instruments import examined
from twin.rig import Rig
from twin.windows import Edges, Samples, Window

SHORT = {**STEP, "truth": {"to_end_of_life": False}, "windows": {"seconds": 2.5}}
UNKNOWN, SOUND = "unknown_effect", "sound"
SAME_WANDERING = 0.04  # of one that wanders from window to window
SAME = 0.02  # relative difference of a frequency or order that is the right one


def machines(count: int, draw: int = 0) -> tuple[Row, ...]:
    """Sound machines, of three benches in turn, every second one at two operating points."""
    return tuple(
        Row(
            f"F{i + 1:02d}-sound", 7_700_000 + 37 * i + 1000 * draw, "clean", windows=6, bench=ON[i % len(ON)],
            two_conditions=i % 2 == 1, extra=merged(SHORT, {}),
        )
        for i in range(count)
    )  # fmt: skip


@dataclass(eq=False, kw_only=True)
class Spoiled:
    """A window that is being changed."""

    window: Window
    teeth: tuple[int, int]
    rng: np.random.Generator  # anew for each window
    seed: int  # of the machine: what stays the same over its windows

    @property
    def fixed(self) -> np.random.Generator:
        """Draws that all windows of a machine share."""
        return np.random.default_rng([self.seed, 5])

    @property
    def speed(self) -> float:
        """Mean speed of the pinion [Hz]."""
        edges = self.window.encoders["pinion"]
        usable = np.flatnonzero(np.isfinite(edges.times))
        first, last = usable[0], usable[-1]
        return float((last - first) / edges.per_rev / (edges.times[last] - edges.times[first]))

    def angle(self, times: np.ndarray) -> np.ndarray:
        """Angle of the pinion [rad] at times [s]; (n,) → (n,)."""
        edges = self.window.encoders["pinion"]
        usable = np.isfinite(edges.times)
        turned = 2 * np.pi * (edges.first_index + np.arange(edges.times.size)) / edges.per_rev
        return np.asarray(np.interp(times, edges.times[usable], turned[usable]))

    def heard(self, change: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]) -> None:
        """Changes every acceleration: (values, times [s], angles [rad]) → values."""
        self.window = replace(
            self.window,
            accelerations={
                name: _changed(samples, change(samples.values, samples.times, self.angle(samples.times)))
                for name, samples in self.window.accelerations.items()
            },
        )

    def twisted(self, change: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> None:
        """Adds to every torque [N·m] at times [s] and angles [rad]."""
        self.window = replace(
            self.window,
            torques={
                name: _changed(samples, samples.values + change(samples.times, self.angle(samples.times)))
                for name, samples in self.window.torques.items()
            },
        )

    def read_off(self, shaft: str, added: Callable[[np.ndarray], np.ndarray]) -> None:
        """Adds an error [rad] at angles of its own shaft [rad] to an encoder: its edges pass earlier by as much."""
        edges: Edges = self.window.encoders[shaft]
        turned = 2 * np.pi * (edges.first_index + np.arange(edges.times.size)) / edges.per_rev
        speed = 2 * np.pi * self.speed * (1.0 if shaft == "pinion" else self.teeth[0] / self.teeth[1])
        moved = replace(edges, times=edges.times - added(turned) / speed)
        self.window = replace(self.window, encoders={**self.window.encoders, shaft: moved})


def _changed(samples: Samples, values: np.ndarray) -> Samples:
    return replace(samples, values=np.asarray(values, dtype=float))


def _rms(x: np.ndarray) -> float:
    return float(np.nanstd(x))


def _nonlinear_path(s: Spoiled) -> None:
    """The path stiffens with the vibration itself: squares and cubes of the acceleration."""
    k = s.fixed.uniform(0.25, 0.45)
    s.heard(lambda x, t, θ: x + k * (x**2 - np.mean(x**2)) / _rms(x) - 0.15 * k * x**3 / _rms(x) ** 2)


def _drifting_tone(s: Spoiled) -> None:
    f = s.fixed.uniform(120, 700) * (1 + 0.03 * s.rng.uniform(-1, 1))
    φ = s.rng.uniform(0, 6)
    s.heard(lambda x, t, θ: x + 0.7 * _rms(x) * np.sin(2 * np.pi * f * t * (1 + 0.002 * t) + φ))


def _load_zone(s: Spoiled) -> None:
    """What is driven takes its load once in 1.6 turns."""
    o, φ = 0.625, s.rng.uniform(0, 6)
    size = 0.15 * abs(float(np.nanmean(next(iter(s.window.torques.values())).values)))
    s.twisted(lambda t, θ: size * np.cos(o * θ + φ))


def _drive_electronics(s: Spoiled) -> None:
    """A converter's lines at six and twelve times its own frequency, in torque and acceleration."""
    f, φ = 6 * s.fixed.uniform(41, 47), s.rng.uniform(0, 6)
    s.heard(lambda x, t, θ: x + 0.6 * _rms(x) * sum(np.sin(2 * np.pi * n * f * t + n * φ) / n for n in (1, 2)))
    s.twisted(lambda t, θ: 0.1 * np.sin(2 * np.pi * f * t + φ))


def _second_gearbox(s: Spoiled) -> None:
    """Another machine's mesh at a speed with slip of its own, modulated by its shaft."""
    shaft = s.fixed.uniform(14, 19) * (1 - 0.02 * s.rng.uniform())
    turned = lambda t: 2 * np.pi * shaft * t  # noqa: E731
    s.heard(
        lambda x, t, θ: (
            x + 0.8 * _rms(x) * (1 + 0.3 * np.cos(turned(t))) * (np.sin(23 * turned(t)) + 0.4 * np.sin(46 * turned(t)))
        )
    )


def _brake_chatter(s: Spoiled) -> None:
    """Stick and slip of the brake at the frequency of its own suspension: a saw tooth, in torque and acceleration."""
    f, φ = s.fixed.uniform(31, 39), s.rng.uniform(0, 6)
    saw = lambda t: 2 * np.mod(f * t + φ, 1) - 1  # noqa: E731
    size = 0.1 * abs(float(np.nanmean(next(iter(s.window.torques.values())).values)))
    s.twisted(lambda t, θ: size * saw(t))
    rate = next(iter(s.window.accelerations.values())).rate
    sos = butter(2, [20, 400], "bandpass", fs=rate, output="sos")
    s.heard(lambda x, t, θ: x + 1.2 * _rms(x) * sosfilt(sos, saw(t)))


def _encoder_disc(s: Spoiled) -> None:
    """The gear's disc sits off its shaft's centre."""
    e, φ = s.fixed.uniform(6e-4, 1.2e-3), s.fixed.uniform(0, 6)
    s.read_off("gear", lambda θ: e * np.cos(θ + φ))


def _lobed_disc(s: Spoiled) -> None:
    """The pinion's disc is out of round, three times a turn."""
    e, φ = s.fixed.uniform(6e-4, 1.2e-3), s.fixed.uniform(0, 6)
    s.read_off("pinion", lambda θ: e * np.cos(3 * θ + φ))


def _turned_sensor(s: Spoiled) -> None:
    """The accelerometer feels another direction: the same lines by another path."""
    rng = s.fixed
    rate = next(iter(s.window.accelerations.values())).rate
    parts = [(rng.uniform(150, 1800), rng.uniform(0.02, 0.08), rng.normal()) for _ in range(6)]

    def path(x: np.ndarray) -> np.ndarray:
        made = 0.25 * x
        for f, ζ, gain in parts:
            r, w = np.exp(-ζ * 2 * np.pi * f / rate), 2 * np.pi * f / rate
            made = made + gain * lfilter([0, 2 * ζ * w * r * np.sin(w)], [1, -2 * r * np.cos(w), r * r], x) / ζ
        return np.asarray(made)

    s.heard(lambda x, t, θ: path(x))


def _foreign_modulation(s: Spoiled) -> None:
    """Something foreign at a frequency of its own swings the level of the mesh."""
    f, φ = s.fixed.uniform(16, 27), s.rng.uniform(0, 6)
    s.heard(lambda x, t, θ: x * (1 + 0.35 * np.sin(2 * np.pi * f * t + φ)))


def _half_mesh(s: Spoiled) -> None:
    """Every second tooth strikes harder: lines at half of the mesh order, as steady as the mesh."""
    z = s.teeth[0]
    s.heard(lambda x, t, θ: x + 0.5 * _rms(x) * sum(np.cos((n - 0.5) * z * θ + 0.7 * n) / n for n in (1, 2, 3, 4)))


def _hydraulic_pulsation(s: Spoiled) -> None:
    """A pump of nine pistons nearby, at a speed of its own with slip: two harmonics in torque and acceleration."""
    f = 9 * s.fixed.uniform(23, 26) * (1 - 0.01 * s.rng.uniform())
    s.heard(lambda x, t, θ: x + 0.6 * _rms(x) * (np.sin(2 * np.pi * f * t) + 0.5 * np.sin(4 * np.pi * f * t + 1)))
    s.twisted(lambda t, θ: 0.08 * np.sin(2 * np.pi * f * t))


def _aliased_mesh(s: Spoiled) -> None:
    """A converter without its filter folds a high multiple of the mesh: a line that falls as the speed rises."""
    rate = next(iter(s.window.accelerations.values())).rate
    order = s.teeth[0] * round(0.93 * rate / (s.teeth[0] * s.speed))
    s.heard(lambda x, t, θ: x + 0.6 * _rms(x) * np.cos(2 * np.pi * rate * t - order * θ))


def _aliased_at(s: Spoiled) -> float:
    rate = next(iter(s.window.accelerations.values())).rate
    mesh = s.teeth[0] * s.speed
    return float(rate - mesh * round(0.93 * rate / mesh))


def _switching(s: Spoiled) -> None:
    """Switching of a power stage: a tone of 0.9 to 1.5 kHz with lines at twice its supply's frequency on both sides."""
    rng = s.fixed
    f, d, φ = rng.uniform(900, 1500), 2 * rng.uniform(44, 52), s.rng.uniform(0, 6)
    s.heard(lambda x, t, θ: x + 0.5 * _rms(x) * (1 + 0.5 * np.cos(2 * np.pi * d * t)) * np.sin(2 * np.pi * f * t + φ))


def _loose_cable(s: Spoiled) -> None:
    """The accelerometer's cable loses contact for some ms, some forty times a second, at no even distance."""
    rate = next(iter(s.window.accelerations.values())).rate

    def cut(x: np.ndarray) -> np.ndarray:
        there = np.ones(x.size)
        for at in s.rng.integers(0, x.size, int(40 * x.size / rate)):
            there[at : at + int(s.rng.uniform(2e-3, 6e-3) * rate)] = 0.0
        return x * there

    s.heard(lambda x, t, θ: cut(x))


def _slipping_belt(s: Spoiled) -> None:
    """A belt on the pinion's shaft, once round in some three turns, with slip: two lines in torque and acceleration."""
    o, φ = s.fixed.uniform(0.28, 0.36) * (1 - 0.004 * s.rng.uniform()), s.rng.uniform(0, 6)
    size = 0.1 * abs(float(np.nanmean(next(iter(s.window.torques.values())).values)))
    s.twisted(lambda t, θ: size * np.cos(o * θ + φ))
    s.heard(lambda x, t, θ: x + 0.5 * _rms(x) * sum(np.cos(n * o * θ + n * φ) for n in (5, 8)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """One way to spoil windows, and what would be the right thing to say of them."""

    spoil: Callable[[Spoiled], None]
    hertz: Callable[[Spoiled], float] | None = None  # the right frequency [Hz]
    order: Callable[[Spoiled], float] | None = None  # of what turns
    harmonics: tuple[int, ...] = (1,)  # of that order which are right as well
    words: str = ""  # one of which is right, apart by |
    fault: str = ""  # of an instrument, which is put right
    name: str = ""  # under which the cause itself is named


KINDS: Mapping[str, Kind] = {
    "non-linear path": Kind(spoil=_nonlinear_path, words="acceleration"),
    "drifting tone": Kind(spoil=_drifting_tone, hertz=lambda s: s.fixed.uniform(120, 700)),
    "load zone": Kind(spoil=_load_zone, order=lambda s: 0.625),
    "drive electronics": Kind(spoil=_drive_electronics, hertz=lambda s: 6 * s.fixed.uniform(41, 47)),
    "second gearbox": Kind(spoil=_second_gearbox, hertz=lambda s: 23 * 0.99 * s.fixed.uniform(14, 19)),
    "brake chatter": Kind(spoil=_brake_chatter, hertz=lambda s: s.fixed.uniform(31, 39)),
    "encoder disc": Kind(spoil=_encoder_disc, words="encoder|disc", name="encoder_disc"),
    "lobed disc": Kind(spoil=_lobed_disc, words="encoder|disc", name="encoder_disc"),
    "turned sensor": Kind(spoil=_turned_sensor, words="accelerometer|acceleration"),
    "foreign modulation": Kind(spoil=_foreign_modulation, hertz=lambda s: s.fixed.uniform(16, 27)),
    "half of the mesh": Kind(spoil=_half_mesh, order=lambda s: s.teeth[0] / 2),
    "hydraulic pulsation": Kind(spoil=_hydraulic_pulsation, hertz=lambda s: 9 * 0.995 * s.fixed.uniform(23, 26)),
    "aliased mesh": Kind(spoil=_aliased_mesh, hertz=_aliased_at),
    "switching": Kind(spoil=_switching, hertz=lambda s: s.fixed.uniform(900, 1500)),
    "loose cable": Kind(spoil=_loose_cable, fault="lost_contact"),
    "slipping belt": Kind(
        spoil=_slipping_belt, order=lambda s: 0.998 * s.fixed.uniform(0.28, 0.36), harmonics=(1, 5, 8)
    ),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Said:
    """What was said of one machine with one kind of content."""

    machine: str
    kind: str
    names: tuple[str, ...]
    beside: tuple[str, ...]  # those of the names that have the right cause among their rivals
    level: str
    verdict: str
    right: bool
    reason: str

    @property
    def others(self) -> tuple[str, ...]:
        """Names of effects that are not there, without those that name the right cause beside."""
        return tuple(name for name in self.names if name != UNKNOWN and name not in self.beside)


def spoiled(rig: Rig, windows: Sequence[Window], kind: Kind, seed: int) -> tuple[list[Window], Spoiled]:
    """The windows changed, with their instruments examined as the service does, and what they were changed by."""
    out, teeth = [], rig.teeth
    for i, window in enumerate(windows):
        s = Spoiled(window=window, teeth=teeth, rng=np.random.default_rng([seed, i]), seed=seed)
        kind.spoil(s)
        out.append(examined(rig, s.window))
    return out, Spoiled(window=windows[0], teeth=teeth, rng=np.random.default_rng(seed), seed=seed)


def beside_of(kind: Kind | None, report: Mapping[str, Any]) -> tuple[str, ...]:
    """Names that say themselves that the right cause is as likely."""
    right = "" if kind is None else kind.name
    return tuple(e["name"] for e in report["effects"] if right in e["evidence"]["indistinguishable_from"])


def is_right(kind: Kind, s: Spoiled, report: Mapping[str, Any]) -> bool:
    """Whether the sentence has the frequency, the order or the channel, or a name the right cause beside it."""
    rest = report["unexplained"]
    reason = rest["reason"] or ""
    if beside_of(kind, report):
        return True
    if rest["verdict"] != UNKNOWN:
        return False
    if kind.words:
        return re.search(kind.words, reason) is not None
    if kind.fault:
        return False
    numbers = [float(x) for x in re.findall(r"(\d+\.?\d*) Hz", reason)]
    if kind.hertz is not None:
        reach = SAME_WANDERING if "wanders" in reason else SAME
        return any(abs(f / kind.hertz(s) - 1) < reach for f in numbers)
    assert kind.order is not None
    orders = [float(x) for x in re.findall(r"order (\d+\.?\d*)", reason)]
    return any(abs(o / (n * kind.order(s)) - 1) < SAME for o in orders for n in kind.harmonics)


def judge(path: Path, name: str, seed: int) -> Said:
    """One machine with one kind of content, or as it is, through the twin."""
    rig, windows = windows_of(path)
    kind = KINDS.get(name)
    given, s = (windows, None) if kind is None else spoiled(rig, windows, kind, seed)
    _, estimates = run(rig, given)
    report = estimates[-1].report
    rest, faults = report["unexplained"], {fault.kind for fault in given[-1].faults}
    return Said(
        machine=path.stem.split("-")[0],
        kind=name,
        names=tuple(e["name"] for e in report["effects"]),
        beside=beside_of(kind, report),
        level=(report.get("status") or {}).get("level", "–"),
        verdict=rest["verdict"],
        right=kind is not None and s is not None and (kind.fault in faults or is_right(kind, s, report)),
        reason=rest["reason"] or "",
    )


def table(said: Sequence[Said]) -> str:
    """One line a kind, and the sums of all kinds of foreign content."""
    lines = [f"{'':<22}cases  other names  rivals  alarms  unknown  right"]
    foreign = [one for one in said if one.kind in KINDS]
    groups = [(kind, [one for one in said if one.kind == kind]) for kind in (SOUND, *KINDS)]
    for kind, own in (*groups, ("all but sound", foreign)):
        if own:
            counts = (
                sum(bool(one.others) for one in own),
                sum(bool(one.beside) for one in own),
                sum(one.level == "alarm" for one in own),
                sum(one.verdict == UNKNOWN for one in own),
                sum(one.right for one in own),
            )
            figures = "  ".join(f"{n:>{w}}" for n, w in zip(counts, (11, 6, 6, 7, 5), strict=True))
            lines.append(f"{kind:<22}{len(own):>5}  {figures}")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Judges all machines with all kinds, and prints the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.foreign_content", description=__doc__)
    parser.add_argument("--machines", type=int, default=4, metavar="N")
    parser.add_argument("--draw", type=int, default=0, metavar="N", help="of the machines and of what spoils them")
    parser.add_argument("--only", nargs="+", default=[], metavar="TEXT", help="kinds whose name has one of these")
    parser.add_argument("--folder", type=Path, default=FOLDER, help="where simulated machines are kept")
    parser.add_argument("--processes", type=int, default=1)
    given = parser.parse_args(arguments)
    kinds = [kind for kind in (SOUND, *KINDS) if not given.only or any(text in kind for text in given.only)]
    made = make_all(machines(given.machines, given.draw), given.folder, given.processes)
    paths = [(path, int(row.name[1:3]) + 100 * given.draw) for row, path, _ in made if path is not None]
    said = []
    with ProcessPoolExecutor(given.processes) as pool:
        work = [pool.submit(judge, path, kind, seed) for path, seed in paths for kind in kinds]
        for done in work:
            one = done.result()
            said.append(one)
            names = ", ".join(one.names) or "nothing"
            print(f"{one.machine} {one.kind:<20} {'right' if one.right else '–':<6} {names}: {one.reason}", flush=True)
    print(table(said))
    return 0


if __name__ == "__main__":
    sys.exit(main())
