"""The transfer path from the mesh to the accelerometer: acceleration over transmission error, and what a sensor adds.

    ln(y_k/TE_k) − ln(H_y/H_TE)(f_k) = ln g(f_k) + δ_k + noise

The mesh's excitation cancels in the quotient: wear, misalignment, profile and stiffness leave it alone. What is left is
the structure, within the rig file's tolerance (δ, by draws), and the sensor. Lines of several harmonics and speeds are
fitted together with the draws' covariance; a gain moves all of them alike, a resonance by its own curve.

A machine whose structure is another than the rig file's (a casing with modes of its own) has quotients that differ by
half and more and turn in phase from line to line. Nothing can then be said of the sensor from levels alone; a *change*
of the quotient between windows still can, for structures do not change (onset).

Source   twin/effects/sensor_gain.py, sensor_resonance.py; the structure's tolerance: `[tolerances]` of the rig file
Holds    without friction, which acts across the line of action: its share is taken out first
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import logsumexp

from twin.closed_forms import log_density
from twin.dynamics.structure import Structure, direction
from twin.effects import EFFECTS
from twin.effects.response import Effect
from twin.rig import Rig
from twin.thresholds import deciding
from twin.tracing.joint_fit import JointFit
from twin.tracing.mount_resonance import Mounts, within_half_turns
from twin.tracing.observed import Observed

DRAWS = 160  # of structures within the rig file's tolerance


@dataclass(frozen=True, slots=True, kw_only=True)
class TransferPathThresholds:
    """Which lines tell of the path, and how well."""

    own_scatter: float = deciding(
        0.02, meaning="of a quotient's logarithm beyond the structure's tolerance", source="not derived: chosen"
    )
    least_error: float = deciding(
        0.5,
        of="pinion graduation error",
        meaning="line of the transmission error that is more than graduation and noise",
        source="0.3 µm on the reference rig; tuned on D00–D13 and T01–T58; not derived",
    )
    error_noise: float = deciding(
        0.0833,
        of="pinion graduation error",
        meaning="noise of a line of the transmission error",
        source="measured: 0.05 µm on the reference rig",
    )
    clear_line: float = deciding(
        8.0, of="standard deviation", meaning="acceleration line that is used", source="not derived: chosen"
    )
    modelled_scatter: float = deciding(
        0.4,
        meaning="of a quotient's logarithm where the model's transmission error is used instead of the measured one",
        source="tuned on D00–D13 and T01–T58; not derived",
    )
    other_structure_scatter: float = deciding(
        0.7,
        meaning="standard deviation of ln and of the phase of a quotient where the structure is another one",
        source="observed: quotients of a finite-element machine of the same frequencies differ by half and more",
    )
    same_frequency: float = deciding(
        0.02, meaning="relative difference of frequency of lines that share the path", source="not derived: chosen"
    )
    least_step_lines: int = deciding(
        4, meaning="lines beyond one a group that a change of gain is judged by", source="not derived: chosen"
    )
    tolerance_scales: tuple[float, ...] = deciding(
        (1.0, 1.41, 2.0),
        of="rig file's tolerance of the structure",
        meaning="spreads of the structure that are taken for equally likely",
        source="not derived: tolerances are estimates, trusted within a factor of two; even on a logarithmic scale",
    )


THRESHOLDS = TransferPathThresholds()


@dataclass(frozen=True, slots=True, kw_only=True)
class Quotient:
    """One line of acceleration over that of the transmission error, as the twin predicts it."""

    frequency: float  # [Hz]
    log: complex  # ln (measured/predicted)
    std: float  # of the real and of the imaginary part
    order: int  # mesh harmonic
    modelled: bool = False  # whether the model's transmission error is used instead of the measured one
    revolutions: float = 0.0  # of the pinion, when it was recorded


@dataclass(frozen=True, slots=True, kw_only=True)
class PathFit:
    """What the quotients say of the sensor."""

    name: str  # "sensor_gain" or "sensor_resonance"
    effect: Effect
    std: float  # of ln g, or of ln f_0
    damping_std: float = 0.0  # of a resonance's damping ratio
    log_evidence: float  # against a sensor as it should be [nat]
    over_other: float  # against a structure that is not the rig file's


def _scaled(values, rng: np.random.Generator, spread: float):
    """A copy of a table with every number scaled by its own draw, evenly within ± spread."""
    return {
        key: value * float(1 + spread * rng.uniform(-1, 1))
        if isinstance(value, (int, float)) and not isinstance(value, bool)
        else value
        for key, value in values.items()
    }


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Paths:
    """Several structures, side by side, seen from the mesh."""

    omega: np.ndarray  # of the modes (s, 21) [rad/s]
    damping: np.ndarray  # 2ζω of the modes (s, 21) [rad/s]
    to_sensor: np.ndarray  # what a force at the mesh makes of each mode's acceleration at the sensor (s, 21)
    to_error: np.ndarray  # and of its transmission error (s, 21)

    @classmethod
    def of(cls, structures: Sequence[Structure], sensor: str) -> _Paths:
        at = direction({sensor: 1.0})
        driven = [s.modes[1].T @ s.mesh for s in structures]
        return cls(
            omega=np.array([s.modes[0] for s in structures]),
            damping=np.array([s.modal_damping_terms for s in structures]),
            to_sensor=np.array([(at @ s.modes[1]) * by for s, by in zip(structures, driven, strict=True)]),
            to_error=np.array(
                [(s.transmission_error @ s.modes[1]) * by for s, by in zip(structures, driven, strict=True)]
            ),
        )

    def logs(self, frequencies: np.ndarray) -> np.ndarray:
        """ln of acceleration over transmission error, for a force at the mesh (s, n) complex."""
        ω = 2 * np.pi * frequencies[:, None]
        modal = 1 / (self.omega[:, None] ** 2 - ω**2 + 1j * ω * self.damping[:, None])  # (s, n, 21)
        a = -(ω[:, 0] ** 2) * (modal * self.to_sensor[:, None]).sum(axis=2)
        e = (modal * self.to_error[:, None]).sum(axis=2)
        return np.log(a / e)


@lru_cache(maxsize=4)
def _draws(text: str, damping: float, sensor: str) -> _Paths:
    """Structures within the tolerance of a rig; the seed is fixed: a pure function."""
    rig, rng = Rig(json.loads(text)), np.random.default_rng(2019)
    out = []
    for _ in range(DRAWS):
        changed, ζ = within_tolerances(rig, damping, rng)
        out.append(Structure.from_rig(changed, modal_damping=ζ))
    return _Paths.of(out, sensor)


def within_tolerances(rig: Rig, damping: float, rng: np.random.Generator) -> tuple[Rig, float]:
    """A rig whose structure is drawn within the tolerances of another one, and its modal damping ratio."""
    values, allowed = json.loads(rig.text), rig.tolerances
    changed = dict(values)
    for table, spread in (
        ("torsional_stiffness", allowed.stiffness),
        ("bearings", allowed.stiffness),
        ("inertias", allowed.mass),
        ("masses", allowed.mass),
    ):
        changed[table] = _scaled(values[table], rng, spread)
    shafts = dict(values["shafts"])
    for key in ("bending_stiffness_input", "bending_stiffness_output"):
        shafts[key] *= float(1 + allowed.stiffness * rng.uniform(-1, 1))
    changed["shafts"] = shafts
    return Rig(changed), min(damping * float(1 + allowed.damping * rng.uniform(-1, 1)), 0.9)


def path_log(rig: Rig, damping: float, frequencies: np.ndarray) -> np.ndarray:
    """ln of acceleration over transmission error for a force at the mesh, of the rig file's structure (n,) complex."""
    (sensor,) = rig.require("the accelerometer's place", "sensors.accelerometer")
    return _Paths.of([Structure.from_rig(rig, modal_damping=damping)], sensor).logs(frequencies)[0]


