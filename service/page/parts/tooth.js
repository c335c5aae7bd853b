// The worn flank drawn on a tooth of either gear, to one scale in both directions.

import { element, svg } from "../dom.js";
import { sentence } from "../format.js";

const ROOM = 0.4; // around the teeth [mm]

export function toothFigure(answer) {
  const points = answer.series.map((s) => s.values.map((y, i) => [s.x[i], -y]));
  const all = points.flat();
  const [left, right] = [Math.min(...all.map((p) => p[0])) - ROOM, Math.max(...all.map((p) => p[0])) + ROOM];
  const [top, bottom] = [Math.min(...all.map((p) => p[1])) - ROOM, Math.max(...all.map((p) => p[1])) + ROOM];
  const lines = answer.series.map((s, i) => svg("polyline", { points: points[i].map((p) => p.join(",")).join(" "),
    class: s.name.includes("worn") ? "worn" : "new" }));
  const names = ["pinion", "gear"].map((gear) => {
    const own = points[answer.series.findIndex((s) => s.name.startsWith(gear))];
    const middle = own.reduce((sum, p) => sum + p[0], 0) / own.length;
    return svg("text", { x: middle, y: bottom - 0.05 }, gear);
  });
  const pitch = svg("line", { x1: left, x2: right, y1: 0, y2: 0, class: "pitch" });
  const drawing = svg("svg", { viewBox: `${left} ${top} ${right - left} ${bottom - top}`, class: "tooth", role: "img",
    "aria-label": `${answer.title}. ${answer.notes.join(". ")}` }, pitch, ...lines, ...names);
  return element("figure", { className: "panel", id: "flank" },
    element("figcaption", {}, element("h2", {}, answer.title), element("p", { className: "caption" }, answer.notes.map(sentence).join(" "))),
    element("p", { className: "legend" },
      element("span", { className: "item" }, element("span", { className: "swatch line new-flank" }), "new"),
      element("span", { className: "item" }, element("span", { className: "swatch line worn-flank" }),
        `worn, depth × ${answer.figures.exaggeration}`),
      element("span", { className: "item" }, element("span", { className: "swatch dashed" }), "pitch circle")),
    drawing);
}
