// All machines, the most severe first, by pages: state, what to do, data, depth, life, course, last seen.

import { addressOf, getPage, newestOf, unlessLeft } from "../api.js";
import { choice, element, keepingFocus, panel, repeat, svg } from "../dom.js";
import { KIND_WORDS, LEVELS, duration, fixed, instant, levelWord, number, range, sentence } from "../format.js";
import { dataBadge, levelBadge, since } from "../parts/health.js";
import { incoming } from "../parts/incoming.js";
import { table } from "../table.js";

const EVERY_MS = 3000; // how often the list is asked for; what has not changed is not sent again
const TYPING_MS = 200; // pause after which what was typed is searched for
const PAGE = 50; // machines of one page
const ATTENTION = LEVELS.slice(0, 3);

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

function lifeCell({ life_hours: hours, life_of_wear_alone: alone, preliminary }) {
  if (!hours) return "–";
  const known = Number.isFinite(hours.median);
  return element("span", {}, hours.median === 0 ? "limit reached" : known ? duration(hours.median) : `at least ${duration(hours.p05)}`,
    known && hours.p95 > 0 ? small(`5–95 %: ${duration(hours.p05)} – ${duration(hours.p95)}`) : "",
    alone && hours.median !== 0 ? element("span", { className: "badge bad" }, "of wear alone") : "", preliminary ? small("preliminary") : "");
}

function stateCell(asset) {
  const { status, alarms, question } = asset;
  const open = alarms?.unacknowledged
    ? element("a", { className: "badge bad", href: addressOf(asset.asset, "alarms"), dataset: { key: `alarms ${asset.asset}` } },
      `${alarms.unacknowledged} alarm${alarms.unacknowledged === 1 ? "" : "s"} not acknowledged`) : "";
  return element("div", { className: "state" }, levelBadge(status?.level), open,
    status?.action ? element("strong", { className: "action" }, status.action) : "",
    element("span", { className: "reason" }, status?.summary || status?.reasons?.length ? sentence(status.summary || status.reasons[0]) : ""),
    asset.retired ? element("span", { className: "badge" }, "retired") : "",
    question ? element("span", { className: "badge warn" }, "a question is open") : "");
}

const HEADS = ["Machine", "State and what to do", "Data", "Wear depth", "Remaining life", "Course", "Last seen", "Answers from"];

const row = (asset) => ({ className: `row-${asset.status?.level}`, dataset: { asset: asset.asset }, cells: [
  element("a", { href: addressOf(asset.asset), dataset: { key: `asset ${asset.asset}` } }, asset.asset),
  stateCell(asset), dataBadge(asset) || "–", depthCell(asset), lifeCell(asset), sparkline(asset.sparkline),
  since(instant(asset.last_seen) ?? instant(asset.last_window)), asset.windows === 0 ? "–" : KIND_WORDS[asset.kind] ?? "–",
] });

function counts(areas) {
  const parts = LEVELS.map((level) => [level, areas.reduce((n, a) => n + (a.levels[level] ?? 0), 0)]).filter(([, n]) => n);
  const open = areas.reduce((n, a) => n + a.alarms, 0);
  const alarms = element("a", { href: "#/alarms", dataset: { key: "all-alarms" } }, `Alarms: ${open} active`);
  return element("p", { className: "counts", role: "status" }, alarms, " · ", ...levelCounts(parts));
}

const levelCounts = (parts) => parts.flatMap(([level, n], i) => [i ? ", " : "",
  element("span", { className: `count-${level}` }, `${n} ${levelWord(level).toLowerCase()}`)]);

// The parts of the plant; pressing one narrows the list to it, pressing it again shows all.
function areaList(areas, filter, choose) {
  return areas.map(({ area, assets, levels }) => {
    const bad = ATTENTION.filter((level) => levels[level]).map((level) => [level, levels[level]]);
    return element("li", {}, element("button", { type: "button", className: "area", "aria-pressed": String(filter.area === area),
      dataset: { key: `area ${area}` }, onclick: () => choose(filter.area === area ? null : area) },
    element("span", { className: "area-name" }, area || "no area"), " ", small(`${assets}`),
    ...(bad.length ? [element("span", { className: "area-levels" }, ...levelCounts(bad))] : [])));
  });
}

function empty() {
  return panel({ title: "No machine has sent data yet", kind: "empty" },
    element("p", {}, "The service is running and waits for the first measurement. To begin, in a terminal on this computer:"),
    element("ul", {},
      element("li", {}, "replay the bundled recording: ", element("code", {}, "gear-twin replay recordings/short-campaign.mcap --connect ENDPOINT"),
        " (the service prints its endpoint when it starts);"),
      element("li", {}, "or import your own measurement: ", element("code", {}, "gear-twin import mapping.toml --source today.csv --out today.mcap"),
        ", then replay it;"),
      element("li", {}, "or publish live frames under the keys of the interface (", element("a", { href: "docs" }, "REST and streams"), ").")));
}

