// The figures that this machine can give, the most important first; what it cannot give has one card with the reasons.

import { element, folded, panel, svg } from "../dom.js";
import { dateTime, day, duration, fixed, instant, isAvailable, number, range, reasonOf, revolutions, sentence, signed,
  words } from "../format.js";

function card(name, value, unit, ...more) {
  const figure = element("p", { className: "value" }, value);
  if (unit) figure.append(" ", element("small", {}, unit));
  return element("section", { className: "card" }, element("h2", { className: "name" }, name), figure,
    ...more.filter(Boolean).map((text) => (text instanceof Node ? text : element("p", { className: "more" }, text))));
}

const tag = (part) => (part?.preliminary ? element("p", { className: "more" },
  element("span", { className: "badge warn" }, "preliminary")) : "");

// A bar from 0 to the limit with the 5–95 % band and the median.
function meter({ median, p05, p95 }, limit) {
  const top = Math.max(limit, median, Number.isFinite(p95) ? Math.min(p95, 1.5 * limit) : 0);
  const at = (v) => 100 * Math.min(v, top) / top;
  const made = svg("svg", { class: "meter", viewBox: "0 0 100 10", preserveAspectRatio: "none", role: "img",
    "aria-label": `${fixed(100 * median / limit)} % of the limit` });
  const bar = (x, width, name) => svg("rect", { x, width: Math.max(width, 0), y: 2, height: 6, class: name });
  made.append(bar(0, 100, "track"), bar(0, at(median), median >= limit ? "full" : "filled"));
  if (Number.isFinite(p05) && Number.isFinite(p95)) made.append(bar(at(p05), at(p95) - at(p05), "spread"));
  made.append(svg("rect", { x: at(limit) - 0.6, width: 1.2, y: 0, height: 10, class: "limit" }));
  return made;
}

function depthCard({ wear }, machine) {
  const depth = isAvailable(wear) ? wear.max_depth_um?.combined : null;
  if (!isAvailable(depth)) return null;
  const { limit } = machine;
  if (!Number.isFinite(depth.median)) {
    const bound = depth.p05 > 0 || depth.p95 == null ? `at least ${fixed(depth.p05)}` : `below ${fixed(depth.p95)}`;
    return card("Largest wear depth", bound, "µm", wear.reason && sentence(wear.reason), tag(wear));
  }
  const share = limit ? `${number(100 * depth.median / limit, 2)} % of the limit of ${number(limit)} µm` : "";
  const flanks = ["pinion", "gear"].filter((flank) => isAvailable(wear.max_depth_um[flank]))
    .map((flank) => `${flank} ${fixed(wear.max_depth_um[flank].median)}`).join(", ");
  const checked = machine.inspections.at(-1);
  const inspected = checked && `last inspection: ${number(checked.inspection.max_depth_um)} ± ${
    number(checked.inspection.std_um, 2)} µm at ${revolutions(checked.inspection.revolutions)} revolutions`;
  return card("Largest wear depth", fixed(depth.median), "µm", limit ? meter(depth, limit) : "", share,
    `5–95 %: ${range(depth)} µm${flanks ? `; ${flanks} µm` : ""}`, wear.relation?.note && sentence(wear.relation.note),
    inspected, tag(wear));
}

// Life counts wear alone: where other damage is found, the card must not calm.
const aloneOf = ({ of_wear_alone: alone }) => (alone
  ? element("p", { className: "more" }, element("span", { className: "badge bad" }, "of wear alone"), " the damage found is not counted in") : "");

function lifeCard({ rul }) {
  if (!isAvailable(rul)) return null;
  const alone = aloneOf(rul);
  const { hours, reached, reason, speed_hz: speed, torque_nm: torque } = rul;
  const date = isAvailable(rul.date) ? rul.date : null;
  if (reached) {
    const more = hours?.p95 > 0 ? `5–95 %: 0 – ${duration(hours.p95)}` : "";
    return card("Remaining life", "none", "", "The limit is reached.", more, tag(rul));
  }
  if (!isAvailable(hours)) return null;
  const point = `at ${number(speed)} Hz and ${number(torque)} N·m`;
  if (!Number.isFinite(hours.median)) {
    return card("Remaining life", `at least ${duration(hours.p05)}`, "", reason && sentence(reason), alone, tag(rul));
  }
  return card("Remaining life", duration(hours.median), "of running",
    `5–95 %: ${duration(hours.p05)} – ${Number.isFinite(hours.p95) ? duration(hours.p95) : "no upper bound"}, ${point}`,
    date?.median ? `limit reached about ${moment(date.median, date)}${date.p05 && date.p95
      ? ` (${moment(date.p05, date)} – ${moment(date.p95, date)})` : ""}, at ${number(date.hours_per_day, 2)} h a day (${date.source})` : "",
    rul.revolutions?.median ? `${number(Number(rul.revolutions.median.toPrecision(3)))} revolutions` : "", alone, tag(rul));
}

