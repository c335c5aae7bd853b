// The menu of a chart: zoom, series, the points as a table, and downloads. Nothing leaves this computer.

import { choice, element } from "./dom.js";
import { number } from "./format.js";

const ROWS = 500; // of the table, the newest

export function chartMenu(chart) {
  if (chart.menu.firstChild) return; // made once; it reads the chart when it is used
  const close = () => { box.open = false; };
  const button = (text, act) => element("button", { type: "button", onclick: () => { act(); close(); summary.focus(); } }, text);
  const summary = element("summary", { "aria-label": `Menu of the chart ${chart.title}`, title: "zoom, series, table, download" }, "Menu");
  const choices = element("div", { className: "choices" });
  const box = element("details", { className: "menu" }, summary, element("div", { className: "menu-list" },
    button("Whole range", () => chart.reset()),
    button("Scale to all points, or without outliers", () => {
      chart.all = !chart.all;
      chart.plot.setData(chart.data(), false);
      chart.rescale();
    }),
    button("Show or hide the table", () => toggleTable(chart)),
    button("Save as CSV", () => save(`${nameOf(chart)}.csv`, new Blob([csv(chart)], { type: "text/csv" }))),
    button("Save as PNG", () => png(chart)),
    choices));
  box.addEventListener("toggle", () => box.open && choices.replaceChildren(...seriesChoices(chart)));
  box.addEventListener("keydown", (event) => {
    if (event.key === "Escape") {
      close();
      summary.focus();
    }
  });
  box.addEventListener("focusout", (event) => {
    if (!box.contains(event.relatedTarget)) close();
  });
  chart.menu.replaceChildren(box);
}

function seriesChoices(chart) {
  return chart.given.series.map((s, i) => choice(s.name, !chart.hidden.has(s.name), (show) => {
    chart.hidden[show ? "delete" : "add"](s.name);
    chart.plot.setSeries(i + 1, { show });
    chart.rescale();
    chart.drawLegend();
  }));
}

// Columns of the chart's points: [heading, values].
function columns(chart) {
  const { x, values, series, bands } = chart.given;
  const first = x.time ? ["time", values.map((v) => new Date(v * 1000).toISOString())] : [x.label, values];
  return [first, ...series.map((s) => [s.unit ? `${s.name} [${s.unit}]` : s.name, s.values]),
    ...bands.flatMap((b) => [[`${b.name}, low`, b.low], [`${b.name}, high`, b.high]])];
}

export function csv(chart) {
  const quoted = (text) => (/[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
  const all = columns(chart);
  const rows = chart.given.values.map((_, i) => all.map(([, values]) => quoted(String(values[i] ?? ""))).join(","));
  const spots = chart.given.spots.map((s) => `# ${s.name}: ${s.x}, ${s.y}${Number.isFinite(s.error) ? ` ± ${s.error}` : ""}`);
  return [all.map(([heading]) => quoted(heading)).join(","), ...rows, ...spots, ""].join("\r\n");
}

function toggleTable(chart) {
  if (chart.extra.firstChild) {
    chart.extra.replaceChildren();
    return;
  }
  const all = columns(chart);
  const from = Math.max(chart.given.values.length - ROWS, 0);
  const cell = (value) => element("td", { className: "number" }, typeof value === "number" ? number(value, 4) : String(value ?? "–"));
  const rows = chart.given.values.slice(from).map((_, i) => element("tr", {}, ...all.map(([, values]) => cell(values[from + i]))));
  chart.extra.append(element("div", { className: "scroll", tabIndex: 0, role: "region", "aria-label": `${chart.title}, as a table` },
    element("table", {}, element("thead", {}, element("tr", {}, ...all.map(([heading]) => element("th", { scope: "col" }, heading)))),
      element("tbody", {}, ...rows))));
}

const nameOf = (chart) => chart.title.toLowerCase().replace(/[^a-z0-9]+/g, "-").replace(/^-|-$/g, "");

function save(name, blob) {
  const link = element("a", { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

// The chart with its title and legend as a picture.
function png(chart) {
  const drawn = chart.plot.ctx.canvas;
  const px = devicePixelRatio || 1;
  const style = getComputedStyle(document.documentElement);
  const canvas = element("canvas", { width: drawn.width, height: drawn.height + 52 * px });
  const ctx = canvas.getContext("2d");
  ctx.fillStyle = style.getPropertyValue("--panel");
  ctx.fillRect(0, 0, canvas.width, canvas.height);
  ctx.fillStyle = style.getPropertyValue("--ink");
  ctx.font = `600 ${14 * px}px system-ui, sans-serif`;
  ctx.fillText(chart.title, 12 * px, 20 * px);
  ctx.font = `${12 * px}px system-ui, sans-serif`;
  let left = 12 * px;
  for (const s of chart.given.series.filter((one) => !chart.hidden.has(one.name))) {
    ctx.fillStyle = style.getPropertyValue(`--${s.colour ?? "predicted"}`);
    ctx.fillRect(left, 34 * px, 14 * px, 4 * px);
    ctx.fillStyle = style.getPropertyValue("--ink");
    ctx.fillText(s.name, left + 20 * px, 40 * px);
    left += ctx.measureText(s.name).width + 40 * px;
  }
  ctx.drawImage(drawn, 0, 52 * px);
  canvas.toBlob((blob) => save(`${nameOf(chart)}.png`, blob), "image/png");
}