def path_covariance(rig: Rig, damping: float, frequencies: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of ln(path) over a rig's tolerance, against the rig file's own; (2n,), (2n, 2n).

    Real parts first, then phases.
    """
    (sensor,) = rig.require("the accelerometer's place", "sensors.accelerometer")
    nominal = _Paths.of([Structure.from_rig(rig, modal_damping=damping)], sensor).logs(frequencies)
    logs = _draws(rig.text, damping, sensor).logs(frequencies) - nominal
    phases = np.angle(np.exp(1j * logs.imag))
    both = np.concatenate((logs.real, phases), axis=1)
    return both.mean(axis=0), np.cov(both.T)


def quotients(
    fit: JointFit,
    windows: Sequence[Observed],
    teeth: int,
    graduation: float,
    limits: TransferPathThresholds = THRESHOLDS,
) -> list[Quotient]:
    """Quotients of all windows, against the model's own lines.

    Where the transmission error is too weak to be read, the model's is used, with what its shape may be off.

    teeth       of the pinion
    graduation  standard deviation of an encoder disc's graduation error [m]
    """
    out = []
    least, noise = limits.least_error * graduation, limits.error_noise * graduation
    for window, predicted in zip(windows, fit.predictions, strict=True):
        error, heard = predicted.lines["encoder"], predicted.lines["acceleration"]
        for k in range(1, heard.size + 1):
            y, y_std = window.lines["acceleration"][k - 1], window.std["acceleration"][k - 1]
            if not np.isfinite(y) or abs(y) < limits.clear_line * y_std or not window.worn:
                continue
            ratio, std = y * np.exp(-1j * k * fit.phase) / heard[k - 1], limits.modelled_scatter
            if k <= error.size:
                e, e_std = window.lines["encoder"][k - 1], window.std["encoder"][k - 1]
                if np.isfinite(e) and abs(e) > least:
                    ratio = ratio * error[k - 1] / (e * np.exp(-1j * k * fit.phase))
                    std = float(np.hypot(noise, e_std) / abs(e))
            out.append(
                Quotient(
                    frequency=k * teeth * window.condition.speed_hz,
                    log=complex(np.log(ratio)),
                    std=float(np.hypot(std, y_std / abs(y))),
                    order=k,
                    modelled=std >= limits.modelled_scatter,
                    revolutions=window.revolutions,
                )
            )
    return out


def merged(quotients: Sequence[Quotient], limits: TransferPathThresholds = THRESHOLDS) -> list[Quotient]:
    """Quotients of one line at nearly one frequency, over windows, as one each."""
    out: list[Quotient] = []
    left = sorted(quotients, key=lambda q: (q.order, q.modelled, q.frequency))
    while left:
        first = left[0]
        same = [
            q
            for q in left
            if (q.order, q.modelled) == (first.order, first.modelled)
            and abs(q.frequency / first.frequency - 1) < limits.same_frequency
        ]
        left = [q for q in left if q not in same]
        weight = np.array([1 / q.std**2 for q in same])
        turned = np.array([q.log.real + 1j * np.angle(np.exp(1j * q.log.imag)) for q in same])
        centre = np.angle((weight * np.exp(1j * turned.imag)).sum())
        phase = centre + (weight * np.angle(np.exp(1j * (turned.imag - centre)))).sum() / weight.sum()
        out.append(
            Quotient(
                frequency=float((weight * [q.frequency for q in same]).sum() / weight.sum()),
                log=complex((weight * turned.real).sum() / weight.sum(), phase),
                std=limits.modelled_scatter if first.modelled else float(1 / np.sqrt(weight.sum())),
                order=first.order,
                modelled=first.modelled,
            )
        )
    return out


def fit_sensor(
    rig: Rig, damping: float, quotients: Sequence[Quotient], limits: TransferPathThresholds = THRESHOLDS
) -> list[PathFit]:
    """Gain and resonance of the sensor by their evidence; empty where fewer than two lines are clear."""
    lines = merged(quotients, limits)
    if len(lines) < 2:
        return []
    f = np.array([q.frequency for q in lines])
    z = np.concatenate(([q.log.real for q in lines], [q.log.imag for q in lines]))
    mean, C = path_covariance(rig, damping, f)
    noise = np.diag(np.tile([q.std**2 + limits.own_scatter**2 for q in lines], 2))
    other = limits.other_structure_scatter**2 * np.eye(z.size)
    path = PathScatter(
        rest=within_half_turns(z - mean),
        covariances=tuple(s**2 * C + noise for s in limits.tolerance_scales),
        other=C + noise + other,
    )
    gain = _fitted_gain(path, rig.tolerances.accelerometer_gain)
    resonance = _fitted_resonance(path, Mounts.of(rig.band[1], f))
    return [gain, resonance]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PathScatter:
    """Quotients of n lines, and how far structures within the tolerance scatter them; real parts first, then phases.

    How wide the tolerance really is, is not known: the scales are equally likely before the lines are seen.
    """

    rest: np.ndarray  # ln of the quotients, less the mean over the tolerance (2n,)
    covariances: tuple[np.ndarray, ...]  # for each scale of the tolerance (2n, 2n)
    other: np.ndarray  # of a structure of another kind (2n, 2n)

    def likelihoods(self, rest: np.ndarray | None = None, added: np.ndarray | float = 0.0) -> np.ndarray:
        """ln likelihood for each scale (s,), of the quotients or of others (m, 2n) → (s, m), with more covariance."""
        rest = self.rest if rest is None else rest
        return np.array([log_density(rest, C + added) for C in self.covariances])

    @property
    def plain(self) -> float:
        """ln evidence of a sensor as it should be."""
        return float(_ln_mean(self.likelihoods()))

    @property
    def by_other(self) -> float:
        """ln evidence of another structure."""
        return float(log_density(self.rest, self.other))


def _ln_mean(logs: np.ndarray) -> np.ndarray:
    """ln of the mean of exp over the first axis."""
    return logsumexp(logs, axis=0) - np.log(logs.shape[0])


def _fitted_gain(path: PathScatter, prior: float) -> PathFit:
    """A gain g that all lines share, ln g with the prior's standard deviation."""
    n = path.rest.size // 2
    level = np.concatenate((np.ones(n), np.zeros(n)))
    with_gain = path.likelihoods(added=prior**2 * np.outer(level, level))
    weight = np.exp(with_gain - with_gain.max())
    weight /= weight.sum()
    inverse = [np.linalg.inv(C) for C in path.covariances]
    information = np.array([level @ P @ level + 1 / prior**2 for P in inverse])
    values = np.array([level @ P @ path.rest for P in inverse]) / information
    ln_g = float(weight @ values)
    evidence = float(_ln_mean(with_gain))
    return PathFit(
        name="sensor_gain",
        effect=EFFECTS["sensor_gain"](gain=float(np.exp(ln_g))),
        std=float(np.sqrt(weight @ (1 / information + (values - ln_g) ** 2))),
        log_evidence=evidence - path.plain,
        over_other=evidence - path.by_other,
    )


def _fitted_resonance(path: PathScatter, mounts: Mounts) -> PathFit:
    """A resonance of the mount."""
    found = mounts.likeliest(_ln_mean(path.likelihoods(mounts.left_of(path.rest))))
    return PathFit(
        name="sensor_resonance",
        effect=found.effect,
        std=found.std,
        damping_std=found.damping_std,
        log_evidence=found.log_evidence - path.plain,
        over_other=found.log_evidence - path.by_other,
    )
