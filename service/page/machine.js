// One asset as this page knows it: loaded once, then only what an event says has changed.

import { get, parsed, pathOf } from "./api.js";

const SETTLE_MS = 200; // events come in bursts; one request answers all of a burst
const POINTS = 600; // of the history that is drawn, at the start
const WINDOWS = 100; // latest window records that are kept
const RETRY_MS = 3000;
const KINDS = ["window", "update", "effect", "rul", "data_fault", "status", "alarm", "change", "inspection", "question"];

// Sends "change" after new data (detail: the kinds of event that brought it), "link" with true or false, and "renamed"
// (detail: the name) once the machine has another name, under which all else is asked for.
export class Machine extends EventTarget {
  constructor(name) {
    super();
    this.name = name;
    this.base = pathOf(name);
    this.state = null;
    this.trend = [];
    this.windows = [];
    this.rig = null;
    this.inspections = [];
    this.seen = new Set();
    this.timer = null;
    this.busy = false;
    this.leaving = false; // while it is given another name: nothing is asked for under the present one
  }

  async load(signal) {
    const [state, trend, rig, inspections] = await Promise.all([
      get(this.base, { signal }), get(`${this.base}/trend?resolution=${POINTS}`, { signal }),
      get(`${this.base}/rig`, { signal }), get(`${this.base}/inspections`, { signal }),
    ]);
    Object.assign(this, { state, trend, rig, inspections, windows: state.windows });
  }

  // The depth at the end of life [µm], or null.
  get limit() {
    if (Number.isFinite(this.state?.rul?.max_depth_um)) return this.state.rul.max_depth_um;
    return Number.isFinite(this.rig?.end_of_life?.max_depth) ? this.rig.end_of_life.max_depth * 1e6 : null;
  }

  // Follows the events until the signal ends it; a hidden page holds no connection.
  follow(signal) {
    const start = () => {
      if (signal.aborted || document.hidden || this.source || this.leaving) return;
      this.source = new EventSource(`${this.base}/events`);
      this.source.onopen = () => this.linked(true);
      this.source.onerror = () => {
        this.linked(false);
        if (this.source?.readyState === EventSource.CLOSED) {
          stop();
          this.soon("window"); // where it has been given another name meanwhile, the answer says so
          setTimeout(start, RETRY_MS);
        }
      };
      for (const kind of KINDS) {
        this.source.addEventListener(kind, (event) => this.happened(kind, parsed(event.data)));
      }
    };
    const stop = () => {
      this.source?.close();
      this.source = null;
    };
    const turned = () => {
      if (document.hidden) stop();
      else start();
    };
    document.addEventListener("visibilitychange", turned, { signal });
    signal.addEventListener("abort", () => {
      stop();
      clearTimeout(this.timer);
    });
    start();
  }

  linked(live) {
    // what happened between loading and the connection, or while there was none, is fetched once
    if (live) this.soon("window");
    this.dispatchEvent(new CustomEvent("link", { detail: live }));
  }

  renamed(name) {
    this.leaving = true;
    this.dispatchEvent(new CustomEvent("renamed", { detail: name }));
  }

  happened(kind, data) {
    if (kind === "change" && data?.effect?.was === this.name) {
      this.renamed(data.effect.asset);
      return;
    }
    if (kind === "window" && Number.isFinite(data?.index)) {
      this.windows = [...this.windows.filter((w) => w.index !== data.index), data].slice(-WINDOWS);
    }
    this.soon(kind);
  }

  // Asks for what changed, once the burst of events is over.
  soon(kind) {
    if (this.leaving) return;
    this.seen.add(kind);
    if (this.timer === null) this.timer = setTimeout(() => this.refresh(), SETTLE_MS);
  }

  async refresh() {
    this.timer = null;
    if (this.leaving) return;
    if (this.busy) {
      this.soon("window");
      return;
    }
    this.busy = true;
    const kinds = this.seen;
    this.seen = new Set();
    try {
      await this.fetchChanged(kinds);
      this.dispatchEvent(new CustomEvent("change", { detail: kinds }));
    } catch (error) {
      if (error.name === "AbortError" || this.leaving) return;
      if (error.body?.renamed) {
        this.renamed(error.body.renamed);
        return;
      }
      console.warn(error.message);
      this.linked(false);
    } finally {
      this.busy = false;
    }
  }

  async fetchChanged(kinds) {
    const last = this.trend.at(-1)?.index ?? -1;
    const other = kinds.has("change") || kinds.has("question");
    const [state, newer, inspections, rig] = await Promise.all([
      get(`${this.base}?windows=0`),
      get(other ? `${this.base}/trend?resolution=${POINTS}` : `${this.base}/trend?after=${last}&resolution=${POINTS}`),
      kinds.has("inspection") || other ? get(`${this.base}/inspections`) : this.inspections,
      other || !this.rig?.gears ? get(`${this.base}/rig`) : this.rig,
    ]);
    const total = state.windows_total;
    const missed = total > 0 && (this.windows.length < Math.min(total, WINDOWS) || other);
    this.windows = missed ? (await get(this.base)).windows : this.windows;
    this.trend = other ? newer : thinned([...this.trend, ...newer]);
    Object.assign(this, { state: { ...state, windows: this.windows }, inspections, rig });
  }
}

// Half of the points once there are twice as many as are wanted: of each four those with the lowest and the highest
// level, so that no peak is left out, and the newest.
export function thinned(points, most = POINTS) {
  if (points.length < 2 * most) return points;
  const out = [];
  for (let at = 0; at < points.length; at += 4) {
    const part = points.slice(at, at + 4);
    const [low, high] = [Infinity, -Infinity].map((none) => (p) => p.rms_measured ?? none);
    const lowest = part.reduce((best, p) => (low(p) < low(best) ? p : best));
    const highest = part.reduce((best, p) => (high(p) > high(best) ? p : best));
    out.push(...part.filter((p, i) => p === lowest || p === highest || (lowest === highest && i === part.length - 1)));
  }
  if (out.at(-1) !== points.at(-1)) out.push(points.at(-1));
  return out;
}
