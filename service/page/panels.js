// The cards on top and the tables below the charts.

import { anything, fixed, isAvailable, isShared, number, range, reasonOf, revolutions, sharedReasons, words } from "./format.js";

const KNOWN = new Set(["asset", "windows", "wear", "rul", "residual", "effects", "unexplained", "calibration",
  "data_quality", "tracing", "pair", "unattributed_lines", "schema_version", "status", "rig", "windows_total",
  "energy_breakdown"]);

function element(tag, attributes = {}, ...children) {
  const made = Object.assign(document.createElement(tag), attributes);
  made.append(...children);
  return made;
}

function card(name, part, value, unit, more) {
  if (isShared(part)) return "";
  const shown = isAvailable(part);
  const figure = element("div", { className: shown ? "value" : "value none" }, shown ? value() : "not available");
  if (shown && unit) figure.append(" ", element("small", {}, unit));
  return element("div", { className: "card" }, element("div", { className: "name" }, name), figure,
    element("div", { className: "more" }, shown ? more() : reasonOf(part)));
}

// One notice for a reason that several parts give, in place of the same sentence in each of them.
export function noteMissing({ wear, rul, calibration, residual, tracing, unexplained }) {
  const parts = { "wear depth and profile": wear, "remaining life": rul, calibration, residual, attribution: tracing,
    "unexplained share": unexplained };
  const named = new Map();
  for (const [name, part] of Object.entries(parts)) {
    if (part === undefined || isAvailable(part)) continue;
    named.set(reasonOf(part), [...(named.get(reasonOf(part)) ?? []), name]);
  }
  sharedReasons.clear();
  const lines = [];
  for (const [reason, names] of named) {
    if (names.length < 2) continue;
    sharedReasons.add(reason);
    lines.push(`Not available for this machine: ${names.join(", ")}. Reason: ${reason.replace(/^[\w ]+ is not available: /, "")}.`);
  }
  const notice = document.getElementById("missing");
  notice.textContent = lines.join(" ");
  notice.hidden = !lines.length;
}

// The hours left, or why there is no more than a lower bound of them.
function lifeOf({ hours, reason }) {
  if (!hours) return { status: "not available" };
  if (hours.median !== null || !reason) return hours;
  return { status: "not available", reason: `at least ${fixed(hours.p05)} h; ${reason}` };
}

export function drawCards(state) {
  const { wear, rul, windows } = state;
  const depth = isAvailable(wear) ? wear.max_depth_um : wear;
  const combined = isAvailable(depth) ? depth.combined ?? { status: "not available" } : depth;
  const hours = isAvailable(rul) ? lifeOf(rul) : rul;
  const k = isAvailable(wear) && wear.k_wear_per_n === null ? { status: "not available" } : wear;
  const last = windows.filter((w) => w.kind !== "calibration").at(-1) ?? windows.at(-1);
  const measured = last && Number.isFinite(last.rms_measured) ? last
    : { status: "not available", reason: windows.length ? "the latest window has no RMS" : "no window yet" };
  document.getElementById("cards").replaceChildren(
    card("Maximum wear depth", combined, () => fixed(combined.median), "µm",
      () => [combined.p95 === null && wear.reason ? wear.reason : `5–95 %: ${range(combined)} µm`, wear.relation?.note]
        .filter(Boolean).join("; ")),
    card("Remaining life", hours, () => fixed(hours.median), "h",
      () => `5–95 %: ${range(hours)} h; ${revolutions(rul.revolutions?.median)} rev`),
    card("Archard coefficient K", k, () => number(wear.k_wear_per_n), "1/N",
      () => `k = ${number(wear.specific_wear_rate_m2_per_n)} m²/N`),
    card("Vibration RMS", measured, () => fixed(measured.rms_measured, 4), "m/s²",
      () => (Number.isFinite(last.error_percent) ? `model error ${signed(last.error_percent)} %` : "no prediction")),
    card("Windows", {}, () => revolutions(windows.length), "",
      () => `${windows.filter((w) => w.updated).length} updated the model${Number.isFinite(last?.revolutions)
        ? `; last at ${revolutions(last.revolutions)} rev` : ""}`),
    ...slowCards(last),
  );
}

// Slow channels (temperatures) as the latest window has them; the record groups them by kind, then by name.
function slowCards(record) {
  const groups = Object.entries(record ?? {}).filter(([, named]) => named && typeof named === "object"
    && Object.values(named).some((value) => value && typeof value === "object" && "age_s" in value));
  return groups.flatMap(([kind, named]) => Object.entries(named).map(([name, slow]) =>
    card(`${words(kind).replace(/s$/, "")} ${name}`, slow, () => fixed(slow.value), slow.unit,
      () => (slow.values ? `mean of ${slow.values} values` : `last known value, ${number(slow.age_s)} s old`))));
}

