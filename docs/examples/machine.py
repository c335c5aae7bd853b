"""Writes CSV files of a gearbox for docs/tutorial.md: one of an eccentric pinion, six healthy, one of a chipped tooth.

    python docs/examples/machine.py

Stand-ins for recordings of one's own: a 23/57 spur pair at about 24.6 Hz, two accelerometers in g, a tachometer in V
with one pulse per turn of the pinion, a time column, a date in the first line, a different load in each file. Every
tooth differs a little from the next, as in real gears.
"""

import csv

import numpy as np

TEETH = (23, 57)
RATE = 5120.0  # [Hz]
SPEED = 24.6  # of the pinion without load [Hz]
DURATION = 10.0  # [s]
LOADS = (0.15, 0.3, 0.45, 0.6, 0.75, 0.9)  # of the rated torque
HIGHEST = 100  # order of the pinion up to which the machine has lines
COLUMNS = ("Time (s)", "Acc1 (g)", "Acc2 (g)", "Tacho (V)")


def recording(
    load: float, seed: int, blow: float = 0.0, modulation: float = 0.0, duration: float = DURATION
) -> np.ndarray:
    """Time [s], two accelerations [g] and a tachometer [V], (n, 4).

    blow        what the damaged gear tooth adds once a gear turn [g]
    modulation  depth of the modulation of the mesh by the turn of the pinion
    """
    chance, machine = np.random.default_rng(seed), np.random.default_rng(2357)
    t = np.arange(int(duration * RATE)) / RATE
    speed = SPEED * (1 - 0.01 * load)  # an induction motor slips under load
    angle = 2 * np.pi * (speed * t + chance.uniform(0, 57))
    signals = 0.02 * chance.normal(size=(2, t.size))
    for teeth in TEETH:  # lines of either shaft, the mesh among them
        shaft = 1.0 if teeth == TEETH[0] else TEETH[0] / TEETH[1]
        for multiple in range(1, int(HIGHEST / shaft)):
            meshing = multiple % teeth == 0
            if meshing and teeth == TEETH[1]:
                continue
            size = (0.2 * teeth / multiple if meshing else 0.004 * abs(machine.normal())) * (0.6 + 0.8 * load)
            phases = machine.uniform(0, 2 * np.pi, 2) + 0.4 * load * machine.normal()
            wave = size * np.cos(multiple * shaft * angle + phases[:, None])
            signals += wave * (1 + modulation * np.cos(angle)) if meshing else wave
    turn = angle * TEETH[0] / TEETH[1] / (2 * np.pi) % 1
    signals[0] += blow * np.exp(-0.5 * ((turn - 0.5) / 0.01) ** 2)
    pulse = np.where(angle / (2 * np.pi) % 1 < 0.05, 5.0, 0.1) + 0.02 * chance.normal(size=t.size)
    return np.column_stack((t, *signals, pulse))


def write(name: str, values: np.ndarray, date: str = "2026-03-09T08:00:00Z") -> None:
    with open(name, "w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        file.write(f"Date: {date}\r\n")
        table.writerow(COLUMNS)
        table.writerows([f"{v:.6g}" for v in row] for row in values)


if __name__ == "__main__":
    write("run.csv", recording(load=0.5, seed=7, modulation=0.15, duration=20.0))
    for number, load in enumerate(LOADS, 1):
        write(f"healthy-{number}.csv", recording(load, seed=number), f"2026-03-02T{7 + number:02}:00:00Z")
    write("today.csv", recording(load=0.5, seed=99, blow=0.3), "2026-03-16T08:00:00Z")
