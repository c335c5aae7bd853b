"""What is said of healthy recordings that were spoiled in a known way, beside simple rules.

    python -m benchmarks.spoiled_recordings [--halves] [LOAD …]

Every healthy recording of the SpectraQuest set is spoiled in each way, by a seed of its own, and compared with a
baseline of the other six. `nothing` counts recordings called explained, `not judged` those without a finding of which
it is said that they cannot be judged. Thresholds were looked at on the loads `TUNED` and are judged on `JUDGED`; the
logistic regression is trained on all cases of `TUNED`. With --halves, each half of every spoiled recording is compared
as a recording of its own. The data lie beside the project (GEAR_TWIN_SHARED); the status is 0 whenever it ran.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit

from benchmarks.measured import LOADS, MEASURED, SENSORS, THIRD, imported
from benchmarks.spoiling import KINDS
from service.files.baseline import load
from twin.baseline.comparison import compare_with_baseline, pair_shafts, tracked
from twin.baseline.learned import Baseline
from twin.baseline.leaving_out import learn
from twin.baseline.reading import WindowReading, read
from twin.errors import TwinError
from twin.features.angle import AngleTrack
from twin.rig import Rig
from twin.windows import Samples, Window

SET = "spectraquest-broken-tooth"
TUNED, JUDGED = (0, 30, 70), (20, 40, 60, 80)
RULES = ("RMS", "kurtosis", "FM4", "SK")
RULE_LIMIT = 3.0  # healthy standard deviations of a simple rule
SENSOR = {"sensor_gain", "sensor_resonance", "sensor_polarity", "sensor_delay", "sensor_dead", "sensor_dead_time",
          "sensor_clipping", "sensor_noise", "hum", "exchanged"}  # fmt: skip

SAID = ("right", "unknown", "sensor", "gears", "nothing", "not judged")
HEADS = ("named", "unknown", "other sensor", "gear fault", "nothing", "not judged")
SPOKEN = dict(zip(SAID, HEADS, strict=True))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Case:
    """One recording, what was done to it, and what is said of it."""

    percent: int
    kind: str  # of `KINDS`, or "healthy"
    names: frozenset[str]
    verdict: str  # on what no name explains
    features: np.ndarray  # of the simple rules, largest deviation over the sensors (4,)

    @property
    def said(self) -> str:
        """`right`, `unknown`, `gears`, `sensor`, `nothing` or `not judged`: how well the names fit, the worst first."""
        kind = KINDS.get(self.kind)
        right = kind.right if kind else frozenset()
        wrong = self.names - {"unknown_effect"} - right
        if wrong:
            return "gears" if wrong - SENSOR else "sensor"
        if self.names & right:
            return "right"
        if self.names:
            return "unknown"
        return "not judged" if self.verdict == "insufficient_data" else "nothing"


def simple_features(window: Window, reading: WindowReading, z1: int) -> dict[str, np.ndarray]:
    """RMS (ln), kurtosis, FM4 and largest spectral kurtosis of every sensor (4,)."""
    out = {}
    for name, samples in window.accelerations.items():
        x = samples.values - samples.values.mean()
        power = max(float(np.mean(x**2)), 1e-30)
        blocks = np.abs(np.fft.rfft(x[: x.size // 256 * 256].reshape(-1, 256) * np.hanning(256), axis=1)) ** 2
        sk = np.mean(blocks**2, axis=0) / np.maximum(np.mean(blocks, axis=0) ** 2, 1e-300) - 2
        fm4 = 0.0
        if name in reading.channels:
            lines = reading.channels[name].lines[reading.period - 1 :: reading.period]
            n = np.arange(1, lines.size + 1)
            kept = np.where(np.isin(n % z1, (0, 1, z1 - 1)), 0, lines)
            turn = np.fft.irfft(np.concatenate([[0], kept]), 4 * kept.size)
            fm4 = float(np.mean(turn**4) / max(float(np.mean(turn**2)) ** 2, 1e-300))
        out[name] = np.array([0.5 * np.log(power), np.mean(x**4) / power**2, fm4, sk[2:-2].max()])
    return out


class Set:
    """The healthy recordings, and a baseline of six for each."""

    def __init__(self, folder: Path) -> None:
        self.windows: dict[int, Window] = {}
        self.readings: dict[int, WindowReading] = {}
        self.tracks: dict[int, AngleTrack] = {}
        self.features: dict[int, Mapping[str, np.ndarray]] = {}
        for percent in LOADS:
            found = load(imported(SET, MEASURED / SET / f"h30hz{percent}.csv.gz", folder))
            self.rig: Rig = found.rig
            self.shafts = (*pair_shafts(found.rig), THIRD)
            one = found.windows[0]
            self.windows[percent] = one.window
            self.tracks[percent] = one.track
            self.readings[percent] = read(self.rig, one.window, self.shafts, f"h{percent}", one.track)
            self.features[percent] = simple_features(one.window, self.readings[percent], self.rig.teeth[0])
        self._baselines: dict[int, Baseline] = {}

    def baseline(self, percent: int) -> Baseline:
        """Of the other six recordings."""
        if percent not in self._baselines:
            others = [self.readings[p] for p in LOADS if p != percent]
            self._baselines[percent] = learn(self.rig, others, self.shafts)
        return self._baselines[percent]

    def case(self, percent: int, kind: str, part: tuple[float, float] = (0.0, 1.0)) -> Case:
        """One recording spoiled in one way, or a part of it."""
        window = self.windows[percent]
        if kind in KINDS:
            rng = np.random.default_rng([percent, list(KINDS).index(kind)])
            values = {name: s.values.copy() for name, s in window.accelerations.items()}
            values = KINDS[kind].spoil(values, str(rng.choice(SENSORS)), window, self.tracks[percent], rng)
            samples = {
                name: Samples(start=s.start, rate=s.rate, values=values[name])
                for name, s in window.accelerations.items()
            }
            window = replace(window, accelerations=samples)
        window = part_of(window, part)
        names: set[str] = set()
        verdict, reading = "unknown_effect", self.readings[percent]
        try:
            one = tracked(self.rig, window, kind, self.shafts)
            reading = read(self.rig, window, self.shafts, kind, one.track)
            result = compare_with_baseline(self.baseline(percent), self.rig, [one])
            names |= {effect.name for effect in result.effects}
            verdict = result.unexplained.verdict
            names |= {"unknown_effect"} & {verdict}
        except TwinError as error:
            names.add("exchanged" if "seem exchanged" in str(error) else "unknown_effect")
        features = self._deviations(percent, window, reading)
        return Case(percent=percent, kind=kind, names=frozenset(names), verdict=verdict, features=features)

    def _deviations(self, percent: int, window: Window, reading: WindowReading) -> np.ndarray:
        """Largest deviation of each simple rule over the sensors, in healthy standard deviations (4,)."""
        here = simple_features(window, reading, self.rig.teeth[0])
        out = []
        for name, values in here.items():
            known = np.array([self.features[p][name] for p in LOADS if p != percent])
            out.append(np.abs(values - known.mean(axis=0)) / np.maximum(known.std(axis=0, ddof=1), 1e-9))
        return np.asarray(np.max(out, axis=0))


def part_of(window: Window, part: tuple[float, float]) -> Window:
    """A stretch of a window, from and to a share of its samples, as a window of its own."""
    out = {}
    for name, samples in window.accelerations.items():
        low, high = (round(share * samples.values.size) for share in part)
        out[name] = Samples(start=samples.start, rate=samples.rate, values=samples.values[low:high])
    return replace(window, accelerations=out)


def cases(data: Set, loads: tuple[int, ...] = LOADS) -> Iterator[Case]:
    """Every recording, as it is and spoiled in every way."""
    for percent in loads:
        for kind in ("healthy", *KINDS):
            yield data.case(percent, kind)


def logistic(trained: list[Case]) -> Callable[[Case], bool]:
    """Whether a case is spoiled, by logistic regression on the simple rules' deviations, with a ridge of 0.1."""

    def row(case: Case) -> np.ndarray:
        return np.concatenate([[1.0], np.log1p(case.features)])

    A = np.array([row(c) for c in trained])
    y = np.array([float(c.kind != "healthy") for c in trained])
    weight = np.where(y > 0, 0.5 / max(y.sum(), 1), 0.5 / max((1 - y).sum(), 1)) * y.size

    def loss(w: np.ndarray) -> tuple[float, np.ndarray]:
        """Negative logarithm of the posterior, and its gradient."""
        s = A @ w
        value = np.sum(weight * (np.logaddexp(0, s) - y * s)) + 0.05 * w @ w
        return float(value), A.T @ (weight * (expit(s) - y)) + 0.1 * w

    w = minimize(loss, np.zeros(A.shape[1]), jac=True, method="BFGS").x
    return lambda case: bool(row(case) @ w > 0)