const signed = (value) => (value > 0 ? "+" : "") + value.toFixed(1).replace("-", "−");

function table(heads, rows) {
  const numeric = heads.map((h) => h.endsWith("#"));
  const cell = (tag, text, i) => element(tag, { className: numeric[i] ? "number" : "" }, text);
  return element("table", {},
    element("thead", {}, element("tr", {}, ...heads.map((h, i) => cell("th", h.replace("#", ""), i)))),
    element("tbody", {}, ...rows.map((row) => {
      const { className = "", cells = row } = row;
      return element("tr", { className }, ...cells.map((text, i) => cell("td", text, i)));
    })));
}

function facts(part, nothing) {
  if (!isAvailable(part)) return element("p", { className: "none" }, `not available: ${reasonOf(part)}`);
  if (typeof part !== "object") return element("p", {}, anything(part));
  const rows = Object.entries(part).filter(([, value]) => value !== null && !sharedReasons.has(value));
  if (!rows.length) return element("p", { className: "none" }, nothing);
  return element("table", {}, element("tbody", {}, ...rows.map(([name, value]) =>
    element("tr", {}, element("td", { className: "name" }, words(name)), element("td", {}, anything(value))))));
}

function panel(title, ...children) {
  return element("div", { className: "panel" }, element("h2", {}, title), ...children);
}

function qualityPanel(quality) {
  const windows = Object.entries(quality.windows ?? {}).filter(([, n]) => n)
    .map(([grade, n]) => `${n} ${grade}`).join(", ") || "none yet";
  const rows = quality.totals.map((f) => [words(f.kind), f.channel, f.action, String(f.count), String(f.windows)]);
  const made = panel("Data quality", element("p", { className: "none" }, `Windows: ${windows}`));
  if (quality.missing_channels?.length) {
    made.append(element("p", { className: "none" }, `Channels never received: ${quality.missing_channels.join(", ")}`));
  }
  const channels = Object.entries(quality.channels ?? {}).map(([label, kinds]) => {
    const { frames = 0, ...wrong } = kinds;
    const what = Object.entries(wrong).filter(([, n]) => n).map(([kind, n]) => `${n} ${words(kind)}`).join(", ");
    return [label, revolutions(frames), what || "–"];
  });
  if (channels.length) made.append(table(["channel", "frames#", "stream faults"], channels));
  made.append(rows.length ? table(["fault", "channel", "action", "count#", "windows#"], rows)
    : element("p", { className: "none" }, "No faults so far."));
  return made;
}

const SMALL = { "m": [1e6, "µm"], "kg·m": [1e6, "g·mm"], "rad": [180 / Math.PI, "°"] };
const VERBS = { found: ["accept", "pin", "reject"], accepted: ["pin", "release", "reject"],
  pinned: ["accept", "release", "reject"] };

// A parameter in the unit that workshops use.
function figure({ value, unit, std }) {
  const [factor, shown] = SMALL[unit] ?? [1, unit];
  const spread = Number.isFinite(std) ? ` ± ${number(factor * std, 2)}` : "";
  return `${number(factor * value)}${spread}${shown && shown !== "°" ? " " : ""}${shown}`;
}

const change = (before, after, unit) => (Number.isFinite(before) && Number.isFinite(after)
  ? `${number(before)} → ${number(after)} ${unit}` : "–");

// The decision in progress, also for screen readers; kept when the panel is drawn again.
const decision = element("p", { className: "none decision" });
decision.setAttribute("role", "status");

export function showDecision(text, working) {
  decision.textContent = text;
  document.body.classList.toggle("deciding", working);
}

function decisionButton(name, verb, decide) {
  const made = element("button", { type: "button", onclick: () => decide(name, verb) }, verb);
  made.setAttribute("aria-label", `${verb} ${words(name)}`);
  made.dataset.effect = name;
  return made;
}

