// Charts on uPlot: linked cursors and zoom, bands, markers, limits, scales that an outlier does not rule, downloads, a table.
//
// const chart = new Chart(host, { id, title, group, height });
// chart.set({
//   caption, y: { label, zero, log }, x: { label, time },      x.time: values are Unix seconds
//   values: [...],                                             ascending
//   series: [{ name, unit, values, colour, dash, points, line, width }],
//   bands: [{ name, low, high, colour }],                      low, high: values as long as x
//   marks: [{ x, label, colour, dash }],                       vertical lines
//   limits: [{ y, label }],                                    horizontal lines
//   spots: [{ name, x, y, error, colour, shape, size }],       points of their own, with error bars
//   about: (index) => "what else is known of this point",
// });
// chart.unavailable(reason) in place of set. `colour` is a name of page.css: measured, predicted, after, …

import { chartMenu } from "./chart_menu.js";
import { drawBands, drawLimits, drawMarks, drawOutside, drawSpots } from "./chart_layers.js";
import { element } from "./dom.js";
import { dateTime, number, sentence } from "./format.js";
import { rangeOf } from "./scale.js";

// What trends are drawn over.
export const AXES = { time: { label: "time", time: true }, revolutions: { label: "pinion revolutions", unit: "rev" }, index: { label: "window", unit: "" } };
const HEIGHT = 250;
const PRINT_WIDTH = 300; // of a chart on paper, two in a row of A4 [px]
const PRINT_HEIGHT = 180;
const groups = new Map(); // name → { charts, zoom }
const shown = new Set(); // every chart on the page

export const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim() || name;

function groupOf(name) {
  if (!groups.has(name)) groups.set(name, { charts: new Set(), zoom: null });
  return groups.get(name);
}

export class Chart {
  constructor(host, { id, title, group = null, height = HEIGHT }) {
    this.title = title;
    this.screenHeight = height;
    this.group = group === null ? { charts: new Set(), zoom: null } : groupOf(group);
    this.groupName = group;
    this.hidden = new Set(); // names of series that are switched off
    this.all = false; // whether outliers are on the scale
    this.caption = element("p", { className: "caption" });
    this.legend = element("p", { className: "legend" });
    this.reading = element("p", { className: "reading", "aria-live": "polite" });
    this.body = element("div", { className: "chart" });
    this.note = element("p", { className: "outside" });
    this.extra = element("div", { className: "as-table" });
    this.menu = element("div", { className: "menu-place" });
    this.figure = element("figure", { className: "panel", id, dataset: { points: "0" } },
      element("figcaption", {}, element("h2", {}, title), this.menu, this.caption),
      this.legend, this.reading, this.body, this.note, this.extra);
    host.append(this.figure);
    this.size = new ResizeObserver(() => this.resize());
    this.size.observe(this.body);
    shown.add(this);
    this.group.charts.add(this);
  }

  destroy() {
    this.size.disconnect();
    this.plot?.destroy();
    this.plot = null;
    shown.delete(this);
    this.group.charts.delete(this);
    if (!this.group.charts.size) this.group.zoom = null;
    this.figure.remove();
  }

  unavailable(reason) {
    this.plot?.destroy();
    this.plot = this.given = null;
    this.figure.dataset.points = "0";
    for (const part of [this.caption, this.legend, this.reading, this.note, this.extra, this.menu]) part.replaceChildren();
    this.body.replaceChildren(element("div", { className: "unavailable" },
      element("strong", {}, "not available"), element("span", {}, sentence(reason))));
  }

  set(given) {
    const before = this.given;
    this.given = { bands: [], marks: [], limits: [], spots: [], about: () => "", ...given };
    const { series, spots } = this.given;
    this.figure.dataset.points = String(series.reduce((n, s) => n + s.values.filter(Number.isFinite).length, 0) + spots.length);
    this.caption.textContent = this.given.caption ?? "";
    const same = before && this.plot && before.x.label === this.given.x.label && before.x.time === this.given.x.time
      && before.y.label === this.given.y.label && before.y.log === this.given.y.log
      && before.series.map((s) => s.name).join("|") === series.map((s) => s.name).join("|");
    if (same) {
      this.plot.setData(this.data(), false);
      this.rescale();
    } else {
      this.build();
    }
    this.drawLegend();
    chartMenu(this);
    this.describe();
  }

