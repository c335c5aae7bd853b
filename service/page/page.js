// One asset at a time: fetched whole, then again whenever an event says that something changed.

import { drawDepth, drawProfile, drawRms, drawRul, redraw } from "./charts.js";
import { drawCards, drawTables, tellDecision } from "./panels.js";

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
  shown.textContent = live ? "live" : "offline";
  shown.classList.toggle("live", live);
}

function showStatus(summary) {
  const badge = document.getElementById("status");
  badge.textContent = summary.status;
  badge.className = `badge ${summary.status}`;
  document.getElementById("reason").textContent = summary.reason;
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
    const [state, windows, trend, quality, inspections, rig, assets] = await Promise.all([
      get(base), get(`${base}/windows?resolution=${POINTS}`), get(`${base}/trend?resolution=${POINTS}`),
      get(`${base}/quality`), get(`${base}/inspections`), get(`${base}/rig`), get("/v1/assets"),
    ]);
    if (asset === chosen.value) {
      const limit = rig.end_of_life?.max_depth ? rig.end_of_life.max_depth * 1e6 : null;
      showStatus(assets.find((a) => a.asset === asset));
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
  if (deciding || (verb === "reject" && !confirm(`${what}? The history is run again without it.`))) return;
  deciding = true;
  tellDecision(`${what}: being carried out …`, true);
  try {
    const answer = await fetch(`/v1/assets/${encodeURIComponent(asset)}/effects/${encodeURIComponent(name)}`, {
      method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify({ decision: verb }),
    });
    const said = await answer.json();
    const done = answer.status === 202 ? "queued; applied after the current window" : "done";
    tellDecision(`${what}: ${answer.ok ? done : said.detail ?? `status ${answer.status}`}`, false);
  } catch (error) {
    console.warn(error);
    tellDecision(`${what}: the service does not answer`, false);
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
    showStatus({ status: "waiting", reason: "" });
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

chosen.addEventListener("change", () => {
  location.hash = encodeURIComponent(chosen.value);
  follow(chosen.value);
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
await listAssets();
setInterval(listAssets, ASSETS_MS);