// One effect: what it is, how sure, what it changes, and what an engineer may decide.
function effectCard(effect, decide) {
  const { evidence = {}, error_before: before = {}, error_after: after = {} } = effect;
  const sizes = Object.entries(effect.parameters ?? {}).map(([name, value]) => [words(name), figure(value)]);
  const rival = evidence.runner_up
    ? `${words(evidence.runner_up)}, ${number(evidence.over_runner_up)} lower` : "none";
  const rows = [...sizes,
    ["since", effect.channels ? "–"
      : effect.onset_revolutions ? `${revolutions(effect.onset_revolutions)} rev` : "from the start"],
    [`ln evidence over the ${effect.channels ? "baseline alone" : "model without it"}`, number(evidence.log_evidence)],
    ["next best explanation", rival],
    ["waveform error, held-out windows", change(before.waveform_percent, after.waveform_percent, "%")],
    ["wear depth", change(effect.wear_depth_um_before, effect.wear_depth_um_after, "µm")]];
  if (Number.isFinite(effect.rul_revolutions_before) && Number.isFinite(effect.rul_revolutions_after)) {
    rows.push(["remaining life",
      `${revolutions(effect.rul_revolutions_before)} → ${revolutions(effect.rul_revolutions_after)} rev`]);
  }
  const alike = evidence.indistinguishable_from ?? [];
  if (alike.length) rows.push(["indistinguishable from", alike.map(words).join(", ")]);
  if (evidence.detail) rows.push(["observation", evidence.detail]);
  // Compared with a baseline there is no model to decide on.
  const verbs = effect.channels ? [] : VERBS[effect.status] ?? VERBS.found;
  const buttons = verbs.map((verb) => decisionButton(effect.name, verb, decide));
  const where = effect.channels ? ` (${effect.channels.join(", ")})` : "";
  return element("div", { className: "effect" },
    element("div", { className: "head" }, element("strong", {}, words(effect.name) + where),
      element("span", { className: "badge" }, effect.status ?? "found"),
      element("span", { className: "decide" }, ...buttons)),
    element("table", {}, element("tbody", {}, ...rows.map(([name, value]) =>
      element("tr", {}, element("td", { className: "name" }, name), element("td", {}, value))))));
}

function effectsPanel(effects, unexplained, tracing, wear, decide) {
  const list = isAvailable(effects) ? effects : [];
  const made = panel("Effects");
  if (!isAvailable(effects)) made.append(facts(effects));
  else if (!list.length) made.append(element("p", { className: "none" }, isAvailable(wear) ? "The model contains wear alone; no other effect was found."
    : "No model is available for this machine, so no effects were evaluated."));
  made.append(...list.map((effect) => effectCard(effect, decide)));
  const ruledOut = (isAvailable(tracing) && tracing.rejected) || [];
  for (const name of ruledOut) {
    made.append(element("p", { className: "none" }, `${words(name)}: rejected `,
      decisionButton(name, "release", decide)));
  }
  made.append(decision);
  if (!isShared(unexplained)) made.append(element("p", { className: "none" }, isAvailable(unexplained)
    ? `Unexplained: ${Number.isFinite(unexplained.share_percent)
      ? `${number(unexplained.share_percent)} % of the energy above the noise; ` : ""}${words(unexplained.verdict ?? "")}${
      unexplained.reason && !sharedReasons.has(unexplained.reason) ? `: ${unexplained.reason}` : ""}`
    : `Unexplained: not available: ${reasonOf(unexplained)}`));
  if (isAvailable(unexplained) && unexplained.verdict === "unknown_effect") {
    const keys = ["order", "frequency_hz", "share_percent"];
    made.append(table(keys.map((k) => `${words(k)}#`),
      (unexplained.orders ?? []).slice(0, 6).map((o) => keys.map((k) => anything(o[k])))));
  }
  return made;
}

function methodsPanel(wear) {
  const methods = Object.entries((isAvailable(wear) && wear.methods) || {});
  if (!methods.length) return [];
  const used = wear.method === "rms" ? "rms" : "fused";
  const rows = methods.map(([name, method]) => [
    name + (name === used ? " (in use)" : ""),
    number(method.wear_depth_um) + (Number.isFinite(method.std_um) ? ` ± ${number(method.std_um, 2)}` : ""),
    number(method.k_wear_per_n), fixed(method.rms_after, 4),
  ]);
  return [panel("Update methods", table(["method", "depth [µm]#", "K [1/N]#", "RMS after [m/s²]#"], rows))];
}

const UNITS = { damping_time: " [s]", contact_half_width: " [m]" };

function calibrationPanel(calibration) {
  if (!isAvailable(calibration) || typeof calibration.values !== "object") {
    return panel("Calibration", facts(calibration));
  }
  const { values, std_percent: std, ...rest } = calibration;
  const rows = Object.entries(values).map(([name, value]) => [words(name) + (UNITS[name] ?? ""), anything(value),
    Number.isFinite(std?.[name]) ? `± ${number(std[name], 2)} %` : "–"]);
  return panel("Calibration", table(["quantity", "value#", "uncertainty#"], rows), facts(rest, ""));
}

