"""Draws the figures of the explanations, and that of the Python client, from the twin and the bundled recordings.

The documentation site shows them (docs/site/hooks.py). Nothing in them is drawn by hand: every curve is computed here,
by the functions that the service uses.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from io import BytesIO

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from benchmarks.estimated_rigs import Bands, bands_of, estimated_rig
from benchmarks.physics import ROOT, reference_rig
from benchmarks.quasi_static import nominal_mesh_stiffness
from service.signals.subject import Subject
from service.signals.views import VIEWS, ViewOptions
from service.stream.sources.mcap import read_windows
from twin.mesh.stiffness import PairStiffness
from twin.model import Calibration, Condition, Model
from twin.rig import Rig
from twin.wear.archard import pinion_share
from twin.wear.curve import MasterCurve
from twin.wear.profile import WornProfile

RECORDINGS = ROOT / "recordings"
BLUE, ORANGE, GREEN, GREY = "#1f4e9c", "#d9730d", "#2a8c55", "#777777"
SHADES = ("#9dbbe8", "#5f8dd3", "#1f4e9c", "#0b2350")  # light to dark: new to worn
DPI = 110
MICROMETRE = 1e-6
DEPTHS = (0.0, 50.0, 100.0, 150.0)  # drawn [µm]


def figure(columns: int) -> tuple[Figure, list[Axes]]:
    """An empty figure with so many plots side by side."""
    drawn = Figure(figsize=(4.8 * columns, 3.4), dpi=DPI, layout="constrained")
    FigureCanvasAgg(drawn)
    plots = [drawn.add_subplot(1, columns, i + 1) for i in range(columns)]
    for axes in plots:
        axes.grid(color="#dddddd", linewidth=0.6)
        axes.spines[["top", "right"]].set_visible(False)
    return drawn, plots


@cache
def reference_curve() -> tuple[Model, Condition, MasterCurve]:
    """The rig of the published campaign, its nominal condition, and its wear from new."""
    rig = reference_rig()
    speed, torque = rig.require("the condition", "operating.pinion_speed_hz", "operating.input_torque")
    model, condition = Model.of(rig, Calibration.prior(rig)), Condition(speed_hz=speed, torque=torque)
    return model, condition, MasterCurve.build(model, condition, model.unworn, DEPTHS[-1] * MICROMETRE)


def worn_by(curve: MasterCurve, model: Model, depth: float) -> WornProfile:
    """The profile at a depth [µm], between the two that were computed next to it."""
    profiles = np.array([np.interp(depth * MICROMETRE, curve.depth, column) for column in curve.profiles.T])
    return WornProfile(positions=model.unworn.positions, depth=profiles, active=model.unworn.active)


def mesh() -> Figure:
    """Mesh stiffness over two mesh periods, and the transmission error of new and worn flanks."""
    drawn, (left, right) = figure(2)
    model, condition, curve = reference_curve()
    pair = model.mesh.pair
    periods = np.linspace(0, 2, 1024, endpoint=False)
    stiffness = np.tile(nominal_mesh_stiffness(PairStiffness.of(pair), 512), 2)
    left.plot(periods, 1e-6 * stiffness, color=BLUE)
    left.set(xlabel="mesh periods", ylabel="mesh stiffness [N/µm]", ylim=(0, None))
    left.set_title("Two pairs in contact, then one", fontsize=10)
    for depth, shade in zip(DEPTHS, SHADES, strict=True):
        steady = model.steady(worn_by(curve, model, depth), condition)
        error = (steady.deflection - steady.deflection.mean()) / MICROMETRE
        phase = np.arange(2 * error.size) / error.size
        right.plot(phase, np.tile(error, 2), color=shade, label=f"{depth:g} µm worn")
    right.set(xlabel="mesh periods", ylabel="transmission error, without its mean [µm]")
    right.set_title("The steady response of the twin", fontsize=10)
    right.set_ylim(-100, 100)
    right.legend(fontsize=8, frameon=False, ncols=2, loc="upper center")
    return drawn


def wear() -> Figure:
    """Depth along the path of contact, and over the revolutions of the published campaign."""
    drawn, (left, right) = figure(2)
    model, _, curve = reference_curve()
    pair, rig = model.mesh.pair, reference_rig()
    for depth, shade in zip(DEPTHS[1:], SHADES[1:], strict=True):
        profile = worn_by(curve, model, depth)
        left.plot(1e3 * profile.positions, profile.mean / MICROMETRE, color=shade, label=f"{depth:g} µm")
    left.axvline(0.0, color=GREY, linewidth=0.8)
    left.text(0.15, 140.0, "pitch point", color=GREY, fontsize=8)
    left.set(
        xlabel="place on the path of contact [mm]", ylabel="worn from both flanks [µm]",
        xlim=(1.05e3 * pair.path_start, 1.05e3 * pair.path_end),
    )  # fmt: skip
    left.set_title("Nothing slides, and nothing wears, at the pitch point", fontsize=10)
    left.legend(fontsize=8, frameon=False)
    speed, K, dwell = rig.require("wear", "operating.pinion_speed_hz", "wear.K", "wear.dwell_time")
    revolutions = curve.work / (K * dwell * 2 * np.pi * speed)
    share = pinion_share(pair)
    for part, label, colour in ((1.0, "both flanks", BLUE), (share, "pinion", ORANGE), (1 - share, "gear", GREEN)):
        right.plot(revolutions, part * curve.depth / MICROMETRE, color=colour, label=label)
    right.set(xlabel="pinion revolutions", ylabel="largest wear depth [µm]")
    right.set_title("With the published wear coefficient", fontsize=10)
    right.legend(fontsize=8, frameon=False)
    return drawn


@cache
def short_campaign(estimated: bool) -> Bands:
    """Depths of the bundled campaign, by its own rig file or by that of `gear-twin init`."""
    recording = RECORDINGS / "short-campaign.mcap"
    own, _, _ = read_windows(recording)
    return bands_of(recording, estimated_rig() if estimated else Rig.from_mapping(own or {}))


def updating() -> Figure:
    """Predicted and measured level before and after each update, and the depth, of the bundled campaign."""
    drawn, (left, right) = figure(2)
    rows = [row for row in short_campaign(False).rows if row.error_before is not None]
    before, after = (np.array([getattr(row, name) for row in rows], float) for name in ("error_before", "error_after"))
    revolutions = [row.revolutions for row in rows]
    left.axhspan(-5, 5, color="#e9eef7", label="no update within 5 %")
    left.plot(revolutions, before, "o--", color=ORANGE, label="prediction, before the update")
    left.plot(revolutions, after, "s-", color=BLUE, label="after the update")
    left.set(xlabel="pinion revolutions", ylabel="error of the modelled RMS [%]")
    left.legend(fontsize=8, frameon=False)
    _depth(right, short_campaign(False), "the machine's own rig file")
    return drawn


def uncertainty() -> Figure:
    """Bands of the same recording, with the machine's own rig file and with an estimated one."""
    drawn, plots = figure(2)
    for axes, estimated in zip(plots, (False, True), strict=True):
        _depth(axes, short_campaign(estimated), "a rig file from the data sheet" if estimated else "its own rig file")
    top = max(axes.get_ylim()[1] for axes in plots)
    for axes in plots:
        axes.set_ylim(0, top)
    return drawn


