"""Calibration on low-speed and unworn windows.

The paper's section 3.3: the scale of the mesh stiffness and the damping are adjusted until the model agrees with
constant-speed tests at 2 Hz under two torques. Here they are the maximum of a posterior over

    θ = (ln stiffness scale, ln ζ, ln τ)

given the transmission error's mesh lines (the loads of unworn teeth shift them), the acceleration's mesh lines (their
size) and priors around the rig file's values. Contact half-width shapes the worn profile only; unworn windows say
nothing of it, so it keeps its prior until worn windows are there (`fit_half_width`).

Source   paper, section 3.3; posterior covariance from the Jacobian at the optimum (Gauss–Newton)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from twin.effects.extended import ExtendedModel, window_lines
from twin.features.window_features import WindowFeatures
from twin.model import Calibration, Condition, Model
from twin.rig import Rig
from twin.structure_spread import structure_spread
from twin.thresholds import deciding
from twin.updating.conditions import condition_of
from twin.wear.curve import MeshLines
from twin.wear.path import FIRST

NAMES = ("stiffness_scale", "modal_damping", "damping_time")
HARMONICS = 3  # of transmission error
LEVEL_HARMONICS = 10  # of acceleration
NOT_SOLVED = 10.0  # normalised difference of every line where a trial has no steady state


@dataclass(frozen=True, slots=True, kw_only=True)
class RigFilePrior:
    """How far the values of a rig file may be from the machine's, as standard deviations of their logarithms.

    The joint fit of attribution has a narrower prior of its own (JointFitThresholds.calibration_spread), that of
    healthy machines: its calibration must not explain an effect away. Here a rig file of estimated values is fitted.
    """

    stiffness_scale: float = deciding(
        0.10,
        meaning="of the mesh stiffness",
        source="not derived: an estimate of how far a computed mesh stiffness is off",
    )
    modal_damping: float = deciding(
        0.25, meaning="of the modal damping ratio", source="not derived: damping of a rig file is an estimate"
    )
    damping_time: float = deciding(
        0.5, meaning="of the mesh damping time", source="not derived: damping of a rig file is an estimate"
    )
    contact_half_width: float = deciding(
        0.2, meaning="of the contact half-width", source="not derived: estimated in the reference rig's file"
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationFit:
    """What lines may be off by in a calibration, and when its result is doubted."""

    doubtful: float = deciding(
        2.9,
        of="prior spread",
        meaning="distance from the rig file beyond which a calibrated value is reported as doubtful",
        source="derivation: of machines that vary as the prior says, one in a hundred has one of three values beyond",
    )
    widest: float = deciding(
        3.0,
        of="prior spread",
        meaning="distance from the rig file that a value may move",
        source="not derived: three standard deviations of the prior",
    )
    line_scatter: float = deciding(
        0.06,
        of="line of unworn transmission error",
        meaning="scatter of the line by the deviations of real teeth",
        source="not derived: real teeth deviate by a few hundredths of a micrometre",
    )
    line_floor: float = deciding(
        0.03e-6,
        unit="m",
        meaning="scatter of a weak line of transmission error",
        source="not derived: of the order of the noise of a mesh line",
    )
    level_scatter: float = deciding(
        0.35,
        meaning="scatter of the logarithm of one acceleration line",
        source="structures within ±3 % of the rig file, lines near resonances",
    )
    least_signal: float = deciding(
        10.0,
        of="standard deviation of the line",
        meaning="amplitude from which an acceleration line takes part",
        source="not derived: the logarithm is then known to a tenth, less than level_scatter",
    )
    least_load_range: float = deciding(
        0.3,
        of="mean torque",
        meaning="range of torques from which the compliance outside the mesh is measured",
        source="not derived: loads that differ less hardly give a slope",
    )


PRIOR, FIT = RigFilePrior(), CalibrationFit()

PRIOR_SPREAD = np.array([getattr(PRIOR, name) for name in NAMES])  # of the logarithms (3,), of a rig file that is known
ESTIMATED_PART = ("mesh", "damping", "damping")  # whose spread holds where these are estimated


def prior_spread(rig: Rig) -> np.ndarray:
    """Standard deviations of the logarithms of the calibrated values (3,): wider where the rig file says so."""
    stated = rig.estimated.spread
    return np.maximum(PRIOR_SPREAD, [stated.get(part, 0.0) for part in ESTIMATED_PART])


@dataclass(frozen=True, slots=True, kw_only=True)
class Fit:
    """A calibration with the uncertainty of each value."""

    calibration: Calibration
    std: dict[str, float]  # relative standard deviation, by name
    windows: int  # that it rests on
    misfit: float  # sum of squared normalised residuals over their number


def _beyond_the_mesh(model: Model, windows: Sequence[WindowFeatures]) -> list[tuple[np.ndarray, np.ndarray] | float]:
    """Factors on each window's lines by effects whose period is longer than a mesh period; 1 where there are none."""
    if not isinstance(model, ExtendedModel) or all(e.period == "mesh" for e in model.effects):
        return [1.0] * len(windows)
    out: list[tuple[np.ndarray, np.ndarray] | float] = []
    for w in windows:
        condition = condition_of(w, model.rig)
        steady = model.steady(model.unworn, condition)
        whole = window_lines(model, model.unworn, condition).lines
        part = MeshLines.of(model, steady, condition)
        out.append(
            (
                np.abs(whole.transmission_error / part.transmission_error),
                np.abs(whole.acceleration / part.acceleration),
            )
        )
    return out