function residualPanel(residual) {
  if (!isAvailable(residual)) return panel("Residual", facts(residual));
  const { bands, orders, ...rest } = residual;
  const made = panel("Residual", facts(rest, "none"));
  if (Array.isArray(bands) && bands.length && typeof bands[0] === "object") {
    const keys = Object.keys(bands[0]);
    made.append(table(keys.map((k) => `${words(k)}#`), bands.map((b) => keys.map((k) => anything(b[k])))));
  }
  if (Array.isArray(orders) && orders.length) {
    const keys = ["order", "frequency_hz", "share_percent"];
    made.append(table(keys.map((k) => `${words(k)}#`), orders.slice(0, 5).map((o) => keys.map((k) => anything(o[k])))));
  }
  return made;
}

// What two encoders show of a gear pair, without a model.
function pairPanel(pair) {
  if (!pair) return [];
  if (!isAvailable(pair)) return [panel("Gear pair from its encoders", facts(pair))];
  const { ratio, rest_urad: rest, stated, missed_counts: missed, sharp_steps: sharp, turns, base_radii: radii } = pair;
  const rows = [["ratio, pinion to gear", `${number(ratio.value, 5)} ± ${number(ratio.std, 2)}`],
    ["tooth counts that fit", pair.teeth_that_fit.slice(0, 6).join(", ") || "none from 10 to 60"],
    ["turns of pinion and gear", `${number(turns.pinion)}, ${number(turns.gear)}`],
    ["transmission error, rms [µrad]", `${number(rest.before, 4)}; ${number(rest.after, 4)} after removal of the run-out`],
    ["missed counts", missed.map((s) => `${number(s.counts)} at ${number(s.time_s)} s`).join(", ") || "none found"],
    ...sharp.map((s) => ["sharp step", `${number(s.counts)} counts ${s.shaft
      ? `at ${fixed(s.turn)} of each turn of the ${s.shaft}` : `at ${number(s.time_s)} s, passed only once`}`])];
  if (stated) {
    rows.push([`ratio from ${stated.source}`, `${number(stated.ratio, 5)}, ${stated.contradicted ? "contradicted" : "not contradicted"}`]);
  }
  const inUm = radii !== null;
  const terms = pair.run_out.map((t) => [`${t.multiple}× a turn of the ${t.shaft}`,
    `${number(t.amplitude_urad, 4)} ± ${number(t.std_urad, 2)}`,
    ...(inUm ? [`${number(t.amplitude_um)} ± ${number(t.std_um, 2)}`] : []), t.indistinguishable_from.join(", ")]);
  return [panel("Gear pair from its encoders",
    element("table", {}, element("tbody", {}, ...rows.map(([name, text]) =>
      element("tr", {}, element("td", { className: "name" }, name), element("td", {}, text))))),
    table(["run-out", "µrad of the pinion#", ...(inUm ? ["µm#"] : []), "indistinguishable from"], terms))];
}

// Lines that belong to no known shaft: their spacing, and the causes that were tested.
function unattributedPanels(lines) {
  return (lines ?? []).map((found) => {
    const sides = found.sidebands.slice(0, 8).map((s) => [s.channel,
      `${s.harmonic ? `mesh ${s.harmonic} ± ` : ""}${s.multiple}×`, number(s.amplitude),
      Number.isFinite(s.depth) ? fixed(100 * s.depth) : "–"]);
    const causes = [...found.causes].sort((a, b) => Number(b.possible) - Number(a.possible))
      .map((c) => [c.name, c.possible ? "possible" : "ruled out", c.detail]);
    const slower = found.part === 1 ? "" : `; weaker lines are at ${fixed(found.frequency_hz / found.part, 5)} Hz`;
    const what = found.geared === null ? "belong to no known shaft" : `belong to another shaft, geared ${found.geared} to the pinion`;
    return panel("Unattributed lines",
      element("p", {}, `Lines spaced by ${fixed(found.frequency_hz, 5)} ± ${number(found.frequency_std_hz, 2)} Hz (order ${
        fixed(found.order, 5)}) ${what}${slower}.`),
      table(["channel", "lines", "amplitude#", "of the mesh line [%]#"], sides),
      table(["cause tested", "", "reason"], causes));
  });
}

