// The trends of a machine against revolutions or time: vibration level, wear depth, remaining life; and the wear profile.

import { AXES, Chart } from "../chart.js";
import { element, pause } from "../dom.js";
import { instant, isAvailable, number, revolutions, words } from "../format.js";
import { timeAt } from "./effects.js";

const MARKS = 60; // update lines at most, the latest
const LEAST = 2; // points of a trend; one has its place on a card

// The points of the trend that have a place on the axis, in its order, with x.
function placed(machine, axis) {
  const x = axis === "time" ? (p) => (p.start_time ? instant(p.start_time) / 1000 : null)
    : axis === "revolutions" ? (p) => p.revolutions : (p) => p.index;
  return machine.trend.filter((p) => p.kind !== "calibration").map((p) => ({ ...p, x: x(p) }))
    .filter((p) => Number.isFinite(p.x)).sort((a, b) => a.x - b.x);
}

// Where a number of revolutions lies on the axis; null where it is not known.
function placeOf(machine, axis, count) {
  if (axis === "revolutions") return count;
  const time = axis === "time" ? timeAt(machine.trend, count) : null;
  return time === null ? null : time / 1000;
}

function marksOf(machine, points, axis) {
  const updates = points.filter((p) => p.updated).slice(-MARKS).map((p) => ({ x: p.x, colour: "update", legend: "model updated" }));
  const { effects } = machine.state;
  const began = (isAvailable(effects) ? effects : []).filter((e) => e.onset_revolutions).map((e) => ({
    x: placeOf(machine, axis, e.onset_revolutions), label: `${words(e.name)} begins`, colour: "muted", dash: [6, 3] }));
  return [...updates, ...began].filter((m) => Number.isFinite(m.x));
}

// What is known of a point: its operating condition, what happened, and the latest windows' notes.
const about = (points, machine) => (i) => {
  const p = points[i];
  return [`window ${p.index}`, Number.isFinite(p.revolutions) ? `${revolutions(p.revolutions)} rev` : "",
    `${number(p.speed_hz)} Hz`, Number.isFinite(p.torque_nm) ? `${number(p.torque_nm)} N·m` : "",
    p.updated ? "model updated" : "", p.quality && p.quality !== "good" ? `data ${p.quality}` : "",
    ...(machine.windows.find((w) => w.index === p.index)?.notes ?? [])].filter(Boolean).join(" · ");
};

// What the charts over the trend's points have in common.
const over = (machine, points, axis) => ({ x: AXES[axis], values: points.map((p) => p.x), marks: marksOf(machine, points, axis),
  about: about(points, machine) });

const bandOf = (name, bands) => ({ name, low: bands.map((b) => b.p05), high: bands.map((b) => b.p95) });

// Each of the following gives what its chart shows, or why it shows nothing.

function level(machine, points, axis) {
  const levels = points.filter((p) => Number.isFinite(p.rms_measured)).length;
  if (levels < LEAST) return levels ? "a trend begins with the second window" : "no window so far has a measured RMS";
  const updates = points.filter((p) => p.updated).length;
  const of = (name, key, values, look) => (points.some((p) => Number.isFinite(p[key])) ? [{ name, unit: "m/s²", values: points.map(values), ...look }] : []);
  const predicted = of("model, before the update", "rms_predicted", (p) => p.rms_predicted, { colour: "predicted", hollow: true });
  const after = of("model, after the update", "rms_after", (p) => (p.updated ? p.rms_after : null), { colour: "after", line: false, points: true });
  return {
    ...over(machine, points, axis), y: { label: "RMS [m/s²]" },
    caption: `reference accelerometer${predicted.length ? `; ${updates} update${updates === 1 ? "" : "s"} of the model` : ""}`,
    series: [...of("measured", "rms_measured", (p) => p.rms_measured, { colour: "measured" }), ...predicted, ...(updates ? after : [])],
  };
}

function inspections(machine, axis) {
  const shapes = { combined: "diamond", pinion: "up", gear: "down" };
  return machine.inspections.map(({ inspection: i }) => ({
    name: `inspection, ${i.flank === "combined" ? "both flanks" : i.flank}`, shape: shapes[i.flank], y: i.max_depth_um,
    x: placeOf(machine, axis, i.revolutions) ?? (axis === "time" ? i.received_ns / 1e9 : null), error: 1.645 * i.std_um,
  })).filter((s) => Number.isFinite(s.x));
}

