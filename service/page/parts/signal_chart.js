// A chart of one window's signal: measured and modelled, with markers of mesh, shafts and bearings, and with cursors.
//
// Cursors: "single" marks one place, "harmonic" its multiples, "sideband" places at equal distances on both sides.
// A click, or Enter where the chart's cursor is, places them; what they read is listed below the chart.

import { Chart } from "../chart.js";
import { element } from "../dom.js";
import { number } from "../format.js";
import { table } from "../table.js";

const HARMONICS = 10;
const SIDEBANDS = 4; // on either side
const MOST_SPOTS = 400; // modelled lines that are drawn, the largest
const MOST_MARKS = 80; // markers that are drawn; beyond, only every so many are
const SHADES = { measured: "measured", modelled: "after" };
const MARKER_SHADES = { mesh: "muted", sideband: "line", shaft: "inspection", bearing: "update" };
const SPECTRA = new Set(["spectrum", "order-spectrum", "envelope-spectrum"]);

export const isSpectrum = (view) => SPECTRA.has(view);

export class SignalChart extends Chart {
  constructor(host, { onZoom }) {
    super(host, { id: "signal", title: "Signal", height: 360 });
    this.all = true; // a spike is what one looks for
    this.onZoom = onZoom;
    this.cursor = { kind: "none", x: null, spacing: null };
    this.readings = element("div", { className: "cursor-readings", role: "status" });
    this.figure.append(this.readings);
    this.body.addEventListener("click", () => this.place());
  }

  // answer: of REST; kinds: of markers that are drawn; log: of the amplitudes
  show(answer, { kinds, log }) {
    this.answer = answer;
    this.options = { kinds, log };
    this.title = answer.title;
    this.figure.querySelector("h2").textContent = answer.title;
    this.draw();
  }

  draw() {
    const { answer, options: { kinds, log } } = this;
    const clean = (values) => (log ? values.map((v) => (v > 0 ? v : null)) : values);
    // what is measured is drawn last, over what is modelled
    const curves = answer.series.filter((s) => s.kind !== "lines").sort((a, b) => (a.name === "measured") - (b.name === "measured"));
    const spots = answer.series.filter((s) => s.kind === "lines").flatMap((s) => strongest(s));
    const spectral = isSpectrum(answer.view);
    const unit = answer.series[0]?.unit ?? "";
    const what = answer.view === "envelope-spectrum" ? "share of the mean envelope" : spectral ? "amplitude" : answer.channel;
    this.set({
      caption: answer.notes.join(". "),
      x: { label: unitOf(answer.x.label, answer.x.unit), unit: answer.x.unit, tight: true },
      y: { label: unitOf(what, unit), log, zero: spectral },
      values: answer.x.values,
      series: curves.map((s) => ({ name: s.name, unit: s.unit, values: clean(s.values), points: false, width: s.name === "modelled" ? 2.2 : 1.2,
        colour: SHADES[s.name] ?? "update" })),
      spots,
      marks: [...this.markers(kinds), ...this.cursorMarks()],
      about: () => "",
    });
    this.drawReadings();
  }

  // The markers in the part that is shown; labels of mesh and bearings, and of others where there is room.
  markers(kinds) {
    const [from, to] = this.group.zoom ?? [-Infinity, Infinity];
    const inside = this.answer.markers.filter((m) => kinds.has(m.kind) && m.x >= from && m.x <= to);
    const step = Math.ceil(inside.length / MOST_MARKS);
    return inside.filter((m, i) => m.kind === "mesh" || m.kind === "bearing" || i % step === 0)
      .map((m) => ({ x: m.x, label: m.label, colour: MARKER_SHADES[m.kind], dash: m.kind === "sideband" ? [1, 4] : [2, 3] }));
  }

  // All of what is drawn, the modelled lines too; on a logarithmic scale down to the floor between the lines.
  rangeY() {
    const [low, high] = super.rangeY();
    if (!this.given.y.log) return [low, high];
    const [from, to] = this.extent();
    const inside = this.given.series.flatMap((s) => s.values.filter((v, i) => v > 0 && this.given.values[i] >= from && this.given.values[i] <= to))
      .sort((a, b) => a - b);
    if (!inside.length) return [low, high];
    const floor = inside[Math.floor(0.05 * inside.length)];
    return [Math.max(floor / 5, high * 1e-8), high * 2];
  }

  // -- cursors ---------------------------------------------------------------------------------------

  setCursorKind(kind, spacing) {
    this.cursor = { ...this.cursor, kind, spacing };
    if (this.answer) this.draw();
  }

  place() {
    const index = this.plot?.cursor.idx;
    if (this.cursor.kind === "none" || index === null || index === undefined) return;
    this.cursor.x = this.peakNear(this.given.values[index]);
    this.draw();
  }

