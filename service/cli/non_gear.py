"""Lines that belong to no known shaft: the section `unattributed_lines` in words, tables and figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from service.cli.figure_style import BEFORE, LOOK, MEASURED
from service.cli.show import number

MOST_SIDEBANDS = 6
LEAST_DRAWN = 0.05  # share of the energy [%]
SPECTRUM_FLOOR = 1e-4  # of the highest line shown


def sentences(strange: Sequence[Mapping[str, Any]]) -> list[str]:
    """Each spacing in words."""
    return [_sentence(found) for found in strange]


def search_sentences(search: Mapping[str, Any] | None) -> list[str]:
    """What was sought and from which size it would have been found, where nothing was; empty otherwise."""
    if search is None or search["found"]:
        return []
    if not search["detection_limits"]:
        return ["Lines of no known shaft were not searched for: the window is too short for them."]
    first: dict[str, str] = {}
    for limit in search["detection_limits"]:
        if limit["harmonic"] == 1:
            first[limit["channel"]] = number(limit["amplitude"], 2)
    return [
        f"Modulation by a frequency of no known shaft: none found. Sidebands {search['from_hz']:.2f} to "
        f"{search['to_hz']:.0f} Hz from the mesh lines were searched for; at mesh harmonic 1, half of "
        "those with this peak would be found: "
        + ", ".join(f"{value} ({channel})" for channel, value in first.items())
        + "."
    ]


def _sentence(found: Mapping[str, Any]) -> str:
    shown = ", ".join(
        f"{s['channel']} {s['multiple']}× "
        + (f"around mesh harmonic {s['harmonic']}" if s["harmonic"] else "itself")
        + f" {number(s['amplitude'], 3)}"
        + (f" ({100 * s['depth']:.0f} % of it)" if s["depth"] is not None else "")
        for s in found["sidebands"][:MOST_SIDEBANDS]
    )
    slower = (
        ""
        if found["part"] == 1
        else (
            f"There are weaker lines at {found['frequency_hz'] / found['part']:.3f} Hz: the source turns at that "
            f"frequency and acts mainly {found['part']} times per turn. "
        )
    )
    possible = [c["name"] for c in found["causes"] if c["possible"]]
    failed = [c["name"] for c in found["causes"] if not c["possible"]]
    place = f"{found['frequency_hz']:.3f} ± {found['frequency_std_hz']:.3f} Hz (order {found['order']:.4f})"
    if found["geared"] is not None:
        return f"Another shaft turns with the pinion as {found['geared']}: lines spaced by {place}, {shown}."
    healthy = found.get("healthy")
    if healthy or not found.get("new", True):
        shows = f"{len(healthy)} healthy windows show them, too" if healthy else "healthy ones show others as clear"
        return f"Lines of no known shaft, not new: spaced by {place}: {shown}; {shows}."
    seen = f" They stand out on {', '.join(found['channels'])}." if found.get("channels") else ""
    return (
        f"Unknown effect: lines spaced by {place} belong to no known shaft: {shown}.{seen} {slower}"
        f"Ruled out: {'; '.join(failed) or 'none'}. Possible: "
        f"{'; '.join(possible) or 'none of the tested causes'}."
    )


def energies(breakdown: Sequence[Mapping[str, Any]]) -> list[str]:
    """The energy of every channel by its source, as lines of a table; empty where it is not known."""
    if not breakdown:
        return []
    families = list(dict.fromkeys(b["family"] for b in breakdown))
    lines = [
        "Share of the energy, %; in brackets how much of it keeps its phase relative to the shaft angle (1: all), and",
        "how much a tone of fixed frequency would keep; if both are equal, the speed was too steady to decide.",
    ]
    lines.append(f"{'':<10}" + "".join(f"{name:>28}" for name in families))
    for channel in dict.fromkeys(b["channel"] for b in breakdown):
        own = {b["family"]: b for b in breakdown if b["channel"] == channel}
        cells = ""
        for name in families:
            b = own[name]
            steady = "   –,    –" if b["steady"] is None else f"{b['steady']:.2f}, {b['steady_if_fixed']:.2f}"
            cells += f"{b['share_percent']:>9.1f} ± {b['share_std_percent']:.1f} ({steady})"
        lines.append(f"{channel:<10}{cells}")
    return lines


def energy_plot(breakdown: Sequence[Mapping[str, Any]]) -> Any:
    """The shares, stacked; None where they are not known."""
    import plotly.graph_objects as go

    if not breakdown:
        return None
    plot = go.Figure()
    for name in dict.fromkeys(b["family"] for b in breakdown):
        own = [b for b in breakdown if b["family"] == name]
        if max(b["share_percent"] for b in own) >= LEAST_DRAWN:
            plot.add_bar(x=[b["channel"] for b in own], y=[b["share_percent"] for b in own], name=name)
    plot.update_layout(
        title="Energy by source (the rest is in no line of these)",
        yaxis_title="share of the energy [%]", barmode="stack", **LOOK,
    )  # fmt: skip
    plot.update_yaxes(range=[0, 100])
    return plot


def tables(strange: Sequence[Mapping[str, Any]]) -> str:
    """HTML of the causes tried on each spacing; empty where there are none."""
    return "".join(_causes(found) for found in strange if found["causes"])


def _causes(found: Mapping[str, Any]) -> str:
    at = found["frequency_hz"] / found["part"]
    rows = "".join(
        f"<tr><td>{escape(c['name'])}</td><td>{'possible' if c['possible'] else 'fails'}</td>"
        f"<td>{escape(c['detail'])}</td></tr>"
        for c in sorted(found["causes"], key=lambda c: not c["possible"])
    )
    head = "<tr><th>cause</th><th></th><th>reason</th></tr>"
    return f"<h2>Causes tested for {at:.3f} Hz</h2><table>{head}{rows}</table>"


def plots(strange: Sequence[Mapping[str, Any]]) -> list[Any]:
    """The spectrum around the mesh lines and the modulation's depth, for each spacing."""
    return [plot for found in strange for plot in (_spectrum(found), _depth(found))]


