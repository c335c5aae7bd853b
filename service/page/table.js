// Tables: of named values, and of rows that become blocks on a narrow screen.

import { element } from "./dom.js";

// heads: column headings, those of numbers end with "#". rows: arrays of cells, or { cells, … } with attributes of the row.
// `named`: the first cell of each row is its heading. `drop`: columns without any value are left out.
// On a phone every row is a block in which each value follows its heading; nothing is cut off.
export function table(heads, rows, { caption = "", blocks = rows.length > 0 && heads.length > 4, drop = false, named = false } = {}) {
  const given = rows.map((row) => (Array.isArray(row) ? { cells: row } : row));
  const columns = heads.map((head, i) => ({ name: head.replace(/#$/, ""), kind: head.endsWith("#") ? "number" : "", i }))
    .filter(({ i }) => !drop || given.some(({ cells }) => !empty(cells[i])));
  const cell = (content, { name, kind, i }) => element(named && i === 0 ? "th" : "td", { scope: named && i === 0 ? "row" : null,
    className: `${kind} ${empty(content) ? "empty-cell" : ""}`.trim(), dataset: { head: named ? name.toLowerCase() : name } }, content);
  return element("div", { className: "scroll" }, element("table", { className: blocks ? "blocks" : "" },
    caption ? element("caption", { className: "visually-hidden" }, caption) : "",
    element("thead", {}, element("tr", {}, ...columns.map(({ name, kind }) => element("th", { scope: "col", className: kind }, name)))),
    element("tbody", {}, ...given.map(({ cells, ...attributes }) => element("tr", attributes, ...columns.map((c) => cell(cells[c.i], c)))))));
}

const empty = (cell) => cell === "" || cell === "–" || cell === null || cell === undefined;

// Named values: pairs of name and text or node.
export function facts(pairs) {
  return element("dl", { className: "facts" }, ...pairs.map(([name, value]) =>
    element("div", {}, element("dt", {}, name), element("dd", {}, value))));
}