  // What is drawn: a line is interrupted where a point lies outside the scale.
  data() {
    this.rangeY();
    const gone = new Set(this.outside.map((o) => `${o.series}/${o.index}`));
    return [this.given.values, ...this.given.series.map((s, number) =>
      (gone.size ? s.values.map((v, i) => (gone.has(`${number}/${i}`) ? null : v)) : s.values))];
  }

  build() {
    this.plot?.destroy();
    this.body.replaceChildren();
    const { x, y, series } = this.given;
    if (this.group.axis !== undefined && this.group.axis !== x.label) this.group.zoom = null;
    this.group.axis = x.label;
    const axis = (label, more) => ({ label, labelSize: 22, size: more.size, labelFont: "12.5px system-ui, sans-serif",
      font: "12px system-ui, sans-serif", stroke: () => colour("muted"), grid: { stroke: () => colour("grid"), width: 1 },
      ticks: { stroke: () => colour("line"), width: 1, size: 5 }, ...more });
    const plot = {
      width: this.width(), height: this.height(), legend: { show: false }, padding: [6, 12, 0, 0],
      scales: { x: { time: Boolean(x.time), range: () => this.extent() },
        y: { distr: y.log ? 3 : 1, range: () => this.rangeY() } },
      axes: [axis(x.time ? "" : x.label, x.time ? { size: 44, values: DATES } : { size: 34 }), axis(y.label, { size: 62, values: (_, ticks) => ticks.map(tick) })],
      series: [{}, ...series.map((s) => ({ label: s.name, scale: "y", stroke: () => colour(s.colour ?? "predicted"),
        width: s.line === false ? 0 : s.width ?? 2, dash: s.dash, spanGaps: false, show: !this.hidden.has(s.name),
        paths: s.line === false ? () => null : undefined,
        points: { ...pointsShown(s, this.given.values.length), size: s.line === false ? 8 : 6, width: 1.5,
          fill: () => (s.hollow ? colour("panel") : colour(s.colour ?? "predicted")) } }))],
      cursor: { drag: { x: true, y: false }, points: { size: 8 }, y: false, bind: { dblclick: () => () => this.reset() },
        ...(this.groupName ? { sync: { key: `${this.groupName}/${x.label}`, scales: ["x", null], filters: MOVES } } : {}) },
      hooks: {
        drawClear: [(u) => drawBands(u, this.given, colour)],
        draw: [(u) => {
          drawMarks(u, this.given, colour);
          drawLimits(u, this.given, colour);
          drawSpots(u, this.given, colour);
          drawOutside(u, this.given, this.outside ?? [], colour);
        }],
        setCursor: [(u) => this.read(u.cursor.idx)],
        setScale: [(u, key) => key === "x" && this.zoomed(u.scales.x)],
      },
    };
    this.plot = new uPlot(plot, this.data(), this.body);
    this.makeFocusable();
    this.rescale();
  }

  makeFocusable() {
    const frame = this.plot.root.querySelector(".u-wrap");
    frame.tabIndex = 0;
    frame.setAttribute("role", "img");
    frame.dataset.key = `chart-${this.figure.id}`;
    frame.addEventListener("keydown", (event) => this.key(event));
  }

  // -- scales ----------------------------------------------------------------------------------------

  // From the first x to the last, of all charts that are zoomed together.
  extent() {
    if (this.group.zoom) return this.group.zoom;
    let [low, high] = [Infinity, -Infinity];
    for (const chart of this.group.charts) {
      if (chart.given?.x.label !== this.given.x.label) continue;
      const { values, spots } = chart.given;
      for (const x of [values[0], values.at(-1), ...spots.map((s) => s.x)]) {
        if (Number.isFinite(x)) [low, high] = [Math.min(low, x), Math.max(high, x)];
      }
    }
    if (low > high) return [0, 1];
    const least = this.given.x.time ? 600 : Math.max(0.1 * Math.abs(high), 1);
    const room = this.given.x.tight ? 0 : Math.max(0.015 * (high - low), high === low ? least : 0);
    return [low - room, high + room];
  }

  rangeY() {
    const { series, bands, limits, spots, y, values } = this.given;
    const visible = series.map((s) => (this.hidden.has(s.name) ? { values: [] } : s));
    const [from, to] = this.extent();
    const first = values.findIndex((x) => x >= from);
    const lastFromEnd = values.findLastIndex((x) => x <= to);
    const inside = spots.filter((s) => s.x >= from && s.x <= to);
    const extra = [...inside.flatMap((s) => [s.y - (s.error ?? 0), s.y + (s.error ?? 0)])];
    for (const band of bands) {
      extra.push(...quantiles(band.low, first, lastFromEnd), ...quantiles(band.high, first, lastFromEnd));
    }
    const found = rangeOf(visible, { from: Math.max(first, 0), to: lastFromEnd, extra, zero: y.zero !== false && !y.log,
      all: this.all || y.log });
    for (const { y: at } of limits) if (at < 3 * found.max && at > found.max * 0.999) found.max = at * 1.08;
    this.outside = found.outside;
    if (y.log) found.min = Math.max(found.min, found.max * 1e-6);
    return [found.min, found.max];
  }

