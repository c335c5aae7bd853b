// Alarms as a list, the most urgent first: what it is, what to do, and a form to acknowledge or clear each by name.

import { newestOf, pathOf, send } from "../api.js";
import { element, keepingFocus } from "../dom.js";
import { ago, dateTime, instant, number, sentence } from "../format.js";
import { busy, field, valuesOf } from "../forms.js";
import { table } from "../table.js";
import { levelBadge } from "./health.js";

const NAME = "gear-twin name"; // key of the browser's store: who acknowledged last
const STATES = {
  active_unacknowledged: ["active, not acknowledged", "bad"], active_acknowledged: ["active, acknowledged", "warn"],
  returned_unacknowledged: ["back to normal, not acknowledged", "warn"], closed: ["closed", ""],
};
const VERBS = { acknowledged: "acknowledged", cleared: "cleared", raised: "raised", escalated: "escalated to alarm",
  lowered: "lowered to watch", ended: "back to normal" };
export const QUANTITY_WORDS = { fm0: "FM0", fm4: "FM4", na4: "NA4", rms: "vibration level", data: "data quality",
  unexplained: "unknown effect", life: "remaining life", depth: "wear depth" };

export const quantityWords = (name) => QUANTITY_WORDS[name] ?? name.replaceAll("_", " ");

export const storedName = () => localStorage.getItem(NAME) ?? "";
export const keepName = (name) => localStorage.setItem(NAME, name);

function title(alarm, withAsset) {
  const place = alarm.place ? `: ${alarm.quantity === "effect" ? alarm.place.replaceAll("_", " ") : alarm.place}` : "";
  const text = `${quantityWords(alarm.quantity)}${place}`;
  const what = element("strong", {}, text[0].toUpperCase() + text.slice(1));
  return withAsset ? [element("a", { href: `#/asset/${encodeURIComponent(alarm.asset)}/alarms` }, alarm.asset), " ", what] : [what];
}

const moment = (text) => element("time", { dateTime: text, title: dateTime(instant(text)) },
  [dateTime(instant(text)), ago(instant(text))].filter(Boolean).map((part, i) => (i ? ` (${part})` : part)).join(""));

function signedLine(word, signed) {
  return signed ? [element("p", { className: "signed" }, `${word} by ${signed.by}, ${dateTime(instant(signed.at))}`,
    signed.note ? `: ${signed.note}` : "")] : [];
}

function history(alarm) {
  const rows = (alarm.history ?? []).map((entry) => [dateTime(instant(entry.at)), VERBS[entry.verb] ?? entry.verb,
    Number.isFinite(entry.value) ? `${number(entry.value)} ${alarm.unit}` : "–",
    Number.isFinite(entry.limit) ? `${number(entry.limit)} ${alarm.unit}` : "–",
    entry.by ? `${entry.by}${entry.note ? `: ${entry.note}` : ""}` : entry.reason || "–"]);
  return element("details", { dataset: { key: `history-${alarm.id}` } }, element("summary", {}, "History"),
    table(["when", "what", "value", "limit", "who, or why"], rows));
}

// The form of one alarm: a name, a note, and one button for each thing that can be done.
function signing(alarm, signal, done) {
  if (alarm.state === "closed") return [];
  const said = element("p", { className: "said", role: "status" });
  const own = element("form", { className: "form", "aria-label": `Acknowledge or clear alarm ${alarm.id}` });
  const act = (verb) => (event) => {
    event.preventDefault();
    if (!own.reportValidity()) return;
    const { by, note = "" } = valuesOf(own);
    busy(event.target, said, async () => {
      keepName(by);
      await send("POST", `${pathOf(alarm.asset)}/alarms/${alarm.id}/${verb}`, { by, note }, { signal });
      await done();
      return "Done.";
    });
  };
  const button = (verb, text, className) => element("button", { type: "button", className, onclick: act(verb),
    dataset: { key: `${verb}-${alarm.id}` } }, text);
  own.addEventListener("submit", (event) => event.preventDefault());
  own.append(element("div", { className: "fields" },
    field({ name: "by", label: "Your name", value: storedName(), required: true, maxLength: 100, key: `by-${alarm.id}`, autocomplete: "name" }),
    field({ name: "note", label: "Note", maxLength: 2000, key: `note-${alarm.id}`, hint: "what you saw or did" })),
  element("div", { className: "submit" },
    ...(alarm.acknowledged ? [] : [button("acknowledge", "Acknowledge", "primary")]),
    button("clear", "Clear after a repair", ""), said));
  return [element("details", { dataset: { key: `sign-${alarm.id}-${alarm.state}` } },
    element("summary", {}, alarm.acknowledged ? "Clear" : "Acknowledge or clear"), own)];
}

function card(alarm, { withAsset, signal, done }) {
  const [state, tone] = STATES[alarm.state] ?? [alarm.state, ""];
  return element("article", { className: `alarm alarm-${alarm.level}`, "aria-label": `Alarm ${alarm.id}`, dataset: { alarm: String(alarm.id) } },
    element("div", { className: "head" }, levelBadge(alarm.level), element("h3", {}, ...title(alarm, withAsset)),
      element("span", { className: `badge ${tone}` }, state)),
    ...(alarm.active && alarm.action ? [element("p", { className: "action" }, sentence(alarm.action))] : []),
    element("p", { className: "reason" }, alarm.reason),
    element("p", { className: "meta" }, `Alarm ${alarm.id}, since `, moment(alarm.raised_at),
      ...(alarm.ended_at && !alarm.active ? ["; back to normal ", moment(alarm.ended_at)] : [])),
    ...signedLine("Acknowledged", alarm.acknowledgement), ...signedLine("Cleared", alarm.clearance),
    ...signing(alarm, signal, done), history(alarm));
}

// A list that fills itself: `load(all)` gives the alarms; `refresh()` asks again and draws what has changed.
export function alarmList({ signal, load, withAsset = false }) {
  let all = false;
  let drawn = "";
  const newest = newestOf(load);
  const summary = element("p", { className: "counts", role: "status" });
  const list = element("div", { className: "alarms" });
  const closed = element("label", {}, element("input", { type: "checkbox", dataset: { key: "closed-alarms" },
    onchange: (event) => { all = event.target.checked; refresh(); } }), " closed alarms too");
  const root = element("section", { className: "panel" }, element("h2", {}, "Alarms"),
    element("form", { className: "filters", onsubmit: (event) => event.preventDefault() }, closed), summary, list);

  async function refresh() {
    const alarms = await newest(all);
    if (alarms === null) return;
    const now = JSON.stringify([alarms, Math.floor(Date.now() / 60_000)]); // "… ago" grows by itself
    if (now === drawn) return;
    drawn = now;
    const open = alarms.filter((a) => a.state !== "closed");
    const waiting = open.filter((a) => !a.acknowledged).length;
    summary.textContent = open.length ? `${open.filter((a) => a.active).length} active, ${waiting} not acknowledged` : "No open alarm.";
    keepingEntries(list, () => keepingFocus(() => {
      list.replaceChildren(...alarms.map((alarm) => card(alarm, { withAsset, signal, done: refresh })));
    }));
    root.dataset.alarms = String(alarms.length);
  }

  return { root, refresh };
}

// What somebody is typing outlives a new drawing of the list.
function keepingEntries(list, change) {
  const typed = new Map([...list.querySelectorAll("input[data-key]")].map((i) => [i.dataset.key, i.value]));
  change();
  for (const [key, value] of typed) {
    const again = list.querySelector(`input[data-key="${CSS.escape(key)}"]`);
    if (again) again.value = value;
  }
}
