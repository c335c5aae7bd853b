// Tables: of named values, and of rows that become blocks on a narrow screen.

import { element } from "./dom.js";

// heads: column headings, those of numbers end with "#". rows: arrays of cells, or { className, cells }.
// `drop`: columns without any value are left out. On a phone every row is a block in which each value follows its heading; nothing is cut off.
export function table(heads, rows, { caption = "", blocks = rows.length > 0 && heads.length > 4, drop = false } = {}) {
  if (drop) {
    const kept = heads.map((_, i) => rows.some((row) => !empty((row.cells ?? row)[i])));
    const of = (list) => list.filter((_, i) => kept[i]);
    return table(of(heads), rows.map((row) => (row.cells ? { ...row, cells: of(row.cells) } : of(row))), { caption, blocks });
  }
  const numeric = heads.map((h) => h.endsWith("#"));
  const names = heads.map((h) => h.replace(/#$/, ""));
  const head = element("thead", {}, element("tr", {}, ...names.map((name, i) =>
    element("th", { scope: "col", className: numeric[i] ? "number" : "" }, name))));
  const body = element("tbody", {}, ...rows.map((row) => {
    const { className = "", cells = row } = row;
    return element("tr", { className }, ...cells.map((cell, i) =>
      element("td", { className: [numeric[i] ? "number" : "", empty(cell) ? "empty-cell" : ""].join(" ").trim(),
        dataset: { head: names[i] } }, cell)));
  }));
  const made = element("table", { className: blocks ? "blocks" : "" }, ...(caption ? [element("caption", {}, caption)] : []),
    head, body);
  return element("div", { className: "scroll" }, made);
}

const empty = (cell) => cell === "" || cell === "–" || cell === null || cell === undefined;

// Named values: pairs of name and text or node.
export function facts(pairs) {
  return element("dl", { className: "facts" }, ...pairs.map(([name, value]) =>
    element("div", {}, element("dt", {}, name), element("dd", {}, value))));
}
