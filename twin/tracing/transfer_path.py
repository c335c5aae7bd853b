"""Sensor gain and sensor resonance, from the acceleration over the transmission error.

    ln(y_k/TE_k) − ln(H_y/H_TE)(f_k) = ln g(f_k) + δ_k + noise

The mesh's excitation cancels in the quotient: wear, misalignment, profile and stiffness leave it alone. What is left is
the structure, within the rig file's tolerance (δ, by draws), and the sensor. Lines of several harmonics and speeds are
fitted together with the draws' covariance; a gain moves all of them alike, a resonance by its own curve.

A machine whose structure is another than the rig file's (a casing with modes of its own) has quotients that differ by
half and more and turn in phase from line to line. Nothing can then be said of the sensor from levels alone; a *change*
of the quotient between windows still can, for structures do not change (onset).

Source   twin/effects/sensor_gain.py, sensor_resonance.py; tolerances as in the reference campaigns: stiffness 3 %,
         mass 1 %, damping 20 %
Holds    without friction, which acts beside the line of action: its share is taken out first
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from scipy.stats import multivariate_normal

from twin.dynamics.structure import Structure, direction
from twin.effects import EFFECTS
from twin.effects.response import Effect
from twin.rig import Rig
from twin.tracing.joint_fit import JointFit
from twin.tracing.observed import Observed

DRAWS = 160
STIFFNESS, MASS, DAMPING = 0.03, 0.01, 0.2  # relative half-widths of what a rig file's values may be off
OWN = 0.02  # of a quotient's logarithm beyond the draws
LEAST_ERROR = 0.3e-6  # transmission error from which its line is more than graduation and noise [m]
ERROR_NOISE = 0.05e-6  # [m]
GAIN_PRIOR = 0.2  # of ln g
OTHER = 0.7  # std of ln and of the phase where the structure is another one
SEEN = 8.0  # line over its std
MODELLED = 0.4  # of a quotient's logarithm where the twin's transmission error stands for the measured one
RESONANCES = np.geomspace(500.0, 6000.0, 60)  # [Hz]
RATIOS = (0.02, 0.05, 0.1)  # damping of the mount


@dataclass(frozen=True, slots=True, kw_only=True)
class Quotient:
    """One line of acceleration over that of the transmission error, as the twin predicts it."""

    frequency: float  # [Hz]
    log: complex  # ln (measured/predicted)
    std: float  # of the real and of the imaginary part
    order: int  # mesh harmonic
    modelled: bool = False  # whether the twin's transmission error stands for the measured one
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


@lru_cache(maxsize=4)
def _draws(text: str, damping: float) -> tuple[Structure, ...]:
    """Structures within the tolerance of a rig; the seed is fixed: a pure function."""
    values, rng = json.loads(text), np.random.default_rng(2019)
    out = []
    for _ in range(DRAWS):
        changed = dict(values)
        for table, spread in (
            ("torsional_stiffness", STIFFNESS),
            ("bearings", STIFFNESS),
            ("inertias", MASS),
            ("masses", MASS),
        ):
            changed[table] = _scaled(values[table], rng, spread)
        shafts = dict(values["shafts"])
        for key in ("bending_stiffness_input", "bending_stiffness_output"):
            shafts[key] *= float(1 + STIFFNESS * rng.uniform(-1, 1))
        changed["shafts"] = shafts
        ζ = min(damping * float(1 + DAMPING * rng.uniform(-1, 1)), 0.9)
        out.append(Structure.from_rig(Rig(changed), modal_damping=ζ))
    return tuple(out)


def _log_paths(structure: Structure, frequencies: np.ndarray, sensor: str) -> np.ndarray:
    """ln of acceleration over transmission error, for a force at the mesh (n,) complex."""
    ω = 2 * np.pi * frequencies
    a = -(ω**2) * structure.receptance(ω, structure.mesh, direction({sensor: 1.0}))
    e = structure.receptance(ω, structure.mesh, structure.transmission_error)
    return np.log(a / e)


def path_covariance(rig: Rig, damping: float, frequencies: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of ln(path) over a rig's tolerance, against the rig file's own; (2n,), (2n, 2n).

    Real parts first, then phases.
    """
    (sensor,) = rig.require("the accelerometer's place", "sensors.accelerometer")
    nominal = _log_paths(Structure.from_rig(rig, modal_damping=damping), frequencies, sensor)
    text = json.dumps(rig.values, sort_keys=True)
    logs = np.array([_log_paths(s, frequencies, sensor) for s in _draws(text, damping)]) - nominal
    phases = np.angle(np.exp(1j * logs.imag))
    both = np.concatenate((logs.real, phases), axis=1)
    return both.mean(axis=0), np.cov(both.T)


