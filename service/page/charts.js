// The four charts: RMS and depth against revolutions (figures 6 and 7 of Feng et al. 2019), profile, remaining life.

import { isAvailable, number, reasonOf, revolutions, sharedReasons } from "./format.js";

// Only buttons that work on this page: none that sends a chart elsewhere.
const CONFIG = { displaylogo: false, responsive: true, showSendToCloud: false, showEditInChartStudio: false,
  modeBarButtons: [["toImage", "zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "resetScale2d"]] };
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
const plotted = new Map(); // chart element → last figure, to draw again when the theme changes

function layout(x, y, more = {}) {
  const axis = (title) => ({
    title: { text: title, font: { size: 12.5 }, standoff: 8 }, gridcolor: colour("grid"), linecolor: colour("line"),
    zerolinecolor: colour("line"), automargin: true, rangemode: "tozero", ticks: "outside", tickcolor: colour("line"),
  });
  return {
    margin: { l: 56, r: 14, t: 10, b: 44 }, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
    font: { family: "system-ui, sans-serif", size: 12, color: colour("ink") }, hovermode: "closest",
    hoverlabel: { bgcolor: colour("panel"), bordercolor: colour("line"), font: { color: colour("ink") } },
    legend: { orientation: "h", x: 0, y: 1.02, yanchor: "bottom", traceorder: "normal", bgcolor: "rgba(0,0,0,0)" },
    xaxis: axis(x), yaxis: axis(y), uirevision: "kept", ...more,
  };
}

function band(x, low, high, name) {
  const fill = { mode: "lines", line: { width: 0 }, hoverinfo: "skip" };
  return [
    { x, y: high, ...fill, showlegend: false },
    { x, y: low, ...fill, fill: "tonexty", fillcolor: `rgba(${colour("band")},0.2)`, name },
  ];
}

function updateLines(windows) {
  const marks = windows.filter((w) => w.updated);
  const line = { color: colour("update"), width: 1, dash: "dot" };
  const shown = marks.slice(-60); // a line for each of the latest; the caption counts them all
  return {
    shapes: shown.map((w) => ({
      type: "line", xref: "x", yref: "paper", x0: w.revolutions, x1: w.revolutions, y0: 0, y1: 1, line, layer: "below",
    })),
    legend: marks.length
      ? [{ x: [null], y: [null], mode: "lines", line, name: "update", hoverinfo: "skip" }]
      : [],
  };
}

function draw(id, caption, figure, unavailable) {
  const panel = document.getElementById(id);
  const chart = panel.querySelector(".chart");
  panel.querySelector("figcaption p").textContent = caption;
  panel.hidden = sharedReasons.has(unavailable);
  if (unavailable) {
    Plotly.purge(chart);
    plotted.delete(chart);
    const note = document.createElement("div");
    note.className = "unavailable";
    const strong = document.createElement("strong");
    strong.textContent = "not available";
    const why = document.createElement("span");
    why.textContent = unavailable;
    note.append(strong, why);
    chart.replaceChildren(note);
    panel.dataset.points = "0";
    return;
  }
  if (chart.querySelector(".unavailable")) chart.replaceChildren();
  plotted.set(chart, figure);
  const { traces, layout: look } = figure();
  panel.dataset.points = String(traces.reduce((n, t) => n + (t.y || []).filter((v) => v !== null).length, 0));
  Plotly.react(chart, traces, look, CONFIG);
}

export function redraw() {
  for (const [chart, figure] of plotted) {
    const { traces, layout: look } = figure();
    Plotly.react(chart, traces, look, CONFIG);
  }
}

export function drawRms({ windows }) {
  const measured = windows.filter((w) => w.kind !== "calibration");
  const left = windows.length - measured.length;
  const counted = measured.some((w) => Number.isFinite(w.revolutions)); // without an encoder windows are only in order
  const shown = counted ? measured.filter((w) => Number.isFinite(w.revolutions)) : measured;
  const updates = windows.filter((w) => w.updated).length;
  const x = shown.map((w) => (counted ? w.revolutions : w.index));
  const at = counted ? "%{x:,.0f} rev" : "window %{x}";
  const hover = shown.map((w) => `window ${w.index}<br>${number(w.speed_hz)} Hz, ${number(w.torque_nm)} N·m`);
  const has = (key) => shown.some((w) => Number.isFinite(w[key]));
  const series = (key, name, mode, look) => ({
    x, y: shown.map((w) => w[key] ?? null), name, mode, text: hover,
    hovertemplate: `${name}: %{y:.4~g} m/s² at ${at}<br>%{text}<extra></extra>`, ...look,
  });
  const figure = () => {
    const marks = updateLines(shown);
    const traces = [
      series("rms_measured", "measured", "lines+markers",
        { line: { color: colour("measured"), width: 2 }, marker: { size: 6 } }),
    ];
    if (has("rms_predicted")) {
      traces.push(series("rms_predicted", "model, before update", "lines+markers",
        { line: { color: colour("predicted"), width: 2 }, marker: { size: 7, symbol: "circle-open" } }));
    }
    if (updates && has("rms_after")) {
      const after = shown.map((w) => (w.updated ? w.rms_after ?? null : null));
      traces.push(series("rms_after", "model, after update", "markers", { y: after,
        marker: { color: colour("after"), size: 9, symbol: "x-thin", line: { width: 2, color: colour("after") } } }));
    }
    const look = layout(counted ? "pinion revolutions" : "window", "RMS [m/s²]", { shapes: marks.shapes });
    if (!counted) Object.assign(look.xaxis, { rangemode: "normal", tickformat: "d" });
    return { traces: [...traces, ...marks.legend], layout: look };
  };
  const parts = [`reference accelerometer; ${updates} update${updates === 1 ? "" : "s"}`];
  if (left) parts.push(`${left} calibration window${left === 1 ? "" : "s"} not drawn`);
  draw("rms", parts.join("; "), figure, has("rms_measured") ? null
    : windows.length ? "no window so far has a measured RMS" : "no window yet");
}

export function drawDepth({ windows, wear, effects, tracing }, trend, inspections, limit) {
  const again = isAvailable(effects) && effects.length && isAvailable(tracing) ? tracing.depths ?? [] : [];
  const points = trend.filter((p) => p.depth_um?.combined && p.revolutions !== null);
  const bare = windows.filter((w) => Number.isFinite(w.wear_depth_um) && w.revolutions !== null);
  const x = points.length ? points.map((p) => p.revolutions) : bare.map((w) => w.revolutions);
  const y = points.length ? points.map((p) => p.depth_um.combined.median) : bare.map((w) => w.wear_depth_um);
  const figure = () => {
    const banded = points.filter((p) => Number.isFinite(p.depth_um.combined.p05));
    const at = banded.map((p) => p.revolutions);
    const marks = updateLines(windows.filter((w) => w.kind !== "calibration"));
    const traces = banded.length ? band(at, banded.map((p) => p.depth_um.combined.p05),
      banded.map((p) => p.depth_um.combined.p95), "5–95 %") : [];
    traces.push({
      x, y, name: "model, both flanks", mode: "lines+markers", line: { color: colour("predicted"), width: 2 },
      marker: { size: 6 }, hovertemplate: "model: %{y:.4~g} µm at %{x:,.0f} rev<extra></extra>",
    });
    for (const [key, name, dash] of [["wear_depth_um_before", "wear alone, history re-evaluated", "dot"],
      ["wear_depth_um_after", "with the effects, history re-evaluated", "dash"]]) {
      if (!again.length) continue;
      traces.push({ x: again.map((d) => d.revolutions), y: again.map((d) => d[key]), name, mode: "lines",
        line: { color: colour(key.endsWith("after") ? "after" : "muted"), width: 1.2, dash },
        hovertemplate: `${name}: %{y:.4~g} µm at %{x:,.0f} rev<extra></extra>` });
    }
    for (const [flank, symbol] of [["combined", "diamond"], ["pinion", "triangle-up"], ["gear", "triangle-down"]]) {
      const own = inspections.map((i) => i.inspection).filter((i) => i.flank === flank);
      if (!own.length) continue;
      traces.push({
        x: own.map((i) => i.revolutions), y: own.map((i) => i.max_depth_um), mode: "markers",
        name: `inspection, ${flank === "combined" ? "both flanks" : flank}`,
        error_y: { type: "data", array: own.map((i) => 1.645 * i.std_um), color: colour("inspection"), thickness: 1.5 },
        marker: { color: colour("inspection"), size: 10, symbol },
        hovertemplate: "inspection: %{y:.4~g} µm at %{x:,.0f} rev<extra></extra>",
      });
    }
    const shapes = marks.shapes;
    if (limit && Math.max(...y, 0) > 0.3 * limit) {
      shapes.push({ type: "line", xref: "paper", x0: 0, x1: 1, y0: limit, y1: limit,
        line: { color: colour("bad"), width: 1.5, dash: "dash" } });
      traces.push({ x: [null], y: [null], mode: "lines", name: "end of life", hoverinfo: "skip",
        line: { color: colour("bad"), width: 1.5, dash: "dash" } });
    }
    return { traces: [...traces, ...marks.legend], layout: layout("pinion revolutions", "maximum depth [µm]",
      { shapes }) };
  };
  const parts = ["both flanks together"];
  if (limit) parts.push(`end of life at ${number(limit)} µm`);
  const validity = isAvailable(wear) ? wear.validity : null;
  if (validity && validity.valid === false) {
    const loss = validity.contact_loss_from_um;
    const why = validity.reason ? `: ${validity.reason}`
      : Number.isFinite(loss) ? `, contact lost from ${number(loss)} µm` : "";
    parts.push(`outside the validity of the model${why}`);
  }
  const caption = parts.join("; ");
  draw("depth", caption, figure, x.length ? null : isAvailable(wear) ? "no window so far has a depth" : reasonOf(wear));
}

// The profile as [{flank, x, y}] with the axis it is given on, whichever of the contract's two that is.
function profileSeries(profile) {
  const axes = { roll_angle_deg: ["roll angle [°]", 1], roll_angle_rad: ["roll angle [rad]", 1],
    roll_angle: ["roll angle [rad]", 1], radius_mm: ["radius [mm]", 1], radius_m: ["radius [mm]", 1e3],
    radius: ["radius [mm]", 1e3] };
  let title = "";
  const series = ["pinion", "gear"].map((flank) => {
    const own = profile[flank] && !Array.isArray(profile[flank]) ? profile[flank] : profile;
    const key = Object.keys(axes).find((k) => Array.isArray(own[k]));
    const y = own === profile ? profile[`${flank}_um`] ?? profile[`${flank}_depth_um`] ?? profile[flank] : own.depth_um;
    if (!key || !Array.isArray(y)) return null;
    title = axes[key][0];
    return { flank, x: own[key].map((v) => v * axes[key][1]), y };
  }).filter(Boolean);
  return { title, series };
}

export function drawProfile({ wear, windows }) {
  const profile = isAvailable(wear) ? wear.profile : null;
  const { title, series } = profile && isAvailable(profile) ? profileSeries(profile) : { title: "", series: [] };
  const figure = () => ({
    traces: series.map(({ flank, x, y }) => ({
      x, y, name: flank, mode: "lines", line: { color: colour(flank === "pinion" ? "predicted" : "gear"), width: 2 },
      fill: "tozeroy", fillcolor: "rgba(128,128,128,0.07)",
      hovertemplate: `${flank}: %{y:.4~g} µm at %{x:.4~g}<extra></extra>`,
    })),
    layout: (() => {
      const look = layout(title, "depth [µm]");
      look.xaxis.rangemode = "normal";
      return look;
    })(),
  });
  const last = windows.filter((w) => w.revolutions !== null).at(-1);
  const caption = last ? `material removed from each flank at ${revolutions(last.revolutions)} revolutions` : "";
  const why = !isAvailable(wear) ? reasonOf(wear) : reasonOf(profile);
  draw("profile", caption, figure, series.length ? null : why);
}

export function drawRul({ rul }, trend) {
  const points = trend.filter((p) => p.rul_hours && p.revolutions !== null && p.kind !== "calibration");
  const x = points.map((p) => p.revolutions);
  const figure = () => {
    const banded = points.filter((p) => Number.isFinite(p.rul_hours.p05) && Number.isFinite(p.rul_hours.p95));
    const traces = banded.length ? band(banded.map((p) => p.revolutions), banded.map((p) => p.rul_hours.p05),
      banded.map((p) => p.rul_hours.p95), "5–95 %") : [];
    traces.push({
      x, y: points.map((p) => p.rul_hours.median), name: "median", mode: "lines+markers",
      line: { color: colour("predicted"), width: 2 }, marker: { size: 6 },
      text: points.map((p) => revolutions(p.rul_revolutions?.median)),
      hovertemplate: "%{y:.4~g} h (%{text} rev) left at %{x:,.0f} rev<extra></extra>",
    });
    return { traces, layout: layout("pinion revolutions", "remaining life [h]") };
  };
  draw("rul", "at the operating condition of each window", figure,
    points.length ? null : isAvailable(rul) ? "no window so far has a remaining life" : reasonOf(rul));
}