// Depth as it was estimated window by window; where effects were found, as the whole history gives it with them.
function depth(machine, points, axis) {
  const { wear, effects, tracing } = machine.state;
  const withDepth = points.filter((p) => Number.isFinite(p.depth_um?.combined?.median));
  const spots = inspections(machine, axis);
  const few = withDepth.length + spots.length < LEAST;
  if (few || !withDepth.length) return { reason: "no window so far has a depth", shown: !few };
  const again = new Map((isAvailable(effects) && effects.length && isAvailable(tracing) ? tracing.depths ?? [] : [])
    .map((d) => [d.index, d]));
  const median = withDepth.map((p) => p.depth_um.combined.median);
  const series = again.size ? [
    { name: "history re-evaluated with the effects", unit: "µm", colour: "after", width: 2.5,
      values: withDepth.map((p) => again.get(p.index)?.wear_depth_um_after ?? null) },
    { name: "as estimated at the time", unit: "µm", colour: "predicted", width: 1.5, values: median },
  ] : [{ name: "estimate", unit: "µm", colour: "predicted", values: median }];
  const { limit } = machine;
  const near = limit && Math.max(...median, ...spots.map((s) => s.y)) > 0.3 * limit;
  const parts = ["both flanks together"];
  if (limit) parts.push(`end of life at ${number(limit)} µm`);
  const validity = isAvailable(wear) ? wear.validity : null;
  if (validity && validity.valid === false) {
    parts.push(`beyond the validity of the model${Number.isFinite(validity.contact_loss_from_um)
      ? `, contact is lost from ${number(validity.contact_loss_from_um)} µm` : ""}`);
  }
  return {
    ...over(machine, withDepth, axis), caption: parts.join("; "), y: { label: "largest depth [µm]" }, series, spots,
    bands: [bandOf(again.size ? "5–95 % at the time" : "5–95 %", withDepth.map((p) => p.depth_um.combined))],
    limits: near ? [{ y: limit, label: `end of life at ${number(limit)} µm` }] : [],
  };
}

function life(machine, points, axis) {
  const withLife = points.filter((p) => Number.isFinite(p.rul_hours?.median));
  if (withLife.length < LEAST) return "no window so far has a remaining life";
  return {
    ...over(machine, withLife, axis), y: { label: "remaining life [h]" },
    caption: "hours of running, at the operating condition of each window",
    series: [{ name: "median", unit: "h", values: withLife.map((p) => p.rul_hours.median), colour: "predicted" }],
    bands: [bandOf("5–95 %", withLife.map((p) => p.rul_hours))],
  };
}

// The probability that the limit has been reached, over hours of running or, where it is known, the date.
function reached({ state: { rul } }) {
  const found = isAvailable(rul) && !rul.reached ? rul.distribution : null;
  const known = found ? found.hours.flatMap((hours, i) => (Number.isFinite(hours) ? [[hours, 100 * found.probability[i]]] : [])) : [];
  if (known.length < 3) return "no distribution of the remaining life";
  const date = isAvailable(rul.date) && rul.date.hours_per_day > 0 ? rul.date : null;
  const place = (hours) => (date ? instant(date.since) / 1000 + hours * 3600 * 24 / date.hours_per_day : hours);
  const points = [[0, 0], ...known].map(([hours, share]) => [place(hours), share]);
  return {
    caption: `at ${number(rul.speed_hz)} Hz and ${number(rul.torque_nm)} N·m${date ? `, ${number(date.hours_per_day, 2)} h a day` : ""}`,
    x: date ? { label: "date", time: true } : { label: "hours of running from now", unit: "h" }, y: { label: "limit reached [%]" },
    values: points.map(([x]) => x),
    series: [{ name: "probability that the limit has been reached", unit: "%", values: points.map(([, share]) => share) }],
    marks: [[0.05, "5 %"], [0.5, "50 %"], [0.95, "95 %"]].flatMap(([p, label]) => {
      const i = found.probability.findIndex((one) => Math.abs(one - p) < 1e-6);
      return i >= 0 && Number.isFinite(found.hours[i]) ? [{ x: place(found.hours[i]), label, colour: "muted" }] : [];
    }),
  };
}

