"""The misalignment study as one self-contained page with figures like the authors' (8 to 13)."""

from __future__ import annotations

from html import escape
from typing import Any

import numpy as np

from studies.misalignment.bands import HARMONICS, SIDEBANDS, shaft_lines
from studies.misalignment.dabrowski_2012 import EXPERIMENT_RISE, SPEEDS_RPM, TEETH
from studies.misalignment.report import COMPLIANT, FAST, NAMED, TILTED, tables
from studies.misalignment.study import DRAWN, POINTS, SHOWN, SIGNALS, VARIANTS, Run, Study

ALIGNED, OUT = "#1f77b4", "#d62728"
COLOURS = {
    "rigid": "#444444", "bearings": "#9467bd", "shafts": "#2ca02c", "both": "#1f77b4", "teeth": "#ff7f0e",
    "all": "#d62728",
}  # fmt: skip
FLOOR = 1e-2  # of a line's amplitude that is drawn [N]


def page(study: Study, style: str) -> str:
    """HTML with the figures and the tables, in a style sheet (CSS)."""
    title = "Spur gears misaligned by 1°, after Dąbrowski et al. (2012)"
    drawn = [
        *((_drawn_rises(study), _drawn_bands(study)) if study.draws else ()),
        _rises(study),
        _signals(study, "rigid"),
        _signals(study, "both"),
        _spectra(study, "rigid"),
        _spectra(study, "both"),
        _bars(study, "rigid"),
        _bars(study, "both"),
        _sidebands(study),
    ]
    figures = "".join(
        plot.to_html(full_html=False, include_plotlyjs="inline" if i == 0 else False) for i, plot in enumerate(drawn)
    )
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{title}</title>'
        f'<meta name="viewport" content="width=device-width"><style>{style}pre{{overflow-x:auto}}</style>'
        f"<h1>{title}</h1>{figures}<h2>Tables</h2>" + "".join(f"<pre>{escape(t)}</pre>" for t in tables(study))
    )


def _point(point: tuple[float, float]) -> str:
    return f"{point[0]:g} rpm, {point[1]:g} N·m"


def _panels(titles: list[str], rows: int, cols: int, **more: Any) -> Any:
    from plotly.subplots import make_subplots

    return make_subplots(rows=rows, cols=cols, subplot_titles=titles, **more)


def _drawn_rises(study: Study) -> Any:
    """Rise of the RMS over the estimates drawn, median and 10 … 90 %, with the experiment."""
    plot = _panels(list(SIGNALS), 1, 2)
    points = [_point(point) for point in POINTS]
    for j, of in enumerate(SIGNALS):
        for variant in DRAWN:
            rises = [[getattr(r, of) for r in draw[variant]] for draw in study.draws]
            _spread_bars(plot, points, rises, variant, shown=j == 0, row=1, col=j + 1)
        _experiment(plot, points, shown=j == 0, row=1, col=j + 1)
    plot.update_yaxes(title="rise of RMS [%]", range=[-100, 400])
    sets = f"{len(study.draws)} sets of estimates"
    shown = f"Rise of the RMS by compliance, {sets}: median and 10 … 90 % (scale cut at 400 %)"
    plot.update_layout(**_look(shown, 520))
    return plot


def _drawn_bands(study: Study) -> Any:
    """Rise of every band at the higher speed over the estimates drawn, median and 10 … 90 %."""
    plot = _panels([_point(POINTS[k]) for k in FAST], 1, 2)
    harmonics = [f"GMF{n}" for n in range(1, HARMONICS + 1)]
    for j, k in enumerate(FAST):
        for variant in DRAWN:
            rises = [draw[variant][k].bands for draw in study.draws]
            _spread_bars(plot, harmonics, rises, variant, shown=j == 0, row=1, col=j + 1)
    plot.update_yaxes(title="rise of the band [%]", range=[-100, 1000])
    shown = (
        f"The same band by band (scale cut at 1000 %); at {SPEEDS_RPM[1]:g} rpm the experiment rose especially at "
        f"GMF{NAMED}"
    )
    plot.update_layout(**_look(shown, 520))
    return plot


