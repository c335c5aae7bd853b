// Effects as plain sentences: how large, since when, what they change, how sure; and an engineer's decisions on them.

import { Problem, get, send, warned } from "../api.js";
import { element, folded, keepingFocus, panel } from "../dom.js";
import { anything, dateTime, figure, instant, isAvailable, number, revolutions, sentence, signedText, words } from "../format.js";
import { form, signature, signed } from "../forms.js";
import { facts, table } from "../table.js";

const VERBS = { found: ["accept", "pin", "reject"], accepted: ["pin", "release", "reject"],
  pinned: ["accept", "release", "reject"] };
const MEANING = { accept: "keep it, confirmed", pin: "keep it with exactly these figures", reject: "remove it; it is not added again",
  release: "let the data decide again" };

const nameOf = (effect) => effect.label ?? words(effect.name);

// "about 26 May 2032", by the windows at hand.
export function timeAt(trend, count) {
  const known = trend.filter((p) => Number.isFinite(p.revolutions) && p.start_time);
  const after = known.findIndex((p) => p.revolutions >= count);
  if (after < 0 || (after === 0 && known[0].revolutions > count)) return null;
  const [a, b] = [known[Math.max(after - 1, 0)], known[after]];
  const share = b.revolutions > a.revolutions ? (count - a.revolutions) / (b.revolutions - a.revolutions) : 0;
  return instant(a.start_time) + share * (instant(b.start_time) - instant(a.start_time));
}

function sinceOf(effect, trend) {
  if (effect.channels) return "It is a change against the healthy baseline.";
  if (!effect.onset_revolutions) return "It has been there from the start.";
  const time = timeAt(trend, effect.onset_revolutions);
  return `It began at about ${revolutions(effect.onset_revolutions)} revolutions${time ? ` (${dateTime(time)})` : ""}.`;
}

const rounded = (count) => number(Number(count.toPrecision(3)));

// Angles and shares describe an effect further: they are part of its evidence.
const secondary = (name) => /(_point|_phase|_share|_angle)$/.test(name);

function sizesOf({ parameters }, wanted) {
  const all = Object.entries(parameters ?? {});
  const main = all.filter(([name]) => !secondary(name));
  const first = main.length ? main : all;
  return (wanted === "main" ? first : all.filter((one) => !first.includes(one)))
    .map(([name, value]) => `${words(name)} ${figure(value, name)}`).join(", ");
}

function sizeOf(effect) {
  const sizes = sizesOf(effect, "main");
  return sizes ? `Size: ${sizes}.` : "";
}

// How the size has gone on since the onset; nothing where it is constant.
function growthOf({ growth }) {
  if (!growth) return "";
  const name = words(growth.parameter);
  const now = `at the latest window it is ${figure(growth.size_at_latest_window, growth.parameter)}`;
  const { rate_per_million_revolutions: rate, second_change_at: again } = growth;
  if (rate) {
    const unit = rate.unit.replace("/1e6 rev", "").replace(/^1$/, "");
    return `The ${name} grows by ${figure({ ...rate, unit }, growth.parameter)} per million revolutions; ${now}.`;
  }
  return `The ${name} changed again at about ${revolutions(again.value)} revolutions; ${now}.`;
}

// An error before and after, in a sentence that says which of the two is better.
function errorSentence(what, before, after) {
  if (!Number.isFinite(before) || !Number.isFinite(after)) return "";
  if (Math.abs(before - after) <= 0.02 * Math.max(before, after)) return `The error of the ${what} does not change (${number(after)} %).`;
  return `The error of the ${what} ${after < before ? "falls" : "rises"} from ${number(before)} to ${number(after)} %.`;
}

function consequences(effect) {
  const { error_before: before = {}, error_after: after = {}, wear_depth_um_before: d0, wear_depth_um_after: d1,
    rul_revolutions_before: l0, rul_revolutions_after: l1 } = effect;
  const changed = (a, b) => Number.isFinite(a) && Number.isFinite(b) && Math.abs(a - b) > 0.005 * Math.max(Math.abs(a), Math.abs(b));
  const depth = changed(d0, d1) ? `With it the wear depth is ${number(d1)} µm; without it, it would be ${number(d0)} µm.` : "";
  const life = changed(l0, l1) ? `The remaining life is ${rounded(l1)} instead of ${rounded(l0)} revolutions.` : "";
  const none = !depth && !life && Number.isFinite(d0) ? "It changes neither the wear depth nor the life until the wear limit." : "";
  return [depth, life, none,
    errorSentence("transmission error", before.transmission_error_percent, after.transmission_error_percent),
    errorSentence("acceleration", before.waveform_percent, after.waveform_percent)].filter(Boolean);
}

