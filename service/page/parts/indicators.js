// Trends of condition indicators, levels and operation over all windows, zoomed together.

import { get } from "../api.js";
import { AXES, Chart } from "../chart.js";
import { element, panel, pause } from "../dom.js";
import { instant, revolutions } from "../format.js";
import { labelled } from "./waterfall.js";

const POINTS = 800;
const NAMES = { level: "Level and depth", operation: "Speed and torque", "mesh bands": "Mesh harmonics", temperature: "Temperature" };

export function indicatorsView(root, { machine, signal, context }) {
  let answer = null;
  let charts = [];
  const grid = element("div", { className: "charts" });
  const said = element("p", { className: "caption", role: "status" });
  const links = element("p", { className: "downloads" });
  const group = element("select", { ariaLabel: "Quantities", onchange: draw });
  const axis = element("select", { ariaLabel: "Axis of the trends", onchange: () => { context.setAxis(axis.value); draw(); } },
    new Option("revolutions", "revolutions"), new Option("time", "time"));
  root.append(panel("Trends of indicators",
    element("div", { className: "controls" }, labelled("show", group), labelled("over", axis)), said, links), grid);

  async function load() {
    try {
      answer = await get(`${machine.base}/indicators?resolution=${POINTS}`, { signal });
    } catch (error) {
      if (error.name !== "AbortError") said.textContent = error.message;
      return;
    }
    const groups = [...new Set(answer.quantities.map((q) => q.group))];
    const chosen = groups.includes(group.value) ? group.value : groups.find((g) => g.includes("pinion")) ?? groups[0];
    group.replaceChildren(...groups.map((g) => new Option(NAMES[g] ?? g, g, false, g === chosen)));
    axis.value = context.axis;
    said.textContent = groups.length ? `${answer.index.length} windows; zoom and cursor of the charts go together.`
      : "No window has a figure to show yet.";
    draw();
  }

  let latest = 0; // drawing that has begun last: an earlier one stops

  async function draw() {
    if (!answer) return;
    const own = latest += 1;
    const over = axis.value === "revolutions" && answer.revolutions.some(Number.isFinite) ? "revolutions"
      : axis.value === "time" ? "time" : "index";
    const place = over === "time" ? answer.start_time.map((t) => instant(t) / 1000)
      : over === "revolutions" ? answer.revolutions : answer.index;
    const rows = place.map((x, i) => ({ x, i })).filter((r) => Number.isFinite(r.x)).sort((a, b) => a.x - b.x);
    const shown = answer.quantities.filter((q) => q.group === group.value);
    const names = shown.map((q) => q.name).join("|");
    if (charts.names !== names) {
      for (const chart of charts) chart.destroy();
      charts = shown.map((q) => new Chart(grid, { id: `trend-${q.name.replaceAll(/[^a-z0-9]+/gi, "-")}`, title: q.label, group: "indicators" }));
      for (const chart of charts) chart.all = true; // what is far off is what an indicator is for
      charts.names = names;
    }
    const path = (format) => `${machine.base}/indicators?${new URLSearchParams([["format", format], ["resolution", String(POINTS)],
      ["axis", over], ...shown.map((q) => ["quantity", q.name])])}`;
    links.replaceChildren("Download: ", element("a", { href: path("csv") }, "CSV"), " · ",
      element("a", { href: path("png"), target: "_blank" }, "PNG"));
    // one chart at a time, so that no task of the browser is long
    for (const [k, q] of shown.entries()) {
      await pause();
      if (signal.aborted || own !== latest) return;
      charts[k].set({
        caption: "", x: AXES[over], y: { label: q.unit ? `${shortOf(q)} [${q.unit}]` : shortOf(q), zero: false },
        values: rows.map((r) => r.x),
        series: [{ name: shortOf(q), unit: q.unit, colour: "predicted", values: rows.map((r) => q.values[r.i]) }],
        about: (at) => {
          const i = rows[at]?.i;
          return i === undefined ? "" : [`window ${answer.index[i]}`, Number.isFinite(answer.revolutions[i]) ? `${revolutions(answer.revolutions[i])} rev` : "",
            answer.quality[i] === "good" ? "" : `data ${answer.quality[i]}`].filter(Boolean).join(" · ");
        },
      });
    }
  }

  signal.addEventListener("abort", () => charts.forEach((chart) => chart.destroy()));
  load();
  return { load };
}

// What follows the sensor and the gear in a label.
const shortOf = (quantity) => quantity.label.split(": ").at(-1);