def _spread_bars(plot: Any, x: list[str], rises: list[Any], variant: str, *, shown: bool, row: int, col: int) -> None:
    """Bars at the median of (draws, n), with whiskers from 10 to 90 %."""
    low, middle, high = np.quantile(np.array(rises), (0.1, 0.5, 0.9), axis=0)
    whiskers = {"type": "data", "array": high - middle, "arrayminus": middle - low, "thickness": 1, "width": 2}
    plot.add_bar(
        x=x, y=middle, error_y=whiskers, name=COMPLIANT[variant], marker_color=COLOURS[variant], legendgroup=variant,
        showlegend=shown, row=row, col=col,
    )  # fmt: skip


def _experiment(plot: Any, points: list[str], *, shown: bool, row: int, col: int) -> None:
    plot.add_scatter(
        x=points, y=[EXPERIMENT_RISE[speed] for speed, _ in POINTS], mode="markers", name="experiment, about",
        marker={"symbol": "line-ew", "size": 70, "line": {"width": 3, "color": "black"}},
        legendgroup="experiment", showlegend=shown, row=row, col=col,
    )  # fmt: skip


def _rises(study: Study) -> Any:
    """Rise of the RMS by variant, acceleration and force, with the experiment; nominal estimates."""
    titles = [f"{of}, {TILTED[tilt]}" for tilt in ("normal", "in_plane") for of in SIGNALS]
    plot = _panels(titles, 2, 2, vertical_spacing=0.14)
    points = [_point(point) for point in POINTS]
    for i, tilt in enumerate(("normal", "in_plane")):
        for j, of in enumerate(SIGNALS):
            for variant in (v for v in VARIANTS if v != "teeth"):
                plot.add_bar(
                    x=points, y=[getattr(r, of) for r in study.of(variant, tilt)], name=COMPLIANT[variant],
                    marker_color=COLOURS[variant], legendgroup=variant, showlegend=i == j == 0, row=i + 1, col=j + 1,
                )  # fmt: skip
            _experiment(plot, points, shown=i == j == 0, row=i + 1, col=j + 1)
    plot.update_yaxes(title="rise of RMS [%]")
    shown = "Rise of the RMS in the mesh bands at the nominal estimates (teeth alone: far beyond, in the table)"
    plot.update_layout(**_look(shown, 820))
    return plot


def _look(title: str, height: int) -> dict[str, Any]:
    """Layout with room for the legend between the figure's title and those of the panels."""
    legend = {"orientation": "h", "y": 1 + 35 / (height - 200), "yanchor": "bottom"}
    shown = {"text": title, "y": 1 - 25 / height, "yanchor": "top"}
    return {
        "template": "plotly_white",
        "title": shown,
        "height": height,
        "margin": {"t": 120, "b": 80},
        "legend": legend,
    }


def _in_bands(run: Run) -> np.ndarray:
    """The force of the mesh bands alone, over a turn (n,) [N]: what the authors' filter leaves."""
    lines = np.fft.rfft(run.force)
    order = np.arange(lines.size)
    harmonic = np.round(order / TEETH)
    kept = (harmonic >= 1) & (harmonic <= HARMONICS) & (np.abs(order - harmonic * TEETH) <= SIDEBANDS)
    return np.fft.irfft(np.where(kept, lines, 0.0), run.force.size)


def _pair(study: Study, variant: str) -> tuple[tuple[str, str, Run], ...]:
    return (
        ("aligned", ALIGNED, study.run(variant, "aligned", *SHOWN)),
        ("misaligned by 1°", OUT, study.run(variant, "normal", *SHOWN)),
    )