function profileOf(machine) {
  const profile = isAvailable(machine.state.wear) ? machine.state.wear.profile : null;
  if (!isAvailable(profile) || !profile.pinion) return "no wear profile";
  const points = ["pinion", "gear"].flatMap((flank) => profile[flank].roll_angle_deg.map((x, i) =>
    ({ x, [flank]: profile[flank].depth_um[i] }))).sort((a, b) => a.x - b.x);
  const of = (flank) => filled(points.map((p) => p[flank]), points.map((p) => p.x));
  const last = machine.windows.findLast((w) => Number.isFinite(w.revolutions));
  return {
    caption: `material removed from each flank${last ? ` at ${revolutions(last.revolutions)} revolutions` : ""}`,
    x: { label: "roll angle [°]", unit: "°", tight: true }, y: { label: "depth [µm]" }, values: points.map((p) => p.x),
    series: [{ name: "pinion", unit: "µm", values: of("pinion"), colour: "predicted", points: false },
      { name: "gear", unit: "µm", values: of("gear"), colour: "after", dash: [7, 3], points: false }],
  };
}

// Values between known ones by straight lines, so that two curves can share one axis.
function filled(values, x) {
  const known = values.flatMap((v, i) => (Number.isFinite(v) ? [i] : []));
  return values.map((v, i) => {
    if (Number.isFinite(v)) return v;
    const next = known.find((k) => k > i);
    const last = known.findLast((k) => k < i);
    if (next === undefined || last === undefined) return null;
    return values[last] + (values[next] - values[last]) * (x[i] - x[last]) / (x[next] - x[last] || 1);
  });
}

// Which axes this machine's trend has; by the number of the window where it has neither.
function axesOf(machine) {
  const has = [["revolutions", (p) => Number.isFinite(p.revolutions)], ["time", (p) => p.start_time]]
    .filter(([, test]) => machine.trend.some(test)).map(([name]) => name);
  return has.length ? has : ["index"];
}

// The charts with their switch of axis: { root, draw }.
export function trends(context) {
  const { machine } = context;
  const grid = element("div", { className: "charts" });
  const switching = element("fieldset", { className: "switch" }, element("legend", {}, "Trends against"));
  const root = element("section", { "aria-label": "Trends" }, switching, grid);
  const charts = [["depth", "Largest wear depth", depth, "trend"], ["rms", "Vibration RMS", level, "trend"], ["rul", "Remaining life", life, "trend"],
    ["reached", "When the limit is reached", reached], ["profile", "Wear profile", profileOf]]
    .map(([id, title, content, group]) => [new Chart(grid, { id, title, group }), content]);
  context.signal.addEventListener("abort", () => charts.forEach(([chart]) => chart.destroy()));

  function drawSwitch(axes, axis) {
    switching.hidden = axes.length < 2 || machine.trend.length < LEAST;
    const names = switching.querySelectorAll("input");
    if (names.length !== axes.length) {
      switching.replaceChildren(switching.querySelector("legend"), ...axes.map((name) => element("label", {},
        element("input", { type: "radio", name: "axis", value: name, dataset: { key: `axis-${name}` },
          onchange: () => { context.setAxis(name); draw(); } }), name)));
    }
    for (const input of switching.querySelectorAll("input")) input.checked = input.value === axis;
  }

  let latest = 0; // drawing that has begun last: an earlier one stops, and is over when the last one is
  let running = null;

  // One chart at a time, so that no task of the browser is long.
  function draw() {
    latest += 1;
    running = drawInTurn(latest);
    return running;
  }

  async function drawInTurn(own) {
    const axes = axesOf(machine);
    const axis = axes.includes(context.axis) ? context.axis : axes[0];
    const points = placed(machine, axis);
    drawSwitch(axes, axis);
    for (const [chart, content] of charts) {
      await pause();
      if (context.signal.aborted) return;
      if (own !== latest) {
        await running;
        return;
      }
      const found = content(machine, points, axis);
      const reason = typeof found === "string" ? found : found.reason;
      chart.figure.hidden = reason !== undefined && !found.shown;
      if (reason === undefined) chart.set(found);
      else chart.unavailable(reason);
    }
  }

  return { root, draw };
}
