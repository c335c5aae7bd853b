// The alarm rules of one machine: what is watched, what has been learned, and an editor.

import { newestOf, send } from "../api.js";
import { element, folded, keepingFocus } from "../dom.js";
import { dateTime, instant, number, signedText } from "../format.js";
import { ASSET_NAME, field, form, signature } from "../forms.js";
import { table } from "../table.js";
import { quantityWords } from "./alarm_list.js";

const BASES = { criterion: "as for the state of the machine", learned: "learned from this machine", fixed: "stated here" };
const NUMBERS = ["watch", "alarm", "windows", "seconds", "learn_windows"];

const limit = (value, unit) => (Number.isFinite(value) ? `${number(value)}${unit ? ` ${unit}` : ""}` : "–");

function learnedText(rule, learning, depthKnown) {
  const own = learning.filter((point) => point.rule === rule.name);
  if (rule.basis !== "learned") return "–";
  if (!own.length) return rule.without_depth && depthKnown ? "not needed: the wear depth is known" : "nothing learned yet";
  const ready = own.filter((point) => Number.isFinite(point.watch)).length;
  return `${ready} of ${own.length} limits learned`;
}

function learnedTable(learning) {
  const rows = learning.map((point) => [quantityWords(point.quantity), point.place || "–", number(point.speed_hz), number(point.torque_nm),
    number(point.median), number(point.watch), number(point.alarm), point.text]);
  return folded("learned", `Learned limits (${learning.length})`,
    table(["quantity", "place", "speed [Hz]#", "torque [N·m]#", "healthy median#", "watch#", "alarm#", "state"], rows));
}

function duration(rule) {
  const parts = [rule.windows > 1 ? `${rule.windows} windows in a row` : "", rule.seconds ? `${number(rule.seconds)} s` : ""].filter(Boolean);
  return parts.join(", ") || "at once";
}

// The fields of one rule; `take(rule)` gets what was entered.
function editor(rule, quantities, take, leave) {
  const choices = quantities.map((q) => [q.name, `${q.label}${q.unit ? ` [${q.unit}]` : ""}`]);
  const number_ = (name, label, hint, rest = {}) => field({ name, label, hint, type: "number", value: rule[name], ...rest });
  const fields = [
    field({ name: "name", label: "Name", value: rule.name, required: true, ...ASSET_NAME }),
    field({ name: "quantity", label: "What is watched", type: "select", options: choices, value: rule.quantity }),
    field({ name: "place", label: "Where", value: rule.place ?? "*", hint: "sensor, sensor/gear, place of the thermometer; * for each" }),
    field({ name: "basis", label: "Limits", type: "select", value: rule.basis, options: Object.entries(BASES) }),
    number_("watch", "Limit of watch", "where limits are stated"), number_("alarm", "Limit of alarm", "where limits are stated"),
    field({ name: "direction", label: "Bad side", type: "select", value: rule.direction ?? "",
      options: [["", "as usual for the quantity"], ["above", "above the limit"], ["below", "below the limit"]] }),
    field({ name: "hysteresis", label: "Hysteresis", unit: "% of the limit", type: "number", min: 0, max: 99, value: 100 * (rule.hysteresis ?? 0.05) }),
    number_("windows", "Windows in a row", "that raise it, and that end it", { min: 1, max: 1000, step: 1, value: rule.windows ?? 1 }),
    number_("seconds", "Duration", "how long it must last besides", { min: 0, unit: "s", value: rule.seconds ?? 0 }),
    number_("learn_windows", "Windows to learn from", "healthy ones, 10 at least", { min: 10, max: 1000, step: 1, value: rule.learn_windows ?? 10 }),
    field({ name: "without_depth", label: "Only where no wear depth is known", type: "checkbox", value: rule.without_depth }),
    field({ name: "enabled", label: "Switched on", type: "checkbox", value: rule.enabled ?? true }),
  ];
  return form({ label: `Rule ${rule.name || "to be added"}`, className: "form rule", fields, submit: "Use this rule",
    more: [element("button", { type: "button", onclick: leave }, "Cancel")], send: (values) => take(ruleOf(values)) });
}

