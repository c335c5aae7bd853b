// Signals to look at: one window in every view, a waterfall of all windows, trends of the indicators.
//
//   #/asset/NAME/signals/window/INDEX/VIEW/CHANNEL     `latest` in place of INDEX follows the newest
//   #/asset/NAME/signals/waterfall
//   #/asset/NAME/signals/indicators

import { addressOf, get, warned } from "../api.js";
import { choice, element, panel } from "../dom.js";
import { dateTime, instant, revolutions, sentence } from "../format.js";
import { indicatorsView } from "../parts/indicators.js";
import { SignalChart, isSpectrum } from "../parts/signal_chart.js";
import { toothFigure } from "../parts/tooth.js";
import { labelled, waterfallView } from "../parts/waterfall.js";

const SETTLE_MS = 180; // before an excerpt is fetched after a zoom
const POINTS = 2400;
const SECTIONS = [["window", "One window"], ["waterfall", "Waterfall"], ["indicators", "Indicators"]];
const VIEWS = { waveform: "Waveform", spectrum: "Spectrum", "order-spectrum": "Order spectrum", "envelope-spectrum": "Envelope spectrum",
  "synchronous-average": "Synchronous average", "transmission-error": "Transmission error", flank: "Worn flank" };
const EVEN = /^(accel|torque)\//; // channels that are sampled evenly in time, which a spectrum needs
const KINDS = [["mesh", "mesh"], ["sideband", "sidebands"], ["shaft", "shafts"], ["bearing", "bearings"]];
const chosen = { view: "spectrum", channel: "", shaft: "pinion", averaged: false, log: true, modelled: true, without_lines: false,
  kinds: new Set(["mesh", "bearing"]), cursor: "none", spacing: "pinion", band: ["", ""] }; // kept while the page is open

export async function show(root, context) {
  const { machine, signal } = context;
  const base = addressOf(machine.name, "signals");
  const given = location.hash.split("/").slice(4).map(decodeURIComponent);
  const kept = await get(`${machine.base}/signals`, { signal });
  const at = { section: SECTIONS.some(([s]) => s === given[0]) ? given[0] : "window",
    index: /^\d+$/.test(given[1] ?? "") ? Number(given[1]) : null };
  chosen.channel = given[3] ?? "";
  if (given[2] in VIEWS) chosen.view = given[2];
  else if (kept.channels.length && !kept.channels.some((c) => EVEN.test(c))) chosen.view = "waveform"; // encoders alone: their speeds

  const body = element("div");
  let section = null; // { load }
  let leaving = new AbortController();
  signal.addEventListener("abort", () => leaving.abort());
  const switches = element("fieldset", { className: "switch" }, element("legend", {}, "Show"), ...SECTIONS.map(([name, text]) =>
    choice(text, name === at.section, () => open(name), { type: "radio", name: "section", value: name })));
  root.append(switches, body);

  function address(...parts) {
    history.replaceState(null, "", [base, at.section, ...parts].map((p, i) => (i > 1 ? encodeURIComponent(p) : p)).join("/"));
  }

  function open(name) {
    leaving.abort();
    leaving = new AbortController();
    at.section = name;
    for (const input of switches.querySelectorAll("input")) input.checked = input.value === name;
    body.replaceChildren();
    const own = { machine, context, signal: leaving.signal, kept, at, address, channel: () => chosen.channel,
      choose: (index) => { at.index = index; open("window"); } };
    if (name !== "window") address();
    section = { window: windowView, waterfall: waterfallView, indicators: indicatorsView }[name](body, own);
  }

  open(at.section);
  context.onChange(async (kinds) => {
    if (!kinds.has("window")) return;
    await get(`${machine.base}/signals`, { signal }).then((found) => {
      Object.assign(kept, found);
      section?.load(true);
    }).catch(warned);
  });
}