  key(event) {
    if (event.key === "Enter" || event.key === " ") {
      event.preventDefault();
      this.place();
      return;
    }
    super.key(event);
  }

  // The largest point within some pixels of a place, of a spectrum: a line is hard to hit.
  peakNear(x) {
    if (!isSpectrum(this.answer.view)) return x;
    const [low, high] = this.extent();
    const reach = (6 / this.plot.over.clientWidth) * (high - low);
    return this.readAt(x, reach)?.x ?? x;
  }

  // The largest value within a reach of x: { x, y }, or null.
  readAt(x, reach) {
    const { values, series } = this.given;
    const measured = (series.find((s) => s.name === "measured") ?? series[0]).values;
    let best = null;
    for (let i = lowerBound(values, x - reach); i < values.length && values[i] <= x + reach; i += 1) {
      const y = measured[i];
      if (Number.isFinite(y) && (best === null || y > best.y)) best = { x: values[i], y };
    }
    return best;
  }

  places() {
    const { kind, x, spacing } = this.cursor;
    if (kind === "none" || x === null) return [];
    if (kind === "harmonic") return Array.from({ length: HARMONICS }, (_, k) => ({ x: (k + 1) * x, label: `${k + 1}×` }));
    if (kind === "sideband" && spacing > 0) {
      return Array.from({ length: 2 * SIDEBANDS + 1 }, (_, k) => k - SIDEBANDS)
        .map((k) => ({ x: x + k * spacing, label: k === 0 ? "centre" : k > 0 ? `+${k}` : `−${-k}` }));
    }
    return [{ x, label: "" }];
  }

  cursorMarks() {
    return this.places().map((p) => ({ x: p.x, label: p.label, colour: "bad", dash: [] }));
  }

  drawReadings() {
    const { answer } = this;
    const at = this.places();
    if (!at.length) {
      this.readings.replaceChildren();
      return;
    }
    const { values } = this.given;
    const bin = answer.figures.resolution ?? (values.at(-1) - values[0]) / Math.max(values.length - 1, 1);
    const unit = answer.series[0]?.unit ?? "";
    const rows = at.map((p) => {
      const found = this.readAt(p.x, isSpectrum(answer.view) ? Math.max(2 * bin, 0.002 * Math.abs(p.x)) : bin);
      return [p.label || "cursor", number(p.x, 6), found ? number(found.x, 6) : "–", found ? number(found.y, 4) : "–"];
    });
    this.readings.replaceChildren(table(["place", `${unitOf(answer.x.label, answer.x.unit)}#`, "largest point near it#",
      `${unitOf("value", unit)}#`], rows, { blocks: false }));
  }

  // -- zoom and text ---------------------------------------------------------------------------------

  zoom(range) {
    super.zoom(range);
    this.onZoom(range);
  }

  describe() {
    const { answer } = this;
    const first = answer.series.find((s) => s.kind !== "lines");
    const figures = Object.entries(answer.figures).map(([name, value]) => `${name.replaceAll("_", " ")} ${number(value)}`).join(", ");
    let text = `${answer.title}. ${figures}.`;
    if (isSpectrum(answer.view) && first) {
      const strongestLines = peaksOf(answer.x.values, first.values, 5)
        .map((p) => `${number(p.y)} ${first.unit} at ${number(p.x, 5)} ${answer.x.unit}`).join("; ");
      text += ` Strongest lines: ${strongestLines}.`;
    }
    this.plot.root.querySelector(".u-wrap").setAttribute("aria-label",
      `${text} Arrow keys read the points, Enter places the cursor, plus and minus zoom, 0 shows the whole range.`);
  }
}

export const unitOf = (label, unit) => (unit ? `${label} [${unit}]` : label);

function strongest(series) {
  const all = series.values.map((y, i) => ({ name: series.name, x: series.x[i], y, colour: "after", size: 3.5 }))
    .filter((s) => Number.isFinite(s.y) && s.y > 0);
  return all.length <= MOST_SPOTS ? all : all.sort((a, b) => b.y - a.y).slice(0, MOST_SPOTS);
}

function lowerBound(values, x) {
  let [low, high] = [0, values.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (values[middle] < x) low = middle + 1;
    else high = middle;
  }
  return low;
}

// The largest points that are larger than their neighbours.
function peaksOf(x, y, count) {
  return y.map((value, i) => ({ x: x[i], y: value, top: value >= (y[i - 1] ?? -Infinity) && value > (y[i + 1] ?? -Infinity) }))
    .filter((p) => p.top && Number.isFinite(p.y)).sort((a, b) => b.y - a.y).slice(0, count);
}
