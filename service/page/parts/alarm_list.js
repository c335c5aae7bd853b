// Alarms as a list, the most urgent first: what it is, what to do, and a form to acknowledge or clear each by name.

import { addressOf, newestOf, pathOf, send } from "../api.js";
import { choice, element, folded, keepingFocus, panel } from "../dom.js";
import { ago, dateTime, instant, number, sentence, signedText } from "../format.js";
import { form, run, signature } from "../forms.js";
import { table } from "../table.js";
import { levelBadge } from "./health.js";

const STATES = {
  active_unacknowledged: ["active, not acknowledged", "bad"], active_acknowledged: ["active, acknowledged", "warn"],
  returned_unacknowledged: ["back to normal, not acknowledged", "warn"], closed: ["closed", ""],
};
const VERBS = { acknowledged: "acknowledged", cleared: "cleared", raised: "raised", escalated: "escalated to alarm",
  lowered: "lowered to watch", ended: "back to normal" };
export const QUANTITY_WORDS = { fm0: "FM0", fm4: "FM4", na4: "NA4", rms: "vibration level", data: "data quality",
  unexplained: "unknown effect", life: "remaining life", depth: "wear depth" };

export const quantityWords = (name) => QUANTITY_WORDS[name] ?? name.replaceAll("_", " ");

function title(alarm, withAsset) {
  const place = alarm.place ? `: ${alarm.quantity === "effect" ? alarm.place.replaceAll("_", " ") : alarm.place}` : "";
  const text = `${quantityWords(alarm.quantity)}${place}`;
  const what = element("strong", {}, text[0].toUpperCase() + text.slice(1));
  return withAsset ? [element("a", { href: addressOf(alarm.asset, "alarms") }, alarm.asset), " ", what] : [what];
}

const moment = (text) => element("time", { dateTime: text, title: dateTime(instant(text)) },
  [dateTime(instant(text)), ago(instant(text))].filter(Boolean).map((part, i) => (i ? ` (${part})` : part)).join(""));

function signedLine(word, signed) {
  return signed ? [element("p", { className: "signed" }, signedText(word, signed, dateTime(instant(signed.at))))] : [];
}

function history(alarm) {
  const rows = (alarm.history ?? []).map((entry) => [dateTime(instant(entry.at)), VERBS[entry.verb] ?? entry.verb,
    Number.isFinite(entry.value) ? `${number(entry.value)} ${alarm.unit}` : "–",
    Number.isFinite(entry.limit) ? `${number(entry.limit)} ${alarm.unit}` : "–",
    entry.by ? `${entry.by}${entry.note ? `: ${entry.note}` : ""}` : entry.reason || "–"]);
  return folded(`history-${alarm.id}`, "History", table(["when", "what", "value", "limit", "who, or why"], rows));
}

// The form of one alarm: a name, a note, and one button for each thing that can be done.
function signing(alarm, signal, done) {
  if (alarm.state === "closed") return [];
  const button = (verb, text, className) => element("button", { type: "button", className, dataset: { key: `${verb}-${alarm.id}` },
    onclick: (event) => run(event.currentTarget, async ({ by, note = "" }) => {
      await send("POST", `${pathOf(alarm.asset)}/alarms/${alarm.id}/${verb}`, { by, note }, { signal });
      await done();
    }) }, text);
  const own = form({
    label: `Acknowledge or clear alarm ${alarm.id}`,
    fields: signature({ required: true, maxLength: 100, hint: "what you saw or did", suffix: `-${alarm.id}` }),
    more: [...(alarm.acknowledged ? [] : [button("acknowledge", "Acknowledge", "primary")]), button("clear", "Clear after a repair", "")],
  });
  return [folded(`sign-${alarm.id}-${alarm.state}`, alarm.acknowledged ? "Clear" : "Acknowledge or clear", own)];
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
  const closed = choice("closed alarms too", false, (checked) => { all = checked; refresh(); }, { dataset: { key: "closed-alarms" } });
  const root = panel("Alarms", element("form", { className: "filters", onsubmit: (event) => event.preventDefault() }, closed), summary, list);

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
