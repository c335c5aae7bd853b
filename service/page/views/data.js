// Windows, condition indicators, data quality, and what the model was calibrated to.

import { get, warned } from "../api.js";
import { element, keepingFocus, panel } from "../dom.js";
import { anything, dateTime, fixed, instant, isAvailable, number, revolutions, sentence, signed, words } from "../format.js";
import { inspectionTable } from "../parts/inspections.js";
import { facts, table } from "../table.js";

const SHOWN = 25; // windows at first
// keys of the state that have a place of their own; others are listed as they come
const KNOWN = new Set(["asset", "windows", "wear", "rul", "residual", "effects", "unexplained", "calibration", "data_quality",
  "tracing", "pair", "unattributed_lines", "schema_version", "status", "rig", "windows_total", "energy_breakdown", "baseline",
  "data", "question", "alarms", "retired", "modulation", "epoch"]);

const noteOf = (w) => w.reason ?? (w.notes ?? []).join("; ");
const depthText = (um) => (Number.isFinite(um) && Math.abs(um) < 0.005 ? "0.00" : fixed(um));

function windowsPanel(windows, all, more) {
  const listed = windows.slice(all ? 0 : -SHOWN).reverse();
  const shared = listed.length > 1 ? noteOf(listed[0]) : ""; // what every window says is said once
  const common = shared && listed.every((w) => noteOf(w) === shared);
  const rows = listed.map((w) => ({
    className: w.updated ? "updated" : "",
    cells: [
      String(w.index), dateTime(instant(w.start_time)), w.kind, revolutions(w.revolutions), fixed(w.speed_hz), fixed(w.torque_nm),
      fixed(w.rms_measured, 4), fixed(w.rms_predicted, 4), Number.isFinite(w.error_percent) ? signed(w.error_percent) : "–",
      w.updated ? "yes" : "", w.quality ?? "", depthText(w.wear_depth_um), fixed(w.k_wear_per_n),
      common ? "" : noteOf(w),
    ],
  }));
  const heads = ["window#", "start", "kind", "revolutions#", "speed [Hz]#", "torque [N·m]#", "RMS [m/s²]#", "model [m/s²]#",
    "error [%]#", "updated", "data", "depth [µm]#", "K [1/N]#", "notes"];
  return panel({ title: "Latest windows", id: "windows" },
    common ? element("p", { className: "meta" }, `All of these windows: ${sentence(shared)}`) : "",
    rows.length ? table(heads, rows, { drop: true }) : element("p", { className: "none" }, "No window has been received yet."),
    windows.length > SHOWN ? element("button", { type: "button", onclick: more, dataset: { key: "more-windows" } },
      all ? `Show the latest ${SHOWN}` : `Show the latest ${windows.length}`) : "");
}

const SENSOR_INDICATORS = ["rms", "kurtosis", "crest_factor"];
const GEAR_INDICATORS = ["fm0", "fm4", "na4", "m6a", "m8a", "energy_ratio", "sideband_level_factor"];

function indicatorsPanel(windows) {
  const latest = windows.findLast((w) => w.indicators && Object.keys(w.indicators).length);
  if (!latest) return [];
  const rows = Object.entries(latest.indicators).flatMap(([sensor, own]) =>
    Object.entries(own.gears ?? { "–": {} }).map(([gear, found]) => [sensor, own.unit ? "unknown" : "m/s²",
      ...SENSOR_INDICATORS.map((key) => number(own[key])), gear, ...GEAR_INDICATORS.map((key) => number(found[key]))]));
  const heads = ["sensor", "unit", "RMS#", "kurtosis#", "crest factor#", "gear", "FM0#", "FM4#", "NA4#", "M6A#", "M8A#",
    "energy ratio#", "sideband level factor#"];
  return [panel(`Condition indicators, window ${latest.index}`, table(heads, rows))];
}

function qualityPanel(quality) {
  const grades = Object.entries(quality.windows ?? {}).filter(([, n]) => n).map(([grade, n]) => `${revolutions(n)} ${grade}`).join(", ");
  const channels = Object.entries(quality.channels ?? {}).map(([label, kinds]) => {
    const { frames = 0, ...wrong } = kinds;
    const what = Object.entries(wrong).filter(([, n]) => n).map(([kind, n]) => `${n} ${words(kind)}`).join(", ");
    return [label, revolutions(frames), what || "none"];
  });
  const rows = quality.totals.map((f) => [words(f.kind), f.channel, f.action, String(f.count), String(f.windows)]);
  const missing = quality.missing_channels ?? [];
  return panel({ title: "Data quality", id: "quality" }, element("p", {}, `Windows: ${grades || "none yet"}.`),
    missing.length ? element("p", {}, `Channels of the rig file that were never received: ${missing.join(", ")}.`) : "",
    channels.length ? table(["channel", "frames#", "faults of the stream"], channels) : "",
    rows.length ? table(["fault", "channel", "action", "count#", "windows#"], rows) : element("p", { className: "none" }, "No faults so far."));
}

