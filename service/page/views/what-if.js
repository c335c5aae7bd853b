// What if: the remaining life under another duty, the chance of reaching a date, and measured depths that change the estimate.

import { send } from "../api.js";
import { Chart } from "../chart.js";
import { element, folded, panel } from "../dom.js";
import { field, form } from "../forms.js";
import { dateTime, duration, day, instant, isAvailable, number, revolutions, sentence } from "../format.js";
import { inspections } from "../parts/inspections.js";
import { facts, table } from "../table.js";

const MOST = 6; // operating conditions of a duty

// One operating condition: speed, torque and share of the running time.
function condition(number, { speed, torque, share }) {
  return element("fieldset", { className: "condition" }, element("legend", {}, `Condition ${number}`),
    field({ name: `speed-${number}`, label: "Pinion speed", unit: "Hz", type: "number", value: speed, required: true, min: 0.01 }),
    field({ name: `torque-${number}`, label: "Torque on the pinion", unit: "N·m", type: "number", value: torque, required: true, min: 0.01 }),
    field({ name: `share-${number}`, label: "Share of the running time", unit: "%", type: "number", value: share, required: true,
      min: 0.1, max: 100 }));
}

// The question as the interface takes it, from the values of the form.
function asked(values) {
  const duty = [];
  for (let i = 1; `speed-${i}` in values; i += 1) {
    duty.push({ speed_hz: values[`speed-${i}`], torque_nm: values[`torque-${i}`], share: values[`share-${i}`] / 100 });
  }
  const until = values.until ? new Date(`${values.until}T00:00:00Z`).toISOString() : undefined;
  const body = { duty, until, hours: until ? undefined : values.hours, hours_per_day: values.hours_per_day,
    max_depth_um: values.max_depth_um };
  return Object.fromEntries(Object.entries(body).filter(([, value]) => value !== undefined));
}

const hours = (value) => (Number.isFinite(value) ? duration(value) : "no bound");

// A probability is never said to be 0 or 100 %.
function percent(p) {
  if (p > 0.99) return "more than 99 %";
  return p < 0.01 ? "less than 1 %" : `${Math.round(100 * p)} %`;
}

function answered(found) {
  const { hours: life, present_hours: present, date, target, revolutions: turns } = found;
  const of = `of ${number(found.max_depth_um)} µm`;
  const first = found.reached ? `The limit ${of} is reached.`
    : Number.isFinite(life.median) ? `The limit ${of} is reached after ${duration(life.median)} of running (5–95 %: ${
      hours(life.p05)} – ${hours(life.p95)}).`
      : `The limit ${of} is reached after ${duration(life.p05)} of running at the earliest (5 %): ${found.reason}.`;
  const known = isAvailable(date) && date.median;
  const running = isAvailable(found.running) ? ` at ${number(found.running.hours_per_day)} h a day (${found.running.source})` : "";
  const chance = target && (target.probability === null ? "not known"
    : `${target.at_least ? "at least " : ""}${percent(target.probability)}`);
  return [
    element("p", { className: "conclusion" }, first),
    ...(target ? [element("p", { className: "conclusion" }, `Probability of reaching ${
      target.date ? day(instant(target.date)) : duration(target.hours)}: `, element("strong", {}, chance),
      target.date ? `, ${duration(target.hours)} of running ahead` : "", ".")] : []),
    ...(found.preliminary ? [element("p", { className: "preliminary" }, element("span", { className: "badge warn" }, "preliminary"), " ",
      found.preliminary.reasons.map(sentence).join(" "))] : []),
    ...found.notes.map((note) => element("p", { className: "note" }, sentence(note))),
    facts([
      ["At the present duty", `${hours(present.median)} (${hours(present.p05)} – ${hours(present.p95)})`],
      ["Revolutions", `${revolutions(turns.median)} (${revolutions(turns.p05)} – ${revolutions(turns.p95)})`],
      ["Date", known ? `${day(instant(date.median))} (${[date.p05, date.p95].map((d) => (d ? day(instant(d)) : "–")).join(" – ")})${running}`
        : sentence(date.reason ?? "more than a hundred years ahead")],
      ["Counted from", found.since ? dateTime(instant(found.since)) : "–"],
    ]),
  ];
}

