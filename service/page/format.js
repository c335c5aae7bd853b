// Numbers and parts of a report as text.

export const isAvailable = (part) =>
  part !== null && part !== undefined && !(typeof part === "object" && part.status === "not available");

export const reasonOf = (part) =>
  (part && typeof part === "object" && part.reason) || "not reported";

const minus = (text) => text.replace("-", "−");

export function number(value, digits = 3) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  if (size !== 0 && (size < 1e-3 || size >= 1e7)) {
    const [mantissa, power] = value.toExponential(digits - 1).split("e");
    return `${mantissa}·10${superscript(Number(power))}`;
  }
  return minus(new Intl.NumberFormat("en", { maximumSignificantDigits: Math.max(digits, Math.ceil(Math.log10(size + 1))) })
    .format(value));
}

// With all its digits, for columns of figures.
export function fixed(value, digits = 3) {
  if (!Number.isFinite(value)) return "–";
  if (value === 0 || Math.abs(value) < 1e-3 || Math.abs(value) >= 1e7) return number(value, digits);
  const decimals = Math.max(0, digits - 1 - Math.floor(Math.log10(Math.abs(value))));
  return minus(new Intl.NumberFormat("en", { minimumFractionDigits: decimals, maximumFractionDigits: decimals }).format(value));
}

export function range(band, digits = 3) {
  if (!band || !Number.isFinite(band.p05) || !Number.isFinite(band.p95)) return "no band";
  return `${fixed(band.p05, digits)} – ${fixed(band.p95, digits)}`;
}

export function revolutions(value) {
  return value === null || value === undefined ? "–" : new Intl.NumberFormat("en").format(Math.round(value));
}

// A value of a report that no panel knows by name: text, number, {value, std, unit} or a list.
export function anything(value) {
  if (value === null || value === undefined) return "–";
  if (typeof value === "number") return number(value, 4);
  if (typeof value === "boolean") return value ? "yes" : "no";
  if (Array.isArray(value)) {
    if (value.length > 8) return `${value.length} values`;
    return value.length ? value.map(anything).join(", ") : "none";
  }
  if (typeof value === "object") {
    if ("value" in value) {
      const std = Number.isFinite(value.std) ? ` ± ${number(value.std, 2)}` : "";
      return `${anything(value.value)}${std}${value.unit ? ` ${value.unit}` : ""}`;
    }
    if ("median" in value) return `${number(value.median)} (${range(value)})`;
    if (!isAvailable(value)) return `not available: ${reasonOf(value)}`;
    return Object.entries(value).map(([k, v]) => `${words(k)} ${anything(v)}`).join("; ");
  }
  return String(value);
}

// A JSON name as words, with its unit where the name carries one.
const UNITS = [
  ["_m2_per_n", " [m²/N]"], ["_per_n", " [1/N]"], ["_n_per_m", " [N/m]"], ["_percent", " [%]"], ["_hours", " [h]"],
  ["_um", " [µm]"], ["_hz", " [Hz]"], ["_nm", " [N·m]"], ["_deg", " [°]"], ["_ns", " [ns]"],
];

export function words(name) {
  for (const [suffix, unit] of UNITS) {
    if (name.endsWith(suffix)) return spaced(name.slice(0, -suffix.length)) + unit;
  }
  return spaced(name);
}

function spaced(name) {
  return name.replaceAll("_", " ").replace(/\b(rms|rul|gmf)\b/g, (short) => short.toUpperCase());
}

function superscript(power) {
  return String(power).replace("-", "⁻").replace(/\d/g, (d) => "⁰¹²³⁴⁵⁶⁷⁸⁹"[d]);
}

export const signed = (value, digits = 1) => (value > 0 ? "+" : "") + value.toFixed(digits).replace("-", "−");

export const sentence = (text) => {
  const whole = String(text).trim().replace(/^./, (c) => c.toUpperCase());
  return /[.!?]$/.test(whole) ? whole : `${whole}.`;
};

