// The shell: addresses of the page, its header, the tabs of a machine, and what is shown where something fails.
//
//   #/                    all machines
//   #/alarms              alarms of all machines
//   #/asset/NAME          one machine, its overview
//   #/asset/NAME/VIEW     one of its other views

import { Problem, addressOf, get } from "./api.js";
import { element, panel, repeat } from "./dom.js";
import { levelWord } from "./format.js";
import { Machine } from "./machine.js";
import { seen } from "./parts/health.js";
import { showSession, signInForm } from "./session.js";
import { VIEWS } from "./views.js";

const main = document.getElementById("main");
const trail = document.getElementById("trail");
const link = document.getElementById("link");
const session = document.getElementById("session");
const AXIS = "gear-twin axis"; // key of the browser's store
const SEEN_MS = 15_000; // how often it is asked when a machine was last seen

let leaving = new AbortController(); // of the view that is shown
let machine = null; // of the asset that is shown
let leavingMachine = new AbortController();
let shownAt = null;

function routeOf(hash) {
  const parts = hash.replace(/^#\/?/, "").split("/").map(decode);
  if (parts[0] === "asset" && parts[1]) return { asset: parts[1], view: parts[2] ?? "" };
  if (parts[0] === "alarms" && parts.length === 1 && hash.startsWith("#/")) return { asset: null, view: "alarms" };
  if (parts[0] === "" && parts.length === 1) return { asset: null, view: "" };
  return { asset: null, view: "", wrong: hash };
}

function decode(text) {
  try {
    return decodeURIComponent(text);
  } catch {
    return text;
  }
}

// -- connection -----------------------------------------------------------------------------------------

export function connected(live, what = "") {
  link.dataset.state = live ? "live" : "lost";
  link.textContent = live ? "connected" : "connection lost, trying again";
  link.title = what;
}

// -- header ---------------------------------------------------------------------------------------------

function showTrail(route) {
  const current = (text) => element("span", { "aria-current": "page" }, text);
  const fleet = route.asset === null && route.view === "";
  const all = fleet ? current("All machines") : element("a", { href: "#/" }, "All machines");
  const here = route.asset ?? (fleet ? null : "Alarms");
  trail.replaceChildren(all, ...(here === null ? []
    : [element("span", { className: "separator", "aria-hidden": "true" }, "›"), current(here)]));
}

function tabs(route, state) {
  const known = VIEWS.filter((view) => !view.shown || view.shown(state) || view.path === route.view);
  const list = element("nav", { className: "tabs", "aria-label": `Views of ${route.asset}` }, ...known.map((view) =>
    element("a", { href: addressOf(route.asset, view.path), "aria-current": view.path === route.view ? "page" : null,
      dataset: { key: `tab-${view.path}` } }, view.title)));
  // arrow keys go along the tabs; Tab leaves them
  list.addEventListener("keydown", (event) => {
    const links = [...list.querySelectorAll("a")];
    const at = links.indexOf(document.activeElement);
    const to = { ArrowRight: at + 1, ArrowLeft: at - 1, Home: 0, End: links.length - 1 }[event.key];
    if (at < 0 || to === undefined) return;
    event.preventDefault();
    links[(to + links.length) % links.length].focus();
  });
  return list;
}

// -- views ----------------------------------------------------------------------------------------------

function problem(error, retry) {
  const known = error.body?.known;
  return panel({ title: error.status === 404 ? "This machine is not known" : "This view could not be loaded", kind: "problem", role: "alert" },
    element("p", {}, error.message),
    ...(Array.isArray(known) ? [element("p", {}, ...known.flatMap((name, i) => [i ? ", " : "Known machines: ",
      element("a", { href: addressOf(name) }, name)]))] : []),
    element("p", {}, element("button", { type: "button", onclick: retry }, "Try again"), " ",
      element("a", { href: "#/" }, "All machines")));
}

async function machineOf(name) {
  if (machine?.name === name) return machine;
  leavingMachine.abort();
  leavingMachine = new AbortController();
  machine = null;
  const opened = new Machine(name);
  await opened.load(leavingMachine.signal);
  const { signal } = leavingMachine;
  opened.addEventListener("link", (event) => connected(event.detail));
  opened.addEventListener("renamed", (event) => goOn(event.detail), { signal });
  opened.follow(leavingMachine.signal);
  machine = opened;
  return opened;
}

// To the same view of a machine under its present name.
function goOn(name) {
  location.replace(addressOf(name, routeOf(location.hash).view));
}

function contextOf(root, signal) {
  const context = {
    machine, signal,
    handlers: [],
    onChange(handler) {
      context.handlers.push(handler);
    },
    get axis() {
      const kept = localStorage.getItem(AXIS);
      return kept === "time" || kept === "revolutions" ? kept : counted(machine.trend) ? "revolutions" : "time";
    },
    setAxis(axis) {
      localStorage.setItem(AXIS, axis);
      root.dispatchEvent(new CustomEvent("axis"));
    },
  };
  return context;
}

// Whether the trend has revolutions that only rise: a counter that begins again makes a poor axis.
function counted(trend) {
  const known = trend.map((p) => p.revolutions).filter(Number.isFinite);
  return known.length > 0 && known.every((n, i) => i === 0 || n >= known[i - 1]);
}

async function showMachine(route, signal) {
  const opened = await machineOf(route.asset);
  if (signal.aborted) return;
  connected(true);
  const view = VIEWS.find((one) => one.path === route.view);
  if (!view) throw new Problem(404, `There is no view ${route.view} of a machine; there are ${
    VIEWS.map((v) => v.title).join(", ")}.`);
  const code = await view.load();
  if (signal.aborted) return;
  const root = element("div", { className: "view" });
  const navigation = tabs(route, opened.state);
  const last = element("div", {}, seen(opened.state));
  main.replaceChildren(element("h1", { className: "visually-hidden", tabIndex: -1 }, `${route.asset}: ${view.title}`), navigation, last, root);
  const context = contextOf(root, signal);
  const mark = () => {
    document.title = `${levelWord(opened.state.status?.level)}: ${route.asset} – gear-twin`;
    main.dataset.windows = String(opened.state.windows_total);
    last.replaceChildren(seen(opened.state));
  };
  repeat(() => opened.soon("seen"), SEEN_MS, signal); // frames that end no window are no event
  const shown = code.show(root, context);
  const changed = async (event) => {
    await shown;
    for (const handler of context.handlers) await handler(event.detail);
    if (!signal.aborted) mark();
  };
  const failed = (error) => signal.aborted || error.name === "AbortError" || console.warn(error); // left while it was loading
  opened.addEventListener("change", (event) => changed(event).catch(failed), { signal });
  await shown;
  mark();
}

const OF_ALL = {
  "": { title: "All machines", load: () => import("./views/fleet.js") },
  alarms: { title: "Alarms of all machines", load: () => import("./views/all-alarms.js") },
};

async function showAll(route, signal) {
  leavingMachine.abort();
  machine = null;
  const { title, load } = OF_ALL[route.view];
  const view = await load();
  if (signal.aborted) return;
  const root = element("div", { className: "view" });
  main.replaceChildren(element("h1", { className: "visually-hidden", tabIndex: -1 }, title), root);
  document.title = `${title} – gear-twin`;
  await view.show(root, { signal, get, connected });
}

async function show({ focus = true } = {}) {
  const route = routeOf(location.hash);
  leaving.abort();
  leaving = new AbortController();
  const { signal } = leaving;
  showTrail(route);
  main.dataset.view = "loading";
  main.setAttribute("aria-busy", "true");
  try {
    if (route.wrong) throw new Problem(404, `The address ${route.wrong} leads to no view.`);
    if (route.asset === null) await showAll(route, signal);
    else await showMachine(route, signal);
    if (signal.aborted) return;
    main.dataset.view = route.asset === null ? route.view || "fleet" : route.view || "overview";
  } catch (error) {
    if (signal.aborted || error.name === "AbortError") return;
    if (error.status === 401) {
      askForKey(error.message);
      return;
    }
    if (error.body?.renamed) {
      goOn(error.body.renamed);
      return;
    }
    console.warn(error);
    if (error.status === 0) connected(false, error.message);
    main.replaceChildren(problem(error, () => show()));
    main.dataset.view = "problem";
  }
  main.removeAttribute("aria-busy");
  // after a change of view the keyboard and the screen reader go on at its beginning
  if (focus && shownAt !== null) {
    scrollTo(0, 0);
    main.querySelector("h1")?.focus({ preventScroll: true });
  }
  shownAt = location.hash;
}

// -- signing in and out ---------------------------------------------------------------------------------

function askForKey(reason = "") {
  main.replaceChildren(element("h1", { className: "visually-hidden", tabIndex: -1 }, "Sign in"), signInForm(signedIn, reason));
  main.dataset.view = "sign-in";
  main.removeAttribute("aria-busy");
  document.title = "Sign in – gear-twin";
}

// Everything is asked for again, as whoever is signed in now.
async function signedIn(asked = false) {
  leavingMachine.abort();
  machine = null;
  if (asked === true) {
    askForKey();
    return;
  }
  await Promise.all([showSession(session, signedIn), show({ focus: false })]);
}

addEventListener("hashchange", () => show());
document.getElementById("skip").addEventListener("click", (event) => {
  event.preventDefault();
  main.focus();
});
await Promise.all([showSession(session, signedIn), show({ focus: false })]);
