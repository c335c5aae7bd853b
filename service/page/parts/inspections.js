// Measured wear depths: a form to enter one, what it changed, and those that were entered.

import { get, send } from "../api.js";
import { element, keepingFocus, panel } from "../dom.js";
import { field, form } from "../forms.js";
import { duration, isAvailable, number, range, reasonOf, revolutions, sentence, signed } from "../format.js";
import { facts, table } from "../table.js";

const SHOWN = 8;
const FLANKS = [["combined", "both flanks together"], ["pinion", "pinion"], ["gear", "gear"]];

const band = (value, show) => (!value ? "not available" : !Number.isFinite(value.median) ? `at least ${show(value.p05)}`
  : `${show(value.median)} (${show(value.p05)} – ${Number.isFinite(value.p95) ? show(value.p95) : "no upper bound"})`);
const arrow = (pair, show) => `${show(pair.before)} → ${show(pair.after)}`;

// What one inspection changed: depth, coefficient and life before and after it.
function changes({ applied, reason, changed, contradiction }) {
  if (!applied) return [element("p", { className: "none" }, `The estimate is unchanged: ${sentence(reason ?? "it is kept for comparison")}`)];
  const micrometres = (v) => `${number(v)} µm`;
  const coefficient = (v) => (Number.isFinite(v) ? `${number(v)} 1/N` : "not available");
  return [
    ...(contradiction ? [element("p", { className: "said error", role: "alert" }, contradiction)] : []),
    facts([
      ["Wear depth now, both flanks", arrow(changed.depth_um, (v) => band(v, micrometres))],
      ["Remaining life", arrow(changed.rul_hours, (v) => band(v, duration))],
      ["Archard coefficient K", arrow(changed.k_wear_per_n, coefficient)],
    ]),
  ];
}

// A table of the latest inspections; `difference` and `last` give the last two cells of each, under `heads`.
export function inspectionTable(inspections, heads, difference, last) {
  return table(["revolutions#", "flank", "measured [µm]#", ...heads], inspections.slice(-SHOWN).reverse().map((entered) => {
    const { inspection, twin } = entered;
    const own = isAvailable(twin) ? twin.max_depth_um : null;
    return [revolutions(inspection.revolutions), inspection.flank,
      `${number(inspection.max_depth_um)} ± ${number(inspection.std_um, 2)}`,
      own ? `${number(own.median)} (${range(own)})${twin.extrapolated ? ", extrapolated" : ""}` : `– (${reasonOf(twin)})`,
      Number.isFinite(entered.difference_um) ? difference(entered) : "–", last(entered)];
  }));
}

const list = (inspections) => inspectionTable(inspections, ["model when entered [µm]#", "model − measured [µm]#", "in the estimate"],
  ({ difference_um: off, difference_in_std: scores }) => `${signed(off)}${Number.isFinite(scores) ? ` (${number(Math.abs(scores), 2)} std)` : ""}`,
  ({ applied, contradiction }) => (applied ? (contradiction ? "yes; contradicts the windows" : "yes") : "no"));

// The panel with the form; `machine.inspections` is renewed after each entry.
export function inspections(machine, signal) {
  const said = element("div", { role: "status", className: "changed" });
  const entered = element("div");
  const last = machine.windows.findLast((w) => Number.isFinite(w.revolutions));
  const entry = form({
    title: "Enter a measured wear depth",
    submit: "Use in the estimate",
    fields: [
      field({ name: "revolutions", label: "Revolutions of the pinion since new", type: "number", required: true, min: 0,
        value: last ? Math.round(last.revolutions) : "" }),
      field({ name: "max_depth_um", label: "Largest depth", unit: "µm", type: "number", required: true, min: 0 }),
      field({ name: "std_um", label: "Its standard deviation", unit: "µm", type: "number", required: true, min: 0.01,
        hint: "of the measurement: place, instrument, reading" }),
      field({ name: "flank", label: "Flank", type: "select", options: FLANKS, value: "combined" }),
    ],
    send: async (values) => {
      const { body } = await send("POST", `${machine.base}/inspections`, values, { signal });
      said.replaceChildren(element("h3", {}, "What it changed"), ...changes(body));
      machine.inspections = await get(`${machine.base}/inspections`, { signal });
      draw();
      return body.applied ? "The inspection is part of the estimate." : "The inspection is kept.";
    },
  });
  const root = panel({ title: "Inspections", id: "inspections" },
    element("p", {}, "A depth measured on the flanks changes depth, wear coefficient and remaining life, as far as its uncertainty allows; "
      + "one of an earlier time counts as of that time."), entry, said, entered);
  const draw = () => keepingFocus(() => entered.replaceChildren(
    ...(machine.inspections.length ? [element("h3", {}, "Entered so far"), list(machine.inspections)] : [])));
  draw();
  return { root, draw };
}