// "Retired by Anna, 22 Nov 2026, 14:43: worn out": what somebody did, as far as who, when and why are known.
export const signedText = (what, { by, note }, at = "") =>
  `${what}${by ? ` by ${by}` : ""}${at ? `, ${at}` : ""}${note ? `: ${note}` : ""}`;

// A span of time in the unit that people use for it.
export function duration(hours) {
  if (!Number.isFinite(hours)) return "–";
  if (hours === 0) return "0 h";
  if (hours < 1) return hours < 1 / 60 ? "less than 1 min" : `${number(hours * 60, 2)} min`;
  if (hours < 72) return `${number(hours, 2)} h`;
  if (hours < 24 * 90) return `${number(hours / 24, 2)} days`;
  return hours < 24 * 730 ? `${number(hours / 24 / 30.44, 2)} months` : `${number(hours / 24 / 365.25, 2)} years`;
}

const DATE = new Intl.DateTimeFormat("en-GB", { dateStyle: "medium", timeStyle: "short" });
const DAY = new Intl.DateTimeFormat("en-GB", { dateStyle: "medium" });

// A time as an instant, from the interface's ISO text (nanoseconds are cut); null where there is none.
export function instant(text) {
  if (!text) return null;
  const time = Date.parse(String(text).replace(/(\.\d{3})\d+/, "$1"));
  return Number.isFinite(time) ? time : null;
}

export const dateTime = (time) => (Number.isFinite(time) ? DATE.format(time) : "–");
export const day = (time) => (Number.isFinite(time) ? DAY.format(time) : "–");

const AHEAD_S = 60; // by which clocks may differ
const STEPS = [[60, "second"], [60, "minute"], [24, "hour"], [7, "day"], [4.345, "week"], [12, "month"],
  [Infinity, "year"]];
const RELATIVE = new Intl.RelativeTimeFormat("en", { numeric: "auto" });

// "5 minutes ago"; nothing of a time to come, which the clock of a recording can show.
export function ago(time, now = Date.now()) {
  if (!Number.isFinite(time)) return "never";
  let value = (time - now) / 1000;
  if (value > AHEAD_S) return "";
  if (Math.abs(value) < 5) return "now";
  for (const [size, unit] of STEPS) {
    if (Math.abs(value) < size) return RELATIVE.format(Math.round(value), unit);
    value /= size;
  }
  return "–";
}

const SMALL = { "m": [1e6, "µm"], "kg·m": [1e6, "g·mm"], "rad": [180 / Math.PI, "°"] };

// A parameter of an effect in the unit that workshops use.
export function figure({ value, unit, std }, name = "") {
  const [factor, shown] = !unit && /(share|loss)$/.test(name) ? [100, "%"] : SMALL[unit] ?? [1, unit ?? ""];
  const spread = Number.isFinite(std) && std > 1e-3 * Math.abs(value) ? ` ± ${number(factor * std, 2)}` : ""; // a tooth is counted
  return `${number(factor * value)}${spread}${shown && shown !== "°" ? " " : ""}${shown}`;
}

// The levels of a status: their words, and how severe they are.
export const LEVELS = ["end_of_life", "alarm", "watch", "no_verdict", "normal"];
const LEVEL_WORDS = { end_of_life: "End of life", alarm: "Alarm", watch: "Watch", no_verdict: "No verdict",
  normal: "Normal" };
export const levelWord = (level) => LEVEL_WORDS[level] ?? words(level ?? "waiting");

export const KIND_WORDS = { model: "rig model", baseline: "healthy baseline", encoders: "two encoders",
  level: "vibration level" };

// The word for the data and its reason, wherever the answer holds them.
export function dataOf(holder) {
  const data = holder?.data;
  if (data && typeof data === "object") return { level: data.level, reason: data.reason ?? "" };
  return data ? { level: data, reason: holder.reason ?? "" } : null;
}