function ruleOf(values) {
  const rule = { ...values, hysteresis: (values.hysteresis ?? 0) / 100 };
  if (!rule.direction) delete rule.direction;
  if (rule.basis !== "fixed") {
    delete rule.watch;
    delete rule.alarm;
  }
  for (const name of NUMBERS) if (!Number.isFinite(rule[name])) delete rule[name];
  return rule;
}

// The panel; `load()` gives the rules as the service has them.
export function alarmRules({ base, signal, load, depthKnown }) {
  const newest = newestOf(load);
  const root = element("section", { className: "panel", id: "alarm-rules" });
  let kept = null; // as the service has them
  let draft = null; // as they are edited here; null where they are not
  let editing = null; // index in the draft, or its length for one that is added

  const rules = () => draft ?? kept.rules;

  function row(rule, index) {
    const unit = kept.quantities.find((q) => q.name === rule.quantity)?.unit;
    const button = (text, act) => element("button", { type: "button", onclick: act, dataset: { key: `${text}-${index}` },
      "aria-label": `${text} rule ${rule.name}` }, text);
    return [rule.name, quantityWords(rule.quantity), rule.place === "*" ? "each" : rule.place, BASES[rule.basis] ?? "–",
      limit(rule.watch, unit), limit(rule.alarm, unit), duration(rule), learnedText(rule, kept.learning, depthKnown()), rule.enabled ? "on" : "off",
      element("span", { className: "buttons" }, button("Edit", () => { draft = [...rules()]; editing = index; draw(); }),
        button("Remove", () => { draft = rules().filter((_, i) => i !== index); editing = null; draw(); }))];
  }

  function saving() {
    return form({
      label: "Save the alarm rules", fields: signature({ required: true, maxLength: 100, note: "Why", hint: "", prefix: "rules-" }), submit: "Save the rules",
      more: [element("button", { type: "button", onclick: () => { draft = editing = null; draw(); } }, "Discard the changes")],
      send: async ({ by, note = "" }) => {
        kept = (await send("PUT", `${base}/alarm-rules`, { by, note, rules: draft }, { signal })).body;
        draft = editing = null;
        draw("The rules are saved.");
      },
    });
  }

  function draw(message = "") {
    const heads = ["name", "watched", "where", "limits", "watch#", "alarm#", "duration", "learned", "switched", "change"];
    const whose = kept.own ? `${signedText("Set", kept, dateTime(instant(kept.at)))}.`
      : "These are the rules of the service; a change makes rules of this machine's own.";
    const take = (rule) => {
      draft = editing < rules().length ? rules().map((r, i) => (i === editing ? rule : r)) : [...rules(), rule];
      editing = null;
      draw();
    };
    const blank = { name: "", quantity: "rms", place: "*", basis: "fixed", enabled: true };
    keepingFocus(() => root.replaceChildren(element("h2", {}, "Alarm rules"), element("p", {}, whose),
      element("p", { className: "said", role: "status" }, message), table(heads, rules().map(row)),
      element("p", {}, element("button", { type: "button", dataset: { key: "add-rule" },
        onclick: () => { draft = [...rules()]; editing = draft.length; draw(); } }, "Add a rule")),
      ...(editing === null ? [] : [editor(rules()[editing] ?? blank, kept.quantities, take, () => { editing = null; draw(); })]),
      ...(draft === null || editing !== null ? [] : [saving()]),
      ...(kept.learning.length ? [learnedTable(kept.learning)] : [])));
    root.dataset.rules = String(rules().length);
    root.querySelector("form.rule input")?.focus(); // brings the fields into view, too
  }

  async function refresh() {
    if (draft !== null) return; // what is being edited stays
    const found = await newest();
    if (found === null || draft !== null) return;
    kept = found;
    draw();
  }

  return { root, refresh };
}
