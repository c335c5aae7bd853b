"""Eccentricity of pinion or gear from its run-out in the transmission error and the sidebands it makes.

    E = e·e^{iφ}        TE at the shaft's own order = E + graduation        sidebands k·z1 ± o: S⁺_k·E, S⁻_k·conj(E)

S    by the harmonic balance with a reference eccentricity, scaled by the measured over the predicted mesh line, so that
     neither the path to the housing nor what softens the mesh has to be known
o    order of the shaft: 1 or z1/z2

An encoder disc sits off its own centre by a micrometre or two, which looks like run-out but moves no tooth: the
order of the shaft alone never proves an eccentricity, its sidebands must agree with it. The mesh's sidebands of a
healthy machine are not zero: teeth differ, the speed wanders. Worn flanks show less of the contact's shift than flanks
that end sharply where the nominal path does; how much less, the sidebands of the worn windows say.

Sizes    graduation 1.5 µm (once a turn of the disc), sidebands of worn machines some 0.4 % of their mesh line
Source   twin/effects/eccentricity.py; R. B. Randall, J. Mech. Des. 104 (1982) 259–267 (sidebands of gear vibration)
Holds    shafts whose sidebands stand apart in the window: 1.2/(z1/z2) turns or more
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from twin.effects import EFFECTS
from twin.effects.response import Effect, Response, solve_with
from twin.errors import NotConverged
from twin.features.window_features import MeasuredLines, WindowFeatures
from twin.model import Condition, Model
from twin.wear.profile import WornProfile

GRADUATION = 1.5e-6  # std of a disc's once-a-turn error, of the real and of the imaginary part together [m]
SHARE = 0.004  # of a mesh line that stands in a sideband of a healthy worn machine
FLOOR = {"acceleration": 0.003, "transmission_error": 0.04e-6}  # [m/s²], [m]
SCATTER = 0.3  # relative, of a predicted sideband
HARMONICS = (1, 2, 3, 4, 5)
REFERENCE = 20e-6  # [m]
PRIOR = 50e-6  # [m]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Line:
    """One measured line and what E does to it: m = s·E or s·conj(E)."""

    measured: complex
    std: float  # of noise, per complex value
    per_metre: complex
    lower: bool
    worn: bool

    def predicted(self, E: complex) -> complex:
        return self.per_metre * (E.conjugate() if self.lower else E)


@dataclass(frozen=True, slots=True, kw_only=True)
class EccentricityFit:
    """What the lines of one shaft say."""

    shaft: int  # 0 pinion, 1 gear
    eccentricity: float  # e [m]
    high_point: float  # φ [rad], in the twin's angle
    std: float  # of e [m]
    log_evidence: float  # against none
    by_sidebands: float  # the part of it that the sidebands alone give
    run_out: float | None  # |E| at the shaft's own order in the transmission error [m]
    disagreement: float  # of run-out and sidebands, over what both may be off
    shift_share: float  # of the contact's shift that the worn windows' sidebands show
    shift_share_std: float

    @property
    def effect(self) -> Effect:
        return KINDS[self.shaft](
            eccentricity=self.eccentricity, high_point=self.high_point, shift_share=self.shift_share
        )

    @property
    def proven(self) -> bool:
        """Whether teeth, not a disc, run out."""
        if self.run_out is not None and (self.run_out < LEAST_RUN_OUT or self.disagreement > MOST_DISAGREEMENT):
            return False
        return self.by_sidebands > LEAST_EVIDENCE and self.log_evidence > LEAST_EVIDENCE


KINDS = (EFFECTS["pinion_eccentricity"], EFFECTS["gear_eccentricity"])
LEAST_EVIDENCE = 10.0  # [nat]
LEAST_RUN_OUT = 6e-6  # a poor disc's own reaches 4 µm [m]
MOST_DISAGREEMENT = 3.0
MOST_SHARE = 1.5  # of the contact's shift


def _key(k: int, side: int, shaft: int) -> tuple[int, int, int]:
    return (k, side, 0) if shaft == 0 else (k, 0, side)


def _sidebands(
    lines: MeasuredLines | None,
    channel: str,
    response: Response,
    shaft: int,
    teeth: tuple[int, int],
    ψ: float,
    worn: bool,
) -> list[_Line]:
    """The sidebands of one channel that were read, with what the response has there."""
    if lines is None:
        return []
    z1, own = teeth[0], (1.0, teeth[0] / teeth[1])[shaft]
    at = response.acceleration if channel == "acceleration" else response.transmission_error
    out = []
    for k in HARMONICS:
        mesh, mesh_std = lines.get(k), lines.get_std(k)
        if mesh is None or mesh_std is None:
            continue
        (m,) = at([k * z1])
        θ0 = ψ / z1
        heard = mesh * np.exp(-1j * k * ψ)
        factor = heard / m if abs(heard) > 5 * mesh_std and 0.1 < abs(heard / m) < 10 else 1.0
        for side in (1, -1):
            y, std = lines.get(*_key(k, side, shaft)), lines.get_std(*_key(k, side, shaft))
            if y is None or std is None:
                continue
            order = k * z1 + side * own
            (s,) = at([order])
            noise = np.sqrt(2 * std**2 + FLOOR[channel] ** 2 + (SHARE * abs(mesh) * worn) ** 2)
            out.append(
                _Line(
                    measured=complex(y * np.exp(-1j * order * θ0)),
                    std=float(noise),
                    per_metre=complex(factor * s / REFERENCE),
                    lower=side < 0,
                    worn=worn,
                )
            )
    return out


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class EccentricityWindow:
    """A window and what else is in the twin when it was recorded."""

    features: WindowFeatures
    condition: Condition
    profile: WornProfile
    worn: bool
    effects: tuple[Effect, ...] = ()  # of the mesh's period


def _read(
    model: Model, windows: Sequence[EccentricityWindow], phase: float, effect: Effect, shaft: int, swung: complex
) -> tuple[list[_Line], list[complex]]:
    """Sidebands and run-outs of all windows with an eccentricity in the twin, `per_metre` per REFERENCE."""
    teeth = model.mesh.pair.teeth
    own = (1.0, teeth[0] / teeth[1])[shaft]
    sidebands: list[_Line] = []
    run_outs: list[complex] = []
    for window in windows:
        response = solve_with(model, (*window.effects, effect), window.profile, window.condition)
        if not response.steady.converged:
            raise NotConverged("no steady state with an eccentricity")
        for channel in FLOOR:
            lines = getattr(window.features, channel)
            sidebands += _sidebands(lines, channel, response, shaft, teeth, phase, window.worn)
        te = window.features.transmission_error
        if te is not None and te.unit == "m" and te.get(*_key(0, 1, shaft)) is not None:
            (s,) = response.transmission_error([own])
            y = te.at(*_key(0, 1, shaft)) * np.exp(-1j * own * phase / teeth[0])
            run_outs.append(complex((y - swung) / (s / REFERENCE)))
    return sidebands, run_outs


def fit_eccentricity(
    model: Model, windows: Sequence[EccentricityWindow], phase: float, shaft: int, swung: complex = 0.0
) -> EccentricityFit | None:
    """The eccentricity that explains the windows best; None where no window has the lines.

    phase  ψ [rad]
    shaft  0 pinion, 1 gear
    swung  run-out that something else makes, in the twin's angle [m]
    """
    sidebands, run_outs = _read(model, windows, phase, KINDS[shaft](eccentricity=REFERENCE), shaft, swung)
    if not sidebands:
        return None
    run_out = None if not run_outs else complex(np.mean(run_outs))
    measured = np.array([line.measured for line in sidebands])
    noise = np.array([line.std for line in sidebands]) ** 2
    lower = np.array([line.lower for line in sidebands])
    gain = np.array([line.per_metre for line in sidebands])

    def cost(x: np.ndarray, with_run_out: bool = True) -> float:
        """−ln likelihood of E = (x0 + i·x1)·10 µm, over that of E = 0."""
        E = complex(x[0], x[1]) * 1e-5
        m = gain * np.where(lower, np.conj(E), E)
        C = noise + (SCATTER * np.abs(m)) ** 2
        total = np.sum(np.abs(measured - m) ** 2 / C + np.log(C / noise) - np.abs(measured) ** 2 / noise)
        if with_run_out and run_out is not None:
            total += (abs(run_out - E) ** 2 - abs(run_out) ** 2) / GRADUATION**2
        return float(total)

    linear = complex(
        np.sum(np.where(lower, gain * np.conj(measured), np.conj(gain) * measured) / noise)
        / np.sum(np.abs(gain) ** 2 / noise)
    )
    starts = [linear] if run_out is None else [linear, run_out]

    def best(with_run_out: bool):
        tried = [
            minimize(
                cost, [E.real * 1e5, E.imag * 1e5], args=(with_run_out,), method="Nelder-Mead", options={"xatol": 1e-4}
            )
            for E in starts
        ]
        return min(tried, key=lambda r: r.fun)

    found, alone = best(True), best(False)
    E = complex(*found.x) * 1e-5
    E_alone = complex(*alone.x) * 1e-5
    h = 1e-2
    curvature = (cost(found.x * (1 + h)) + cost(found.x * (1 - h)) - 2 * cost(found.x)) / (h * abs(E)) ** 2
    std = float(1 / np.sqrt(max(curvature, 1 / PRIOR**2)))
    occam = float(np.log(max(std / PRIOR, 1e-6)) * 2 - 0.5 * (abs(E) / PRIOR) ** 2)
    disagreement = 0.0
    if run_out is not None:  # by size: where along the tip circle the contact begins turns the sidebands' phase
        allowed = np.hypot(2 * GRADUATION, 0.5 * max(abs(run_out), abs(E_alone)))
        disagreement = float(abs(abs(run_out) - abs(E_alone)) / allowed)
        std = min(std, GRADUATION)
    seen = E if run_out is None else run_out
    share, share_std = _shift_share([line for line in sidebands if line.worn], seen)
    return EccentricityFit(
        shaft=shaft,
        eccentricity=abs(E) if run_out is None else abs(run_out),
        high_point=float(np.angle(E if run_out is None else run_out)),
        std=std,
        log_evidence=-float(found.fun) + occam,
        by_sidebands=-float(alone.fun) + occam,
        run_out=None if run_out is None else abs(run_out),
        disagreement=disagreement,
        shift_share=share,
        shift_share_std=share_std,
    )


def _shift_share(worn: Sequence[_Line], E: complex) -> tuple[float, float]:
    """How much of the predicted sidebands of worn windows is there, by linear least squares, and its std.

    Without any worn window the whole, give or take the range that it may lie in.
    """
    m, y = np.array([line.predicted(E) for line in worn]), np.array([line.measured for line in worn])
    weight = 1 / np.array([line.std for line in worn]) ** 2
    energy = float(np.sum(weight * np.abs(m) ** 2)) if worn else 0.0
    if energy == 0:
        return 1.0, MOST_SHARE / np.sqrt(12)
    share = float(np.clip(np.sum(weight * (np.conj(m) * y).real) / energy, 0.0, MOST_SHARE))
    misfit = float(np.sum(weight * np.abs(y - share * m) ** 2)) / len(worn)
    return share, float(np.sqrt(max(misfit, 1.0) / (2 * energy)))