def _depth(axes: Axes, bands: Bands, title: str) -> None:
    rows = bands.rows
    revolutions = [row.revolutions for row in rows]
    low, depth, high = (np.array([getattr(row, name) for row in rows], float) for name in ("low", "depth", "high"))
    axes.fill_between(revolutions, low, high, color="#c9d8f0", label="5–95 % band")
    axes.plot(revolutions, depth, "o-", color=BLUE, label="stated")
    axes.plot(revolutions, [row.true for row in rows], "x", color=ORANGE, label="simulated flanks")
    axes.set(xlabel="pinion revolutions", ylabel="largest wear depth [µm]")
    axes.set_title(f"With {title}", fontsize=10)
    axes.legend(fontsize=8, frameon=False, loc="upper left")


def attribution() -> Figure:
    """What is left of the average turn of the pinion, before and after a tooth begins to crack."""
    drawn, (axes,) = figure(1)
    drawn.set_size_inches(8.0, 3.4)
    recording = RECORDINGS / "faulty-campaign.mcap"
    own, _, windows = read_windows(recording)
    windows, rig = list(windows), Rig.from_mapping(own or {})
    truth = json.loads((RECORDINGS / "truth" / "faulty-campaign.json").read_text(encoding="utf-8"))["windows"]
    last_healthy = max(number for number, window in enumerate(truth) if not window["effects_active"])
    for number, label, colour in ((len(windows) - 1, "with the crack", ORANGE), (last_healthy, "before it", BLUE)):
        subject = Subject(asset="machine", index=number, window=windows[number], rig=rig)
        found = VIEWS["synchronous-average"](subject, ViewOptions(shaft="pinion"))
        residual = next(series for series in found.series if series.name != "measured")
        axes.plot(found.x.values, residual.values, color=colour, linewidth=0.9, label=label)
    axes.set(xlabel="angle of the pinion [°]", ylabel="acceleration [m/s²]", xlim=(0, 360))
    axes.set_title("Average over a turn, without mesh harmonics and first sidebands", fontsize=10)
    axes.legend(fontsize=8, frameon=False)
    return drawn