function inspectionsPanel(inspections) {
  if (!inspections.length) return [];
  return [panel({ title: "Inspections", id: "inspections" }, inspectionTable(inspections,
    ["model then [µm]#", "difference [µm]#", "within band"], ({ difference_um: off }) => signed(off),
    ({ within_band: within }) => (within === null || within === undefined ? "–" : within ? "yes" : "no")))];
}

function methodsPanel(wear) {
  const methods = Object.entries((isAvailable(wear) && wear.methods) || {});
  if (!methods.length) return [];
  const used = wear.method === "rms" ? "rms" : "fused";
  const names = { fused: "transmission error from the encoders", rms: "vibration RMS" };
  const rows = methods.map(([name, method]) => [
    (names[name] ?? words(name)) + (name === used ? " (in use)" : ""),
    number(method.wear_depth_um) + (Number.isFinite(method.std_um) ? ` ± ${number(method.std_um, 2)}` : ""),
    number(method.k_wear_per_n), fixed(method.rms_after, 4),
  ]);
  return [panel("Update methods", table(["method", "depth [µm]#", "K [1/N]#", "RMS after [m/s²]#"], rows))];
}

const UNITS = { damping_time: " [s]", contact_half_width: " [m]" };

const pairsOf = (part) => Object.entries(part).filter(([, value]) => value !== null && !(Array.isArray(value) && !value.length))
  .map(([name, value]) => [words(name), anything(value)]);

function calibrationPanel(calibration) {
  if (!isAvailable(calibration)) return [];
  if (typeof calibration.values !== "object") return [panel("Calibration", facts(pairsOf(calibration)))];
  const { values, std_percent: std, ...rest } = calibration;
  const rows = Object.entries(values).map(([name, value]) => [words(name) + (UNITS[name] ?? ""), anything(value),
    Number.isFinite(std?.[name]) ? `± ${number(std[name], 2)} %` : "–"]);
  return [panel("Calibration", table(["quantity", "value#", "uncertainty#"], rows), facts(pairsOf(rest)))];
}

function residualPanel(residual) {
  if (!isAvailable(residual)) return [];
  const { bands, orders, channels, ...rest } = residual;
  const made = panel("Residual", facts(pairsOf(rest)));
  if (Array.isArray(bands) && bands.length) {
    const heads = { harmonic: "mesh harmonic#", frequency_hz: "frequency [Hz]#", measured: "measured [m/s²]#",
      predicted: "model [m/s²]#", predicted_before: "without the effects [m/s²]#", channel: "channel" };
    const keys = Object.keys(heads).filter((key) => key in bands[0]);
    made.append(table(keys.map((k) => heads[k]), bands.map((b) => keys.map((k) => anything(b[k])))));
  }
  if (Array.isArray(orders) && orders.length) {
    made.append(element("h3", {}, "Strongest unexplained lines"), table(["order#", "frequency [Hz]#", "share of the energy [%]#"],
      orders.slice(0, 5).map((o) => [anything(o.order), anything(o.frequency_hz), anything(o.share_percent)])));
  }
  if (channels) made.append(facts(Object.entries(channels).map(([name, value]) => [name, anything(value)])));
  return [made];
}

// Parts of the answer that this page does not know by name.
function otherPanels(state) {
  return Object.entries(state).filter(([name, part]) => !KNOWN.has(name) && part !== null).map(([name, part]) =>
    panel(sentence(words(name)).slice(0, -1), typeof part === "object" && !Array.isArray(part) && isAvailable(part)
      ? facts(pairsOf(part)) : element("p", {}, anything(part))));
}

export async function show(root, context) {
  const { machine, signal } = context;
  let quality = await get(`${machine.base}/quality`, { signal });
  let all = false;
  const columns = element("div", { className: "columns" });
  const list = element("div");
  root.append(list, columns);

  const draw = () => keepingFocus(() => {
    const { state, windows, inspections } = machine;
    list.replaceChildren(windowsPanel(windows, all, () => {
      all = !all;
      draw();
    }), ...indicatorsPanel(windows), ...inspectionsPanel(inspections));
    columns.replaceChildren(qualityPanel(quality), ...methodsPanel(state.wear), ...calibrationPanel(state.calibration),
      ...residualPanel(state.residual), ...otherPanels(state));
  });
  draw();
  context.onChange(() => get(`${machine.base}/quality`, { signal }).then((found) => {
    quality = found;
    draw();
  }).catch(warned));
}