def table(found: list[Case]) -> str:
    """All kinds in one table, of the loads that nothing was tuned on and of the others."""
    lines = []
    trained = [c for c in found if c.percent in TUNED]
    judge = logistic(trained) if trained else None
    for title, loads in (("judged", JUDGED), ("tuned on", TUNED)):
        own = [c for c in found if c.percent in loads]
        if not own:
            continue
        lines.append(f"\n{title}: loads {', '.join(map(str, loads))} %")
        heads = ("cases", *HEADS, "|", *RULES)
        lines.append(f"{'':<28}{'  '.join(heads)}  logistic")
        for kind in ("healthy", *KINDS):
            here = [c for c in own if c.kind == kind]
            said = Counter(c.said for c in here)
            counts: list[object] = [len(here), *(said[name] for name in SAID), "|"]
            counts += [sum(c.features[i] > RULE_LIMIT for c in here) for i in range(len(RULES))]
            row = "  ".join(f"{count:>{len(head)}}" for count, head in zip(counts, heads, strict=True))
            lines.append(f"{kind:<28}{row}  {sum(judge(c) for c in here) if judge else 0:>8}")
    return "\n".join(lines).strip()


def halves(data: Set, loads: tuple[int, ...]) -> str:
    """What is said of each half of every recording, beside the whole."""
    lines = [f"{'':<28}halves  as the whole  otherwise (whole: half)"]
    for kind in ("healthy", *KINDS):
        count, other = 0, Counter[str]()
        for percent in loads:
            whole = data.case(percent, kind)
            for part in ((0.0, 0.5), (0.5, 1.0)):
                said = data.case(percent, kind, part).said
                count += 1
                if said != whole.said:
                    other[f"{percent} % {SPOKEN[whole.said]}: {SPOKEN[said]}"] += 1
        told = ", ".join(f"{what}{f' ({n})' if n > 1 else ''}" for what, n in other.items())
        lines.append(f"{kind:<28}{count:>6}  {count - other.total():>12}  {told}".rstrip())
        print(lines[-1], file=sys.stderr)
    return "\n".join(lines)


def main() -> None:
    if not (MEASURED / SET).is_dir():
        print(f"left out: {SET} is not in {MEASURED} (GEAR_TWIN_SHARED)", file=sys.stderr)
        return
    loads = tuple(int(text) for text in sys.argv[1:] if text != "--halves") or LOADS
    with TemporaryDirectory() as folder:
        data = Set(Path(folder))
    if "--halves" in sys.argv:
        print(halves(data, loads))
        return
    found = []
    for case in cases(data, loads):
        print(f"{case.percent:>3} %  {case.kind:<28} {case.said:<8} {', '.join(sorted(case.names))}", file=sys.stderr)
        found.append(case)
    print(table(found))


if __name__ == "__main__":
    main()
