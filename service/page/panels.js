// The cards on top and the tables below the charts.

import { anything, fixed, isAvailable, number, range, reasonOf, revolutions, words } from "./format.js";

const KNOWN = new Set(["asset", "windows", "wear", "rul", "residual", "effects", "unexplained", "calibration",
  "data_quality"]);

function element(tag, attributes = {}, ...children) {
  const made = Object.assign(document.createElement(tag), attributes);
  made.append(...children);
  return made;
}

function card(name, part, value, unit, more) {
  const shown = isAvailable(part);
  const figure = element("div", { className: shown ? "value" : "value none" }, shown ? value() : "not available");
  if (shown && unit) figure.append(" ", element("small", {}, unit));
  return element("div", { className: "card" }, element("div", { className: "name" }, name), figure,
    element("div", { className: "more" }, shown ? more() : reasonOf(part)));
}

export function drawCards(state) {
  const { wear, rul, windows } = state;
  const depth = isAvailable(wear) ? wear.max_depth_um : wear;
  const combined = isAvailable(depth) ? depth.combined ?? { status: "not available" } : depth;
  const hours = isAvailable(rul) ? rul.hours ?? { status: "not available" } : rul;
  const k = isAvailable(wear) && wear.k_wear_per_n === null ? { status: "not available" } : wear;
  const last = windows.filter((w) => w.kind !== "calibration").at(-1) ?? windows.at(-1);
  const measured = last && Number.isFinite(last.rms_measured) ? last
    : { status: "not available", reason: windows.length ? "the latest window has no RMS" : "no window yet" };
  document.getElementById("cards").replaceChildren(
    card("Maximum wear depth", combined, () => fixed(combined.median), "µm", () => `5–95 %: ${range(combined)} µm`),
    card("Remaining life", hours, () => fixed(hours.median), "h",
      () => `5–95 %: ${range(hours)} h; ${revolutions(rul.revolutions?.median)} rev`),
    card("Archard coefficient K", k, () => number(wear.k_wear_per_n), "1/N",
      () => `k = ${number(wear.specific_wear_rate_m2_per_n)} m²/N`),
    card("Vibration RMS", measured, () => fixed(measured.rms_measured, 4), "m/s²",
      () => (Number.isFinite(last.error_percent) ? `twin's error ${signed(last.error_percent)} %` : "no prediction")),
    card("Windows", {}, () => revolutions(windows.length), "",
      () => `${windows.filter((w) => w.updated).length} updated the twin; last at ${revolutions(last?.revolutions)} rev`),
  );
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
  const rows = Object.entries(part);
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
    made.append(element("p", { className: "none" }, `Never seen: ${quality.missing_channels.join(", ")}`));
  }
  const channels = Object.entries(quality.channels ?? {}).map(([label, kinds]) => {
    const { frames = 0, ...wrong } = kinds;
    const what = Object.entries(wrong).filter(([, n]) => n).map(([kind, n]) => `${n} ${words(kind)}`).join(", ");
    return [label, revolutions(frames), what || "–"];
  });
  if (channels.length) made.append(table(["channel", "frames#", "faults of the stream"], channels));
  made.append(rows.length ? table(["fault", "channel", "done about it", "count#", "windows#"], rows)
    : element("p", { className: "none" }, "No fault in any window so far."));
  return made;
}

function effectsPanel(effects, unexplained) {
  const list = isAvailable(effects) ? effects : [];
  const parameters = (p) => Object.entries(p ?? {}).map(([k, v]) => `${words(k)} ${anything(v)}`).join("; ");
  const rows = list.map((e) => [words(e.name), parameters(e.parameters), revolutions(e.onset_revolutions)]);
  const found = !isAvailable(effects) ? facts(effects)
    : rows.length ? table(["effect", "parameters", "since [rev]#"], rows)
      : element("p", { className: "none" }, "No effect beyond the model has been added.");
  const verdict = isAvailable(unexplained)
    ? `Unexplained: ${number(unexplained.share_percent)} % of the energy over the noise; ${words(unexplained.verdict ?? "")}${
      unexplained.reason ? `: ${unexplained.reason}` : ""}`
    : `Unexplained: not available: ${reasonOf(unexplained)}`;
  return panel("Effects", found, element("p", { className: "none" }, verdict));
}

function waysPanel(wear) {
  const ways = Object.entries((isAvailable(wear) && wear.ways) || {});
  if (!ways.length) return [];
  const used = wear.from === "rms" ? "paper" : "fused";
  const rows = ways.map(([name, way]) => [
    name + (name === used ? " (in use)" : ""),
    number(way.wear_depth_um) + (Number.isFinite(way.std_um) ? ` ± ${number(way.std_um, 2)}` : ""),
    number(way.k_wear_per_n), fixed(way.rms_after, 4),
  ]);
  return [panel("Ways of updating", table(["way", "depth [µm]#", "K [1/N]#", "RMS after [m/s²]#"], rows))];
}

function calibrationPanel(calibration) {
  if (!isAvailable(calibration) || typeof calibration.values !== "object") {
    return panel("Calibration", facts(calibration));
  }
  const { values, std_percent: std, ...rest } = calibration;
  const rows = Object.entries(values).map(([name, value]) => [words(name), anything(value),
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

function windowsPanel(windows) {
  const rows = windows.slice(-12).reverse().map((w) => ({
    className: w.updated ? "updated" : "",
    cells: [
      String(w.index), w.kind, revolutions(w.revolutions), fixed(w.speed_hz), fixed(w.torque_nm),
      fixed(w.rms_measured, 4), fixed(w.rms_predicted, 4),
      Number.isFinite(w.error_percent) ? signed(w.error_percent) : "–", w.updated ? "yes" : "", w.quality ?? "",
      fixed(w.wear_depth_um), fixed(w.k_wear_per_n), w.reason ?? (w.notes ?? []).join("; "),
    ],
  }));
  const heads = ["window#", "kind", "revolutions#", "speed [Hz]#", "torque [N·m]#", "RMS [m/s²]#", "twin [m/s²]#",
    "error [%]#", "updated", "data", "depth [µm]#", "K [1/N]#", "notes"];
  return panel("Latest windows", table(heads, rows));
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
    ["revolutions#", "flank", "measured [µm]#", "twin then [µm]#", "difference [µm]#", "in the band"], rows));
}

export function drawTables(state, quality, inspections) {
  const { windows, wear, effects, unexplained, residual, calibration } = state;
  const more = Object.entries(state).filter(([name]) => !KNOWN.has(name));
  document.getElementById("tables").replaceChildren(
    qualityPanel(quality),
    effectsPanel(effects, unexplained),
    ...waysPanel(wear),
    calibrationPanel(calibration ?? { status: "not available", reason: "the twin has not been calibrated" }),
    residualPanel(residual),
    ...more.map(([name, part]) => panel(words(name).replace(/^./, (c) => c.toUpperCase()), facts(part, "none"))),
  );
  document.getElementById("lists").replaceChildren(
    ...(inspections.length ? [inspectionsPanel(inspections)] : []),
    ...(windows.length ? [windowsPanel(windows)] : []),
  );
}