function windowView(root, { machine, signal, kept, at, address }) {
  const stage = element("div");
  const said = element("p", { className: "said", role: "status" });
  const links = element("p", { className: "downloads" });
  const controls = element("div", { className: "controls" });
  const bar = element("section", { className: "panel" });
  root.append(bar, stage);
  let chart = null;
  let answer = null;
  let asked = 0;
  let timer = null;
  signal.addEventListener("abort", () => { chart?.destroy(); clearTimeout(timer); });

  // -- which window ------------------------------------------------------------------------------------

  const slider = element("input", { type: "range", min: "0", className: "windows", ariaLabel: "Window", dataset: { key: "window" } });
  const label = element("output", { className: "which" });
  const step = (by) => {
    slider.value = String(Number(slider.value) + by);
    slider.dispatchEvent(new Event("input"));
  };
  const previous = element("button", { type: "button", onclick: () => step(-1), dataset: { key: "previous-window" } }, "‹ previous");
  const next = element("button", { type: "button", onclick: () => step(1), dataset: { key: "next-window" } }, "next ›");
  slider.addEventListener("input", () => {
    const place = Number(slider.value);
    at.index = place === kept.windows.length - 1 ? null : kept.windows[place].index;
    named();
    soon(() => load());
  });

  // The place in the list: the window asked for, the nearest one where it is not kept, the newest where none is asked for.
  function placeNow() {
    const last = kept.windows.length - 1;
    if (at.index === null) return last;
    const exact = kept.windows.findIndex((w) => w.index === at.index);
    if (exact >= 0) return exact;
    const after = kept.windows.findIndex((w) => w.index > at.index);
    return after < 0 ? last : after;
  }

  const current = () => kept.windows[placeNow()];

  function named() {
    const w = current();
    if (!w) return;
    slider.max = String(kept.windows.length - 1);
    slider.value = String(placeNow());
    previous.disabled = placeNow() === 0;
    next.disabled = placeNow() === kept.windows.length - 1;
    const text = [`window ${w.index}`, dateTime(instant(w.start_time)), w.revolutions === null ? "" : `${revolutions(w.revolutions)} rev`,
      w.refused ? "refused" : "", w.found ? "effects changed here" : "", at.index === null ? "newest" : ""].filter(Boolean).join(" · ");
    label.textContent = text;
    slider.setAttribute("aria-valuetext", text);
  }

  // -- what of it --------------------------------------------------------------------------------------

  function option(text, name) {
    return choice(text, chosen[name], (checked) => { chosen[name] = checked; name === "log" ? redraw() : load(); }, { dataset: { key: `option-${name}` } });
  }

  function select(text, name, values, after) {
    return labelled(text, element("select", { dataset: { key: `choice-${name}` }, onchange: (event) => { chosen[name] = event.target.value; after(); } },
      ...values.map(([value, shown]) => new Option(shown, value, false, value === chosen[name]))));
  }

  const whole = () => { drawControls(); load(); };

  function drawControls() {
    const focused = document.activeElement?.dataset?.key;
    if (!kept.channels.includes(chosen.channel)) chosen.channel = kept.channels[0] ?? "";
    const spectral = isSpectrum(chosen.view);
    const { view } = chosen;
    const parts = [select("view", "view", Object.entries(VIEWS), whole)];
    if (view !== "transmission-error" && view !== "flank") parts.push(select("channel", "channel", kept.channels.map((c) => [c, c]), whole));
    if (view === "synchronous-average") parts.push(select("over turns of the", "shaft", [["pinion", "pinion"], ["gear", "gear"]], whole));
    if (view === "spectrum" || view === "order-spectrum") parts.push(option("averaged", "averaged"));
    if (view === "envelope-spectrum") parts.push(...bandFields(), option("without lines of the shafts", "without_lines"));
    if (spectral) parts.push(option("logarithmic", "log"));
    if (!["waveform", "envelope-spectrum", "flank"].includes(view)) parts.push(option("modelled", "modelled"));
    if (spectral) {
      parts.push(element("span", { className: "control", role: "group", "aria-label": "Markers" }, "markers", ...KINDS.map(([kind, text]) =>
        choice(text, chosen.kinds.has(kind), (checked) => { chosen.kinds[checked ? "add" : "delete"](kind); redraw(); },
          { dataset: { key: `marker-${kind}` } }))));
    }
    if (view !== "flank") {
      const kinds = [["none", "none"], ["single", "one place"], ...(spectral ? [["harmonic", "harmonics"], ["sideband", "sidebands"]] : [])];
      parts.push(select("cursor", "cursor", kinds, () => { drawControls(); setCursor(); }));
      if (spectral && chosen.cursor === "sideband") {
        parts.push(select("spaced by the", "spacing", [["pinion", "pinion's rotation"], ["gear", "gear's rotation"]], setCursor));
      }
    }
    controls.replaceChildren(...parts);
    if (focused) controls.querySelector(`[data-key="${CSS.escape(focused)}"]`)?.focus();
  }

  function bandFields() {
    return ["from", "to"].map((text, i) => labelled(`${i ? "" : "band "}${text}`, element("input", { type: "number", min: "0", step: "any", className: "short",
      value: chosen.band[i], placeholder: "Hz", ariaLabel: `Band ${text} [Hz]`, onchange: (event) => {
        chosen.band[i] = event.target.value;
        if (Boolean(chosen.band[0]) === Boolean(chosen.band[1])) load();
      } })));
  }

  // The distance of sidebands on the axis of the answer; null where a shaft's speed is not marked.
  function spacing() {
    return answer?.markers.find((m) => m.label === `${chosen.spacing} 1×`)?.x ?? null;
  }

  function setCursor() {
    chart?.setCursorKind(chosen.cursor, spacing());
    const hint = chosen.cursor === "none" ? "" : chosen.cursor === "sideband" && spacing() === null
      ? `Sidebands of the ${chosen.spacing} need its speed and the numbers of teeth.` : "Click in the chart, or press Enter at its cursor, to place it.";
    said.textContent = hint;
  }

  // -- fetching and drawing ----------------------------------------------------------------------------

  function soon(act) {
    clearTimeout(timer);
    timer = setTimeout(act, SETTLE_MS);
  }

  function query(more = {}) {
    const { view } = chosen;
    const all = { modelled: String(chosen.modelled || view === "flank"), ...more };
    if (view !== "transmission-error" && view !== "flank" && chosen.channel) all.channel = chosen.channel;
    if (view === "synchronous-average") all.shaft = chosen.shaft;
    if (chosen.averaged && (view === "spectrum" || view === "order-spectrum")) all.averaged = "true";
    if (view === "envelope-spectrum") {
      if (chosen.without_lines) all.without_lines = "true";
      if (chosen.band[0] && chosen.band[1]) Object.assign(all, { band_low_hz: chosen.band[0], band_high_hz: chosen.band[1] });
    }
    return `${machine.base}/windows/${current().index}/signals/${view}?${new URLSearchParams(all)}`;
  }

  async function load(fromEvent = false) {
    named();
    if (!current()) {
      bar.replaceChildren(element("h2", {}, "No signals to look at yet"), element("p", {}, sentence(kept.reason ?? "")));
      return;
    }
    if (!controls.firstChild || !bar.contains(controls)) {
      bar.replaceChildren(element("h2", {}, "Signals of one window"), element("div", { className: "controls" }, previous, slider, next, label), controls, said, links);
      drawControls();
    }
    if (fromEvent && at.index !== null) return; // another window than the newest is looked at
    const number = asked += 1;
    const { view } = chosen;
    address(at.index ?? "latest", view, ...(chosen.channel && view !== "flank" && view !== "transmission-error" ? [chosen.channel] : []));
    root.setAttribute("aria-busy", "true");
    const zoom = same() ? chart.group.zoom : null;
    const excerpt = zoom ? { x_from: zoom[0], x_to: zoom[1] } : {};
    try {
      // what is measured is there at once; the model's lines may take seconds the first time
      if (chosen.modelled && view !== "flank") await fetched({ points: POINTS, ...excerpt, modelled: "false" }, number);
      await fetched({ points: POINTS, ...excerpt }, number);
    } catch (error) {
      if (error.name === "AbortError" || number !== asked) return;
      failed(error);
    }
    if (number === asked) root.removeAttribute("aria-busy");
  }

  const key = () => `${chosen.view} ${chosen.channel} ${chosen.shaft}`;
  const same = () => chart?.shownKey === key();

  async function fetched(more, number) {
    const found = await get(query(more), { signal });
    if (number !== asked) return;
    answer = found;
    redraw();
    const png = { format: "png", log: String(chosen.log && isSpectrum(chosen.view)), markers: [...chosen.kinds].join(",") || "none",
      theme: matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light" };
    links.replaceChildren("Download: ", element("a", { href: query({ format: "csv" }) }, "CSV, every point"), " · ",
      element("a", { href: query(png), target: "_blank" }, "PNG"));
  }

  function redraw() {
    if (!answer) return;
    if (answer.view === "flank") {
      chart?.destroy();
      chart = null;
      stage.replaceChildren(toothFigure(answer));
      return;
    }
    if (!chart) {
      stage.replaceChildren();
      chart = new SignalChart(stage, { onZoom: () => soon(() => load()) });
    }
    if (!same()) {
      chart.group.zoom = null;
      chart.cursor.x = null;
      chart.shownKey = key();
    }
    chart.cursor.kind = chosen.cursor;
    chart.cursor.spacing = spacing();
    chart.show(answer, { kinds: chosen.kinds, log: chosen.log && isSpectrum(answer.view) });
  }

  function failed(error) {
    chart?.destroy();
    chart = answer = null;
    links.replaceChildren();
    stage.replaceChildren(panel(`${VIEWS[chosen.view]} is not available`, element("p", {}, sentence(error.message))));
  }

  load();
  return { load };
}
