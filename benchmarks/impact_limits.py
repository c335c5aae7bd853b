"""From which height on impacts once a turn are found, and what healthy recordings reach (SpectraQuest, no model).

    python -m benchmarks.impact_limits

Impacts as those of `benchmarks.spoiled_recordings`, once a turn of either gear, at four angles, each sensor in turn the
nearest, are added to the lines of every healthy recording beside a baseline of the other six. `named` counts
deviations that are a change, `not judged` those from which a recording is not called explained. The healthy values are
of every recording beside every baseline of six and of five others, of each shaft and octave. The data lie beside the
project (GEAR_TWIN_SHARED); the status is 0 whenever it ran.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from itertools import combinations
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.measured import LOADS, MEASURED, SENSORS
from benchmarks.spoiled_recordings import SET, TUNED, Set
from benchmarks.spoiling import OTHERS, ringing
from twin.baseline.leaving_out import learn
from twin.baseline.reading import WindowReading, read
from twin.baseline.turn_impacts import DEFAULT, GUMBEL, turn_impacts

STRENGTHS = (0.5, 1.0, 1.5, 2.0, 3.0)  # peak over the nearest sensor's RMS
ANGLES = (0.0, 0.27, 0.51, 0.83)  # of the shaft [turns]
HEALTHY = (2.0, 3.0, 4.2, 6.0)  # standard deviations


def unit_lines(data: Set, percent: int, shaft: Fraction) -> dict[str, np.ndarray]:
    """Lines of impacts as high as each sensor's RMS (K,), by sensor."""
    window, track = data.windows[percent], data.tracks[percent]
    rng = np.random.default_rng(0)
    alone = {
        name: replace(s, values=s.values.std() * ringing(float(shaft), 0.0, s, track, rng))
        for name, s in window.accelerations.items()
    }
    reading = read(data.rig, replace(window, accelerations=alone), data.shafts, "impacts", track)
    return {name: c.lines for name, c in reading.channels.items()}


def struck(
    reading: WindowReading, unit: dict[str, np.ndarray], shaft: Fraction, strength: float
) -> Iterator[WindowReading]:
    """A recording with impacts, each sensor in turn the nearest, at each angle."""
    for sensor in SENSORS:
        for angle in ANGLES:
            channels = {}
            for name, c in reading.channels.items():
                turned = np.exp(-2j * np.pi * np.arange(1, c.lines.size + 1) / (reading.period * float(shaft)) * angle)
                size = strength * (1 if name == sensor else OTHERS)
                channels[name] = replace(c, lines=c.lines + size * turned * unit[name])
            yield replace(reading, channels=channels)


def limits_table(data: Set) -> str:
    """Share of impacts that are found, by shaft and height, on the loads tuned on and the others."""
    least = DEFAULT.suspected * DEFAULT.changed
    lines = [f"{'':<34}cases  named  not judged  median deviation  least"]
    for title, loads in (("judged", [p for p in LOADS if p not in TUNED]), ("tuned on", list(TUNED))):
        for name, shaft in (("pinion", data.shafts[0]), ("gear", data.shafts[1])):
            units = {p: unit_lines(data, p, shaft) for p in loads}
            for strength in STRENGTHS:
                found = []
                for p in loads:
                    baseline = data.baseline(p)
                    expected = baseline.expected(data.readings[p])
                    for reading in struck(data.readings[p], units[p], shaft, strength):
                        own = [x for x in turn_impacts(baseline, reading, expected) if x.shaft == shaft]
                        found.append(own[0].deviation)
                z = np.array(found)
                counts = f"{np.sum(z > DEFAULT.changed):>5}  {np.sum((z > least) & (z <= DEFAULT.changed)):>10}"
                lines.append(
                    f"{f'{title}, {name}, {strength:g} x RMS':<34}{z.size:>5}  {counts}  "
                    f"{np.median(z):>16.1f}  {z.min():>5.1f}"
                )
    return "\n".join(lines)


def healthy_table(data: Set) -> str:
    """Deviations of healthy recordings, and what the tail that is stated expects of so many."""
    values: list[float] = []
    recordings = 0
    for count in (len(LOADS) - 1, len(LOADS) - 2):
        for known in combinations(LOADS, count):
            baseline = learn(data.rig, [data.readings[p] for p in known], data.shafts)
            for percent in set(LOADS) - set(known):
                reading = data.readings[percent]
                values += [x.deviation for x in turn_impacts(baseline, reading, baseline.expected(reading))]
                recordings += 1
    z = np.array(values)
    lines = [f"{z.size} healthy values of {recordings} comparisons; the largest is {z.max():.1f}"]
    lines.append("above          of them  expected")
    for limit in HEALTHY:
        tail = 1 - np.exp(-np.exp(-GUMBEL * limit - np.euler_gamma))
        lines.append(f"{limit:>5.1f}  {np.sum(z > limit):>14}  {z.size * tail:>8.1f}")
    return "\n".join(lines)


def main() -> None:
    if not (MEASURED / SET).is_dir():
        print(f"left out: {SET} is not in {MEASURED} (GEAR_TWIN_SHARED)", file=sys.stderr)
        return
    with TemporaryDirectory() as folder:
        data = Set(Path(folder))
    print(limits_table(data))
    print(f"\n{healthy_table(data)}")


if __name__ == "__main__":
    main()