def quotients(fit: JointFit, windows: Sequence[Observed], teeth: int) -> list[Quotient]:
    """Quotients of all windows, against the twin's own lines.

    Where the transmission error is too weak to be read, the twin's stands for it, with what its shape may be off.
    """
    out = []
    for window, predicted in zip(windows, fit.predictions, strict=True):
        error, heard = predicted.lines["encoder"], predicted.lines["acceleration"]
        for k in range(1, heard.size + 1):
            y, y_std = window.lines["acceleration"][k - 1], window.std["acceleration"][k - 1]
            if not np.isfinite(y) or abs(y) < SEEN * y_std or not window.worn:
                continue
            ratio, std = y * np.exp(-1j * k * fit.phase) / heard[k - 1], MODELLED
            if k <= error.size:
                e, e_std = window.lines["encoder"][k - 1], window.std["encoder"][k - 1]
                if np.isfinite(e) and abs(e) > LEAST_ERROR:
                    ratio = ratio * error[k - 1] / (e * np.exp(-1j * k * fit.phase))
                    std = float(np.hypot(ERROR_NOISE, e_std) / abs(e))
            out.append(
                Quotient(
                    frequency=k * teeth * window.condition.speed_hz,
                    log=complex(np.log(ratio)),
                    std=float(np.hypot(std, y_std / abs(y))),
                    order=k,
                    modelled=std >= MODELLED,
                    revolutions=window.revolutions,
                )
            )
    return out


def merged(quotients: Sequence[Quotient]) -> list[Quotient]:
    """Quotients of one line at nearly one frequency, over windows, as one each."""
    out: list[Quotient] = []
    left = sorted(quotients, key=lambda q: (q.order, q.modelled, q.frequency))
    while left:
        first = left[0]
        same = [
            q
            for q in left
            if (q.order, q.modelled) == (first.order, first.modelled) and abs(q.frequency / first.frequency - 1) < 0.02
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
                std=MODELLED if first.modelled else float(1 / np.sqrt(weight.sum())),
                order=first.order,
                modelled=first.modelled,
            )
        )
    return out


@dataclass(frozen=True, slots=True, kw_only=True)
class GainStep:
    """A sensor whose gain has changed in mid-campaign."""

    gain: float  # after over before
    std: float  # of its logarithm
    onset: float  # revolutions
    log_evidence: float