// A day; with the time where the limit is less than three days away.
function moment(text, { since, median }) {
  const near = instant(median) - instant(since) < 3 * 86_400_000;
  return near ? dateTime(instant(text)) : day(instant(text));
}

function levelCard(last) {
  if (!Number.isFinite(last?.rms_measured)) return null;
  return card("Vibration RMS", fixed(last.rms_measured), "m/s²",
    Number.isFinite(last.error_percent) ? `the model predicted ${fixed(last.rms_predicted)} m/s² (${signed(last.error_percent)} %)` : "",
    `${number(last.speed_hz)} Hz${Number.isFinite(last.torque_nm) ? `, ${number(last.torque_nm)} N·m` : ""}; ${
      dateTime(instant(last.start_time))}`);
}

function indicatorCard(last) {
  const [sensor, own] = Object.entries(last?.indicators ?? {})[0] ?? [];
  if (!own || !Number.isFinite(own.kurtosis)) return null;
  const gears = Object.entries(own.gears ?? {}).filter(([, found]) => Number.isFinite(found.fm4))
    .map(([gear, found]) => `FM4 of the ${gear} ${number(found.fm4)}`);
  return card("Kurtosis", fixed(own.kurtosis), "", `of ${sensor}; 3 for random vibration, higher for shocks`, gears.join(", "));
}

const EXPLAINED = { explained: "the model explains the vibration", unknown_effect: "part of the vibration has an unknown cause",
  insufficient_data: "whether the vibration is explained cannot be said yet" };

// What is new of the mesh's modulation counts as a change like any other.
const newModulation = (modulation) => [...new Set((isAvailable(modulation) ? modulation : []).filter((m) => m.new)
  .map((m) => `modulation ${m.per_turn} × per turn of the ${m.shaft}`))].map((name) => ({ name, label: name }));

// What the windows would have shown, in the words of the answer.
function couldBeFound(detectable) {
  const [heading, ...sizes] = detectable?.said ?? [];
  return heading ? folded("could-be-found", heading, element("ul", {}, ...sizes.map((size) => element("li", {}, size)))) : "";
}

function effectsCard({ effects, modulation, unexplained, baseline, wear, calibration, detectable }) {
  const found = [...(isAvailable(effects) ? effects : []), ...newModulation(modulation)];
  const learned = isAvailable(baseline);
  const judged = isAvailable(unexplained) ? unexplained.verdict : null;
  const verdict = judged === "explained" && learned ? "baseline and changes together explain the vibration" : EXPLAINED[judged];
  const searched = learned || isAvailable(wear) || isAvailable(calibration) || judged === "unknown_effect";
  if (!found.length && !searched) return null;
  const names = new Map();
  for (const e of found) names.set(e.label ?? words(e.name), (names.get(e.label ?? words(e.name)) ?? 0) + 1);
  return card(learned ? "Changes since the healthy baseline" : "Effects other than wear",
    found.length ? String(found.length) : "none found", "", [...names].map(([name, count]) => (count > 1 ? `${name} (${count} channels)` : name)).join(", "), verdict,
    ...new Set(found.flatMap((e) => e.caveats ?? [])),
    judged && Number.isFinite(unexplained.share_percent) && unexplained.share_percent <= 100 ? `${number(unexplained.share_percent)} % of the energy above the noise is unexplained` : "",
    couldBeFound(detectable));
}

