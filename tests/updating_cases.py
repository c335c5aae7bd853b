"""Windows as the model itself would make them, for tests of the estimators' algebra."""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from tests.dynamics_cases import PRIOR, RIG, TEN, model
from twin.features.window_features import MeasuredLines, WindowFeatures
from twin.model import Condition, Model
from twin.wear.curve import LINES, MasterCurve

TEETH = RIG.teeth[0]
HOUR_NS = 3_600_000_000_000


@lru_cache(maxsize=4)
def curve(until: float = 60e-6, condition: Condition = TEN) -> MasterCurve:
    return MasterCurve.build(model(), condition, model().unworn, until)


def lines(unit, amplitudes, std, mean=0.0) -> MeasuredLines:
    """Mesh harmonics 1 … n (n,) and a mean."""
    n = len(amplitudes)
    return MeasuredLines(
        unit=unit,
        keys=((0, 0, 0), *((k, 0, 0) for k in range(1, n + 1))),
        orders=(0.0, *(float(TEETH * k) for k in range(1, n + 1))),
        amplitudes=(complex(mean), *(complex(a) for a in amplitudes)),
        std=(std,) * (n + 1),
    )


def seen(
    profile,
    condition: Condition = TEN,
    *,
    twin: Model | None = None,
    revolutions: float = 10.0,
    phase: float = 0.0,
    offset: float = 0.0,
    disturbance: np.ndarray | float = 0.0,
    noise: float = 0.0,
    seed: int = 1,
    gear_encoder: bool = True,
    torque_meter: bool = True,
) -> WindowFeatures:
    """Features of a noiseless machine that is the model, with its encoder's zero turned by `phase` [rad]."""
    twin = twin or model()
    steady = twin.steady(profile, condition)
    turn = np.exp(1j * np.arange(1, LINES + 1) * phase)
    random = np.random.default_rng(seed)
    jitter = noise * (random.normal(size=LINES) + 1j * random.normal(size=LINES))
    te = twin.transmission_error_lines(steady)[:LINES] * turn + disturbance + jitter
    heard = twin.acceleration_lines(steady)[:LINES] * turn
    inside = np.arange(1, LINES + 1) * TEETH * condition.speed_hz <= RIG.band[1]
    mean = twin.mean_transmission_error(steady, condition) + offset
    return WindowFeatures(
        start_time_ns=int(revolutions * HOUR_NS),
        duration=2.5,
        quality="good",
        angle_from="encoder/pinion",
        speed_hz=condition.speed_hz,
        revolutions=revolutions,
        turns=2.5 * condition.speed_hz,
        torque_nm=condition.torque if torque_meter else None,
        sensor="y6",
        rms=float(np.sqrt(0.5 * np.sum(np.abs(heard[inside]) ** 2))),
        noise_rms=0.0,
        band=RIG.band,
        mesh_bands=tuple(float(abs(a) / np.sqrt(2)) for a in heard[:5]),
        acceleration=lines("m/s²", heard, 1e-4),
        transmission_error=lines("m", te, max(noise, 1e-9), mean) if gear_encoder else None,
        pinion_motion=None if gear_encoder else lines("m", twin.pinion_motion_lines(steady)[:LINES] * turn, 1e-9),
        unavailable={} if torque_meter else {"torque_nm": "no torque channel"},
    )


def machine(**changes: float) -> Model:
    """The reference machine with other calibrated values, relative to the rig file's."""
    values = {name: getattr(PRIOR, name) * factor for name, factor in changes.items()}
    return Model.of(RIG, replace(PRIOR, **values))
