// All machines, the most severe first: state, what to do, data, depth, life, course, last seen.

import { newestOf } from "../api.js";
import { element, keepingFocus, svg } from "../dom.js";
import { KIND_WORDS, LEVELS, ago, dateTime, duration, fixed, instant, levelWord, number, range, sentence } from "../format.js";
import { dataBadge, levelBadge } from "../parts/health.js";
import { incoming } from "../parts/incoming.js";

const EVERY_MS = 3000; // how often the list is asked for; what has not changed is not sent again

const severity = (asset) => LEVELS.indexOf(asset.status?.level) + 1 || LEVELS.length + 1;

function inOrder(assets) {
  return [...assets].sort((a, b) => severity(a) - severity(b)
    || (b.alarms?.unacknowledged ?? 0) - (a.alarms?.unacknowledged ?? 0) || a.asset.localeCompare(b.asset));
}

// The course of one quantity as a small line.
export function sparkline(course) {
  const values = course?.values ?? [];
  if (values.length < 2) return "–";
  const [low, high] = [Math.min(...values), Math.max(...values)];
  const at = values.map((v, i) => `${(2 + 96 * i / (values.length - 1)).toFixed(1)},${(22 - 20 * (v - low) / (high - low || 1)).toFixed(1)}`);
  const last = at.at(-1).split(",");
  return element("span", {}, svg("svg", { class: "sparkline", viewBox: "0 0 100 24", role: "img",
    "aria-label": `${course.quantity}: from ${number(values[0])} to ${number(values.at(-1))} ${course.unit}` },
  svg("polyline", { points: at.join(" ") }), svg("circle", { cx: last[0], cy: last[1], r: 2.2 })), small(course.quantity));
}

const small = (text) => element("small", {}, text);

function depthCell({ depth_um: depth, limit_um: limit, preliminary }) {
  if (!depth) return "–";
  const value = Number.isFinite(depth.median) ? `${fixed(depth.median)} µm` : `at least ${fixed(depth.p05)} µm`;
  return element("span", {}, value, limit && Number.isFinite(depth.median) ? ` (${number(100 * depth.median / limit, 2)} % of limit)` : "",
    Number.isFinite(depth.p95) ? small(`5–95 %: ${range(depth)} µm`) : "", preliminary ? small("preliminary") : "");
}

function lifeCell({ life_hours: hours, preliminary }) {
  if (!hours) return "–";
  const known = Number.isFinite(hours.median);
  return element("span", {}, hours.median === 0 ? "limit reached" : known ? duration(hours.median) : `at least ${duration(hours.p05)}`,
    known && hours.p95 > 0 ? small(`5–95 %: ${duration(hours.p05)} – ${duration(hours.p95)}`) : "",
    preliminary ? small("preliminary") : "");
}

function seenCell(asset) {
  const seen = instant(asset.last_seen) ?? instant(asset.last_window);
  return element("time", { title: dateTime(seen), dateTime: Number.isFinite(seen) ? new Date(seen).toISOString() : "" },
    ago(seen) || dateTime(seen));
}

function stateCell(asset) {
  const { status, alarms, question } = asset;
  const open = alarms?.unacknowledged
    ? element("a", { className: "badge bad", href: `#/asset/${encodeURIComponent(asset.asset)}/alarms`, dataset: { key: `alarms ${asset.asset}` } },
      `${alarms.unacknowledged} alarm${alarms.unacknowledged === 1 ? "" : "s"} not acknowledged`) : "";
  return element("div", { className: "state" }, levelBadge(status?.level), open,
    status?.action ? element("strong", { className: "action" }, status.action) : "",
    element("span", { className: "reason" }, status?.reasons?.length ? sentence(status.reasons[0]) : ""),
    asset.retired ? element("span", { className: "badge" }, "retired") : "",
    question ? element("span", { className: "badge warn" }, "a question is open") : "");
}

function row(asset) {
  const cells = [
    ["machine", element("a", { href: `#/asset/${encodeURIComponent(asset.asset)}`, dataset: { key: `asset ${asset.asset}` } }, asset.asset)],
    ["state", stateCell(asset)], ["data", dataBadge(asset) || "–"], ["wear depth", depthCell(asset)], ["remaining life", lifeCell(asset)],
    ["course", sparkline(asset.sparkline)], ["last seen", seenCell(asset)], ["answers from", asset.windows === 0 ? "–" : KIND_WORDS[asset.kind] ?? "–"],
  ];
  return element("tr", { className: `row-${asset.status?.level}`, dataset: { asset: asset.asset } },
    ...cells.map(([head, content], i) => element(i ? "td" : "th", { ...(i ? {} : { scope: "row" }),
      className: content === "–" ? "empty-cell" : "", dataset: { head } }, content)));
}