function alternatives(effect) {
  const { evidence = {} } = effect;
  const alike = evidence.indistinguishable_from ?? [];
  if (!alike.length) return "";
  if (effect.channels) return `The same channels would show the same for ${alike.map(words).join(", ")}.`;
  return `These channels cannot distinguish it from ${alike.map(words).join(", ")}. Recordings at a clearly different load and speed, `
    + "or one more channel (torque, or an encoder on each shaft), can help to decide.";
}

// The error of the lines that an effect moves, channel by channel, without and with it.
function movedLines(effect) {
  return (effect.moved_lines ?? []).filter((m) => Number.isFinite(m.before_percent) && Number.isFinite(m.after_percent))
    .map((m) => `${m.channel.replaceAll("_", " ")} ${number(m.before_percent)} → ${number(m.after_percent)} %`).join(", ");
}

function evidencePairs(effect) {
  const { evidence = {}, error_before: before = {}, error_after: after = {}, channels } = effect;
  const rival = evidence.runner_up ? `${words(evidence.runner_up)}, by ${number(evidence.over_runner_up)}` : "none";
  const change = (a, b) => (Number.isFinite(a) && Number.isFinite(b) ? `${number(a)} → ${number(b)} %` : null);
  return [[`log evidence over the ${channels ? "baseline alone" : "model without it"}`, number(evidence.log_evidence)],
    ["ahead of the next best explanation", rival],
    ["further parameters", sizesOf(effect, "rest")],
    ["observation", evidence.detail],
    ["waveform error on held-out windows", change(before.waveform_percent, after.waveform_percent)],
    ["RMS error on held-out windows", change(before.rms_percent, after.rms_percent)],
    ["error of the lines that it moves, on held-out windows", movedLines(effect)],
    ["held-out windows", after.windows?.join(", ")]].filter(([, value]) => value);
}

const momentOf = (decision) => dateTime(Math.floor(decision.received_ns / 1e6));

// "Accept by Anna, 22 Nov 2026, 14:43: seen on the flank", of the latest decision on an effect.
function signedLine(decisions, name) {
  const latest = decisions.filter((d) => d.name === name && d.done).at(-1);
  if (!latest?.by && !latest?.note) return [];
  return [element("p", { className: "signed" }, signedText(`Latest decision: ${latest.decision}`, latest, momentOf(latest)))];
}

function decisionsOf(decisions) {
  if (!decisions.length) return [];
  const rows = [...decisions].reverse().map((d) => [momentOf(d), `${d.decision} ${words(d.name)}${d.done ? "" : " (queued)"}`, d.by ?? "", d.note ?? ""]);
  return [folded("decisions", `Decisions (${decisions.length})`, table(["when", "decision", "by", "note"], rows))];
}

function effectCard(effect, machine, decisions, decide) {
  const verbs = effect.channels ? [] : VERBS[effect.status] ?? VERBS.found; // a baseline leaves no model to decide on
  const where = effect.channels ? ` (${effect.channels.join(", ")})` : "";
  const buttons = verbs.map((verb) => element("button", { type: "button", title: MEANING[verb], onclick: () => decide(effect.name, verb),
    "aria-label": `${verb} ${words(effect.name)}`, dataset: { key: `${verb} ${effect.name}`, group: effect.name } }, verb));
  return element("article", { className: "effect" },
    element("div", { className: "head" }, element("h3", {}, sentence(nameOf(effect)).slice(0, -1) + where),
      element("span", { className: "badge" }, effect.status ?? "found"), element("span", { className: "decide" }, ...buttons)),
    element("p", {}, [sizeOf(effect), sinceOf(effect, machine.trend), growthOf(effect), ...effect.caveats ?? [], ...consequences(effect)].filter(Boolean).join(" ")),
    element("p", { className: "alike" }, alternatives(effect)), ...signedLine(decisions, effect.name),
    folded(`evidence ${effect.name}`, "Evidence", facts(evidencePairs(effect))));
}

// The effects with the most severe first, as the status orders them.
function bySeverity(effects, status) {
  const order = (status.findings ?? []).map((f) => f.subject);
  const place = ({ name }) => (order.findIndex((subject) => `${subject}/`.startsWith(`effect/${name}/`)) + 1) || order.length + 1;
  return [...effects].sort((a, b) => place(a) - place(b));
}