function quantiles({ distribution: { probability, hours: times, revolutions: turns } }) {
  return table(["with a probability of [%]#", "no more than, of running#", "revolutions#"],
    probability.map((p, i) => [number(100 * p), hours(times[i]), revolutions(turns[i])]));
}

export async function show(root, { machine, signal, onChange }) {
  const { rul } = machine.state;
  const inspected = inspections(machine, signal);
  if (!isAvailable(rul)) {
    root.append(panel("What if", element("p", {}, `A life under another duty is not available: ${sentence(rul?.reason ?? "no remaining life yet")}`)),
      inspected.root);
    onChange((kinds) => kinds.has("inspection") && inspected.draw());
    return;
  }
  const rows = element("div", { className: "conditions" }, condition(1, { speed: number(rul.speed_hz, 4), torque: number(rul.torque_nm, 4), share: 100 }));
  const more = element("button", { type: "button", dataset: { key: "more-conditions" }, onclick: () => {
    const count = rows.children.length + 1;
    if (count <= MOST) rows.append(condition(count, { speed: "", torque: "", share: "" }));
    more.hidden = count >= MOST;
  } }, "Add a condition");
  const result = element("section", { className: "panel", hidden: true, "aria-label": "Answer" });
  const charts = element("div", { className: "charts" });
  let chart = null;
  signal.addEventListener("abort", () => chart?.destroy());

  const known = isAvailable(rul.date) ? rul.date.hours_per_day : "";
  const question = form({
    submit: "Compute",
    fields: [rows, more,
      field({ name: "hours_per_day", label: "Running time per day", unit: "h", type: "number", min: 0.01, max: 24, value: known,
        hint: known ? "" : "needed for dates: neither the rig file states it nor have the windows shown it" }),
      field({ name: "until", label: "Date to reach", type: "date" }),
      field({ name: "hours", label: "or running time to reach", unit: "h", type: "number", min: 0 }),
      field({ name: "max_depth_um", label: "Limit", unit: "µm", type: "number", min: 0, placeholder: number(rul.max_depth_um),
        hint: "left out: the end of life of the rig file" })],
    send: async (values) => {
      const { body } = await send("POST", `${machine.base}/what-if`, asked(values), { signal });
      result.replaceChildren(element("h2", {}, "Answer"), ...answered(body), folded("quantiles", "Quantiles", quantiles(body)));
      result.hidden = false;
      drawn(body);
      return "Computed.";
    },
  });

  function drawn({ survival, target, hours: life, present_hours: present, reached }) {
    if (reached || survival.hours.length < 3) {
      chart?.destroy();
      chart = null;
      return;
    }
    chart ??= new Chart(charts, { id: "survival", title: "Probability of not having reached the limit" });
    const marks = [{ x: life.median, label: "median", colour: "predicted" }];
    if (Number.isFinite(present.median)) marks.push({ x: present.median, label: "present duty", colour: "muted", dash: [4, 4] });
    if (target) marks.push({ x: target.hours, label: "to reach", colour: "limit" });
    chart.set({
      caption: "over the running time from the latest window on",
      x: { label: "running time [h]" },
      y: { label: "probability [%]" },
      values: [0, ...survival.hours],
      series: [{ name: "probability", unit: "%", values: [100, ...survival.probability.map((p) => 100 * p)], colour: "predicted", points: false }],
      marks,
    });
  }

  root.append(panel("What if the machine ran under another duty?",
    element("p", {}, "Wear goes on by Archard's law with the present wear coefficient: operating conditions and their shares give the remaining "
      + "life as a distribution. A condition that is new takes some seconds to compute. Nothing is changed."), question), result, charts, inspected.root);
  onChange((kinds) => kinds.has("inspection") && inspected.draw());
}