  rescale() {
    if (!this.plot) return;
    const [min, max] = this.extent();
    this.plot.setScale("x", { min, max });
    queueMicrotask(() => this.noteOutside()); // once the scale has been set
  }

  noteOutside() {
    if (!this.given) return;
    const out = this.outside ?? [];
    const names = [...new Set(out.map((o) => this.given.series[o.series]?.name))].join(", ");
    const unit = this.given.series[out[0]?.series]?.unit ?? "";
    this.note.textContent = !out.length ? "" : `${out.length} ${out.length === 1 ? "point is" : "points are"} outside the scale (${
      names}: up to ${number(Math.max(...out.map((o) => o.value)))} ${unit}). The menu of the chart shows all points.`;
  }

  zoomed({ min, max }) {
    if (!Number.isFinite(min)) return;
    const [low, high] = this.group.zoom ?? this.extent();
    if (min === low && max === high) return;
    this.zoom([min, max]);
  }

  zoom(range) {
    this.group.zoom = range;
    for (const chart of this.group.charts) if (chart.given?.x.label === this.given.x.label) chart.rescale();
  }

  reset() {
    this.zoom(null);
  }

  // -- reading ---------------------------------------------------------------------------------------

  drawLegend() {
    const { series, bands, spots, marks, limits } = this.given;
    this.values = new Map();
    const item = (name, shade, shape, off) => {
      const value = element("span", { className: "at" });
      this.values.set(name, value);
      const swatch = element("span", { className: `swatch ${shape}`, "aria-hidden": "true" });
      swatch.style.color = `var(--${shade})`;
      return element("span", { className: off ? "item off" : "item" }, swatch, name, value);
    };
    const markNames = new Map(marks.filter((m) => m.legend).map((m) => [m.legend, m]));
    this.legend.replaceChildren(
      ...series.map((s) => item(s.name, s.colour ?? "predicted", s.line === false ? "dot" : s.dash ? "dashed" : "line",
        this.hidden.has(s.name))),
      ...bands.map((b) => item(b.name, b.colour ?? "predicted", "area")),
      ...[...new Map(spots.map((s) => [s.name, s])).values()].map((s) => item(s.name, s.colour ?? "inspection", "diamond")),
      ...[...markNames.values()].map((m) => item(m.legend, m.colour ?? "update", "upright")),
      ...limits.map((l) => item(l.label, "bad", "dashed")),
    );
  }

  // The values at a point, in the legend, and what is known of the point.
  read(index) {
    if (!this.given) return;
    const has = index !== null && index !== undefined;
    for (const s of this.given.series) {
      const v = has ? s.values[index] : null;
      this.values?.get(s.name)?.replaceChildren(Number.isFinite(v) ? ` ${number(v)}${s.unit ? ` ${s.unit}` : ""}` : "");
    }
    for (const b of this.given.bands) {
      const [low, high] = has ? [b.low[index], b.high[index]] : [];
      this.values?.get(b.name)?.replaceChildren(Number.isFinite(low) && Number.isFinite(high)
        ? ` ${number(low)} – ${number(high)}` : "");
    }
    const { x, values, about } = this.given;
    this.reading.textContent = has
      ? [this.textOfX(values[index], x), about(index)].filter(Boolean).join(" · ") : "";
  }

  textOfX(value, x = this.given.x) {
    return x.time ? dateTime(value * 1000) : `${number(value, 5)}${x.unit ? ` ${x.unit}` : ""}`;
  }

  key(event) {
    const { plot, given } = this;
    const last = given.values.length - 1;
    const now = plot.cursor.idx ?? last;
    const moves = { ArrowLeft: now - 1, ArrowRight: now + 1, Home: 0, End: last };
    if (event.key in moves) {
      this.cursorTo(Math.min(Math.max(moves[event.key], 0), last));
    } else if (event.key === "+" || event.key === "-") {
      const [low, high] = this.extent();
      const half = (high - low) * (event.key === "+" ? 0.25 : 1);
      const middle = given.values[now] ?? (low + high) / 2;
      this.zoom([middle - half, middle + half]);
    } else if (event.key === "0" || event.key === "Escape") {
      this.reset();
    } else {
      return;
    }
    event.preventDefault();
  }