def modulation() -> Figure:
    """A mesh line whose amplitude follows the turn of the pinion, over time and in its spectrum."""
    drawn, (left, right) = figure(2)
    teeth, speed, depth, rate, seconds = 23, 25.0, 0.3, 8192, 4.0
    t = np.arange(int(rate * seconds)) / rate
    envelope = 1 + depth * np.cos(2 * np.pi * speed * t)
    signal = envelope * np.cos(2 * np.pi * teeth * speed * t)
    shown = t < 3 / speed
    left.plot(speed * t[shown], signal[shown], color=BLUE, linewidth=0.7)
    left.plot(speed * t[shown], envelope[shown], color=ORANGE, label=f"1 + {depth:g} cos(2π·turns)")
    left.set(xlabel="turns of the pinion", ylabel="acceleration [m/s²]", ylim=(-1.5, 1.9))
    left.legend(fontsize=8, frameon=False, loc="upper right")
    amplitude = 2 * np.abs(np.fft.rfft(signal)) / t.size
    order = np.fft.rfftfreq(t.size, 1 / rate) / speed
    near = (order > teeth - 2.5) & (order < teeth + 2.5)
    right.plot(order[near], amplitude[near], color=BLUE)
    for at, name in ((teeth, f"mesh, {teeth}×"), (teeth - 1, "−1 pinion"), (teeth + 1, "+1 pinion")):
        height = float(amplitude[np.argmin(np.abs(order - at))])
        right.annotate(
            f"{name}: {height:.2f}", (at, height), (0, 4), textcoords="offset points", ha="center", fontsize=8
        )
    right.set(xlabel="order of the pinion", ylabel="amplitude [m/s²]", ylim=(0, 1.15))
    return drawn


def python_figure() -> Figure:
    """What `result.plot()` draws of the bundled campaign."""
    import gear_twin

    drawn = gear_twin.assess(RECORDINGS / "short-campaign.mcap").plot()
    FigureCanvasAgg(drawn)
    return drawn


FIGURES: dict[str, Callable[[], Figure]] = {
    "explanation-mesh": mesh,
    "explanation-wear": wear,
    "explanation-updating": updating,
    "explanation-uncertainty": uncertainty,
    "explanation-attribution": attribution,
    "explanation-modulation": modulation,
    "python-figure": python_figure,
}


@cache
def png(name: str) -> bytes:
    """A figure as a picture."""
    picture = BytesIO()
    FIGURES[name]().savefig(picture, metadata={"Software": None})
    return picture.getvalue()