def _residuals(model: Model, windows: Sequence[WindowFeatures], factors: Sequence) -> np.ndarray:
    """Normalised differences of all windows."""
    out: list[np.ndarray] = []
    for w, factor in zip(windows, factors, strict=True):
        of_error, of_level = (factor, factor) if isinstance(factor, float) else factor
        condition = condition_of(w, model.rig)
        spread = structure_spread(model.rig, condition.speed_hz)
        steady = model.steady(model.unworn, condition)
        if not steady.converged:
            out.append(np.full(HARMONICS, NOT_SOLVED))
            continue
        if w.transmission_error is not None:
            _, y, std = w.transmission_error.mesh()
            n = min(HARMONICS, y.size)
            m = (model.transmission_error_lines(steady, FIRST) * of_error)[:n]
            share = np.hypot(FIT.line_scatter, 0.0 if spread is None else spread.transmission_error.std[:n])
            σ = np.sqrt((share * np.abs(m)) ** 2 + FIT.line_floor**2 + std[:n] ** 2)
            out.append((np.abs(y[:n]) - np.abs(m)) / σ)
        if w.acceleration is not None and model.rig.band[1] > 0:
            _, y, std = w.acceleration.mesh()
            n = min(LEVEL_HARMONICS, y.size)
            m = np.abs((model.acceleration_lines(steady, FIRST) * of_level)[:n])
            clear = np.abs(y[:n]) > FIT.least_signal * std[:n]
            share = np.hypot(FIT.level_scatter, 0.0 if spread is None else spread.acceleration.std[:n])
            out.append((np.log(np.abs(y[:n]) / m) / share)[clear])
    return np.concatenate(out) if out else np.empty(0)


def calibrate(model: Model, windows: Sequence[WindowFeatures]) -> Fit:
    """Fits the calibrated values around those of the model given; windows must be unworn, with speed and torque."""
    prior = model.calibration
    centre = np.log([getattr(prior, name) for name in NAMES])
    factors = _beyond_the_mesh(model, windows)

    def at(θ: np.ndarray) -> Model:
        return model.calibrated(**dict(zip(NAMES, np.exp(θ).tolist(), strict=True)))

    def residuals(θ: np.ndarray) -> np.ndarray:
        return np.concatenate((_residuals(at(θ), windows, factors), (θ - centre) / spread))

    spread = prior_spread(model.rig)
    limits = centre - FIT.widest * spread, centre + FIT.widest * spread
    found = least_squares(
        residuals, centre, bounds=limits, x_scale=spread, diff_step=1e-3, max_nfev=8, xtol=1e-3, ftol=1e-3
    )
    covariance = np.linalg.inv(found.jac.T @ found.jac)
    std = dict(zip(NAMES, np.sqrt(np.diag(covariance)).tolist(), strict=True))
    std["contact_half_width"] = PRIOR.contact_half_width
    return Fit(
        calibration=at(found.x).calibration,
        std=std,
        windows=len(windows),
        misfit=float(2 * found.cost / found.fun.size),
    )


def outliers(rig: Rig, fit: Fit) -> list[str]:
    """Values that the calibration moved farther than those of a rig file are usually wrong by, a sentence each.

    The fit then absorbs something that the model lacks: a misaligned pair, for one, looks like a soft mesh.
    """
    prior, found = Calibration.prior(rig), fit.calibration
    out = []
    for name, spread in zip(NAMES, prior_spread(rig), strict=True):
        given, value = getattr(prior, name), getattr(found, name)
        if abs(np.log(value / given)) > FIT.doubtful * spread:
            out.append(
                f"{name} = {value:.3g} lies {abs(np.log(value / given)) / spread:.1f} spreads of its prior from the "
                f"rig file's {given:.3g}: an effect that is not in the model may be present, and would affect the depth"
            )
    return out


def fit_half_width(fit: Fit, misfit: Callable[[float], float], factors: Sequence[float] = (0.75, 1.0, 1.33)) -> Fit:
    """The contact half-width that makes worn windows fit best, by a parabola over its logarithm.

    misfit  −2·ln likelihood of the worn windows with a half-width [m], the depth free
    """
    a0 = fit.calibration.contact_half_width
    u = np.log(factors)
    cost = np.array([misfit(a0 * f) for f in factors]) + (u / PRIOR.contact_half_width) ** 2
    curvature, slope, _ = np.polyfit(u, cost, 2)
    best = float(np.clip(-slope / (2 * curvature), u[0], u[-1])) if curvature > 0 else float(u[np.argmin(cost)])
    std = float(np.sqrt(1 / max(curvature, 1 / PRIOR.contact_half_width**2)))
    return Fit(
        calibration=replace(fit.calibration, contact_half_width=a0 * float(np.exp(best))),
        std={**fit.std, "contact_half_width": std},
        windows=fit.windows,
        misfit=fit.misfit,
    )


def compliance_scale(model: Model, windows: Sequence[WindowFeatures]) -> float:
    """Measured over predicted mean transmission error per torque outside the mesh, from windows of different loads.

    1 where the loads do not differ enough.
    """
    seen = [
        (w.torque_nm, w.transmission_error.at(0).real)
        for w in windows
        if w.torque_nm is not None and w.transmission_error is not None and w.transmission_error.get(0) is not None
    ]
    speed = windows[0].speed_hz if windows else None
    if len(seen) < 2 or speed is None:
        return 1.0
    torque, mean = np.array(seen).T
    if np.ptp(torque) < FIT.least_load_range * torque.mean():
        return 1.0
    slope = float(np.polyfit(torque, mean, 1)[0])
    low, high = (
        model.steady(model.unworn, Condition(speed_hz=speed, torque=t)).deflection.mean()
        for t in (torque.min(), torque.max())
    )
    return (slope - (high - low) / float(np.ptp(torque))) / model.compliance_outside_mesh