function windowsPanel(windows) {
  const rows = windows.slice(-12).reverse().map((w) => ({
    className: w.updated ? "updated" : "",
    cells: [
      String(w.index), w.kind, revolutions(w.revolutions), fixed(w.speed_hz), fixed(w.torque_nm),
      fixed(w.rms_measured, 4), fixed(w.rms_predicted, 4),
      Number.isFinite(w.error_percent) ? signed(w.error_percent) : "–", w.updated ? "yes" : "", w.quality ?? "",
      fixed(w.wear_depth_um), fixed(w.k_wear_per_n), w.reason ?? (w.notes ?? []).filter((note) => !sharedReasons.has(note)).join("; "),
    ],
  }));
  const heads = ["window#", "kind", "revolutions#", "speed [Hz]#", "torque [N·m]#", "RMS [m/s²]#", "model [m/s²]#",
    "error [%]#", "updated", "data", "depth [µm]#", "K [1/N]#", "notes"];
  return panel("Latest windows", table(heads, rows));
}

const SENSOR_INDICATORS = ["rms", "kurtosis", "crest_factor"];
const GEAR_INDICATORS = ["fm0", "fm4", "na4", "m6a", "m8a", "energy_ratio", "sideband_level_factor"];

// Condition indicators of every accelerometer and gear in the latest window that has any.
function indicatorsPanel(windows) {
  const latest = windows.findLast((w) => w.indicators && Object.keys(w.indicators).length);
  if (!latest) return [];
  const rows = Object.entries(latest.indicators).flatMap(([sensor, own]) =>
    Object.entries(own.gears ?? { "–": {} }).map(([gear, found]) => [sensor,
      ...SENSOR_INDICATORS.map((key) => number(own[key])), gear, ...GEAR_INDICATORS.map((key) => number(found[key]))]));
  const heads = ["sensor", "RMS [m/s²]#", "kurtosis#", "crest factor#", "gear", "FM0#", "FM4#", "NA4#", "M6A#", "M8A#",
    "energy ratio#", "sideband level factor#"];
  return [panel(`Condition indicators, window ${latest.index}`, table(heads, rows))];
}

function inspectionsPanel(inspections) {
  const rows = inspections.slice(-8).reverse().map(({ inspection, twin, difference_um, within_band }) => {
    const own = isAvailable(twin) ? twin.max_depth_um : null;
    return [revolutions(inspection.revolutions), inspection.flank,
      `${number(inspection.max_depth_um)} ± ${number(inspection.std_um, 2)}`,
      own ? `${number(own.median)} (${range(own)})${twin.extrapolated ? ", extrapolated" : ""}` : `– (${reasonOf(twin)})`,
      Number.isFinite(difference_um) ? signed(difference_um) : "–",
      within_band === null || within_band === undefined ? "–" : within_band ? "yes" : "no"];
  });
  return panel("Inspections", table(
    ["revolutions#", "flank", "measured [µm]#", "model then [µm]#", "difference [µm]#", "within band"], rows));
}

// The button that has the focus, so that the keyboard focus survives when the panel is drawn again.
function focused() {
  const { activeElement: active } = document;
  return { label: active?.getAttribute("aria-label"), effect: active?.dataset?.effect };
}

function refocus(label, effect) {
  if (!effect) return;
  const own = [...document.querySelectorAll("#tables button")].filter((b) => b.dataset.effect === effect);
  (own.find((b) => b.getAttribute("aria-label") === label) ?? own[0])?.focus({ preventScroll: true });
}

export function drawTables(state, quality, inspections, decide) {
  const { windows, wear, effects, unexplained, residual, calibration, tracing, pair } = state;
  const more = Object.entries(state).filter(([name]) => !KNOWN.has(name));
  const { label, effect } = focused();
  document.getElementById("tables").replaceChildren(
    effectsPanel(effects, unexplained, tracing, wear, decide),
    qualityPanel(quality),
    ...methodsPanel(wear),
    ...indicatorsPanel(windows),
    ...pairPanel(pair),
    ...unattributedPanels(state.unattributed_lines),
    ...(isShared(calibration) ? []
      : [calibrationPanel(calibration ?? { status: "not available", reason: "the model has not been calibrated" })]),
    ...(isShared(residual) ? [] : [residualPanel(residual)]),
    ...more.map(([name, part]) => panel(words(name).replace(/^./, (c) => c.toUpperCase()), facts(part, "none"))),
  );
  refocus(label, effect);
  document.getElementById("lists").replaceChildren(
    ...(inspections.length ? [inspectionsPanel(inspections)] : []),
    ...(windows.length ? [windowsPanel(windows)] : []),
  );
}