function pairCards({ pair }) {
  if (!isAvailable(pair)) return [];
  const { ratio, stated, teeth_that_fit: fit, missed_counts: missed, run_out: terms } = pair;
  const largest = [...terms].sort((a, b) => b.amplitude_urad - a.amplitude_urad)[0];
  const size = largest && (Number.isFinite(largest.amplitude_um) ? `${fixed(largest.amplitude_um)}` : `${fixed(largest.amplitude_urad)}`);
  return [
    card("Gear ratio", number(ratio.value, 5), "", `± ${number(ratio.std, 2)}`,
      stated ? `the ratio from ${stated.source} is ${stated.contradicted ? "contradicted" : "confirmed"}` : "",
      fit.length ? `tooth counts that fit: ${fit.slice(0, 4).join(", ")}` : ""),
    ...(largest ? [card("Largest run-out", size, Number.isFinite(largest.amplitude_um) ? "µm" : "µrad",
      `${largest.multiple}× a turn of the ${largest.shaft}`, largest.indistinguishable_from?.length
        ? `indistinguishable from ${largest.indistinguishable_from.join(", ")}` : "")] : []),
    card("Missed counts", missed.length ? String(missed.length) : "none", "", "in the latest window"),
  ];
}

function baselineCard({ baseline }) {
  if (!isAvailable(baseline)) return null;
  const { recordings, sufficiency, days, loads } = baseline;
  const many = recordings.length;
  const on = days ? `recorded on ${days} day${days === 1 ? "" : "s"}, at ${loads} operating condition${loads === 1 ? "" : "s"}` : "";
  const judged = (sufficiency?.not_judged ?? []).map((n) => sentence(`${n.what}: ${n.reason}`));
  const load = sufficiency?.load_percent;
  return card("Healthy baseline", `${many} window${many === 1 ? "" : "s"}`, "", on,
    sufficiency?.recordings_needed > sufficiency?.recordings ? `at least ${sufficiency.recordings_needed} are needed` : "",
    load ? `load ${number(load[0])} to ${number(load[1])} %` : "", ...judged);
}

// Slow channels (temperatures) as the latest window has them; the record groups them by kind, then by name.
function slowCards(record) {
  const groups = Object.entries(record ?? {}).filter(([, named]) => named && typeof named === "object"
    && Object.values(named).some((value) => value && typeof value === "object" && "age_s" in value));
  return groups.flatMap(([kind, named]) => Object.entries(named).map(([name, slow]) =>
    card(`${words(kind).replace(/s$/, "").replace(/^./, (c) => c.toUpperCase())} ${name}`, fixed(slow.value), slow.unit,
      slow.values ? `mean of ${slow.values} values` : `last known value, ${number(slow.age_s)} s old`)));
}

export function cards(machine, kind) {
  const { state, windows } = machine;
  const last = windows.findLast((w) => w.kind !== "calibration" && w.quality !== "refused") ?? windows.at(-1);
  const level = [levelCard(last), kind === "model" ? null : indicatorCard(last)];
  const order = {
    model: [depthCard(state, machine), lifeCard(state), effectsCard(state), ...level],
    baseline: [effectsCard(state), baselineCard(state), ...level, depthCard(state, machine), ...pairCards(state)],
    encoders: [...pairCards(state), ...level],
    level: [depthCard(state, machine), lifeCard(state), ...level, effectsCard(state), ...pairCards(state)],
  };
  return element("div", { className: "cards" }, ...order[kind].filter(Boolean), ...slowCards(last));
}

const PARTS = { wear: "wear depth and profile", rul: "remaining life", residual: "residual", unexplained: "unexplained share",
  calibration: "calibration", tracing: "search for other effects", pair: "gear pair from its encoders" };

function missingParts(state) {
  const named = new Map();
  for (const [key, name] of Object.entries(PARTS)) {
    const part = state[key];
    if (part === undefined || part === null || isAvailable(part)) continue;
    const reason = reasonOf(part).replace(/^[\w ]+ (is|are) not available: /, "");
    named.set(reason, [...(named.get(reason) ?? []), name]);
  }
  return named;
}

export const missingReasons = (state) => (state.windows_total === 0 ? [] : [...missingParts(state).keys()]);

// One card for all that this machine cannot tell: every reason once, with the parts that it concerns.
export function missing(state) {
  const named = missingParts(state);
  if (!named.size) return "";
  return panel({ title: "What this machine cannot tell yet", kind: "missing" },
    element("ul", {}, ...[...named].map(([reason, names]) =>
      element("li", {}, element("strong", {}, `${sentence(names.join(", ")).slice(0, -1)}: `), sentence(reason)))));
}