def _signals(study: Study, variant: str) -> Any:
    plot = _panels(["aligned", "misaligned by 1°"], 1, 2, shared_yaxes=True)
    for i, (name, colour, run) in enumerate(_pair(study, variant)):
        turn = _in_bands(run)[::4]
        time = np.arange(turn.size) / turn.size * 60 / SHOWN[0]
        part = time < 0.02
        plot.add_scatter(
            x=1e3 * time[part], y=turn[part], mode="lines", line={"color": colour, "width": 1.5}, name=name,
            showlegend=False, row=1, col=i + 1,
        )  # fmt: skip
    plot.update_xaxes(title="time [ms]")
    plot.update_yaxes(title="force [N]", col=1)
    plot.update_layout(
        **_look(f"Vertical force in the mesh bands, {_point(SHOWN)}; compliant: {COMPLIANT[variant]}", 380)
    )
    return plot


def _stems(plot: Any, run: Run, colour: str, name: str, lowest: int, highest: int, row: int, col: int) -> None:
    """Power of every line, as stems on a logarithmic axis."""
    power = np.abs(shaft_lines(run.force)) ** 2 / 2
    orders = [o for o in range(lowest, highest + 1) if power[o] > FLOOR**2]
    x: list[float | None] = []
    y: list[float | None] = []
    for o in orders:
        f = o * run.speed_rpm / 60
        x += [f, f, None]
        y += [FLOOR**2, power[o], None]
    plot.add_scatter(
        x=x, y=y, mode="lines", line={"color": colour, "width": 2}, name=name, showlegend=False, row=row, col=col
    )


def _spectra(study: Study, variant: str) -> Any:
    plot = _panels(["aligned", "misaligned by 1°"], 1, 2, shared_yaxes=True)
    for i, (name, colour, run) in enumerate(_pair(study, variant)):
        _stems(plot, run, colour, name, TEETH - 5, HARMONICS * TEETH + 5, 1, i + 1)
    ends = [o * SHOWN[0] / 60 for o in (TEETH - 15, HARMONICS * TEETH + 15)]
    plot.update_xaxes(title="frequency [Hz]", range=ends)
    plot.update_yaxes(type="log", dtick=2, exponentformat="power")
    plot.update_yaxes(title="power of the line [N²]", col=1)
    plot.update_layout(**_look(f"Spectrum of the force, {_point(SHOWN)}; compliant: {COMPLIANT[variant]}", 380))
    return plot


def _bars(study: Study, variant: str) -> Any:
    titles = [_point(point) for point in POINTS]
    plot = _panels(titles, 2, 2, vertical_spacing=0.18)
    harmonics = [f"GMF{n}" for n in range(1, HARMONICS + 1)]
    for i, point in enumerate(POINTS):
        for tilt, name, colour in (("aligned", "C, aligned", ALIGNED), ("normal", "Mis, misaligned by 1°", OUT)):
            plot.add_bar(
                x=harmonics, y=study.run(variant, tilt, *point).force_bands, name=name, marker_color=colour,
                legendgroup=name, showlegend=i == 0, row=i // 2 + 1, col=i % 2 + 1,
            )  # fmt: skip
    plot.update_yaxes(title="RMS [N]")
    plot.update_layout(**_look(f"RMS of the force in the mesh bands ± 2 orders; compliant: {COMPLIANT[variant]}", 640))
    return plot


def _sidebands(study: Study) -> Any:
    """Lines about the second mesh harmonic, for every kind of tilt."""
    tilts = list(TILTED)
    plot = _panels([TILTED[t] for t in tilts], 2, 2, shared_yaxes=True, vertical_spacing=0.27)
    for i, tilt in enumerate(tilts):
        run = study.run("both", tilt, *SHOWN)
        _stems(plot, run, OUT, TILTED[tilt], 2 * TEETH - 6, 2 * TEETH + 6, i // 2 + 1, i % 2 + 1)
    around = [2 * TEETH + d for d in (-6, 6)]
    plot.update_xaxes(title="frequency [Hz]", range=[o * SHOWN[0] / 60 for o in around], dtick=SHOWN[0] / 60 * 2)
    plot.update_yaxes(type="log", dtick=2, exponentformat="power", title="power [N²]")
    plot.update_layout(
        **_look(
            "Lines about the second mesh harmonic: a misaligned axis produces no sidebands, a tilted gear does", 600
        )
    )
    return plot
