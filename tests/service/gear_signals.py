"""Windows of a made-up gear pair of 19 and 52 teeth whose lines are known in closed form."""

from __future__ import annotations

from math import pi

import numpy as np

from twin.windows import Edges, Samples, Window

START = 1_700_000_000_000_000_000
RATE, SPEED, SECONDS, Z1, Z2 = 6400.0, 10.0, 6.0, 19, 52
MESH, SIDEBAND, ERROR, RUN_OUT = 4.0, 0.6, 3e-6, 20e-6  # [m/s²], [m/s²], [m], [m]
BASE_RADIUS = 0.03
RIG = {
    "schema": "gear-rig/1",
    "name": "made up",
    "gears": {"pinion": {"teeth": Z1, "base_radius": BASE_RADIUS}, "gear": {"teeth": Z2}},
    "operating": {"pinion_speed_hz": SPEED},
    "rolling_bearings": [
        {
            "name": "drive end",
            "shaft": "pinion",
            "rolling_elements": 8,
            "element_diameter": 0.01,
            "pitch_diameter": 0.04,
        }
    ],
}


def meshing_window(index: int = 0, *, run_up: float = 0.0, noise: float = 0.01, **changes) -> Window:
    """Mesh line of MESH with a sideband of SIDEBAND at one pinion order above, TE of ERROR at the mesh and RUN_OUT at
    the gear's turn; the speed rises by a share over the window.
    """
    rng = np.random.default_rng(index)
    fine = np.linspace(0.0, SECONDS, 600_001)

    def angle(t):
        return 2 * pi * SPEED * (t + 0.5 * run_up * t**2 / SECONDS)

    t = np.arange(int(RATE * SECONDS)) / RATE
    θ = angle(t)
    values = MESH * np.cos(Z1 * θ + 0.3) + SIDEBAND * np.cos((Z1 + 1) * θ) + noise * rng.standard_normal(t.size)
    # TE = r_b1·(θ1 − θ2·z2/z1): all of it on the gear's side
    te = ERROR * np.cos(Z1 * angle(fine)) + RUN_OUT * np.cos(Z1 / Z2 * angle(fine))
    gear = (angle(fine) - te / BASE_RADIUS) * Z1 / Z2
    given = {
        "start_time_ns": START + index * 600 * 10**9,
        "accelerations": {"y6": Samples(rate=RATE, start=0.0, values=values)},
        "torques": {"pinion": Samples(rate=RATE, start=0.0, values=10 + 0.5 * np.cos(θ))},
        "encoders": {
            "pinion": edges(angle(fine), fine, 256),
            "gear": edges(gear, fine, 512),
        },
    }
    return Window(**given | changes)


def edges(angle, t, per_rev: int) -> Edges:
    first = int(np.ceil(angle[0] / (2 * pi) * per_rev)) + 1
    last = int(angle[-1] / (2 * pi) * per_rev)
    return Edges(
        per_rev=per_rev, first_index=first, times=np.interp(np.arange(first, last) * 2 * pi / per_rev, angle, t)
    )