  cursorTo(index) {
    const { plot, given } = this;
    const left = plot.valToPos(given.values[index], "x");
    plot.setCursor({ left, top: plot.over.clientHeight / 2 }, true, true);
  }

  // One sentence a series, for those who do not see the chart.
  describe() {
    const { series, values, bands, limits, spots } = this.given;
    const ends = values.length ? `${values.length} points from ${this.textOfX(values[0])} to ${this.textOfX(values.at(-1))}` : "no points";
    const each = series.map((s) => {
      const finite = s.values.filter(Number.isFinite);
      return finite.length ? `${s.name}: latest ${number(finite.at(-1))} ${s.unit ?? ""}, from ${number(Math.min(...finite))} to ${
        number(Math.max(...finite))}.` : "";
    });
    const band = bands.map((b) => (Number.isFinite(b.low.at(-1)) && Number.isFinite(b.high.at(-1))
      ? `${b.name}: latest ${number(b.low.at(-1))} to ${number(b.high.at(-1))}.` : ""));
    const text = [`${this.title}: ${ends}.`, ...each, ...band, ...limits.map((l) => `${l.label}.`),
      spots.length ? `${spots.length} ${spots[0].name}.` : ""].filter(Boolean).join(" ");
    this.plot.root.querySelector(".u-wrap").setAttribute("aria-label", `${text} Arrow keys read the points, plus and minus zoom.`);
  }

  // -- size ------------------------------------------------------------------------------------------

  width() {
    return document.documentElement.dataset.print ? PRINT_WIDTH : Math.max(this.body.clientWidth, 200);
  }

  height() {
    return document.documentElement.dataset.print ? PRINT_HEIGHT : this.screenHeight;
  }

  resize() {
    if (!this.plot) return;
    const width = this.width();
    if (Math.abs(width - this.plot.width) > 1) this.plot.setSize({ width, height: this.height() });
  }

  redraw() {
    this.plot?.redraw(false, true);
  }
}

// Templates of a time axis by its step: 24 hours a day, the day in a second line where it changes.
const DATES = [
  [31536000, "{YYYY}", null, null, null, null, null, null, 1],
  [2419200, "{MMM}", "\n{YYYY}", null, null, null, null, null, 1],
  [86400, "{D} {MMM}", "\n{YYYY}", null, null, null, null, null, 1],
  [60, "{HH}:{mm}", "\n{D} {MMM} {YYYY}", null, "\n{D} {MMM}", null, null, null, 1],
  [1, "{HH}:{mm}:{ss}", "\n{D} {MMM} {YYYY}", null, "\n{D} {MMM}", null, null, null, 1],
  [0.001, "{ss}.{fff} s", "\n{D} {MMM} {YYYY}", null, "\n{D} {MMM}", null, null, null, 1],
];

const tick = (v) => (v === null ? "" : new Intl.NumberFormat("en", { maximumSignificantDigits: 6 }).format(v));

// The 5 and 95 % points of a band's edge within the part shown, so that one wide end does not rule the scale.
function quantiles(values, first, last) {
  const finite = values.slice(Math.max(first, 0), last + 1).filter(Number.isFinite).sort((a, b) => a - b);
  if (!finite.length) return [];
  return [finite[Math.floor(0.05 * (finite.length - 1))], finite[Math.ceil(0.95 * (finite.length - 1))],
    values.slice(0, last + 1).findLast(Number.isFinite)];
}

// Charts of a group follow one another's cursor; zoom is passed on by the group itself.
const MOVES = { pub: (type) => type === "mousemove" || type === "mouseleave" };

// Points as well as lines where there are few, or where the series asks for them; else where they are far enough apart.
const pointsShown = (series, count) => {
  const wanted = series.points ?? (count <= 60 ? true : undefined);
  return wanted === undefined ? {} : { show: wanted };
};

matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => shown.forEach((chart) => chart.redraw()));

// On paper: light, and as wide as the sheet.
function printing(on) {
  if (on) document.documentElement.dataset.print = "yes";
  else delete document.documentElement.dataset.print;
  for (const chart of shown) {
    if (!chart.plot) continue;
    chart.plot.setSize({ width: chart.width(), height: chart.height() });
    chart.redraw();
  }
}
addEventListener("beforeprint", () => printing(true));
addEventListener("afterprint", () => printing(false));