def gain_step(quotients: Sequence[Quotient]) -> GainStep | None:
    """The change of gain at one time that all measured lines share; None where there is none.

    ln|q| of line and condition: a_k before, a_k + ln g after. The structure is the same before and after and drops
    out, so this needs no rig file's tolerance.
    """
    lines = [q for q in quotients if not q.modelled]
    turns = sorted({q.revolutions for q in lines})
    groups: list[list[Quotient]] = []
    for q in sorted(lines, key=lambda q: (q.order, q.frequency)):
        last = groups[-1][0] if groups else None
        if last is not None and last.order == q.order and abs(q.frequency / last.frequency - 1) < 0.02:
            groups[-1].append(q)
        else:
            groups.append([q])
    groups = [g for g in groups if len(g) >= 2]
    best: GainStep | None = None
    for before, after in pairwise(turns):
        onset = 0.5 * (before + after)
        information = total = squares = 0.0
        count = 0
        for group in groups:
            y = np.array([q.log.real for q in group])
            weight = 1 / np.array([np.hypot(q.std, OWN) for q in group]) ** 2
            late = np.array([q.revolutions > onset for q in group], dtype=float)
            y, late = y - np.average(y, weights=weight), late - np.average(late, weights=weight)
            information += float(weight @ late**2)
            total += float(weight @ (late * y))
            squares += float(weight @ y**2)
            count += len(group) - 1
        if information == 0 or count < 4:
            continue
        step = total / information
        rest = max(squares - total**2 / information, 0.0) / (count - 1)
        widen = max(rest, 1.0)
        evidence = 0.5 * total**2 / information / widen - 0.5 * np.log1p(GAIN_PRIOR**2 * information / widen)
        if best is None or evidence > best.log_evidence:
            std = float(np.sqrt(widen / information))
            best = GainStep(gain=float(np.exp(step)), std=std, onset=onset, log_evidence=float(evidence))
    return best


def fit_sensor(rig: Rig, damping: float, quotients: Sequence[Quotient]) -> list[PathFit]:
    """Gain and resonance of the sensor by their evidence; empty where no line tells."""
    lines = merged(quotients)
    if len(lines) < 2:
        return []
    f = np.array([q.frequency for q in lines])
    z = np.concatenate(([q.log.real for q in lines], [q.log.imag for q in lines]))
    mean, C = path_covariance(rig, damping, f)
    C = C + np.diag(np.tile([q.std**2 + OWN**2 for q in lines], 2))
    rest = z - mean
    n = len(lines)
    plain = multivariate_normal.logpdf(rest, cov=C)
    other = multivariate_normal.logpdf(rest, cov=C + OTHER**2 * np.eye(2 * n))
    level = np.concatenate((np.ones(n), np.zeros(n)))
    with_gain = multivariate_normal.logpdf(rest, cov=C + GAIN_PRIOR**2 * np.outer(level, level))
    inverse = np.linalg.inv(C)
    information = level @ inverse @ level + 1 / GAIN_PRIOR**2
    ln_g = float(level @ inverse @ rest / information)
    std = float(1 / np.sqrt(information))
    out = [
        PathFit(
            name="sensor_gain",
            effect=EFFECTS["sensor_gain"](gain=float(np.exp(ln_g))),
            std=std,
            log_evidence=float(with_gain - plain),
            over_other=float(with_gain - other),
        )
    ]
    tried = []
    for f0 in RESONANCES:
        for ζ in RATIOS:
            effect = EFFECTS["sensor_resonance"](frequency=float(f0), damping_ratio=ζ)
            shape = np.log(effect.response(f))
            moved = rest - np.concatenate((shape.real, np.angle(np.exp(1j * shape.imag))))
            tried.append((float(multivariate_normal.logpdf(moved, cov=C)), effect))
    likelihood = np.array([t[0] for t in tried])
    best = int(np.argmax(likelihood))
    evidence = float(np.log(np.mean(np.exp(likelihood - likelihood[best]))) + likelihood[best])
    weight = np.exp(likelihood - likelihood[best])
    logs = np.log([t[1].frequency for t in tried])
    spread = float(np.sqrt((weight * (logs - (weight * logs).sum() / weight.sum()) ** 2).sum() / weight.sum()))
    ratios = np.array([t[1].damping_ratio for t in tried])
    step = float(np.log(RESONANCES[1] / RESONANCES[0]))
    out.append(
        PathFit(
            name="sensor_resonance",
            effect=tried[best][1],
            std=float(np.hypot(spread, step / np.sqrt(12))),
            damping_std=float(np.sqrt(weight @ (ratios - tried[best][1].damping_ratio) ** 2 / weight.sum())),
            log_evidence=evidence - float(plain),
            over_other=evidence - float(other),
        )
    )
    return out