// The address of the first page of what is chosen.
function firstPage({ text, level, area, retired }) {
  const given = new URLSearchParams({ limit: PAGE });
  if (text.trim()) given.set("search", text.trim().slice(0, 200));
  if (area !== null) given.set("area", area);
  for (const one of level === "attention" ? ATTENTION : [level].filter(Boolean)) given.append("level", one);
  if (!retired) given.set("retired", "false");
  return `v1/assets?${given}`;
}

function filters(filter, chosen) {
  let typing = 0;
  const search = element("input", { type: "search", placeholder: "Search name, reason, kind", "aria-label": "Search machines",
    value: filter.text, oninput: (e) => { filter.text = e.target.value; clearTimeout(typing); typing = setTimeout(chosen, TYPING_MS); } });
  const level = element("select", { "aria-label": "Which states", onchange: (e) => { filter.level = e.target.value; chosen(); } },
    new Option("all states", ""), new Option("needs attention", "attention"), ...LEVELS.map((l) => new Option(levelWord(l).toLowerCase(), l)));
  const retired = choice("retired machines too", false, (checked) => { filter.retired = checked; chosen(); });
  return element("form", { className: "filters", role: "search", onsubmit: (e) => e.preventDefault() }, search, level, retired);
}

export async function show(root, { signal, get, connected }) {
  const filter = { text: "", level: "", area: null, retired: false };
  let pages = [firstPage(filter)]; // the addresses of the pages up to the one that is shown
  const newest = newestOf(async () => {
    const at = pages.at(-1);
    const [page, areas] = await Promise.all([getPage(at, { signal }), get("v1/areas", { signal })]);
    return { at, page, areas };
  });
  let found = await newest();
  connected(true);
  const summary = element("div");
  const none = element("p", { className: "none", hidden: true }, "No machine matches.");
  const list = element("section", { className: "panel fleet" });
  const turn = (text, move) => element("button", { type: "button", onclick: async () => {
    move();
    [back.disabled, on.disabled] = [true, true];
    await asked();
    scrollTo(0, 0);
  } }, text);
  const back = turn("Previous machines", () => { pages.pop(); });
  const on = turn("Next machines", () => { pages.push(found.page.next); });
  const where = element("span", { role: "status" });
  const pager = element("nav", { className: "pager", "aria-label": "Pages of machines" }, back, where, on);
  const groups = element("ul", { className: "areas", "aria-label": "Parts of the plant" });
  const chosen = () => { pages = [firstPage(filter)]; return asked(); };
  const tools = filters(filter, chosen);
  const start = empty();
  const waiting = incoming({ get, signal, changed: () => renewed() });
  root.append(start, summary, waiting.root, tools, groups, list, pager);
  let drawn = "";

  function draw() {
    const { page, areas } = found;
    const shown = page.list;
    const any = areas.some((a) => a.assets + a.retired > 0);
    start.hidden = any || !waiting.root.hidden;
    tools.hidden = list.hidden = !any;
    groups.hidden = areas.length < 2;
    tools.querySelector("label").hidden = !areas.some((a) => a.retired);
    pager.hidden = pages.length === 1 && page.next === null;
    [back.disabled, on.disabled] = [pages.length === 1, page.next === null];
    const now = JSON.stringify([shown, areas, filter.area, pages.length, page.next, Math.floor(Date.now() / 30_000)]); // "last seen" grows by itself
    if (now === drawn) return;
    drawn = now;
    keepingFocus(() => {
      summary.replaceChildren(...(any ? [counts(areas.filter((a) => filter.area === null || a.area === filter.area))] : []));
      groups.replaceChildren(...areaList(areas, filter, (area) => { filter.area = area; chosen(); }));
      list.replaceChildren(table(HEADS, shown.map(row), { caption: "Machines, the most severe first", named: true, blocks: true }), none);
      none.hidden = shown.length > 0;
      const first = PAGE * (pages.length - 1) + 1;
      where.textContent = shown.length ? `machines ${first} to ${first + shown.length - 1}` : "no more machines";
    });
    root.dataset.assets = String(shown.length);
  }

  async function renewed() {
    const [answer] = await Promise.all([newest(), waiting.refresh()]);
    if (answer?.at === pages.at(-1)) found = answer;
    connected(true);
    draw();
  }

  // What somebody has just asked for.
  const asked = () => renewed().catch(unlessLeft((reason) => connected(false, reason)));

  await waiting.refresh();
  draw();
  repeat(asked, EVERY_MS, signal);
}
