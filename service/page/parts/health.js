// What a person should know first: the state of the machine, what to do, and apart from it whether the data are good.

import { addressOf } from "../api.js";
import { element, folded } from "../dom.js";
import { missingReasons } from "./cards.js";
import { ago, dataOf, dateTime, instant, isAvailable, levelWord, revolutions, sentence, signedText } from "../format.js";

const DATA_WORDS = { ok: "data good", waiting: "no data yet", degraded: "data degraded", stale: "data out of date" };

export function levelBadge(level) {
  return element("span", { className: `level level-${level ?? "no_verdict"}` }, levelWord(level));
}

export function dataBadge(holder) {
  const data = dataOf(holder);
  if (!data) return "";
  return element("span", { className: `badge data-${data.level}`, title: data.reason }, DATA_WORDS[data.level] ?? data.level);
}

function sinceOf(status) {
  const { time, revolutions: count } = status.since ?? {};
  const parts = [time ? dateTime(instant(time)) : "", Number.isFinite(count) ? `${revolutions(count)} revolutions` : ""].filter(Boolean);
  return parts.length ? `since ${parts.join(", ")}` : "";
}

// Why depth or life is preliminary, and which measurement would cure it.
function preliminary({ wear, rul, status }) {
  const found = [wear, rul].filter(isAvailable).map((part) => part.preliminary).filter(Boolean);
  const reasons = [...new Set(found.flatMap((p) => p.reasons ?? []))];
  const remedies = [...new Set(found.flatMap((p) => p.remedies ?? []))];
  if (!reasons.length) return "";
  const said = (status.reasons ?? []).join(" ").toLowerCase(); // what the state has said is not repeated
  const others = reasons.filter((reason) => !said.includes(reason.toLowerCase()));
  return element("div", { className: "preliminary" }, element("strong", {}, "Depth and life are preliminary. "),
    ...others.map((reason) => `${sentence(reason)} `),
    ...(remedies.length ? [element("span", {}, `What helps: ${sentence(remedies.join("; ")).replace(/^./, (c) => c.toLowerCase())}`)] : []));
}

// The reasons, without why parts are not available: a card below says that once.
function shortened(state) {
  const listed = missingReasons(state);
  let pointed = false;
  return (state.status.reasons ?? []).map((reason) => {
    const why = listed.find((one) => reason.includes(one));
    const head = why ? reason.slice(0, reason.indexOf(why)).replace(/[;:,]?\s*([\w ]+ (is|are) not available)?[;:,]?\s*$/, "") : reason;
    if (!why || !head) return reason;
    if (pointed || head.includes(":")) return head;
    pointed = true;
    return `${head}; see below what it cannot tell yet, and why`;
  });
}

function question(asked, machine) {
  if (!asked) return "";
  return element("p", { className: "question" }, element("strong", {}, "Question: "), `${asked.text} `,
    element("a", { href: addressOf(machine, "life") }, "Answer it"));
}

function retirement({ retired }) {
  if (!retired) return "";
  return element("p", { className: "question" }, element("strong", {}, "Retired. "),
    `${signedText(`Out of use since ${dateTime(instant(retired.since))}`, retired)}. New frames are left out; the state is that of the latest window.`);
}

// The window that the verdict rests on, where the state names it.
function restsOn({ verdict }) {
  if (!verdict || !Number.isFinite(verdict.window)) return "";
  return `verdict of window ${verdict.window}, ${dateTime(instant(verdict.start_time))}`;
}

// The state in one sentence with one action; all reasons, and what is preliminary, are folded.
export function health(state) {
  const { status } = state;
  const [lead = "", ...others] = shortened(state);
  const first = lead === status.reasons?.[0] && status.summary ? status.summary : lead;
  const reasons = first === lead ? others : [lead, ...others];
  const more = [...(reasons.length ? [element("ul", { className: "more-reasons" }, ...reasons.map((reason) => element("li", {}, sentence(reason))))] : []),
    preliminary(state)].filter(Boolean);
  const data = dataOf(state);
  return element("section", { className: `panel health health-${status.level}`, "aria-label": "State of the machine" },
    element("div", { className: "head" }, levelBadge(status.level),
      ...(status.action ? [element("p", { className: "action" }, sentence(status.action))] : [])),
    retirement(state),
    element("p", { className: "reason" }, first && sentence(first)),
    ...(more.length ? [folded(`reasons ${state.asset}`, "More reasons, and what helps", ...more)] : []),
    question(state.question, state.asset),
    element("p", { className: "meta" }, ...[sinceOf(status), restsOn(status), data ? data.reason : ""]
      .filter(Boolean).flatMap((part, i) => (i ? [" · ", part] : [part]))));
}

// A moment as how long ago it was; where that says nothing, its date.
export const since = (at) => element("time", { title: dateTime(at), dateTime: Number.isFinite(at) ? new Date(at).toISOString() : "" },
  ago(at) || dateTime(at));

// When a machine was last seen, and what waits: the line that every view of it has.
export function seen(state) {
  const at = instant(state.last_seen) ?? instant(state.windows?.at(-1)?.start_time);
  const waiting = state.data?.waiting;
  const behind = waiting?.behind?.length ? `, behind ${waiting.behind.join(", ")}` : "";
  return element("p", { className: "seen" }, "Last seen ",
    since(at), " · ", dataBadge(state),
    waiting ? ` · ${waiting.windows} window${waiting.windows === 1 ? " waits" : "s wait"} to be assessed, the first came ${ago(instant(waiting.since))}${behind}` : "");
}
