// One asset at a time: fetched whole, then again whenever an event says that something changed.

import { drawDepth, drawProfile, drawRms, drawRul, redraw } from "./charts.js";
import { drawCards, drawTables, noteMissing, showDecision } from "./panels.js";

const KINDS = ["window", "update", "effect", "rul", "data_fault"];
const SETTLE_MS = 200; // events come in bursts; one fetch answers all of a burst
const ASSETS_MS = 4000;
const POINTS = 600; // of a history that is drawn, at most

const chosen = document.getElementById("asset");
let source = null;
let pending = null;
let busy = false;
let again = false;

const get = async (path) => {
  const answer = await fetch(path, { headers: { Accept: "application/json" } });
  if (!answer.ok) throw new Error(`${path}: ${answer.status}`);
  return answer.json();
};

function link(live) {
  const shown = document.getElementById("link");
  shown.textContent = live ? "live" : "no connection";
  shown.classList.toggle("live", live);
}

const LOOK = { normal: "ok", watch: "degraded", alarm: "lost", end_of_life: "lost" };

// What a person should know first: the state of the machine, with its reasons.
function showStatus({ level, reasons }) {
  const badge = document.getElementById("status");
  badge.textContent = level.replaceAll("_", " ");
  badge.className = `badge ${LOOK[level] ?? ""}`;
  document.getElementById("reason").textContent = reasons.join(" ");
}

async function refresh() {
  if (busy) {
    again = true;
    return;
  }
  busy = true;
  const asset = chosen.value;
  const base = `/v1/assets/${encodeURIComponent(asset)}`;
  try {
    const [state, windows, trend, quality, inspections, rig] = await Promise.all([
      get(base), get(`${base}/windows?resolution=${POINTS}`), get(`${base}/trend?resolution=${POINTS}`),
      get(`${base}/quality`), get(`${base}/inspections`), get(`${base}/rig`),
    ]);
    if (asset === chosen.value) {
      const limit = rig.end_of_life?.max_depth ? rig.end_of_life.max_depth * 1e6 : null;
      showStatus(state.status);
      noteMissing(state);
      drawCards(state);
      drawRms({ ...state, windows });
      drawDepth({ ...state, windows }, trend, inspections, limit);
      drawProfile(state);
      drawRul(state, trend);
      drawTables(state, quality, inspections, decide);
      document.body.dataset.shown = asset;
      document.body.dataset.windows = String(state.windows_total);
    }
  } catch (error) {
    console.warn(error);
    link(false);
  } finally {
    busy = false;
    if (again) {
      again = false;
      soon();
    }
  }
}

// An engineer's decision on an effect; what it changes comes back as an event.
let deciding = false;

async function decide(name, verb) {
  const asset = chosen.value;
  const what = `${verb} ${name.replaceAll("_", " ")} of ${asset}`;
  if (deciding || (verb === "reject" && !confirm(`${what}? The whole history is then re-evaluated without it.`))) return;
  deciding = true;
  showDecision(`${what}: in progress …`, true);
  try {
    const answer = await fetch(`/v1/assets/${encodeURIComponent(asset)}/effects/${encodeURIComponent(name)}`, {
      method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify({ decision: verb }),
    });
    const said = await answer.json();
    const done = answer.status === 202 ? "queued; applied after the current window" : "done";
    showDecision(`${what}: ${answer.ok ? done : said.detail ?? `status ${answer.status}`}`, false);
  } catch (error) {
    console.warn(error);
    showDecision(`${what}: the service does not answer`, false);
  } finally {
    deciding = false;
    soon();
  }
}

function soon() {
  if (pending === null) pending = setTimeout(() => { pending = null; refresh(); }, SETTLE_MS);
}

function follow(asset) {
  source?.close();
  source = new EventSource(`/v1/assets/${encodeURIComponent(asset)}/events`);
  source.onopen = () => { link(true); soon(); };
  source.onerror = () => link(false);
  for (const kind of KINDS) source.addEventListener(kind, soon);
  refresh();
}

async function listAssets() {
  let assets = [];
  try {
    assets = await get("/v1/assets");
  } catch (error) {
    console.warn(error);
    link(false);
    return;
  }
  const names = assets.map((a) => a.asset);
  document.getElementById("empty").hidden = names.length > 0;
  document.getElementById("content").hidden = names.length === 0;
  if (!names.length) {
    showStatus({ level: "waiting for data", reasons: [] });
    return;
  }
  const had = [...chosen.options].map((o) => o.value);
  if (names.join() !== had.join()) {
    const before = chosen.value || decodeURIComponent(location.hash.slice(1));
    chosen.replaceChildren(...names.map((name) => new Option(name, name)));
    chosen.value = names.includes(before) ? before : names[0];
    if (chosen.value !== document.body.dataset.shown) follow(chosen.value);
  }
  if (source?.readyState === EventSource.CLOSED) follow(chosen.value);
}

// The address names the asset, so that Back, bookmarks and pasted links lead to it.
function fromAddress() {
  const name = decodeURIComponent(location.hash.slice(1));
  if (name && name !== chosen.value && [...chosen.options].some((o) => o.value === name)) {
    chosen.value = name;
    follow(name);
  }
}

chosen.addEventListener("change", () => {
  location.hash = encodeURIComponent(chosen.value);
  follow(chosen.value);
});
addEventListener("hashchange", fromAddress);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
await listAssets();
setInterval(listAssets, ASSETS_MS);
