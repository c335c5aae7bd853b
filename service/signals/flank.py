"""The worn flank drawn on a tooth of either gear.

The involute and its fillet, to scale in millimetres, and the drive flank with the worn depth drawn so many times too
large: a depth of some micrometres is not visible on a tooth of some millimetres. The factor is 1, 2 or 5 times a power
of ten, and is stated.
"""

from __future__ import annotations

from math import floor, log10

import numpy as np

from service.signals.subject import Subject
from service.signals.view import Axis, Series, View
from twin.errors import NotAvailable
from twin.geometry import GearPair
from twin.geometry.involute import roll_angle

POINTS = 160  # along a flank
DRAWN = 0.25  # modules that the largest depth is drawn with at most
MILLIMETRE, MICROMETRE = 1e-3, 1e-6


def flank(subject: Subject) -> View:
    """Both gears' teeth at the window's wear depth."""
    m = subject.modelled
    if m is None:
        why = subject.why_not_modelled or "it is drawn from the model, which was not asked for"
        raise NotAvailable(f"the worn flank is not available: {why}")
    from twin.wear.archard import pinion_share  # loads the model, which only views with a model need

    share = pinion_share(m.pair)
    s = np.linspace(m.pair.path_start, m.pair.path_end, POINTS)
    worn, _ = m.profile.at(s)
    deepest = max(float(worn.max()) * max(share, 1 - share), 0.0)
    factor = _factor(DRAWN * m.pair.module / deepest) if deepest > 0 else 1.0
    series: list[Series] = []
    notes = []
    for i, (gear, part) in enumerate((("pinion", share), ("gear", 1 - share))):
        middle = (2 * i - 1) * 1.5 * m.pair.module
        series += _drawn(m.pair, i, middle, s, worn * part, factor)
        notes.append(f"{gear} {worn.max() * part / MICROMETRE:.3g} µm")
    return View(
        view="flank",
        channel="",
        title="Worn flank on the tooth",
        x=Axis(label="across the tooth", unit="mm", values=series[0].x if series[0].x is not None else np.empty(0)),
        series=tuple(series),
        notes=(
            *subject.notes,
            f"Worn depth drawn {factor:g} times too large; largest depth: {', '.join(notes)}",
            "Pinion on the left, gear on the right; heights from the pitch circle",
        ),
        figures={"exaggeration": factor, "depth_um": m.depth / MICROMETRE},
        thinned="none",
        equal_axes=True,
    )


def _factor(most: float) -> float:
    """The largest of 1, 2 and 5 times a power of ten that does not exceed a number."""
    power = 10.0 ** floor(log10(most))
    return max(f * power for f in (1.0, 2.0, 5.0) if f * power <= most * (1 + 1e-9))


def _drawn(pair: GearPair, wheel: int, middle: float, s: np.ndarray, worn: np.ndarray, factor: float) -> list[Series]:
    """The outline of a new tooth, and its drive flank as worn."""
    tooth, gear = pair.tooth(wheel), ("pinion", "gear")[wheel]
    τ_form, γ_form = tooth.form_point
    τ_tip = float(roll_angle(pair.tip_radius[wheel], tooth.base_radius)) - tooth.base_half_angle
    τ = np.linspace(τ_form, τ_tip, POINTS)
    flank_x, flank_y = tooth.flank_point(τ)
    fillet_x, fillet_y = tooth.fillet_point(np.linspace(np.pi / 2, γ_form, POINTS // 2))
    half_x, half_y = np.concatenate((fillet_x, flank_x)), np.concatenate((fillet_y, flank_y))
    x = np.concatenate((-half_x, half_x[::-1])) + middle
    y = np.concatenate((half_y, half_y[::-1])) - tooth.pitch_radius
    # depth by roll angle: the radius of curvature over the base radius
    ρ = pair.curvature_radius(s)[wheel]
    roll = τ + tooth.base_half_angle
    order = np.argsort(ρ)
    depth = np.interp(roll * tooth.base_radius, ρ[order], worn[order], left=0.0, right=0.0)
    worn_x = flank_x - factor * depth * np.cos(τ) + middle
    worn_y = flank_y - factor * depth * np.sin(τ) - tooth.pitch_radius
    return [
        Series(name=f"{gear}, new", unit="mm", x=x / MILLIMETRE, values=y / MILLIMETRE),
        Series(name=f"{gear}, worn (× {factor:g})", unit="mm", x=worn_x / MILLIMETRE, values=worn_y / MILLIMETRE),
    ]