const HEADS = ["Machine", "State and what to do", "Data", "Wear depth", "Remaining life", "Course", "Last seen", "Answers from"];

function counts(assets) {
  const parts = LEVELS.map((level) => [level, assets.filter((a) => a.status?.level === level).length]).filter(([, n]) => n);
  const open = assets.reduce((n, a) => n + (a.alarms?.active ?? 0), 0);
  const alarms = element("a", { href: "#/alarms", dataset: { key: "all-alarms" } }, `Alarms: ${open} active`);
  return element("p", { className: "counts", role: "status" }, alarms, " · ", ...parts.flatMap(([level, n], i) => [i ? ", " : "",
    element("span", { className: `count-${level}` }, `${n} ${levelWord(level).toLowerCase()}`)]));
}

function empty() {
  return element("section", { className: "panel empty" },
    element("h2", {}, "No machine has sent data yet"),
    element("p", {}, "The service is running and waits for the first measurement. To begin, in a terminal on this computer:"),
    element("ul", {},
      element("li", {}, "replay the bundled recording: ", element("code", {}, "gear-twin replay recordings/short-campaign.mcap --connect ENDPOINT"),
        " (the service prints its endpoint when it starts);"),
      element("li", {}, "or import your own measurement: ", element("code", {}, "gear-twin import mapping.toml --source today.csv --out today.mcap"),
        ", then replay it;"),
      element("li", {}, "or publish live frames under the keys of the interface (", element("a", { href: "/docs" }, "REST and streams"), ").")));
}

// The machines that the search and the choice of state let through.
function chosen(assets, { text, level, retired }) {
  const words = text.toLowerCase().split(/\s+/).filter(Boolean);
  return assets.filter((a) => (retired || !a.retired) && (!level || (level === "attention" ? severity(a) <= 3 : a.status?.level === level))
    && words.every((w) => JSON.stringify([a.asset, a.status, a.rig, KIND_WORDS[a.kind]]).toLowerCase().includes(w)));
}

function filters(filter, draw) {
  const search = element("input", { type: "search", placeholder: "Search name, reason, kind", "aria-label": "Search machines",
    value: filter.text, oninput: (e) => { filter.text = e.target.value; draw(); } });
  const level = element("select", { "aria-label": "Which states", onchange: (e) => { filter.level = e.target.value; draw(); } },
    new Option("all states", ""), new Option("needs attention", "attention"), ...LEVELS.map((l) => new Option(levelWord(l).toLowerCase(), l)));
  const retired = element("label", {}, element("input", { type: "checkbox", onchange: (e) => { filter.retired = e.target.checked; draw(); } }),
    " retired machines too");
  return element("form", { className: "filters", role: "search", onsubmit: (e) => e.preventDefault() }, search, level, retired);
}

export async function show(root, { signal, get, connected }) {
  const newest = newestOf(() => get("/v1/assets", { signal }));
  let assets = await newest();
  connected(true);
  const filter = { text: "", level: "", retired: false };
  const summary = element("div");
  const body = element("tbody");
  const none = element("p", { className: "none", hidden: true }, "No machine matches.");
  const list = element("section", { className: "panel fleet" }, element("table", { className: "blocks" },
    element("caption", { className: "visually-hidden" }, "Machines, the most severe first"),
    element("thead", {}, element("tr", {}, ...HEADS.map((h) => element("th", { scope: "col" }, h)))), body), none);
  const tools = filters(filter, () => draw());
  const start = empty();
  const waiting = incoming({ get, signal, changed: () => renewed() });
  root.append(start, summary, waiting.root, tools, list);
  let drawn = "";

  function draw() {
    const shown = inOrder(chosen(assets, filter));
    const now = JSON.stringify([shown, Math.floor(Date.now() / 30_000)]); // "last seen" grows by itself
    start.hidden = assets.length > 0 || !waiting.root.hidden;
    tools.hidden = list.hidden = assets.length === 0;
    tools.querySelector("label").hidden = !assets.some((a) => a.retired);
    if (now === drawn) return;
    drawn = now;
    keepingFocus(() => {
      summary.replaceChildren(...(assets.length ? [counts(assets.filter((a) => !a.retired))] : []));
      body.replaceChildren(...shown.map(row));
      none.hidden = shown.length > 0;
    });
    root.dataset.assets = String(shown.length);
  }

  async function renewed() {
    const [found] = await Promise.all([newest(), waiting.refresh()]);
    assets = found ?? assets;
    connected(true);
    draw();
  }

  await waiting.refresh();
  draw();
  const timer = setInterval(async () => {
    if (document.hidden) return;
    try {
      await renewed();
    } catch (error) {
      if (error.name !== "AbortError") connected(false, error.message);
    }
  }, EVERY_MS);
  signal.addEventListener("abort", () => clearInterval(timer));
}