function verdictOf({ unexplained, status, baseline }, found) {
  if (!isAvailable(unexplained)) return [];
  const share = Number.isFinite(unexplained.share_percent) && unexplained.share_percent <= 100 // else the reason says it
    ? `Unexplained: ${number(unexplained.share_percent)} % of the energy above the noise. ` : "";
  const verdict = { explained: isAvailable(baseline) ? "Baseline and changes together explain the vibration."
    : found ? "The model with these effects explains the vibration." : "The model explains the vibration.",
    unknown_effect: "Part of the vibration has a cause that no known effect explains.",
    insufficient_data: "Whether the vibration is explained cannot be said yet." }[unexplained.verdict] ?? "";
  const said = (status.reasons ?? []).some((reason) => unexplained.reason && reason.includes(unexplained.reason)); // in the banner
  const small = unexplained.verdict === "explained" ? " Small, and of no known effect:" : "";
  const why = unexplained.reason && !said && !(small && isAvailable(baseline)) ? `${small} ${sentence(unexplained.reason)}` : "";
  const parts = [element("p", { className: "verdict" }, share + verdict + why)];
  const lines = (unexplained.orders ?? []).slice(0, 6);
  if (unexplained.verdict === "unknown_effect" && lines.length) {
    const keys = ["order", "frequency_hz", "share_percent"];
    parts.push(table(keys.map((k) => `${words(k)}#`), lines.map((o) => keys.map((k) => anything(o[k])))));
  }
  return parts;
}

// The panel and how it is kept up to date: `effectsPanel(machine).draw()`.
export function effectsPanel(machine, signal) {
  const body = element("div");
  const said = element("p", { className: "said decision", role: "status" });
  const signing = form({ label: "Name and note of decisions", fields: signature({ prefix: "decision-", hint: "kept with the next decision" }) });
  const deciders = folded("decision-signature", "Name and note of decisions", signing);
  const root = panel({ title: "Effects other than wear", kind: "effects", id: "effects" }, body, deciders, said);
  let deciding = false;
  let decisions = [];
  let known = null; // the effects with their status, for which the decisions have been read

  async function readDecisions() {
    const found = await get(`${machine.base}/decisions`, { signal });
    if (JSON.stringify(found) === JSON.stringify(decisions)) return;
    decisions = found;
    keepingFocus(drawBody);
  }

  async function decide(name, verb) {
    const what = `${sentence(`${verb} ${words(name)}`).slice(0, -1)}`;
    if (deciding || (verb === "reject" && !confirm(`${what}? The whole history is then re-evaluated without it.`))) return;
    deciding = true;
    root.classList.add("deciding");
    said.textContent = `${what}: in progress …`;
    try {
      const { by, note } = signed(signing);
      const { status } = await send("POST", `${machine.base}/effects/${encodeURIComponent(name)}`, { decision: verb, by, note }, { signal });
      signing.querySelector("[name=note]").value = "";
      said.textContent = `${what}: ${status === 202 ? "queued; applied after the current window" : "done"}.`;
    } catch (error) {
      if (error.name !== "AbortError") said.textContent = `${what}: ${error instanceof Problem && error.status ? error.message
        : "the service does not answer"}`;
    } finally {
      deciding = false;
      root.classList.remove("deciding");
      machine.soon("effect");
      readDecisions().catch(warned);
    }
  }

  function draw() {
    drawBody();
    const { effects, tracing } = machine.state;
    const now = JSON.stringify([isAvailable(effects) ? effects.map((e) => [e.name, e.status]) : [], tracing?.rejected ?? []]);
    if (now !== known) readDecisions().catch(warned);
    known = now;
  }

  function drawBody() {
    const { effects, unexplained, tracing, baseline, wear, calibration } = machine.state;
    root.querySelector("h2").textContent = isAvailable(baseline) ? "Changes since the healthy baseline" : "Effects other than wear";
    const found = isAvailable(effects) ? bySeverity(effects, machine.state.status) : [];
    const rejected = (isAvailable(tracing) && tracing.rejected) || [];
    body.replaceChildren(
      ...found.map((effect) => effectCard(effect, machine, decisions, decide)),
      ...(found.length ? [] : [element("p", { className: "none" }, isAvailable(baseline) ? "No change was found."
        : "No effect other than wear was found.")]),
      ...rejected.map((name) => element("p", { className: "none" }, `${words(name)}: rejected `, element("button", {
        type: "button", title: MEANING.release, onclick: () => decide(name, "release"), "aria-label": `release ${words(name)}`,
        dataset: { key: `release ${name}`, group: name } }, "release"))).flatMap((line, i) => [line, ...signedLine(decisions, rejected[i])]),
      ...verdictOf(machine.state, found.length), ...decisionsOf(decisions));
    deciders.hidden = !rejected.length && !found.some((effect) => !effect.channels);
    // without a model and without a baseline nothing was searched for, so that nothing can be said of it
    const searched = isAvailable(wear) || isAvailable(baseline) || isAvailable(calibration);
    const small = unexplained?.reason && !isAvailable(baseline); // something stands clear though the machine is explained
    const settled = unexplained?.verdict === "explained" && !small || unexplained?.verdict === "insufficient_data"; // the card says it
    root.hidden = !found.length && !rejected.length && (settled || !searched && unexplained?.verdict !== "unknown_effect");
  }

  return { root, draw };
}