def _spectrum(found: Mapping[str, Any]) -> Any:
    from plotly.subplots import make_subplots

    parts = found.get("spectrum") or []
    if not parts:
        return None
    spacing = found["frequency_hz"]
    plot = make_subplots(rows=len(parts), cols=1, vertical_spacing=0.3 / len(parts))
    for i, part in enumerate(parts):
        frequency = [part["from_hz"] + j * part["step_hz"] for j in range(len(part["amplitude"]))]
        highest = max(part["amplitude"])
        middle = (frequency[0] + frequency[-1]) / 2
        near = {"row": i + 1, "col": 1}
        plot.add_scatter(
            x=frequency, y=[max(a, highest * SPECTRUM_FLOOR) for a in part["amplitude"]], mode="lines",
            line={"color": MEASURED, "width": 1}, name="spectrum", showlegend=False, **near,
        )  # fmt: skip
        for m in (-3, -2, -1, 1, 2, 3):
            plot.add_vline(
                x=middle + m * spacing, line={"color": BEFORE, "width": 1, "dash": "dot"}, **near,
                annotation={"text": f"{m:+d}×", "font": {"color": BEFORE, "size": 11}},
            )  # fmt: skip
        plot.update_xaxes(title=f"around mesh harmonic {part['harmonic']} [Hz]", **near)
        plot.update_yaxes(type="log", title="in the channel's unit", exponentformat="power", dtick=1, **near)
    plot.update_layout(
        title=f"{parts[0]['channel']}: spectrum around the mesh lines, marked at mesh ± n·{spacing:.3f} Hz",
        **LOOK | {"height": 90 + 260 * len(parts), "margin": {"t": 90}},
    )
    return plot


def _depth(found: Mapping[str, Any]) -> Any:
    import plotly.graph_objects as go

    sides = [s for s in found["sidebands"] if s["depth"] is not None]
    if not sides:
        return None
    channels = sorted({s["channel"] for s in sides}, reverse=True)
    columns = sorted({(s["harmonic"], s["multiple"]) for s in sides})
    depth = {(s["channel"], s["harmonic"], s["multiple"]): 100 * s["depth"] for s in sides}
    values = [[depth.get((c, h, m)) for h, m in columns] for c in channels]
    plot = go.Figure()
    plot.add_heatmap(
        x=[f"mesh {h} ± {m}×" for h, m in columns], y=channels, z=values, colorscale="Blues", zmin=0,
        text=[["" if v is None else f"{v:.0f}" for v in row] for row in values], texttemplate="%{text}",
        colorbar={"title": "%"}, hoverongaps=False, xgap=2, ygap=2,
    )  # fmt: skip
    plot.update_layout(
        title=f"Depth of the modulation at n·{found['frequency_hz']:.3f} Hz: both side lines over the mesh line [%]",
        **LOOK | {"height": 160 + 32 * len(channels)},
    )
    return plot
