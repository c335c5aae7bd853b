"""What is found in the measured sets, each load left out in turn.

    python -m benchmarks.measured [SET …]

Sets: `spectraquest` (broken tooth: baseline from the healthy loads but one, then the healthy and the broken recording
of that one; every sensor together and alone; error before and after with what was found at another load) and
`modulation` (28 channels: what the lines belong to), `encoders` (a pair's ratio and run-out) and `wear` (levels at
measured depths: everything that is tried on them). The data lie beside the project (GEAR_TWIN_SHARED sets where); the
status is 0 whenever it ran.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import combinations
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from service.cli.answers import with_assumed_radii
from service.files import relation as relating
from service.files.baseline import energy_of, lines_of_no_shaft, load
from service.files.import_recording import import_recording
from service.files.series import load_series
from service.report.lines import energies, pair_sentences
from service.report.relation import relation_text
from service.runtime.assess import assess
from twin.baseline.comparison import pair_shafts
from twin.baseline.diagnosis import WindowParts, diagnose
from twin.baseline.findings import BaselineComparison
from twin.baseline.learned import Baseline
from twin.baseline.leaving_out import learn
from twin.baseline.reading import WindowReading, read

ROOT = Path(__file__).parents[1]
MAPPINGS = ROOT / "recordings" / "mappings"
MEASURED = Path(os.environ.get("GEAR_TWIN_SHARED", ROOT.parent / "shared")) / "measured"
LOADS = (0, 20, 30, 40, 60, 70, 80)
RADII_MM = (15.0, 30.0)  # base radii of the source's model of the encoder pair: assumed
FEWER = 5  # healthy recordings of a baseline beside which broken ones are looked at, too
THIRD = Fraction(3, 20)
DRAWS = 12  # of what the rig file of the wear series estimates
SENSORS = ("a1", "a2", "a3", "a4")


def imported(name: str, source: Path, folder: Path) -> Path:
    """A measured file as a recording."""
    out = folder / f"{source.name.split('.')[0]}.mcap"
    import_recording(MAPPINGS / f"{name}.toml", out, source=source)
    return out


def of(reading: WindowReading, sensors: Sequence[str]) -> WindowReading:
    """With some of its sensors alone."""
    return replace(reading, channels={s: reading.channels[s] for s in sensors})


def spectraquest(folder: Path) -> None:
    """Leave one load out."""
    data = MEASURED / "spectraquest-broken-tooth"
    readings: dict[tuple[str, int], WindowReading] = {}
    rig = None
    for state in "hb":
        for percent in LOADS:
            found = load(imported(data.name, data / f"{state}30hz{percent}.csv.gz", folder))
            rig, window = found.rig, found.windows[0]
            shafts = (*pair_shafts(rig), THIRD)
            seen = window.spacings[0].ratio if window.spacings else None
            print(f"{state}{percent:<3} {window.track.speed:.4f} Hz   strange spacing of order {seen}", file=sys.stderr)
            readings[state, percent] = read(rig, window.window, shafts, f"{state}{percent}", window.track)
    assert rig is not None
    print("left out        sensor  found")
    counts: dict[tuple[str, str], int] = {}
    compared: dict[int, tuple[Baseline, BaselineComparison]] = {}
    for percent in LOADS:
        for sensors in (SENSORS, *((s,) for s in SENSORS)):
            base = learn(rig, [of(readings["h", p], sensors) for p in LOADS if p != percent], shafts)
            for state in "hb":
                diagnosis = diagnose(base, [WindowParts(whole=of(readings[state, percent], sensors))])
                names = [_short(e) for e in diagnosis.effects]
                who = "all" if len(sensors) > 1 else sensors[0]
                local = any("tooth_crack" in (e.name, *e.indistinguishable_from) for e in diagnosis.effects)
                counts[state, who] = counts.get((state, who), 0) + (local if state == "b" else bool(names))
                if who == "all" or local:
                    title = f"{'healthy' if state == 'h' else 'broken':<8} {percent:>3} %"
                    print(f"{title}  {who:>6}  {'; '.join(names) or 'nothing'}")
                if state == "b" and who == "all":
                    compared[percent] = base, diagnosis.compared[0]
    print("\nsensor  broken: a change once a turn      healthy with a finding")
    for who in ("all", *SENSORS):
        print(
            f"{who:<7} {counts['b', who]} of {len(LOADS)}                           {counts['h', who]} of {len(LOADS)}"
        )
    _errors(readings, compared)
    _fewer(readings, rig, shafts)


def _fewer(readings, rig, shafts) -> None:
    """Healthy recordings with a finding, and broken ones traced, beside every baseline of fewer healthy ones."""

    def counted(state: str, count: int, counts) -> tuple[list[int], list[int]]:
        """How many recordings of a state count, and of how many: between the loads learned, and beyond them."""
        tally = {True: [0, 0], False: [0, 0]}
        for known in combinations(LOADS, count):
            base = learn(rig, [readings["h", p] for p in known], shafts)
            for percent in set(LOADS) - set(known):
                found = diagnose(base, [WindowParts(whole=readings[state, percent])])
                place = tally[found.compared[0].expected.interpolated]
                place[0] += any(counts(e) for e in found.effects)
                place[1] += 1
        return tally[True], tally[False]

    print("\nhealthy recordings with a finding, for every baseline of so many others")
    print("recordings   load between those learned   beyond them")
    for count in range(2, len(LOADS)):
        (a, b), (c, d) = counted("h", count, lambda effect: True)
        print(f"{count:<12} {a:>12} of {b:<14} {c:>6} of {d}")
    (a, b), (c, d) = counted("b", FEWER, lambda effect: "tooth_crack" in (effect.name, *effect.indistinguishable_from))
    print(f"broken ones found with {FEWER}: {a} of {b} inside the learned load range, {c} of {d} outside")


def _short(effect) -> str:
    said = [", ".join(effect.channels)]
    if "shaft_order" in effect.parameters:
        said.append(f"shaft of order {effect.parameters['shaft_order'].value:g}")
    elif "frequency" in effect.parameters:
        said.append(f"{effect.parameters['frequency'].value:.0f} Hz")
    if effect.log_evidence is not None:
        said.append(f"{effect.log_evidence:.0f} nat")
    return f"{effect.name} ({'; '.join(said)})"


def _errors(readings, compared) -> None:
    """Level error of every mesh band on the load left out: baseline, and with what was found at the nearest load."""
    print("\nmean |error| of the mesh bands' RMS on loads left out, %, with what was found at the nearest other load")
    print("sensor   before   after        waveform before   after")
    for sensor in SENSORS:
        off: list[tuple[float, float, float, float]] = []
        for percent in LOADS:
            _, here = compared[percent]
            other = min((p for p in LOADS if p != percent), key=lambda p: abs(p - percent))
            there = compared[other][1]
            y = here.reading.channels[sensor].lines
            x = here.expected.lines[sensor]
            y = y[: x.size]
            carried = _carried(here, there, sensor)
            orders = np.arange(1, x.size + 1) / here.reading.period
            power = here.expected.power[sensor]
            level = power.copy()
            for path in there.paths:
                if path.channel == sensor and path.changed:
                    level *= path.level_at(orders) ** 2
            waveform = [np.linalg.norm(y - v) / np.linalg.norm(y) for v in (x, carried)]
            for k in range(1, 6):
                inside = np.abs(orders - 32 * k) <= 2
                rms = [np.sqrt(p[inside].sum()) for p in (np.abs(y) ** 2, power, level)]
                off.append((abs(rms[1] / rms[0] - 1), abs(rms[2] / rms[0] - 1), *waveform))
        before, after, wave_before, wave_after = 100 * np.mean(off, axis=0)
        print(f"{sensor:<8} {before:6.1f}  {after:6.1f}        {wave_before:15.1f}  {wave_after:6.1f}")


def _carried(here: BaselineComparison, there: BaselineComparison, sensor: str) -> np.ndarray:
    """The expected lines of one load with the paths found at another."""
    x = here.expected.lines[sensor].copy()
    orders = np.arange(1, x.size + 1) / here.reading.period
    for path in there.paths:
        if path.channel == sensor and path.changed:
            x *= path.at(orders)
    return x


def modulation(folder: Path) -> None:
    """What the lines of the 28-channel rig belong to."""
    data = MEASURED / "spur-rig-28ch-2000rpm"
    recording = imported(data.name, data / "channels.npz", folder)
    found = load(recording)
    breakdown = energy_of(recording)
    assert isinstance(breakdown, list), breakdown
    print("\n".join(energies(breakdown)))
    for s in lines_of_no_shaft(found):
        chance = f"by chance once in {np.exp(s['clearness']):.0e} searches; on {len(s['channels'])} channels"
        place = f"{s['frequency_hz']:.4f} ± {s['frequency_std_hz']:.4f} Hz, order {s['order']:.5f}"
        print(f"lines spaced by {place}; {chance}")
        if s["part"] > 1:
            print(f"  weaker lines at {s['frequency_hz'] / s['part']:.4f} Hz, too: causes are tried at that")
        for b in s["sidebands"][:12]:
            depth = "" if b["depth"] is None else f"  {100 * b['depth']:5.1f} % of the mesh line"
            print(f"  {b['channel']}  mesh {b['harmonic']} ± {b['multiple']}×   {b['amplitude']:.3f}{depth}")
        for c in s["causes"]:
            print(f"  {'possible' if c['possible'] else 'fails   '}  {c['name']}: {c['detail']}")


def encoders(folder: Path) -> None:
    """Ratio and run-out of a pair from its two encoders."""
    data = MEASURED / "spur-pair-dual-encoder"
    out = folder / "pair.mcap"
    notes = import_recording(MAPPINGS / f"{data.name}.toml", out, source=data / "encoders.npz")["notes"]
    for name in ("encoder/pinion", "encoder/gear", "senses"):
        print(f"{name}: {notes[name]}")
    answer = assess(out)
    for line in pair_sentences(with_assumed_radii(answer, RADII_MM)["pair"]):
        print(line)


def wear(folder: Path) -> None:
    """Levels at measured depths, each case left out in turn."""
    name = "bgu-spur-wear-35"
    series = load_series(MAPPINGS / f"{name}.toml", MEASURED / name / "records.csv")
    tried = relating.tried_on(
        series, DRAWS, lambda share, doing: print(f"{100 * share:3.0f} % {doing}", file=sys.stderr)
    )
    answer = relating.answer(series, tried)
    print(relation_text(answer))


SETS = {"spectraquest": spectraquest, "modulation": modulation, "encoders": encoders, "wear": wear}


def main() -> None:
    wanted = sys.argv[1:] or list(SETS)
    if not MEASURED.is_dir():
        print(f"left out: no measured sets in {MEASURED} (GEAR_TWIN_SHARED)", file=sys.stderr)
        return
    unknown = [name for name in wanted if name not in SETS]
    if unknown:
        raise SystemExit(f"no such set: {', '.join(unknown)}; there are {', '.join(SETS)}")
    with TemporaryDirectory() as folder:
        for name in wanted:
            SETS[name](Path(folder))


if __name__ == "__main__":
    main()
